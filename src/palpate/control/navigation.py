"""What every navigator is given and gives, and what navigators share: touches, headings, steering, measured speed."""

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
    """Touches and a pose in, speeds of the tracks out.

    Attributes:
        state: what it does now, such as "move to goal".
        why: a sentence: what led to the state, or what it waits for.
        arrived: the goal was reached; it stays so until `reset`.
    """

    state: str
    why: str
    arrived: bool

    def update(
        self, time: float, touches: Float[np.ndarray, "k 2"] | None, pose: Float[np.ndarray, "3"]
    ) -> tuple[float, float]:
        """What the tracks are to do from now on.

        Args:
            time: [s] on one monotonic clock, the caller's.
            touches: angle [rad] in the robot's frame, 0 ahead, counter-clockwise, and force [N] that presses inward
                there, one row each; None: the skin says nothing (`planar_touches`).
            pose: x [m], y [m] and heading [rad] of the robot in the frame of its goal.

        Returns:
            Speeds of the left and the right track [m/s].
        """
        ...

    def reset(self) -> None:
        """Anew: nothing touched yet, the goal not reached."""
        ...


def planar_touches(contacts: Contacts) -> Float[np.ndarray, "k 2"] | None:
    """The touches of one frame as navigators take them, of any sensor's contacts.

    What counts is the part of the force that presses, along the normal, in the plane x-y of the contacts' frame:
    friction says nothing of where an obstacle is. Where a row has no normal the whole force does. Rows without a force,
    or whose force does not press, are left out; contacts that are doubted (OFF_SURFACE, IMPLAUSIBLE) are touches.

    Args:
        contacts: the rows of one frame, in the robot's frame.

    Returns:
        (k, 2) angle [rad] where it is touched (opposite of the direction in which it is pressed) and force [N]; None
        where the sensor said nothing: a reading that is invalid, saturated or lacks a pose.
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
    """By how much to turn [rad], counter-clockwise, in [-pi, pi]; from `heading` to `wanted`, any turns."""
    return math.remainder(wanted - heading, math.tau)


def require_goal(goal: ArrayLike) -> tuple[float, float]:
    """The goal (x, y) [m].

    Raises:
        InputError: it is not two finite numbers.
    """
    numbers = shaped(goal, (...,), "goal")
    if numbers.shape != (2,) or not np.isfinite(numbers).all():
        raise InputError(f"the goal must be two finite numbers, x and y [m], not {numbers.tolist()}.", where="goal")
    return float(numbers[0]), float(numbers[1])


class Steering:
    """A PI controller of the heading: turn = k_p e + k_i integral of e, through the drive.

    The robot goes forward by the cosine of the error, and turns on the spot where it looks more than 90 deg away. The
    integral counts only while the error is small, and is bounded, so that long turns on the spot do not wind it up.

    Args:
        drive: of the robot.
        proportional: k_p [1/s].
        integral: k_i [1/s^2].
        small: [rad] up to which the integral counts; it is forgotten beyond.
    """

    def __init__(
        self, drive: DifferentialDrive, proportional: float = 3.0, integral: float = 0.5, small: float = 0.35
    ) -> None:
        self.drive, self.proportional, self.integral, self.small = drive, proportional, integral, small
        self._sum, self._time = 0.0, math.nan

    def reset(self) -> None:
        """Forget the integral; for a new direction."""
        self._sum, self._time = 0.0, math.nan

    def wheels(self, time: float, error: float, speed: float) -> tuple[float, float]:
        """Speeds of the tracks [m/s].

        Args:
            time: [s].
            error: [rad] by which to turn (`heading_error`).
            speed: [m/s] wanted straight ahead; 0: only turn.
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
    """The velocity of a robot from noisy poses: the slope of a straight line through those of a window.

    With noise of s [m] in each of n poses at a distance of h [s] the slope's deviation is s/h sqrt(12/(n^3 - n)):
    0.8 mm/s for 0.5 mm, 30 Hz and 0.5 s.

    Args:
        window: [s].
    """

    def __init__(self, window: float = 0.5) -> None:
        self.window = window
        self._seen: deque[tuple[float, float, float]] = deque()

    def reset(self) -> None:
        """Forget all poses."""
        self._seen.clear()

    def velocity(self, time: float, x: float, y: float) -> tuple[float, float]:
        """(2,) [m/s] over the window that ends now; (NaN, NaN) before half of the window is known.

        A time that does not grow is a repetition and adds nothing; poses that are not finite are left out.
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
