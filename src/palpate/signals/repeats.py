"""Find stretches of a log in which readings repeat, as of a sensor that hangs."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from palpate.spatial.arguments import takes_arrays

SHORTEST, LONGER = 10, 20.0  # rows that repeat, and times the usual number of such rows
FIRST = 100  # rows at the start, at rest: where most of them repeat, readings are too coarse to show noise


@takes_arrays
def hung(time: Float[np.ndarray, " n"], same: Bool[np.ndarray, " n"]) -> list[str]:
    """Return a sentence if readings repeat for far longer than is usual in a log, else [].

    Args:
        time: (n,) [s].
        same: (n,) whether all readings of a row equal those of the row before.

    Raises:
        InputError: arrays of other shapes.
    """
    starts = np.flatnonzero(~same)
    runs = np.diff(np.append(starts, len(same)))
    if len(runs) < SHORTEST:
        return []
    frozen = np.flatnonzero(runs > max(SHORTEST, LONGER * float(np.median(runs))))
    noisy = not np.mean(same[:FIRST]) > 0.5
    usual = int(starts[-1]) if noisy and len(frozen) and frozen[-1] == len(runs) - 1 else len(same)
    if not len(frozen) or len(runs) < 0.5 * usual:
        return []
    begun = starts[frozen[0]]
    last = f" to {time[begun + runs[frozen[0]] - 1]:.2f} s" if len(frozen) == 1 else f" s on, {len(frozen)} times"
    return [f"the readings repeat from {time[begun]:.2f}{last}: the sensor or its reader hung, and nothing is measured"]
