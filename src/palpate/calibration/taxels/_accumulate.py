"""Compiled: the normal equations of every taxel, from the lines of force of the pokes that it answered to."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry

__all__ = ["accumulate"]


@entry
def accumulate(force, torque, starts, taxel, weights, matrix, vector, pressing):
    """Adds w (I - u u') to matrix (k, 6: xx xy xz yy yz zz), w u x m / |f| to vector and w u to pressing (k, 3).

    u = f / |f|.

    Pokes (n, 3) [N], [N m] about the origin in which places are wanted; answers by `starts`, `taxel`, `weights`.
    """
    line = np.empty(9)
    for i in range(len(force)):
        f, m = force[i], torque[i]
        square = f[0] * f[0] + f[1] * f[1] + f[2] * f[2]
        if not square > 0.0:
            continue
        size = np.sqrt(square)
        line[0], line[1], line[2] = 1.0 - f[0] * f[0] / square, -f[0] * f[1] / square, -f[0] * f[2] / square
        line[3], line[4], line[5] = 1.0 - f[1] * f[1] / square, -f[1] * f[2] / square, 1.0 - f[2] * f[2] / square
        line[6] = (f[1] * m[2] - f[2] * m[1]) / square
        line[7] = (f[2] * m[0] - f[0] * m[2]) / square
        line[8] = (f[0] * m[1] - f[1] * m[0]) / square
        for a in range(starts[i], starts[i + 1]):
            j, w = taxel[a], weights[a]
            for c in range(6):
                matrix[j, c] += w * line[c]
            for c in range(3):
                vector[j, c] += w * line[6 + c]
                pressing[j, c] += w * f[c] / size
