"""Estimates in another frame than the surface's."""

from __future__ import annotations

import numpy as np

from palpate.contact.estimate import ContactEstimate
from palpate.spatial.pose import Pose

__all__ = ["in_frame"]


def in_frame(estimate: ContactEstimate, pose: Pose) -> ContactEstimate:
    """The same contacts with points, normals, forces and covariances in another frame.

    The uncertainty of `pose` itself is not added.

    Args:
        estimate: (*batch) in the source frame.
        pose: T_target_source, one or a batch.
    """
    turn = pose.rotation
    return ContactEstimate(
        point=pose.apply(estimate.point),
        normal=pose.rotate(estimate.normal),
        force=pose.rotate(estimate.force),
        torque=estimate.torque.copy(),
        covariance=turn @ estimate.covariance @ np.swapaxes(turn, -1, -2),
        residual=estimate.residual.copy(),
        candidates=estimate.candidates.copy(),
        status=estimate.status.copy(),
    )
