"""Whether a robot still gets on: nearer to its goal, or where it has not been before."""

from __future__ import annotations

from collections import deque
from math import inf

from palpate.errors import InputError

__all__ = ["ProgressWatch"]

MOST = 16_384  # places: beyond, the first are forgotten


class ProgressWatch:
    """Tells a robot that searches from one that only goes over the same ground.

    A long way round brings a robot no nearer for minutes, but always to new ground; a goal that cannot be reached
    brings it back to where it was, again and again.

    Args:
        within: [s] in which it should have come nearer to its goal.
        ground: places that are enough in that time instead, if they are new to it.
        nearer: [m] that it must have come nearer.
        place: [m] from one place to the next.

    Attributes:
        doubtful: it came neither nearer nor to enough that is new; until it comes nearer.

    Raises:
        InputError: `ground` is less than 1.
    """

    def __init__(self, within: float, ground: int, *, nearer: float = 0.05, place: float = 0.1) -> None:
        if ground < 1:
            raise InputError(f"ground ({ground}) must be at least 1.")
        self.within, self.ground, self.nearer, self.place = within, ground, nearer, place
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.doubtful = False
        self._nearest, self._since = inf, 0.0
        self._been: dict[tuple[int, int], None] = {}  # a set in order: the first place is the first key
        self._new = deque[float](maxlen=self.ground)  # [s] of the last places

    def update(self, time: float, x: float, y: float, far: float) -> float:
        """For how long it has come no nearer [s].

        Args:
            time: [s].
            x: where it is [m].
            y: the same.
            far: [m] from its goal.
        """
        if far < self._nearest - self.nearer:
            self._nearest, self._since, self.doubtful = far, time, False
        at = round(x / self.place), round(y / self.place)
        if at not in self._been:
            self._been[at] = None
            self._new.append(time)
            if len(self._been) > MOST:
                del self._been[next(iter(self._been))]
        stalled = time - self._since
        seen = len(self._new) == self.ground and time - self._new[0] <= self.within
        self.doubtful = self.doubtful or (stalled > self.within and not seen)
        return stalled
