"""Whether what a robot presses against moves: the only way to tell a box from a wall by touch."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import cos, radians

__all__ = ["Push", "PushTest"]

SAME = cos(radians(30.0))  # of two directions that are of one contact
GONE = 0.2  # s without a touch after which a contact has ended


class Push(Enum):
    """What is known of what is pressed."""

    WAITING = "seeing whether what is ahead moves"
    MOVES = "what is ahead moves"
    STANDS = "what is ahead does not move"
    BACK = "what is ahead pushes back"


@dataclass
class PushTest:
    """Follows one contact ahead, at the caller's rate.

    Args:
        settle: [s] until the force is there: a soft skin is pressed in first.
        test: [s] in which it must move.
        moved: [m] by which.

    Attributes:
        push: what is known; None: nothing is pressed.
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
        """Nothing is pressed any more."""
        self.push = None

    def touch(self, time: float, place: tuple[float, float], way: tuple[float, float]) -> Push:
        """The robot at a place [m] presses in a direction (a unit vector).

        It moves where the robot gets on in that direction: what slides past does not.
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
        """Nothing is felt ahead now."""
        if self.push is not None and time - self._seen > GONE:
            self.end()
