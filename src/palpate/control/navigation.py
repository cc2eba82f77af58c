"""Interface of navigators and their common parts: touches, headings, goals."""

from __future__ import annotations

import math
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.contact import Contacts, Status
from palpate.errors import InputError
from palpate.spatial._arrays import shaped

_SILENT = (Status.SATURATED, Status.INVALID, Status.NO_POSE)  # nothing is known of what touches


@runtime_checkable
class Navigator(Protocol):
    """Interface of a navigator: from touches and a pose to speeds of the tracks.

    Attributes:
        state: present action, such as "move to goal".
        why: reason for it, or the event that it waits for, as a sentence.
        arrived: True once the goal was reached, until `reset`.
    """

    state: str
    why: str
    arrived: bool

    def update(
        self, time: float, touches: Float[np.ndarray, "k 2"] | None, pose: Float[np.ndarray, "3"]
    ) -> tuple[float, float]:
        """Return (left, right), the track speeds [m/s] from now on.

        Args:
            time: [s] on one monotonic clock, the caller's.
            touches: angle [rad] in the robot's frame, 0 ahead, counter-clockwise, and force [N] that presses inward
                there, one row each; None: the skin has no valid reading (`planar_touches`).
            pose: x [m], y [m] and heading [rad] of the robot in the frame of its goal.
        """
        ...

    def reset(self) -> None:
        """Forget all touches, and set `arrived` to False."""


def planar_touches(contacts: Contacts) -> Float[np.ndarray, "k 2"] | None:
    """Return the touches of one frame as angles and forces for a `Navigator`, from any sensor's contacts.

    Only the normal force counts, in the plane x-y of the contacts' frame; without a normal, the complete force. Rows
    whose force is missing or does not press are left out; OFF_SURFACE and IMPLAUSIBLE rows are touches.

    Args:
        contacts: the rows of one frame, in the robot's frame.

    Returns:
        (k, 2) angle [rad] of each touch, opposite to the direction in which it presses, and force [N]; None if a row's
        status is INVALID, SATURATED or NO_POSE.
    """
    status = contacts.status
    if len(status) == 0 or np.isin(status, _SILENT).any():
        return None if len(status) else np.empty((0, 2))
    force, normal = contacts.force, contacts.normal
    along = np.einsum("ij,ij->i", force, normal)
    pressing = np.where(np.isfinite(along)[:, None], along[:, None] * normal, force)[:, :2]
    there = np.isfinite(pressing).all(axis=1) & ~(along >= 0.0) & (status != Status.NO_CONTACT)
    x, y = -pressing[there].T
    size = np.hypot(x, y)
    return np.stack([np.arctan2(y, x), size], axis=1)[size > 0.0]


def heading_error(wanted: float, heading: float) -> float:
    """Return the counter-clockwise angle from `heading` to `wanted` [rad], in [-pi, pi].

    Raises:
        ValueError: one of them is infinite.
    """
    return math.remainder(wanted - heading, math.tau)


def require_goal(goal: ArrayLike) -> tuple[float, float]:
    """Return the goal as (x, y) [m].

    Raises:
        InputError: the goal is not two finite numbers.
    """
    numbers = shaped(goal, (...,), "goal")
    if numbers.shape != (2,) or not np.isfinite(numbers).all():
        raise InputError(f"the goal must be two finite numbers, x and y [m], not {numbers.tolist()}.", where="goal")
    return float(numbers[0]), float(numbers[1])
