"""Compiled: sum the normal equations of every taxel over the lines of force of the pokes to which it responded."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import released


@released("force n 3, torque n 3, starts int64 n+1, taxel int64 a, weights a, sums out k 12")
def accumulate(force, torque, starts, taxel, weights, sums):
    """Add to sums (k, 12): w (I - u u') as xx xy xz yy yz zz, w u x m / |f|, and w u.

    u = f / |f|.

    Pokes (n, 3) [N], [N m] about the origin of the places; answers by `starts`, `taxel`, `weights`.
    """
    line = np.empty(sums.shape[1])
    for i in range(len(force)):
        f, m = force[i], torque[i]
        square = f[0] * f[0] + f[1] * f[1] + f[2] * f[2]
        if not square > 0.0:
            continue
        s = 1.0 / np.sqrt(square)
        x, y, z = f[0] * s, f[1] * s, f[2] * s
        line[0], line[1], line[2] = 1.0 - x * x, -x * y, -x * z
        line[3], line[4], line[5] = 1.0 - y * y, -y * z, 1.0 - z * z
        line[6], line[7], line[8] = s * (y * m[2] - z * m[1]), s * (z * m[0] - x * m[2]), s * (x * m[1] - y * m[0])
        line[9], line[10], line[11] = x, y, z
        for a in range(starts[i], starts[i + 1]):
            j, w = taxel[a], weights[a]
            for c in range(len(line)):  # not 12: a loop of known length becomes scalars, and is no vector any more
                sums[j, c] += w * line[c]
