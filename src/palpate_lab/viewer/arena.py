"""Place blocks, choose colours of robots and keep their trails, for pictures of an arena."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays
from palpate.viewer._style import AXES, STATUS, mixed
from palpate_lab.simulation.arena.layout import ArenaLayout, Block

STEP = 0.01  # m between two points of a trail
_COLOURS = (AXES[2], AXES[1], STATUS[6], STATUS[1], STATUS[7], STATUS[5])  # vermilion is kept for forces


def standing(layout: ArenaLayout, moved: Float[np.ndarray, "m 3"]) -> Iterator[Block]:
    """Yield the blocks of an arena, the movable ones at the poses of a moment."""
    places = iter(moved.tolist())
    for block in layout.blocks:
        if block.mass is None:
            yield block
        else:
            x, y, turn = next(places)
            yield replace(block, x=x, y=y, turn=turn)


def outline(block: Block, size: tuple[float, float]) -> Float[np.ndarray, "k 2"]:
    """Return the corners of a block within a field of this size [m], counter-clockwise; (0, 2) if all is outside."""
    corners = block.corners()
    for axis, length in enumerate(size):
        corners = _cut(_cut(corners, axis, 1.0, 0.0), axis, -1.0, -length)
    return corners


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


FORCE = mixed(AXES[0], 0.0)
