"""Find the form of a log's quaternions from the weight of a payload, which the force shows as the sensor turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.files.logs.layout import ORIENTATION_COLUMNS
from palpate.files.logs.orientation import QUATERNION
from palpate.sensors.force_torque._payload_mistakes import BASE, compose, corrected
from palpate.sensors.force_torque._payload_search import weight_misfit
from palpate.sensors.force_torque.poses import average_poses
from palpate.setup.makers import NamedPose
from palpate.signals.recording import ORIENTATION, Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion

__all__ = ["orientation_form"]

INVERSE, W_FIRST = "inverse rotations", "w first"
UNIT = 0.01  # by which a quaternion's length may be off
SURE = 3.0  # times that every other form must fit worse


@takes_arrays
def orientation_form(
    wrenches: Float[np.ndarray, "n 6"], quaternions: Float[np.ndarray, "n 4"], *, based: bool = False
) -> tuple[str, bool, float] | None:
    """Return form, inverse, and how many times worse all others fit; None if the log does not tell.

    A payload of unknown weight w acts with F = R^T w + f0 on a sensor of orientation R. Each form gives another R, and
    that is right with which a linear fit leaves the least of F; poses that are touched are left out.

    Args:
        wrenches: (n, 6) as recorded, with the payload; rows with NaN are left out.
        quaternions: (n, 4) as recorded.
        based: whether the wrenches are written in the base frame.

    Returns:
        `form` and `inverse` of a rig's [orientation], and the factor.

    Raises:
        InputError: arrays of other shapes.
    """
    known = np.isfinite(wrenches).all(axis=1) & np.isfinite(quaternions).all(axis=1)
    if not known.any():
        return None
    rotations = rotation_from_quaternion(quaternions[known])
    means, poses, _ = average_poses(wrenches[known], rotations)
    misfits: dict[tuple[str, bool], float] = {}
    for form, order in ((QUATERNION, ""), ("quaternion_wxyz", W_FIRST)):
        for inverse in (False, True):
            parts = [order, INVERSE * inverse, BASE * based]
            misfit = weight_misfit(*corrected(means, poses, compose(*filter(None, parts))))
            if misfit is None:
                return None
            misfits[form, inverse] = misfit
    (form, inverse), *others = sorted(misfits, key=misfits.__getitem__)
    ratio = misfits[others[0]] / misfits[form, inverse]
    return (form, inverse, ratio) if ratio > SURE else None


def confirmed_pose(pose: NamedPose, recording: Recording, *, based: bool) -> NamedPose | None:
    """Return a pose with the form of its quaternions that the weight of a payload shows, or as it is.

    None, where columns that do not name their order hold no quaternions.

    Args:
        pose: columns of a quaternion.
        recording: of the log, with the quaternions as they are recorded.
        based: whether the wrenches are written in the base frame.
    """
    quaternions = recording.channels[ORIENTATION]
    lengths = np.linalg.norm(quaternions[np.isfinite(quaternions).all(axis=1)], axis=1)
    if not pose.ordered and len(lengths) and not np.mean(np.abs(lengths - 1.0) < UNIT) > 0.5:
        return None
    found = orientation_form(recording.wrenches(), quaternions, based=based)
    if found is None:
        return pose
    form, inverse, ratio = found
    order = f"{'w, x, y, z' if form.endswith('wxyz') else 'x, y, z, w'}{' of the base in the sensor' * inverse}"
    remark = (
        f"{pose.orientation[0]!r} ... is the sensor's orientation, as {order}: the weight in the force fits it "
        f"{min(ratio, 1000.0):.0f} times better than other orders"
    )
    usual = pose.orientation == ORIENTATION_COLUMNS and (form, inverse) == (QUATERNION, False)
    return replace(pose, form=form, inverse=inverse, proven=True, remark="" if usual else remark)
