"""Steer a robot on tracks by a PI controller of its heading, and measure its velocity from poses."""

from __future__ import annotations

import math
from collections import deque

from palpate.control.drive import DifferentialDrive

PROPORTIONAL, INTEGRAL = 3.0, 0.5  # 1/s, 1/s^2: k_p, k_i
SMALL = 0.35  # rad up to which the integral counts; it is reset beyond
_PAUSE = 0.2  # s between two updates beyond which the integral does not count the time


class Steering:
    """A PI controller of the heading: turn = k_p e + k_i integral of e, through the drive.

    The forward speed is scaled by the cosine of the error; beyond 90 deg the robot turns on the spot. The
    integral counts only while the error is small, and is bounded, so that long turns on the spot do not wind it up.

    Args:
        drive: the robot's drive.
    """

    def __init__(self, drive: DifferentialDrive) -> None:
        self.drive = drive
        self.reset()

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
        if abs(error) > SMALL:
            self._sum = 0.0
        elif 0.0 < step < _PAUSE:
            self._sum = max(-SMALL, min(SMALL, self._sum + error * step))
        self._time = time
        turn = PROPORTIONAL * error + INTEGRAL * self._sum
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

        Both are NaN before half of the window is known. A time that does not grow, or a pose that is not finite, adds
        nothing.
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
