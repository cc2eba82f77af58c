"""From readings to contact wrenches: sensor, payload, mounting and what is unsure about each, prepared as numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int8

from palpate.errors import InputError
from palpate.sensors.force_torque import ForceTorque, Payload
from palpate.sensors.pose_track import sound_quaternions
from palpate.sensors.recording import ACCELERATION, FORCE, ORIENTATION, TORQUE, UNSTEADY, Recording
from palpate.spatial.pose import Pose, rotation_from_quaternion, skew
from palpate.spatial.uncertain import inverse_pose_covariance

__all__ = ["Chain", "Readings"]

NOTHING = Payload(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3))


class Readings(NamedTuple):
    """Samples as the compiled loops take them: contiguous and writable, n rows, or one that stands for all.

    Attributes:
        time: (n,) [s]; wrench: (n, 6) as measured.
        rotation: (n or 1, 3, 3) sensor in base; acceleration: (n or 1, 3); unsteady: (n or 1, 1).
    """

    time: np.ndarray
    wrench: np.ndarray
    rotation: np.ndarray
    acceleration: np.ndarray
    unsteady: np.ndarray

    def picked(self, rows: Bool[np.ndarray, " n"]) -> Readings:
        """Those of a mask."""
        count = len(self.time)
        return Readings(*(part[rows] if len(part) == count else part for part in self))

    def mean(self) -> Readings:
        """Their means, as one sample."""
        return Readings(*(part.mean(axis=0, keepdims=True) for part in self))


class Chain:
    """What does not depend on the sample; each step is the same to the last bit however samples are cut into blocks.

    Args:
        sensor, payload, mount, mount_covariance: as of `Estimator`.
    """

    def __init__(
        self,
        sensor: ForceTorque,
        payload: Payload | None,
        mount: Pose,
        mount_covariance: Float[np.ndarray, "6 6"] | None,
    ) -> None:
        from palpate.contact import _chain  # compiled: loaded when first needed

        self._compensate, self._propagate = _chain.compensate, _chain.propagate
        load = NOTHING if payload is None else payload
        self.weighs = bool(load.weight.any() or load.covariance[:3, :3].any())
        self.turned = sensor.frame == "base"
        self.noise = sensor.noise
        self._limits = np.full(6, np.inf) if sensor.limits is None else sensor.limits.copy()
        slope = load.gravity / load.magnitude**2 if load.weight.any() else np.zeros(3)
        self._load = np.concatenate([load.weight, load.center_of_mass, slope, [load.mass]])
        self._bias = np.concatenate([load.force_bias, load.torque_bias])
        self._doubts = _doubts(load.covariance)
        self._mounting = _doubts(
            np.zeros((6, 6)) if mount_covariance is None else inverse_pose_covariance(mount, mount_covariance)
        )
        self.matrix = mount.inverse().wrench_matrix()
        push = self.matrix[:, :3] + self.matrix[:, 3:] @ skew(load.center_of_mass)  # of a force at the payload's centre
        self._constant = np.zeros((3, 6, 6))
        if self.noise is not None:
            self._constant[0] = self.matrix @ self.noise @ self.matrix.T
            self._constant[2] = load.mass**2 * push @ push.T
        self.untare()

    def untare(self) -> None:
        """Take off the payload's biases, and nothing else."""
        self._zero, self._unsure, self._mean = self._bias.copy(), self._doubts, np.zeros((4, 3))
        self._constant[1] = 0.0

    def tare(self, offset: Float[np.ndarray, "6"], middle: Readings, samples: int) -> None:
        """Take off from now on what was read, on average, in some samples.

        Their error is in it too: of the payload's, only the difference to what it was there is left, so biases go.

        Args:
            offset: (6,) mean of the compensated wrenches, without a tare.
            middle: the mean of the readings they came from.
            samples: how many.
        """
        rotation, acceleration = middle.rotation[0], middle.acceleration[0]
        weight, slope, mass = self._load[:3], self._load[6:9], self._load[9]
        turn, hanging = rotation.T - np.outer(acceleration, slope), rotation.T @ weight - mass * acceleration
        self._mean = np.concatenate([turn, hanging[None]])
        self._zero = self._bias + offset
        self._unsure = self._doubts.copy()
        self._unsure[:, 3:6] = self._unsure[:, 9:] = 0.0
        self._constant[1] = self._constant[0] / samples

    def readings(self, recording: Recording) -> Readings:
        """The channels that are needed.

        Raises:
            InputError: an orientation is needed and there is none.
        """
        channels = recording.channels
        acceleration = channels.get(ACCELERATION) if self.weighs else None
        unsteady = channels.get(UNSTEADY) if self.weighs else None
        return Readings(
            recording.time.copy(),
            np.concatenate([channels[FORCE], channels[TORQUE]], axis=1),
            self._rotations(recording),
            np.zeros((1, 3)) if acceleration is None else acceleration.copy(),
            np.zeros((1, 1)) if unsteady is None else unsteady.copy(),
        )

    def compensated(
        self, readings: Readings, *, tared: bool = True
    ) -> tuple[Float[np.ndarray, "n 6"], Int8[np.ndarray, " n"]]:
        """The contacts' wrenches in the sensor's frame, and statuses known beforehand (else -1)."""
        wrenches, statuses = np.empty_like(readings.wrench), np.empty(len(readings.wrench), np.int8)
        self._compensate(
            readings.wrench,
            readings.rotation,
            readings.acceleration,
            self._limits,
            self._load,
            self._zero if tared else self._bias,
            self.turned,
            wrenches,
            statuses,
        )
        return wrenches, statuses

    def in_surface(
        self, wrenches: Float[np.ndarray, "n 6"], readings: Readings, share: Float[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None]:
        """Compensated wrenches in the surface's frame, and their covariances where the sensor's noise is known.

        Args:
            wrenches: (n, 6) in the sensor's frame, filtered or not.
            readings: they came from.
            share: (n,) or (1,) of the variance of the noise that is left in them.
        """
        located, covariances = np.empty_like(wrenches), np.empty((len(wrenches), 6, 6))
        self._propagate(
            wrenches,
            readings.rotation,
            readings.acceleration,
            readings.unsteady,
            share,
            self._load,
            self._mean,
            self._unsure,
            self._mounting,
            self.matrix,
            self._constant,
            located,
            covariances,
        )
        return located, None if self.noise is None else covariances

    @property
    def needs_orientation(self) -> str:
        """Why, or nothing."""
        if self.weighs:
            return "the payload's weight turns with the sensor"
        return "the wrenches are in the base frame" if self.turned else ""

    def _rotations(self, recording: Recording) -> Float[np.ndarray, "_ 3 3"]:
        """Sensor in base, NaN where the quaternion is none; the identity where nothing needs it."""
        if not self.needs_orientation:
            return np.eye(3)[None]
        quaternions = recording.channels.get(ORIENTATION)
        if quaternions is None:
            raise InputError(
                f"the log has no orientation, and {self.needs_orientation}.",
                where=recording.source,
                mend="Add columns qx, qy, qz, qw (sensor in base), or name them in [orientation].",
            )
        return rotation_from_quaternion(np.where(sound_quaternions(quaternions)[:, None], quaternions, np.nan))


def _doubts(covariance: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "r n"]:
    """Vectors whose squares sum to a covariance, as many as its rank; in units in which its diagonal is 1."""
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > 1e-14
    return np.ascontiguousarray((vectors[:, kept] * np.sqrt(values[kept])).T * scale)
