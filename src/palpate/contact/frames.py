"""Transform contacts from the surface's frame to that of the sensor or the base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.errors import InputError
from palpate.signals.recording import ORIENTATION, POSITION, Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose


def placed(contacts: Contacts, block: Recording, frame: str, mount: Pose) -> Contacts:
    """Return the `Contacts` of a block in another frame.

    Args:
        contacts: of all samples of `block`, in the surface's frame.
        block: the samples; for "base" with orientation and position of the sensor.
        frame: "surface", "sensor" or "base".
        mount: T_sensor_surface.

    Raises:
        InputError: another frame.
        KeyError: "base", and the block has no orientation or position.
    """
    if frame == "surface" or not len(contacts):
        return contacts
    if frame == "sensor":
        return contacts.in_frame(mount)
    if frame != "base":
        raise InputError(f"the frame {frame!r} is unknown: use surface, sensor or base.")
    rows = contacts.sample - contacts.sample[0]  # every sample of the block has one or more
    poses = block.channels[ORIENTATION][rows], block.channels[POSITION][rows]
    return contacts.with_estimate(in_base(contacts.estimate, *poses, mount))


@takes_arrays
def in_base(
    estimate: ContactEstimate,
    quaternions: Float[np.ndarray, "n 4"],
    positions: Float[np.ndarray, "n 3"],
    mount: Pose,
) -> ContactEstimate:
    """Return n estimates in the base; those with a point but no pose of the sensor become NO_POSE.

    Args:
        estimate: (n,) in the surface's frame.
        quaternions: (n, 4) x, y, z, w of the sensor in the base; NaN where not known.
        positions: (n, 3) [m] of the sensor in the base; NaN where not known.
        mount: T_sensor_surface.

    Raises:
        InputError: other shapes.
    """
    lost = np.isnan(np.concatenate([quaternions, positions], axis=1).sum(axis=1))
    sensor = Pose.from_quaternion(np.where(lost[:, None], [0.0, 0.0, 0.0, 1.0], quaternions), positions)
    moved = estimate.in_frame(sensor @ mount)
    located = np.isfinite(estimate.point).all(axis=1)
    return replace(
        moved,
        point=_blank(moved.point, lost),
        normal=_blank(moved.normal, lost),
        force=_blank(moved.force, lost),
        torque=_blank(moved.torque, lost),
        covariance=_blank(moved.covariance, lost),
        candidates=np.where(lost, 0, moved.candidates),
        status=np.where(lost & located, np.int8(Status.NO_POSE), moved.status),
    )


def _blank(values: Float[np.ndarray, "n ..."], lost: np.ndarray) -> Float[np.ndarray, "n ..."]:
    return np.where(lost.reshape(-1, *[1] * (values.ndim - 1)), np.nan, values)
