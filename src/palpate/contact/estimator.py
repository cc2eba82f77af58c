"""The chain from a recording to contacts: sensor, payload, mounting, method."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int8

from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.locate import Locator
from palpate.errors import InputError
from palpate.sensors.force_torque import ForceTorque, Payload
from palpate.sensors.recording import ACCELERATION, ORIENTATION, Recording
from palpate.spatial.pose import Pose, rotation_from_quaternion
from palpate.spatial.uncertain import inverse_pose_covariance, pose_noise_on_wrench

__all__ = ["Estimator"]


class Estimator:
    """Pure and streaming: `run` takes a block of a recording and carries hysteresis and last contact to the next.

    Args:
        locator: on the surface, in the surface's frame.
        sensor: noise, range and frame of the wrenches.
        payload: what hangs on the sensor; None leaves the wrenches as they are.
        mount: T_sensor_surface.
        mount_covariance: (6, 6) of its (rotation vector [rad], translation [m]), perturbed on the left.
    """

    def __init__(
        self,
        locator: Locator,
        sensor: ForceTorque,
        payload: Payload | None = None,
        mount: Pose | None = None,
        mount_covariance: Float[np.ndarray, "6 6"] | None = None,
    ) -> None:
        self.locator, self.sensor, self.payload = locator, sensor, payload
        self.mount = Pose.identity() if mount is None else mount
        self._to_surface = self.mount.inverse()
        self._mount_covariance = (
            None if mount_covariance is None else inverse_pose_covariance(self.mount, mount_covariance)
        )

    def run(self, recording: Recording) -> ContactEstimate:
        """Contacts of a block, one a sample, in the surface's frame.

        Raises:
            InputError: an orientation is needed (payload with weight, wrenches in the base frame) and there is none.
        """
        wrenches, covariances, statuses = self.contact_wrenches(recording)
        return self.locator.run(wrenches, covariances, statuses)

    def contact_wrenches(
        self, recording: Recording
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "*#n 6 6"] | None, Int8[np.ndarray, " n"]]:
        """Compensated wrenches in the surface's frame, their covariances, and statuses known beforehand (else -1)."""
        measured = recording.wrenches()
        invalid = ~np.all(np.isfinite(measured), axis=1)
        measured = np.where(invalid[:, None], np.nan, measured)  # infinity would spoil what it is multiplied with
        rotations = self._rotations(recording)
        statuses = np.full(len(measured), -1, dtype=np.int8)
        if rotations is not None:
            statuses[~np.isfinite(rotations).all(axis=(1, 2))] = Status.NO_POSE
        if self.sensor.frame == "base" and rotations is not None:
            measured = np.einsum("nji,nkj->nki", rotations, measured.reshape(-1, 2, 3)).reshape(-1, 6)
        statuses[self.sensor.saturated(measured)] = Status.SATURATED
        statuses[invalid] = Status.INVALID
        noise, added = self.sensor.noise, None
        if self.payload is not None:
            acceleration = recording.channels.get(ACCELERATION)
            measured, added = self.payload.compensate(measured, rotations, acceleration)
        matrix = self._to_surface.wrench_matrix()
        located = measured @ matrix.T
        if noise is None:
            return located, None, statuses
        covariance = matrix @ (noise if added is None else noise + added) @ matrix.T
        if self._mount_covariance is not None:
            covariance = covariance + pose_noise_on_wrench(located, self._mount_covariance)
        return located, covariance, statuses

    def _rotations(self, recording: Recording) -> Float[np.ndarray, "n 3 3"] | None:
        """Sensor in base, or None where nothing needs it."""
        weighs = self.payload is not None and bool(np.any(self.payload.weight))
        if not weighs and self.sensor.frame == "sensor":
            return None
        quaternions = recording.channels.get(ORIENTATION)
        if quaternions is None:
            reason = "the payload's weight turns with the sensor" if weighs else "the wrenches are in the base frame"
            raise InputError(
                f"the log has no orientation, and {reason}.",
                where=recording.source,
                mend="Add columns qx, qy, qz, qw (sensor in base), or name them in [orientation].",
            )
        length = np.linalg.norm(quaternions, axis=1, keepdims=True)
        usable = np.isfinite(length) & (length > 0.5) & (length < 2.0)
        return rotation_from_quaternion(np.where(usable, quaternions, np.nan))
