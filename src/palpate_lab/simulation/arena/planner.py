"""Check whether robots can cross an arena, by a planner that sees the complete map, which no robot does."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from palpate.errors import InputError
from palpate_lab.simulation.arena.layout import ArenaLayout, Block

_CELL = 0.020  # m


def require_solvable(layout: ArenaLayout, radius: float, *, pushing: bool = False) -> None:
    """Require a path for each robot, for a disc that keeps clear of walls and blocks.

    Robots are obstacles to each other only at their starts and goals. A path is sought among cells of 20 mm whose
    middle is clear, so a passage needs up to 30 mm more than the disc's diameter.

    Args:
        layout: the arena.
        radius: radius of the disc [m]: the robot's and a margin.
        pushing: movable blocks are no obstacle to the path; to starts and goals they are.

    Raises:
        InputError: a robot starts in a wall, a block or another robot, has its goal there, or has no path; it names the
            robot.
    """
    places = layout.starts[:, :2], layout.goals
    for word, points in zip(("start", "goal"), places, strict=True):
        _require_clear(layout, points, radius, word)
        _require_apart(layout, points, radius, word)
    solid = tuple(block for block in layout.blocks if block.mass is None) if pushing else layout.blocks
    area, _ = ndimage.label(_free(layout.size, solid, radius), np.ones((3, 3)))
    for k, (start, goal) in enumerate(zip(*places, strict=True)):
        if not _near(area, start) & _near(area, goal):
            widen = "Take a block away or widen a passage."
            raise InputError(
                f"robot {k + 1} has no way from {_said(start)} to {_said(goal)} for a disc of radius {radius:.3f} m.",
                where=_where(layout),
                hint=widen if len(solid) < len(layout.blocks) else f"{widen} Movable blocks count as solid.",
            )


def _require_clear(layout: ArenaLayout, points: Float[np.ndarray, "n 2"], radius: float, word: str) -> None:
    hint = f"Keep every {word} {radius:.3f} m away from walls and blocks."
    for k, point in enumerate(points):
        if float(np.minimum(point, np.subtract(layout.size, point)).min()) < radius:
            raise InputError(
                f"the {word} of robot {k + 1} at {_said(point)} is in a wall.", where=_where(layout), hint=hint
            )
    for i, block in enumerate(layout.blocks):
        for k in np.flatnonzero(block.distance(points) < radius).tolist():
            at = f"the {word} of robot {k + 1} at {_said(points[k])}"
            what = f"block {i + 1} at ({block.x:.3f}, {block.y:.3f})"
            raise InputError(f"{at} is in {what}.", where=_where(layout), hint=hint)


def _require_apart(layout: ArenaLayout, points: Float[np.ndarray, "n 2"], radius: float, word: str) -> None:
    apart = np.linalg.norm(points[:, None] - points, axis=2) + 2 * radius * np.tri(len(points))
    for i, k in np.argwhere(apart < 2 * radius).tolist():
        raise InputError(
            f"the {word}s of robots {i + 1} and {k + 1} overlap, at a distance of {apart[i, k] * 1e3:.0f} mm.",
            where=_where(layout),
            hint=f"Keep a distance of at least {2e3 * radius:.0f} mm.",
        )


def _free(size: tuple[float, float], blocks: tuple[Block, ...], radius: float) -> Bool[np.ndarray, "w h"]:
    """Return the cells whose middle is clear; each block is compared with the cells around it only."""
    x, y = ((np.arange(int(np.ceil(side / _CELL))) + 0.5) * _CELL for side in size)
    free = np.outer((x >= radius) & (x <= size[0] - radius), (y >= radius) & (y <= size[1] - radius))
    for block in blocks:
        far = block.reach + radius
        i, j = (slice(*np.searchsorted(axis, (m - far, m + far))) for axis, m in ((x, block.x), (y, block.y)))
        points = np.stack(np.meshgrid(x[i], y[j], indexing="ij"), axis=-1)
        free[i, j] &= block.distance(points) >= radius
    return free


def _near(area: np.ndarray, point: Float[np.ndarray, "2"]) -> set[int]:
    """Return the areas of the clear cells around a clear point."""
    i, j = (int(value / _CELL) for value in point)
    return set(area[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2].ravel().tolist()) - {0}


def _said(point: np.ndarray) -> str:
    return f"({point[0]:.3f}, {point[1]:.3f})"


def _where(layout: ArenaLayout) -> str:
    return f'arena "{layout.name}"' if layout.name else "arena"
