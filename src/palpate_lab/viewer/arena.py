"""The drawn arena: its fixed parts, one moment of a run, the colours of the robots and their trails."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, UInt8

from palpate.errors import InputError
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.viewer._style import AXES, STATUS, mixed

STEP = 0.01  # m between two points of a trail
_COLOURS = (AXES[2], AXES[1], STATUS[6], STATUS[1], STATUS[7], STATUS[5])  # vermilion is kept for forces


@frozen_value
class Arena:
    """The fixed parts of an arena that is drawn.

    Attributes:
        size: (width, height) of the field [m]; its corner is the origin.
        half: (m, 2) half sizes of the blocks along their own axes [m].
        movable: (m,) True for blocks that can be pushed.
        goals: (n, 2) goal of each robot [m].
        radius: radius of a robot [m].
        name: name of the layout.
    """

    size: tuple[float, float]
    half: Float[np.ndarray, "m 2"]
    movable: Bool[np.ndarray, " m"]
    goals: Float[np.ndarray, "n 2"]
    radius: float = 0.055
    name: str = ""

    @property
    def robots(self) -> int:
        """Number of robots."""
        return len(self.goals)

    def outline(self, block: int, place: Float[np.ndarray, "3"]) -> Float[np.ndarray, "k 2"]:
        """Return the corners (k, 2) of a block within the walls [m], counter-clockwise; (0, 2) if all of it is outside.

        Args:
            block: index of the block.
            place: its x, y [m] and turn [rad].

        Raises:
            InputError: place has another shape.
        """
        x, y, turn = place.tolist()
        turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        corners = _SQUARE * self.half[block] @ turned.T + [x, y]
        for axis, size in enumerate(self.size):
            corners = _cut(_cut(corners, axis, 1.0, 0.0), axis, -1.0, -size)
        return corners


@frozen_value
class ArenaScene:
    """A moment of a run, as it is drawn.

    Attributes:
        time: time [s].
        poses: (n, 3) x, y and heading of the robots [m], [rad].
        blocks: (m, 3) x, y and turn of the blocks [m], [rad].
        touches: (k, 2) for each robot: angle in its own frame and inward force [rad], [N]; None while its skin gives
            no reading.
        states: state of each robot, in a word or two.
        whys: reason for each state, in a sentence.
        arrived: (n,) True for robots that have arrived.
        frames: image of each robot's camera, blue, green, red; None without images.
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
    """The paths of all robots so far, with a point every centimetre.

    Args:
        robots: number of robots.
    """

    def __init__(self, robots: int) -> None:
        self._points: list[list[tuple[float, float]]] = [[] for _ in range(robots)]

    def add(self, poses: Float[np.ndarray, "n 3"]) -> None:
        """Add the position of each robot that has moved a centimetre since its last point.

        Raises:
            InputError: the number of poses is not the number of robots.
        """
        if len(poses) != len(self._points):
            raise InputError(f"poses must have one row for each of {len(self._points)} robots, not {len(poses)} rows.")
        for points, (x, y, _) in zip(self._points, poses.tolist(), strict=True):
            if not points or (x - points[-1][0]) ** 2 + (y - points[-1][1]) ** 2 >= STEP**2:
                points.append((x, y))

    def of(self, robot: int) -> Float[np.ndarray, "p 2"]:
        """Return the points of a robot's path, (p, 2) [m], the oldest first."""
        return np.array(self._points[robot]).reshape(-1, 2)

    def length(self, robot: int) -> int:
        """Return the number of points in a robot's path."""
        return len(self._points[robot])


def colour(robot: int) -> tuple[int, int, int]:
    """Return red, green and blue, 0 to 255, of a robot, counted from 0; the colours repeat after the sixth."""
    return mixed(_COLOURS[robot % len(_COLOURS)], 0.0)


@takes_arrays
def newtons(touches: Float[np.ndarray, "_ 2"] | None) -> str:
    """Return the forces that a skin feels as a short text: at most three of them, as "1.2 + 0.4 N".

    It is "free" without contact, and "feels nothing: blind" for None.

    Raises:
        InputError: touches has another shape.
    """
    if touches is None:
        return "feels nothing: blind"
    if not len(touches):
        return "free"
    return " + ".join(f"{force:.1f}" for force in touches[:3, 1]) + (" + .." if len(touches) > 3 else "") + " N"


def _cut(corners: Float[np.ndarray, "k 2"], axis: int, sign: float, least: float) -> Float[np.ndarray, "m 2"]:
    """Return the part of a convex outline where sign * coordinate >= least (one step of Sutherland and Hodgman)."""
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
