"""Compiled loop from readings to rows of `estimate.ROW` in one call, with the same steps and bits as for blocks."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.contact._kernel import estimate_many
from palpate.contact._live import filtered, matrix, stack, vector
from palpate.sensors.force_torque._kernels import compensate, place
from palpate.surfaces._jit import entry


@entry(
    """
    inputs 20n, time n, memory m, table int64 14 4, unused 0, clock out 2, past out a 6, noises h 6 6, nodes float32
    k 14 8 | 10 | function, corners p 20 | s 6 | s 6, settings 14, state out 162, rows out n 22
    """
)
def locate(inputs, time, memory, table, unused, clock, past, noises, nodes, corners, settings, state, rows):
    """Compute n rows of estimates from the inputs (20 n,) of n samples at times (n,) [s].

    `Compensation.inputs` lays them out. Noises (1, 6, 6) are used if the sensor's noise is not known; else they are
    (0, 6, 6).
    """
    n = len(rows)
    wrenches, statuses, located = np.empty((n, 6)), np.empty(n, np.int8), np.empty((n, 6))
    rotations, accelerations = inputs[6 * n : 15 * n].reshape((n, 3, 3)), inputs[15 * n : 18 * n].reshape((n, 3))
    load, covariances = vector(memory, table, 1), np.empty((n, 6, 6))
    compensate(
        inputs[: 6 * n].reshape((n, 6)),
        rotations,
        accelerations,
        vector(memory, table, 0),
        load,
        vector(memory, table, 2),
        vector(memory, table, 3)[0] == 1.0,
        wrenches,
        statuses,
    )
    share = filtered(time, statuses, wrenches, clock, past, memory, table, 9)
    place(
        wrenches,
        rotations,
        accelerations,
        inputs[18 * n : 19 * n].reshape((n, 1)),
        inputs[19 * n :].reshape((n, 1)),
        share,
        load,
        matrix(memory, table, 4),
        matrix(memory, table, 5),
        matrix(memory, table, 6),
        matrix(memory, table, 7),
        stack(memory, table, 8),
        located,
        covariances,
    )
    each = noises if len(noises) > 0 else covariances
    estimate_many(located, each, statuses, nodes, corners, settings, state, True, rows)
