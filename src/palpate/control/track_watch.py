"""Whether a robot moves as its tracks are told to: one that is stuck, and what holds the robot unfelt."""

from __future__ import annotations

from collections import deque
from math import cos, hypot, sin

from palpate.control.drive import DifferentialDrive
from palpate.control.navigation import heading_error

__all__ = ["TrackWatch"]


class TrackWatch:
    """Compares poses with what was asked for, over windows in which nothing is felt.

    Args:
        drive: of the robot.
        window: [s].
        least: [m] that a track must have been asked for in a window.
        follows: share of it below which a track does not follow.
        times: windows in a row before a track is called stuck.
    """

    def __init__(
        self,
        drive: DifferentialDrive,
        *,
        window: float = 1.5,
        least: float = 0.025,
        follows: float = 0.3,
        times: int = 3,
    ) -> None:
        self.drive, self.window, self.least, self.follows, self.times = drive, window, least, follows, times
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._past: deque[tuple[float, float, float, float]] = deque()
        self._asked = [0.0, 0.0]
        self._time: float | None = None
        self._stuck = [0, 0]
        self.held = False

    def update(
        self, time: float, pose: tuple[float, float, float], wheels: tuple[float, float], *, touched: bool
    ) -> str | None:
        """Which track does not follow, "left" or "right", if one does not; `held` says that neither does, now.

        Args:
            time: [s].
            pose: x, y [m], heading [rad], now.
            wheels: track speeds [m/s] asked for since the last call.
            touched: something is felt, so that no conclusion can be drawn.
        """
        self.held = False
        if touched or self._time is None or not 0.0 < time - self._time < 0.5:
            self._past.clear()
        else:
            step = time - self._time
            self._asked = [sum_ + step * speed for sum_, speed in zip(self._asked, wheels, strict=True)]
        self._time = time
        if not self._past:
            self._asked = [0.0, 0.0]
        self._past.append((time, *pose))
        if time - self._past[0][0] >= self.window:
            self._judge(pose)
            self._past.clear()
            self._past.append((time, *pose))
            self._asked = [0.0, 0.0]
        sides = [name for name, count in zip(("left", "right"), self._stuck, strict=True) if count >= self.times]
        return sides[0] if sides else None

    def _judge(self, pose: tuple[float, float, float]) -> None:
        """The window that ends now."""
        _, x, y, heading = self._past[0]
        turned = heading_error(pose[2], heading)
        middle = heading + 0.5 * turned
        forward = (pose[0] - x) * cos(middle) + (pose[1] - y) * sin(middle)
        made = forward - 0.5 * self.drive.track * turned, forward + 0.5 * self.drive.track * turned
        shares = [way / asked if abs(asked) > self.least else None for way, asked in zip(made, self._asked, strict=True)]
        slow = [share is not None and share < self.follows for share in shares]
        self.held = all(slow) and hypot(pose[0] - x, pose[1] - y) < self.least
        for side in (0, 1):
            other = shares[1 - side]
            if slow[side] and other is not None and other > 2.0 * self.follows:
                self._stuck[side] += 1
            elif shares[side] is not None:
                self._stuck[side] = 0
