"""Interface of navigators and their common parts: touches, headings, steering, measured speed."""

from __future__ import annotations

import math
from collections import deque
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.contact import Contacts, Status
from palpate.control.drive import DifferentialDrive
from palpate.errors import InputError
from palpate.spatial._arrays import shaped

__all__ = ["Navigator", "Speedometer", "Steering", "heading_error", "planar_touches", "require_goal"]

_SILENT = (Status.SATURATED, Status.INVALID, Status.NO_POSE)  # nothing is known of what touches
_PAUSE = 0.2  # s between two updates beyond which the integral does not count the time


@runtime_checkable
class Navigator(Protocol):
    """Interface of a navigator: from touches and a pose to speeds of the tracks.

    Attributes:
        state: its present action, such as "move to goal".
        why: a sentence: the reason for the state, or the event that it waits for.
        arrived: whether the goal was reached; it stays True until `reset`.
    """

    state: str
    why: str
    arrived: bool

    def update(
        self, time: float, touches: Float[np.ndarray, "k 2"] | None, pose: Float[np.ndarray, "3"]
    ) -> tuple[float, float]:
        """Return the track speeds to drive with from now on.

        Args:
            time: [s] on one monotonic clock, the caller's.
            touches: angle [rad] in the robot's frame, 0 ahead, counter-clockwise, and force [N] that presses inward
                there, one row each; None: the skin has no valid reading (`planar_touches`).
            pose: x [m], y [m] and heading [rad] of the robot in the frame of its goal.

        Returns:
            Speeds of the left and the right track [m/s].
        """
        ...

    def reset(self) -> None:
        """Begin anew: nothing touched yet, the goal not reached."""
        ...


def planar_touches(contacts: Contacts) -> Float[np.ndarray, "k 2"] | None:
    """Return the touches of one frame as angles and forces for a `Navigator`, from any sensor's contacts.

    Only the normal force counts, in the plane x-y of the contacts' frame: friction does not show the place of an
    obstacle. If a row has no normal the complete force counts. Rows without a force, or whose force does not press,
    are left out; contacts that are not answered (OFF_SURFACE, IMPLAUSIBLE) are touches.

    Args:
        contacts: the rows of one frame, in the robot's frame.

    Returns:
        (k, 2) angle [rad] of each touch (opposite to the direction in which it presses) and force [N], (0, 2) without
        touches; None if a row's status is INVALID, SATURATED or NO_POSE, so that the reading is not valid.
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
    """Return the angle [rad] to turn counter-clockwise, in [-pi, pi], from `heading` to `wanted` [rad]."""
    return math.remainder(wanted - heading, math.tau)


def require_goal(goal: ArrayLike) -> tuple[float, float]:
    """Return the goal as a tuple of two floats, x and y [m].

    Raises:
        InputError: the goal is not two finite numbers.
    """
    numbers = shaped(goal, (...,), "goal")
    if numbers.shape != (2,) or not np.isfinite(numbers).all():
        raise InputError(f"the goal must be two finite numbers, x and y [m], not {numbers.tolist()}.", where="goal")
    return float(numbers[0]), float(numbers[1])


class Steering:
    """A PI controller of the heading: turn = k_p e + k_i integral of e, through the drive.

    The forward speed is scaled by the cosine of the error; beyond 90 deg the robot turns on the spot. The
    integral counts only while the error is small, and is bounded, so that long turns on the spot do not wind it up.

    Args:
        drive: the robot's drive.
        proportional: k_p [1/s].
        integral: k_i [1/s^2].
        small: [rad] up to which the integral counts; it is reset beyond.
    """

    def __init__(
        self, drive: DifferentialDrive, proportional: float = 3.0, integral: float = 0.5, small: float = 0.35
    ) -> None:
        self.drive, self.proportional, self.integral, self.small = drive, proportional, integral, small
        self._sum, self._time = 0.0, math.nan

    def reset(self) -> None:
        """Set the integral of the error to 0, for a new direction."""
        self._sum, self._time = 0.0, math.nan

    def wheels(self, time: float, error: float, speed: float) -> tuple[float, float]:
        """Return (left, right), the speeds of the tracks [m/s], and add the error to the integral.

        Args:
            time: [s].
            error: [rad] by which to turn (`heading_error`).
            speed: [m/s] wanted forward speed; 0: only turn.
        """
        step = time - self._time
        if abs(error) > self.small:
            self._sum = 0.0
        elif 0.0 < step < _PAUSE:
            self._sum = max(-self.small, min(self.small, self._sum + error * step))
        self._time = time
        turn = self.proportional * error + self.integral * self._sum
        return self.drive.wheels(speed * max(0.0, math.cos(error)), turn)


class Speedometer:
    """Estimator of a robot's velocity from noisy poses: the slope of a straight line fitted over a window.

    With noise of s [m] in each of n poses, every h [s], the slope's standard deviation is s/h sqrt(12/(n^3 - n)):
    0.8 mm/s for 0.5 mm, 30 Hz and 0.5 s.

    Args:
        window: [s] length of the window.
    """

    def __init__(self, window: float = 0.5) -> None:
        self.window = window
        self._seen: deque[tuple[float, float, float]] = deque()

    def reset(self) -> None:
        """Forget all poses."""
        self._seen.clear()

    def velocity(self, time: float, x: float, y: float) -> tuple[float, float]:
        """Add a position (x, y) [m] at a time [s]; return the mean velocity (x, y) [m/s] over the window that ends now.

        Both are NaN before half of the window is known.

        A time that does not grow, or a pose that is not finite, adds nothing.
        """
        seen = self._seen
        if math.isfinite(x) and math.isfinite(y) and not (seen and time <= seen[-1][0]):
            seen.append((time, x, y))
        while seen and seen[0][0] < time - self.window - 1e-9:
            seen.popleft()
        if len(seen) < 3 or seen[-1][0] - seen[0][0] < 0.5 * self.window - 1e-9:
            return math.nan, math.nan
        begin, x0, y0 = seen[0]
        n, st, stt, sx, sy, stx, sty = len(seen), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for t, px, py in seen:
            t, px, py = t - begin, px - x0, py - y0
            st, stt, sx, sy, stx, sty = st + t, stt + t * t, sx + px, sy + py, stx + t * px, sty + t * py
        spread = n * stt - st * st
        return (n * stx - st * sx) / spread, (n * sty - st * sy) / spread
