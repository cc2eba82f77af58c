"""Watch whether a robot makes progress: nearer to its goal, or to new places."""

from __future__ import annotations

from collections import deque
from math import inf

from palpate.errors import InputError

NEARER = 0.05  # m by which the robot must come nearer
PLACE = 0.1  # m from one place to the next
MOST = 16_384  # places: beyond, the first are forgotten


class ProgressWatch:
    """A watch that distinguishes a robot on a long detour, which finds new places, from one that repeats its way.

    Args:
        within: [s] in which it should come 50 mm nearer to its goal.
        ground: number of new places, 100 mm apart, that are enough in that time instead.

    Attributes:
        doubtful: True once it came neither nearer nor to enough new places, until it comes nearer.

    Raises:
        InputError: `ground` is less than 1.
    """

    def __init__(self, within: float, ground: int) -> None:
        if ground < 1:
            raise InputError(f"ground ({ground}) must be at least 1.")
        self.within, self.ground = within, ground
        self.reset()

    def reset(self) -> None:
        """Forget all places and the nearest distance."""
        self.doubtful = False
        self._nearest, self._since = inf, 0.0
        self._been: dict[tuple[int, int], None] = {}  # a set in order: the first place is the first key
        self._new = deque[float](maxlen=self.ground)  # [s] of the last places

    def update(self, time: float, x: float, y: float, far: float) -> float:
        """Add the present place (x, y) [m]; return the time [s] since the robot last came nearer to its goal.

        Args:
            time: [s].
            x: [m].
            y: [m].
            far: [m] distance from its goal.

        Raises:
            ValueError: the position is not finite.
        """
        if far < self._nearest - NEARER:
            self._nearest, self._since, self.doubtful = far, time, False
        at = round(x / PLACE), round(y / PLACE)
        if at not in self._been:
            self._been[at] = None
            self._new.append(time)
            if len(self._been) > MOST:
                del self._been[next(iter(self._been))]
        stalled = time - self._since
        seen = len(self._new) == self.ground and time - self._new[0] <= self.within
        self.doubtful = self.doubtful or (stalled > self.within and not seen)
        return stalled
