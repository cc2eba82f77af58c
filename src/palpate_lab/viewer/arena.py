"""An arena of robots as values: what stands, what a moment holds, which colours robots have, where they have been."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays
from palpate.viewer._style import AXES, STATUS, mixed

__all__ = ["FORCE", "Arena", "ArenaScene", "Trails", "colour", "newtons"]

STEP = 0.01  # m between two points of a trail
_COLOURS = (AXES[2], AXES[1], STATUS[6], STATUS[1], STATUS[7], STATUS[5])  # vermilion is kept for forces


@takes_arrays
@dataclass(frozen=True, eq=False)
class Arena:
    """What does not change.

    Attributes:
        size: (width, height) of the field [m], its corner at the origin.
        half: (m, 2) half sizes of the blocks along their own axes [m].
        movable: (m,) which blocks can be pushed.
        goals: (n, 2) of the robots [m].
        radius: of a robot [m].
        name: of the layout.
    """

    size: tuple[float, float]
    half: Float[np.ndarray, "m 2"]
    movable: Bool[np.ndarray, " m"]
    goals: Float[np.ndarray, "n 2"]
    radius: float = 0.055
    name: str = ""

    @property
    def robots(self) -> int:
        """How many."""
        return len(self.goals)

    def outline(self, block: int, place: Float[np.ndarray, "3"]) -> Float[np.ndarray, "k 2"]:
        """Corners of a block within the walls, counter-clockwise [m]; none where nothing of it is within.

        Args:
            block: which.
            place: its x, y and turn.
        """
        x, y, turn = place.tolist()
        turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        corners = _SQUARE * self.half[block] @ turned.T + [x, y]
        for axis, size in enumerate(self.size):
            corners = _cut(_cut(corners, axis, 1.0, 0.0), axis, -1.0, -size)
        return corners


@takes_arrays
@dataclass(frozen=True, eq=False)
class ArenaScene:
    """A moment.

    Attributes:
        time: [s].
        poses: (n, 3) x, y, heading of the robots [m], [rad].
        blocks: (m, 3) x, y and turn of the blocks [m], [rad].
        touches: of each robot (k, 2) angle in its own frame and inward force [rad], [N]; None where its skin says
            nothing.
        states: of the robots, in a word or two.
        whys: of them, in a sentence.
        arrived: (n,).
        frames: what each robot's camera sees, blue, green, red; None where there are no images.
    """

    time: float
    poses: Float[np.ndarray, "n 3"]
    blocks: Float[np.ndarray, "m 3"]
    touches: tuple[Float[np.ndarray, "_ 2"] | None, ...]
    states: tuple[str, ...]
    whys: tuple[str, ...]
    arrived: Bool[np.ndarray, " n"]
    frames: tuple[UInt8[np.ndarray, "h w 3"], ...] | None = None


@takes_arrays
class Trails:
    """Where each robot has been, a point every centimetre of its way.

    Args:
        robots: how many.
    """

    def __init__(self, robots: int) -> None:
        self._points: list[list[tuple[float, float]]] = [[] for _ in range(robots)]

    def add(self, poses: Float[np.ndarray, "n 3"]) -> None:
        """The next moment; what moved less than a step adds nothing."""
        if len(poses) != len(self._points):
            raise InputError(f"poses must be of {len(self._points)} robots, not {len(poses)}.")
        for points, (x, y, _) in zip(self._points, poses.tolist(), strict=True):
            if not points or (x - points[-1][0]) ** 2 + (y - points[-1][1]) ** 2 >= STEP**2:
                points.append((x, y))

    def of(self, robot: int) -> Float[np.ndarray, "p 2"]:
        """(p, 2) [m], the oldest first."""
        return np.array(self._points[robot]).reshape(-1, 2)

    def length(self, robot: int) -> int:
        """How many points there are."""
        return len(self._points[robot])


def colour(robot: int) -> tuple[int, int, int]:
    """Red, green, blue of a robot, counted from 0; they begin anew after the sixth."""
    return mixed(_COLOURS[robot % len(_COLOURS)], 0.0)


@takes_arrays
def newtons(touches: Float[np.ndarray, "_ 2"] | None) -> str:
    """What a skin feels, in a few words."""
    if touches is None:
        return "feels nothing: blind"
    if not len(touches):
        return "free"
    return " + ".join(f"{force:.1f}" for force in touches[:3, 1]) + (" + .." if len(touches) > 3 else "") + " N"


def _cut(corners: Float[np.ndarray, "k 2"], axis: int, sign: float, least: float) -> Float[np.ndarray, "m 2"]:
    """What of a convex outline has sign * coordinate >= least (Sutherland and Hodgman's step)."""
    kept = list[np.ndarray]()
    for one, two in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a, b = sign * one[axis] - least, sign * two[axis] - least
        if a >= 0.0:
            kept.append(one)
        if a * b < 0.0:
            kept.append(one + a / (a - b) * (two - one))
    return np.array(kept).reshape(-1, 2)


_SQUARE = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
FORCE = mixed(AXES[0], 0.0)
