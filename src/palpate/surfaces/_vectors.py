"""Compiled: products of three-vectors and small systems, without a call into BLAS; copies that check no shapes."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner

__all__ = ["copy_into", "cross_into", "dot", "solve_positive"]


@inner
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def cross_into(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inner
def copy_into(values, out):
    """`out[:] = values` of one length: the compiler takes seconds over the message that shapes differ."""
    for k in range(len(out)):
        out[k] = values[k]


@inner
def solve_positive(matrix, right, size, out):
    """Solves matrix out = right by Cholesky's factor, which is left in `matrix`; False: it has none."""
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                matrix[i, i] = np.sqrt(total)
            else:
                matrix[i, j] = total / matrix[j, j]
    for i in range(size):
        total = right[i]
        for k in range(i):
            total -= matrix[i, k] * out[k]
        out[i] = total / matrix[i, i]
    for i in range(size - 1, -1, -1):
        total = out[i]
        for k in range(i + 1, size):
            total -= matrix[k, i] * out[k]
        out[i] = total / matrix[i, i]
    return True
