"""Find readings at rest: their mean, their noise, the steps in which they come, and the direction of a load."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays

CLOSE = 4.0  # standard deviations about the baseline that still are at rest
ROUNDING = 12**-0.5  # standard deviation of rounding to whole steps
RECURS, RARELY = 3, 500  # times that a step recurs at least, and one in so many frames
FAR = 20.0  # deviations of its noise that a cell moves under a load that shows the direction,
FARTHER = 3.0  # times as far as in the other direction,
SHORT = 0.3  # in at most this share of the frames: most have no load
LONE = 2  # frames of a cell that may be faults: the largest excursion is the next


@takes_arrays
def resting(
    cells: Float[np.ndarray, "n k"], *, counts: bool
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return mean and standard deviation, (k,) each [counts], of the readings near each cell's lower end.

    The deviation is at least that of rounding to the steps in which the readings come.

    Args:
        cells: (n, k) readings that rise under load.
        counts: readings are integers, which come in steps of at least 1.

    Raises:
        InputError: cells has another shape.
    """
    steps, step = np.abs(np.diff(cells, axis=0)), np.maximum(quantum(cells), float(counts))
    low = np.quantile(cells, 0.1, axis=0)
    rough = np.maximum(np.median(steps, axis=0) / 0.954, np.where(step > 0, step, 1e-12 + 1e-6 * np.ptp(cells)))
    near = np.abs(cells - low) <= 2 * CLOSE * rough
    middle = np.nanmedian(np.where(near, cells, np.nan), axis=0)
    near = np.abs(cells - middle) <= CLOSE * rough
    count = near.sum(axis=0)
    baseline = np.where(near, cells, 0.0).sum(axis=0) / count
    variance = np.where(near, (cells - baseline) ** 2, 0.0).sum(axis=0) / np.maximum(count - 1, 1)
    least = np.where(step > 0, ROUNDING * step, 1e-9 + 1e-3 * float(np.median(np.sqrt(variance))))
    return baseline, np.sqrt(np.maximum(variance, least**2))


@takes_arrays
def quantum(cells: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " k"]:
    """Return the step (k,) in which each cell's readings come, 0 where they are continuous.

    It is the smallest difference between successive frames that recurs. Where all readings are whole numbers, all cells
    have the same, at least 1; a cell without any has the median of the others.

    Raises:
        InputError: cells has another shape.
    """
    steps, often = np.sort(np.abs(np.diff(cells, axis=0)), axis=0), max(RECURS, len(cells) // RARELY)
    known = steps[: max(len(steps) - often + 1, 0)]
    kind = np.float32 if (cells.astype(np.float32) == cells).all() else np.float64
    least = 4.0 * np.finfo(kind).eps * np.abs(cells).max(initial=0.0)
    alike = (steps[often - 1 :] - known <= least) & (known > least)
    found = np.where(alike, known, np.inf).min(axis=0, initial=np.inf)
    if (cells == np.rint(cells)).all() and np.ptp(cells) > 0:
        return np.full(len(found), found.min() if np.isfinite(found).any() else 1.0)
    usual = float(np.median(found[np.isfinite(found)])) if np.isfinite(found).any() else 0.0
    return np.where(np.isfinite(found), found, usual)


@takes_arrays
def falls(cells: Float[np.ndarray, "n k"], rest: Float[np.ndarray, "m k"]) -> bool:
    """Return whether the largest excursions from rest are downward, so that readings fall under load.

    Args:
        cells: (n, k) raw readings.
        rest: (m, k) those that are mostly untouched.

    Raises:
        InputError: arrays of other shapes.
    """
    if len(cells) <= LONE:
        return False
    middle = np.median(rest, axis=0)
    noise = np.maximum(np.median(np.abs(rest - middle), axis=0) / 0.6745, ROUNDING * np.maximum(quantum(rest), 1e-9))
    off = np.sort((cells - middle) / noise, axis=0)
    down, up = float(-off[LONE].min()), float(off[-1 - LONE].max())
    most = np.partition(-off[LONE], -2)[-2] if off.shape[1] > 1 else 0.0  # a lone cell that fails is no load
    loaded = (off < -0.5 * down).mean(axis=0).max()
    return bool(most > FAR and down > FARTHER * up and loaded < SHORT)
