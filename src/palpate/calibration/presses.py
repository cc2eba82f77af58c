"""Which stretches of a log are touches, when nobody wrote them down."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays

__all__ = ["find_presses"]

HELD = 0.7  # of a press's own 90th percentile of force: leaves the ramps out


@takes_arrays
def find_presses(
    time: Float[np.ndarray, " n"],
    wrenches: Float[np.ndarray, "n 6"],
    *,
    on: float,
    off: float,
    shortest: int = 10,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Start and end [s] of the steady part of every press.

    A press is a stretch in which the force stays above `off` and exceeds `on`; its steady part is where the force is
    at least 0.7 of what it reaches. A finger that slides while it presses is one touch at no place: do not slide.

    Args:
        time: (n,) [s], not running backwards.
        wrenches: (n, 6) compensated [N, N m].
        on: force [N] that a touch exceeds.
        off: force [N] below which it has ended.
        shortest: samples that make a touch.
    """
    strength = np.where(np.isfinite(wrenches).all(axis=1), np.linalg.norm(wrenches[:, :3], axis=1), 0.0)
    edges = np.flatnonzero(np.diff(np.r_[0, strength > off, 0]))
    starts: list[float] = []
    ends: list[float] = []
    for first, last in edges.reshape(-1, 2):
        held = strength[first:last]
        if held.max() <= on:
            continue
        steady = first + np.flatnonzero(held >= HELD * np.percentile(held, 90))
        if len(steady) >= shortest:
            starts.append(float(time[steady[0]]))
            ends.append(float(time[steady[-1]]))
    return np.array(starts), np.array(ends)
