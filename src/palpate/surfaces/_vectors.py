"""Compiled: products of three-vectors and small systems, without a call into BLAS; copies that check no shapes."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner


@inner
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def cross_into(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inner
def rotation_into(quaternion, out):
    """Write the rotation matrix of a quaternion x, y, z, w into out (3, 3); NaN of a length that is far from 1."""
    q, r = quaternion, out
    length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if not 0.5 < length < 2.0:
        length = np.nan
    x, y, z, w = q[0] / length, q[1] / length, q[2] / length, q[3] / length
    xx, yy, zz = 2.0 * x * x, 2.0 * y * y, 2.0 * z * z
    r[0, 0], r[1, 1], r[2, 2] = 1.0 - yy - zz, 1.0 - zz - xx, 1.0 - xx - yy
    r[1, 2], r[2, 1] = 2.0 * y * z - 2.0 * x * w, 2.0 * y * z + 2.0 * x * w
    r[2, 0], r[0, 2] = 2.0 * z * x - 2.0 * y * w, 2.0 * z * x + 2.0 * y * w
    r[0, 1], r[1, 0] = 2.0 * x * y - 2.0 * z * w, 2.0 * x * y + 2.0 * z * w


@inner
def copy_into(values, out):
    """Copy `values` into `out` of one length; `out[:] = values` costs seconds to compile, for its error message."""
    for k in range(len(out)):
        out[k] = values[k]


@inner
def tangents(n, out):
    """Write two unit vectors across n, right-handed with it (Duff et al. 2017), into out (2, 3)."""
    sign = 1.0 if n[2] >= 0.0 else -1.0
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    out[0, 0], out[0, 1], out[0, 2] = 1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]
    out[1, 0], out[1, 1], out[1, 2] = b, sign + n[1] * n[1] * a, -n[1]


@inner
def solve_positive(matrix, right, size, out):
    """Solve matrix out = right by Cholesky's factor, which stays in `matrix`; return False where there is none."""
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
