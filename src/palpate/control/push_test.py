"""Test whether a pressed object moves: the only way to distinguish a box from a wall by touch."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import cos, radians

SAME = cos(radians(30.0))  # of two directions that are of one contact
GONE = 0.2  # s without a touch after which a contact has ended


class Push(Enum):
    """Result of a push test so far."""

    WAITING = "seeing whether what is ahead moves"
    MOVES = "what is ahead moves"
    STANDS = "what is ahead does not move"
    BACK = "what is ahead pushes back"


@dataclass
class PushTest:
    """A test of one contact, updated at the caller's rate.

    Args:
        settle: [s] until the force has built up: a soft skin is pressed in first.
        test: [s] in which the object must move.
        moved: [m] distance by which it must move.

    Attributes:
        push: result so far; None: nothing is pressed.
    """

    settle: float
    test: float
    moved: float
    push: Push | None = None
    _since: float = 0.0
    _seen: float = 0.0
    _way: tuple[float, float] = (0.0, 0.0)
    _from: tuple[float, float, float] | None = None  # x, y [m], time [s]

    def end(self) -> None:
        """Set `push` to None: nothing is pressed."""
        self.push = None

    def touch(self, time: float, place: tuple[float, float], way: tuple[float, float]) -> Push:
        """Update the test at a time [s] by the robot's place [m] and pressing direction (unit vector); return a `Push`.

        The object moves if the robot advances in that direction.
        """
        if self.push is None or way[0] * self._way[0] + way[1] * self._way[1] < SAME:
            self.push, self._since, self._way, self._from = Push.WAITING, time, way, None
        self._seen = time
        if time - self._since < self.settle:
            return self.push
        if self._from is None:
            self._from = (*place, time)
        gone = (place[0] - self._from[0]) * self._way[0] + (place[1] - self._from[1]) * self._way[1]
        if gone >= self.moved:
            self.push, self._from = Push.MOVES, (*place, time)
        elif gone <= -self.moved:
            self.push = Push.BACK
        elif time - self._from[2] >= self.test:
            self.push = Push.STANDS
        return self.push

    def none(self, time: float) -> None:
        """Note that nothing is felt at a time [s]; after 0.2 s the test ends: `push` is None."""
        if self.push is not None and time - self._seen > GONE:
            self.end()
