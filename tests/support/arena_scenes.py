"""A small arena and moments of it, made up."""

import numpy as np

from palpate_lab.simulation.arena.layout import ArenaLayout, Block
from palpate_lab.simulation.arena.moment import ArenaMoment

BLOCKS = (
    Block(1.0, 0.5, 0.3, (0.2, 0.1)),
    Block(2.0, 1.0, 0.0, (0.1, 0.1), mass=1.0),
    Block(1.5, 2.0, 0.0, (0.1, 0.1)),
)


def arena() -> ArenaLayout:
    """Three metres by two, a fixed block, one that can be pushed, one halfway in the wall, two robots."""
    starts = np.array([[0.4, 1.0, 0.0], [0.5, 1.5, np.pi / 2]])
    return ArenaLayout((3.0, 2.0), BLOCKS, starts, np.array([[2.7, 0.5], [2.7, 1.5]]), "made up")


def scene(time: float = 0.0, *, force: float = 2.0, blind: bool = False, images: bool = False) -> ArenaMoment:
    """The first robot goes ahead and is pressed at its left, the second stands, and may be blind."""
    poses = np.array([[0.4 + 0.05 * time, 1.0, 0.0], [0.5, 1.5, np.pi / 2]])
    touches = [np.array([[np.pi / 2, force]]), None if blind else np.zeros((0, 2))]
    frames = [np.full((48, 64, 3), 40, np.uint8), np.full((48, 64, 3), 200, np.uint8)] if images else None
    states, whys = ("follow wall", "arrived"), ("something is at its left", "within 0.10 m of its goal")
    rest = touches, [np.zeros((0, 5))] * 2, np.zeros((2, 2)), states, whys, frames, np.array([False, True])
    return ArenaMoment(time, poses, poses, np.array([[2.0, 1.0, 0.0]]), *rest)
