"""A small arena and moments of it, made up."""

import numpy as np

from palpate_lab.viewer.arena import Arena, ArenaScene

BLOCKS = np.array([[1.0, 0.5, 0.3], [2.0, 1.0, 0.0], [1.5, 2.0, 0.0]])  # the last one stands halfway in the wall


def arena() -> Arena:
    """Three metres by two, a fixed block, one that can be pushed, one in the wall, two robots."""
    half = np.array([[0.2, 0.1], [0.1, 0.1], [0.1, 0.1]])
    return Arena((3.0, 2.0), half, np.array([False, True, False]), np.array([[2.7, 0.5], [2.7, 1.5]]), name="made up")


def scene(time: float = 0.0, *, force: float = 2.0, blind: bool = False, images: bool = False) -> ArenaScene:
    """The first robot goes ahead and is pressed at its left, the second stands, and may be blind."""
    poses = np.array([[0.4 + 0.05 * time, 1.0, 0.0], [0.5, 1.5, np.pi / 2]])
    touches = (np.array([[np.pi / 2, force]]), None if blind else np.zeros((0, 2)))
    frames = (np.full((48, 64, 3), 40, np.uint8), np.full((48, 64, 3), 200, np.uint8)) if images else None
    states, whys = ("follow wall", "arrived"), ("something is at its left", "within 0.10 m of its goal")
    return ArenaScene(time, poses, BLOCKS, touches, states, whys, np.array([False, True]), frames)
