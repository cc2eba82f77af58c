"""Compiled: from live readings to rows of `estimate.ROW`, in one call, because each call from Python costs 2 us.

The steps are those of the blocks, and so are the bits. What a sensor is made of comes packed, since every array that
is handed over costs 0.15 us: `memory` holds the arrays that `constants` of the sensor names, one behind the other, and
`table` (k, 4) where each begins and its shape, with ones in front.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.contact._kernel import estimate_many
from palpate.sensors import _compensation, _load_cells
from palpate.surfaces._jit import entry, inner

__all__ = ["force_torque", "load_cells", "packed"]


def packed(arrays: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Arrays of up to three axes as memory and table."""
    sizes = np.array([array.size for array in arrays])
    shapes = [(1,) * (3 - array.ndim) + array.shape for array in arrays]
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    return np.concatenate([array.ravel() for array in arrays]), np.column_stack([starts, shapes]).astype(np.int64)


@inner
def _stack(memory, table, k):
    start, a, b, c = table[k]
    return memory[start : start + a * b * c].reshape((a, b, c))


@inner
def _matrix(memory, table, k):
    return _stack(memory, table, k)[0]


@inner
def _vector(memory, table, k):
    return _stack(memory, table, k)[0, 0]


@entry(
    """
    inputs i, memory m, table int64 11 4, memory_of_blame out b, noises 0 6 6, nodes float32 k 14 8 | 10 |
    function, corners p 20 | s 6 | s 6, settings 14, state out 162, rows out n 22
    """
)
def load_cells(inputs, memory, table, memory_of_blame, noises, nodes, corners, settings, state, rows):
    """Inputs are the voltages (n m,) of n samples; noises (0, 6, 6), for the sensor always knows its own."""
    n = len(rows)
    wrenches, statuses, which = np.empty((n, 6)), np.empty(n, np.int8), np.empty(n, np.int64)
    extra, located, covariances = np.empty((n, 6, 6)), np.empty((n, 6)), np.empty((n, 6, 6))
    _load_cells.measure(
        inputs.reshape((n, len(inputs) // n)),
        _matrix(memory, table, 0),
        _matrix(memory, table, 1),
        _stack(memory, table, 2),
        _stack(memory, table, 3),
        _vector(memory, table, 4),
        _matrix(memory, table, 5),
        memory_of_blame,
        wrenches,
        statuses,
        which,
        extra,
    )
    _load_cells.place(
        wrenches,
        which,
        extra,
        np.ones(1),
        _vector(memory, table, 6)[0],
        _stack(memory, table, 7),
        _matrix(memory, table, 8),
        _matrix(memory, table, 9),
        _matrix(memory, table, 10),
        located,
        covariances,
    )
    estimate_many(located, covariances, statuses, nodes, corners, settings, state, True, rows)


@entry(
    """
    inputs 20n, memory m, table int64 9 4, unused 0, noises h 6 6, nodes float32 k 14 8 | 10 | function, corners p
    20 | s 6 | s 6, settings 14, state out 162, rows out n 22
    """
)
def force_torque(inputs, memory, table, unused, noises, nodes, corners, settings, state, rows):
    """Inputs (20 n,) of n samples, as `Compensation.inputs` lays them out.

    Noises (1, 6, 6) if the sensor knows none, or (0, 6, 6).
    """
    n = len(rows)
    wrenches, statuses, located = np.empty((n, 6)), np.empty(n, np.int8), np.empty((n, 6))
    rotations, accelerations = inputs[6 * n : 15 * n].reshape((n, 3, 3)), inputs[15 * n : 18 * n].reshape((n, 3))
    load, covariances = _vector(memory, table, 1), np.empty((n, 6, 6))
    _compensation.compensate(
        inputs[: 6 * n].reshape((n, 6)),
        rotations,
        accelerations,
        _vector(memory, table, 0),
        load,
        _vector(memory, table, 2),
        _vector(memory, table, 3)[0] == 1.0,
        wrenches,
        statuses,
    )
    _compensation.place(
        wrenches,
        rotations,
        accelerations,
        inputs[18 * n : 19 * n].reshape((n, 1)),
        inputs[19 * n :].reshape((n, 1)),
        np.ones(1),
        load,
        _matrix(memory, table, 4),
        _matrix(memory, table, 5),
        _matrix(memory, table, 6),
        _matrix(memory, table, 7),
        _stack(memory, table, 8),
        located,
        covariances,
    )
    each = noises if len(noises) > 0 else covariances
    estimate_many(located, each, statuses, nodes, corners, settings, state, True, rows)
