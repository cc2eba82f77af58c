"""Make the fixed arenas: one like the paper's, and two traps."""

from __future__ import annotations

import numpy as np

from palpate.errors import InputError
from palpate_lab.simulation.arena.layout import GRAVITY, ArenaLayout, Block

TRAPS = ("u", "corridor")
_FIELD = (3.0, 2.0)  # m
_WALL = 0.01  # m: half of an inner wall's thickness


def paper_layout() -> ArenaLayout:
    """Make an `ArenaLayout` of four robots and two walls with narrow passages, after figure 11 of papers/002.

    The figure gives no lengths. The first wall has passages 1.5 and 2 robots wide, the second one 2 and 2.5. The middle
    passage, on the shorter way, is plugged by a box that robots can push through, like box 2 of figure 12a; the other
    is free.
    """
    blocks = (
        *_wall_with_gaps(1.0, (0.45, 0.615), (1.33, 1.55)),
        *_wall_with_gaps(2.0, (0.90, 1.12), (1.60, 1.875)),
        Block(0.62, 1.05, 0.5, (0.09, 0.07)),
        Block(1.45, 0.42, 0.3, (0.13, 0.10)),
        Block(1.52, 1.12, -0.6, (0.10, 0.12)),
        Block(1.62, 1.72, 0.2, (0.12, 0.06)),
        Block(2.42, 0.55, -0.4, (0.12, 0.08)),
        Block(2.45, 1.45, 0.7, (0.10, 0.10)),
        _box(1.99, 1.01, 0.0, (0.06, 0.085), push=1.2),
        _box(0.66, 0.42, 0.4, (0.06, 0.06), push=0.9),
        _box(1.30, 1.50, 0.1, (0.05, 0.08), push=1.5),
        _box(2.40, 1.00, -0.3, (0.07, 0.05), push=0.7),
    )
    starts = [[0.15, y, 0.0] for y in (0.40, 0.80, 1.20, 1.60)]
    goals = [[2.83, y] for y in (1.20, 0.40, 1.60, 0.80)]
    return ArenaLayout(_FIELD, blocks, np.array(starts), np.array(goals), "paper")


def trap_layout(kind: str) -> ArenaLayout:
    """Make an `ArenaLayout` that traps robots which drive straight to the goal.

    Args:
        kind: u: one robot, and between it and its goal walls that are open towards it only, 0.5 m deep and 0.8 m wide;
            corridor: two robots, and one passage 1.0 m long and 1.5 robots wide.

    Raises:
        InputError: any other kind.
    """
    if kind == "u":
        arms = tuple(Block(1.35, y, 0.0, (0.25 + _WALL, _WALL)) for y in (0.6, 1.4))
        back = Block(1.6, 1.0, 0.0, (_WALL, 0.4 - _WALL))
        return ArenaLayout(_FIELD, (*arms, back), np.array([[0.3, 1.0, 0.0]]), np.array([[2.7, 1.0]]), "trap u")
    if kind == "corridor":
        half = 0.5 * 0.165
        sides = tuple(Block(1.5, y, 0.0, (0.5, 0.5 - 0.5 * half)) for y in (0.5 - 0.5 * half, 1.5 + 0.5 * half))
        starts, goals = [[0.4, 0.6, 0.0], [0.4, 1.4, 0.0]], [[2.6, 1.4], [2.6, 0.6]]
        return ArenaLayout(_FIELD, sides, np.array(starts), np.array(goals), "trap corridor")
    raise InputError(f'the trap "{kind}" is unknown.', where="arena", hint=f"Choose one of {', '.join(TRAPS)}.")


def _wall_with_gaps(x: float, *gaps: tuple[float, float]) -> tuple[Block, ...]:
    """Make a wall across the complete field at x, except for passages from one y to another."""
    edges = [0.0, *(edge for gap in gaps for edge in gap), _FIELD[1]]
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return tuple(Block(x, 0.5 * (low + high), 0.0, (_WALL, 0.5 * (high - low))) for low, high in pairs)


def _box(x: float, y: float, turn: float, half: tuple[float, float], push: float, friction: float = 0.4) -> Block:
    """Make a box that slides under a push of `push` newtons."""
    return Block(x, y, turn, half, push / (friction * GRAVITY), friction)
