"""Compiled loop from voltages to rows of `estimate.ROW` in one call, with the same steps and bits as for blocks."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.contact._kernel import estimate_many
from palpate.contact._live import filtered, matrix, stack, vector
from palpate.sensors.load_cells._kernels import measure, place
from palpate.surfaces._jit import entry


@entry(
    """
    inputs i, time n, memory m, table int64 16 4, memory_of_blame out b, clock out 2, past out a 6, noises 0 6 6, nodes
    float32 k 14 8 | 10 | function, corners p 20 | s 6 | s 6, settings 14, state out 162, rows out n 22
    """
)
def locate(inputs, time, memory, table, memory_of_blame, clock, past, noises, nodes, corners, settings, state, rows):
    """Compute n rows of estimates from voltages (n m,) of n samples at times (n,) [s]; noises (0, 6, 6)."""
    n = len(rows)
    wrenches, statuses, which = np.empty((n, 6)), np.empty(n, np.int8), np.empty(n, np.int64)
    extra, located, covariances = np.empty((n, 6, 6)), np.empty((n, 6)), np.empty((n, 6, 6))
    measure(
        inputs.reshape((n, len(inputs) // n)),
        matrix(memory, table, 0),
        matrix(memory, table, 1),
        stack(memory, table, 2),
        stack(memory, table, 3),
        vector(memory, table, 4),
        matrix(memory, table, 5),
        memory_of_blame,
        wrenches,
        statuses,
        which,
        extra,
    )
    share = filtered(time, statuses, wrenches, clock, past, memory, table, 11)
    place(
        wrenches,
        which,
        extra,
        share,
        vector(memory, table, 6)[0],
        stack(memory, table, 7),
        matrix(memory, table, 8),
        matrix(memory, table, 9),
        matrix(memory, table, 10),
        located,
        covariances,
    )
    estimate_many(located, covariances, statuses, nodes, corners, settings, state, True, rows)
