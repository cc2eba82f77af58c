"""Compiled: arrays of a sensor packed into one, for loops that turn live readings into rows in one call.

A call from Python costs 2 us, and every array that is passed 0.15 us. `memory` holds the arrays that the sensor's
`constants` returns, one after the other, and `table` (k, 4) their offsets and shapes, padded with leading ones.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.signals._filters import smooth
from palpate.surfaces._jit import inner


def packed(arrays: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return arrays of up to three axes packed as memory and table."""
    sizes = np.array([array.size for array in arrays])
    shapes = [(1,) * (3 - array.ndim) + array.shape for array in arrays]
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    return np.concatenate([array.ravel() for array in arrays]), np.column_stack([starts, shapes]).astype(np.int64)


@inner
def stack(memory, table, k):
    start, a, b, c = table[k]
    return memory[start : start + a * b * c].reshape((a, b, c))


@inner
def matrix(memory, table, k):
    return stack(memory, table, k)[0]


@inner
def vector(memory, table, k):
    return stack(memory, table, k)[0, 0]


@inner
def filtered(time, statuses, wrenches, clock, past, memory, table, k):
    """Filter wrenches (n, 6) in place, and return the share of their noise that remains, (n,) or (1,).

    From array k on, `memory` holds the sections, start, gains, gap and shares of a `Forward`; no shares: no filter.
    """
    shares = vector(memory, table, k + 4)
    if len(shares) == 0:
        return np.ones(1)
    age = np.empty(len(time), np.int64)
    parts = matrix(memory, table, k), matrix(memory, table, k + 1), vector(memory, table, k + 2)
    smooth(time, statuses, wrenches, *parts, vector(memory, table, k + 3)[0], clock, past, age)
    return shares[np.minimum(age, len(shares) - 1)]
