"""Find the touches in a log whose times were not recorded."""

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
    """Return start and end [s] of the steady part of every press, (k,) each.

    A press is a stretch in which the force stays above `off` and exceeds `on`; its steady part is where the force is
    at least 0.7 of its 90th percentile. A finger that slides while it presses touches no single place: do not slide.

    Args:
        time: (n,) [s], not running backwards.
        wrenches: (n, 6) compensated [N, N m].
        on: force [N] that a touch exceeds.
        off: force [N] below which it has ended.
        shortest: least number of samples of the steady part.
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
