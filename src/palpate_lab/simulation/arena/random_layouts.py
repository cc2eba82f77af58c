"""Draw arenas at random from a seed."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate_lab.simulation.arena.layout import GRAVITY, ArenaLayout, Block
from palpate_lab.simulation.arena.planner import require_solvable

DENSITIES = {"sparse": 0.5, "paper": 1.0, "dense": 1.6}  # of blocks, in times the paper's
_FIELD = (3.0, 2.0)  # m, for up to four robots
_CLEAR = 0.065  # m: the radius of a robot and 10 mm
_EDGE = 0.12  # m from the walls within which nothing starts or arrives
_BAND = 0.28  # m beyond it in which robots start, and arrive at the other end
_DRAWS, _TRIES = 300, 200  # of an arena, of one thing in it


def random_layout(seed: int, robots: int = 4, density: str = "paper") -> ArenaLayout:
    """Draw an `ArenaLayout` at random: starts at its left end, goals at its right end, boxes and inner walls between.

    It is drawn again until a disc 10 mm larger than a robot has a path for each robot around all blocks, movable ones
    too.

    Args:
        seed: seed of the draws, 0 or more.
        robots: number of robots; the field grows beyond four so that each has as much room.
        density: density of blocks: sparse, paper (10 fixed, 2 inner walls and 6 movable ones for four robots) or dense.

    Raises:
        InputError: an unknown density, no robot, a negative seed, or no arena that can be solved was drawn.
    """
    if density not in DENSITIES:
        raise InputError(
            f'the density "{density}" is unknown.', where="arena", hint=f"Choose one of {', '.join(DENSITIES)}."
        )
    if robots < 1 or seed < 0:
        raise InputError(f"robots must be 1 or more and seed 0 or more, not {robots} and {seed}.", where="arena")
    rng = np.random.default_rng([seed, 18])
    for _ in range(_DRAWS):
        layout = _drawn(rng, robots, DENSITIES[density], f"{density} {seed}")
        if layout is None:
            continue
        try:
            require_solvable(layout, _CLEAR)
        except InputError:
            continue
        return layout
    raise InputError(
        f"none of {_DRAWS} random arenas can be solved.", where=f"arena {density} {seed}", hint="Take another seed."
    )


def _drawn(rng: np.random.Generator, robots: int, density: float, name: str) -> ArenaLayout | None:
    """Draw one arena; return None if something found no room."""
    grown = sqrt(max(robots, 4) / 4)
    width, height = (grown * side for side in _FIELD)
    band = _BAND * grown
    starts = _spread(rng, robots, (_EDGE, _EDGE + band), height, 0.20)
    goals = _spread(rng, robots, (width - _EDGE - band, width - _EDGE), height, 0.25)
    if starts is None or goals is None:
        return None
    places = np.concatenate([starts, goals])
    blocks: list[Block] = []
    share = density * grown**2
    kinds = (_inner_wall, round(2 * share)), (_fixed_box, round(10 * share)), (_movable_box, round(6 * share))
    for draw, count in kinds:
        for _ in range(count):
            for _ in range(_TRIES):
                block = draw(rng, _EDGE + band, width, height)
                if _fits(block, blocks, places, height):
                    blocks.append(block)
                    break
            else:
                return None
    headings = rng.uniform(-pi, pi, robots)
    return ArenaLayout(
        (width, height), tuple(blocks), np.column_stack([starts, headings]), rng.permutation(goals), name
    )


def _spread(
    rng: np.random.Generator, count: int, across: tuple[float, float], height: float, apart: float
) -> Float[np.ndarray, "n 2"] | None:
    """Draw points in a band over the field's complete height, at least `apart` from each other."""
    places = np.empty((0, 2))
    for _ in range(_TRIES * count):
        place = rng.uniform((across[0], _EDGE), (across[1], height - _EDGE))
        if (np.linalg.norm(places - place, axis=1) >= apart).all():
            places = np.concatenate([places, place[None]])
        if len(places) == count:
            return places
    return None


def _fits(block: Block, blocks: list[Block], places: Float[np.ndarray, "n 2"], height: float) -> bool:
    """Tell whether a block is clear of starts, goals and other blocks, and a movable one of the walls."""
    y = block.corners()[:, 1]
    if block.mass is not None and (y.min() < 0.01 or y.max() > height - 0.01):
        return False
    if (block.distance(places) < _CLEAR + 0.015).any():
        return False
    near = (
        other for other in blocks if np.hypot(other.x - block.x, other.y - block.y) < other.reach + block.reach + 0.01
    )
    return all(block.gap(other) >= 0.01 for other in near)


def _inner_wall(rng: np.random.Generator, band: float, width: float, height: float) -> Block:
    """Draw a wall 20 mm thick, more or less across the way."""
    x, y = rng.uniform((band + 0.3, 0.0), (width - band - 0.3, height))
    return Block(float(x), float(y), rng.uniform(-pi / 4, pi / 4), (0.01, 0.5 * rng.uniform(0.4, 0.8)))


def _fixed_box(rng: np.random.Generator, band: float, width: float, height: float) -> Block:
    x, y = rng.uniform((band, 0.0), (width - band, height))
    a, b = 0.5 * rng.uniform(0.1, 0.4, 2)
    return Block(float(x), float(y), rng.uniform(-pi, pi), (float(a), float(b)))


def _movable_box(rng: np.random.Generator, band: float, width: float, height: float) -> Block:
    """Draw a box; four of five slide under a push of 0.6 to 2 N, the others under 4 to 8 N, more than a robot dares."""
    x, y = rng.uniform((band, 0.0), (width - band, height))
    a, b = 0.5 * rng.uniform(0.08, 0.2, 2)
    push = rng.uniform(4.0, 8.0) if rng.random() < 0.2 else rng.uniform(0.6, 2.0)
    friction = 0.4
    return Block(float(x), float(y), rng.uniform(-pi, pi), (float(a), float(b)), push / (friction * GRAVITY), friction)
