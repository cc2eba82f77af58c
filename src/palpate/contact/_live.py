"""Compiled: arrays of a sensor packed into one, for loops that turn live readings into rows in one call.

A call from Python costs 2 us, and every array that is passed 0.15 us. `memory` holds the arrays that the sensor's
`constants` returns, one after the other, and `table` (k, 4) their offsets and shapes, padded with leading ones.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

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
