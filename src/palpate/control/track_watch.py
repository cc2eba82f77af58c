"""Watch whether a robot moves as its tracks are commanded: find a stuck track, or an obstacle that is not felt."""

from __future__ import annotations

from math import cos, sin

from palpate.control.drive import DifferentialDrive
from palpate.control.navigation import heading_error

WINDOW = 1.5  # s
LEAST = 0.015  # m/s root mean square that a track must have been commanded
FOLLOWS = 0.3  # gain below which a track does not follow
TIMES = 3  # windows in a row before a track is called stuck


class TrackWatch:
    """A watch that compares poses with commanded track speeds, over windows of 1.5 s in which nothing is felt.

    The gain by which each track follows is a least-squares fit of its motion to the command, frame by frame:
    sum(made commanded) / sum(commanded^2). A track is stuck after three windows with a gain below 0.3.

    Args:
        drive: the robot's drive.

    Attributes:
        held: True if neither track followed in the window that has just ended.
    """

    def __init__(self, drive: DifferentialDrive) -> None:
        self.drive = drive
        self.reset()

    def reset(self) -> None:
        """Forget all poses and windows."""
        self._last: tuple[float, float, float, float] | None = None
        self._stuck = [0, 0]
        self._begin(0.0)

    def _begin(self, time: float) -> None:
        """Begin a new window."""
        self.held, self._since, self._frames = False, time, 0
        self._both, self._asked = [0.0, 0.0], [0.0, 0.0]

    def update(
        self, time: float, pose: tuple[float, float, float], wheels: tuple[float, float], *, touched: bool
    ) -> str | None:
        """Add a pose; return the track that does not follow, "left" or "right", or None.

        Args:
            time: [s].
            pose: x, y [m], heading [rad] now.
            wheels: track speeds [m/s] commanded since the last call.
            touched: True if a touch is felt: the window begins anew.

        Raises:
            ValueError: a heading is infinite.
        """
        last, self._last = self._last, (time, *pose)
        self.held = False
        if touched or last is None or not 0.0 < time - last[0] < 0.5:
            self._begin(time)
        else:
            step = time - last[0]
            for side, made in enumerate(self._made(last, pose)):
                self._both[side] += made * wheels[side] * step
                self._asked[side] += (wheels[side] * step) ** 2
            self._frames += 1
            if time - self._since >= WINDOW:
                held = self._judge(time - self._since)
                self._begin(time)
                self.held = held
        return next((name for name, k in zip(("left", "right"), self._stuck, strict=True) if k >= TIMES), None)

    def _made(self, last: tuple[float, float, float, float], pose: tuple[float, float, float]) -> tuple[float, float]:
        """Return the distances [m] that the left and the right track covered."""
        _, x, y, heading = last
        turned = heading_error(pose[2], heading)
        middle = heading + 0.5 * turned
        forward = (pose[0] - x) * cos(middle) + (pose[1] - y) * sin(middle)
        return forward - 0.5 * self.drive.track * turned, forward + 0.5 * self.drive.track * turned

    def _judge(self, seconds: float) -> bool:
        """Return whether neither track followed; count one that alone did not."""
        enough = (LEAST * seconds) ** 2 / self._frames  # sum of squares at that speed, frame by frame
        gains = [both / asked if asked > enough else None for both, asked in zip(self._both, self._asked, strict=True)]
        slow = [gain is not None and gain < FOLLOWS for gain in gains]
        for side in (0, 1):
            other = gains[1 - side]
            if slow[side] and other is not None and other > 2.0 * FOLLOWS:
                self._stuck[side] += 1
            elif gains[side] is not None:
                self._stuck[side] = 0
        return all(slow)
