"""Compiled: symmetric positive band systems in one thread; BLAS's threads wait for each other on a busy computer."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import released


@released("band out n m, vector out n")
def solve_band(band, vector):
    """Solve A x = b in place by Cholesky: band (n, w) contains A[j + k, j] at [j, k], vector b and then x.

    Return False where A is not positive definite.
    """
    n, w = band.shape
    for j in range(n):
        pivot = band[j, 0]
        if not pivot > 0.0:
            return False
        reach = min(w, n - j)
        for i in range(1, reach):
            factor = band[j, i] / pivot
            if factor != 0.0:
                target, source = band[j + i], band[j, i:]
                for k in range(reach - i):
                    target[k] -= factor * source[k]
                vector[j + i] -= factor * vector[j]
    for j in range(n - 1, -1, -1):
        rest = vector[j]
        for i in range(1, min(w, n - j)):
            rest -= band[j, i] * vector[j + i]
        vector[j] = rest / band[j, 0]
    return bool(np.isfinite(vector).all())
