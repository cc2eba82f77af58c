"""Find the touches in a log whose times were not recorded."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays

HELD = 0.7  # of a press's own 90th percentile of force: leaves the ramps out
SHORTEST = 10  # samples of the steady part


@takes_arrays
def find_presses(
    time: Float[np.ndarray, " n"],
    wrenches: Float[np.ndarray, "n 6"],
    *,
    on: float,
    off: float,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return start and end [s] of the steady part of every press, (k,) each.

    A press is a stretch in which the force stays above `off` and exceeds `on`; in its steady part the force is at
    least 0.7 of its 90th percentile. A press without ten such samples is omitted.

    Args:
        time: (n,) [s], not running backwards.
        wrenches: (n, 6) compensated [N, N m].
        on: force [N] that a touch exceeds.
        off: force [N] below which it has ended.

    Raises:
        InputError: arrays of other shapes.
    """
    strength = np.where(np.isfinite(wrenches).all(axis=1), np.linalg.norm(wrenches[:, :3], axis=1), 0.0)
    edges = np.flatnonzero(np.diff(strength > off, prepend=False, append=False))
    found: list[np.ndarray] = [np.zeros((0, 2))]
    for first, last in edges.reshape(-1, 2):
        held = strength[first:last]
        steady = first + np.flatnonzero(held >= HELD * np.percentile(held, 90))
        if held.max() > on and len(steady) >= SHORTEST:
            found.append(time[steady[[0, -1]]][None])
    start, end = np.concatenate(found).T.copy()
    return start, end
