"""Compiled: a tensor-product B-spline and its derivatives at scattered parameters."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inner

__all__ = ["evaluate", "normal_equations"]

MOST = 6  # orders (degree + 1) up to quintic


@inner
def _basis(knots, degree, x, out):
    """Values, first and second derivatives of the basis functions that are not zero at x into out (3, MOST).

    Returns the number of the first. Beyond the knots the polynomials at the end go on.
    """
    low, high = degree, len(knots) - degree - 2
    while low < high:
        middle = (low + high + 1) // 2
        if knots[middle] <= x:
            low = middle
        else:
            high = middle - 1
    out[:] = 0.0
    out[0, 0] = 1.0
    for p in range(1, degree + 1):  # N_(i,p) from N_(i,p-1), and the derivatives of both sides [deboor]
        for r in range(p, -1, -1):
            i = low - p + r
            value = first = second = 0.0
            if r > 0:
                width = knots[i + p] - knots[i]
                rise = (x - knots[i]) / width
                value = rise * out[0, r - 1]
                first = rise * out[1, r - 1] + out[0, r - 1] / width
                second = rise * out[2, r - 1] + 2.0 * out[1, r - 1] / width
            if r < p:
                width = knots[i + p + 1] - knots[i + 1]
                fall = (knots[i + p + 1] - x) / width
                value += fall * out[0, r]
                first += fall * out[1, r] - out[0, r] / width
                second += fall * out[2, r] - 2.0 * out[1, r] / width
            out[0, r], out[1, r], out[2, r] = value, first, second
    return low - degree


@entry
def evaluate(uv, knots_u, knots_v, degree_u, degree_v, coefficients, out):
    """Position, r_u, r_v, r_uu, r_uv, r_vv at (n, 2) parameters into out (n, 6, 3)."""
    bu, bv = np.empty((3, MOST)), np.empty((3, MOST))
    rows = np.empty((3, 3))
    for n in range(len(uv)):
        first_u = _basis(knots_u, degree_u, uv[n, 0], bu)
        first_v = _basis(knots_v, degree_v, uv[n, 1], bv)
        out[n] = 0.0
        for i in range(degree_u + 1):
            rows[:] = 0.0
            for j in range(degree_v + 1):
                for k in range(3):
                    c = coefficients[first_u + i, first_v + j, k]
                    rows[0, k] += bv[0, j] * c
                    rows[1, k] += bv[1, j] * c
                    rows[2, k] += bv[2, j] * c
            for k in range(3):
                out[n, 0, k] += bu[0, i] * rows[0, k]
                out[n, 1, k] += bu[1, i] * rows[0, k]
                out[n, 2, k] += bu[0, i] * rows[1, k]
                out[n, 3, k] += bu[2, i] * rows[0, k]
                out[n, 4, k] += bu[1, i] * rows[1, k]
                out[n, 5, k] += bu[0, i] * rows[2, k]


@entry
def normal_equations(
    uv, points, directions, knots_u, knots_v, degree_u, degree_v, starts, spokes, matrix, vector
):
    """Adds what points ask of the offsets s_ij along the lines A_ij + s_ij D_ij to matrix and vector.

    A row for each point Q: the sum over ij of N_i M_j (d . D_ij) s_ij = d . (Q - sum N_i M_j A_ij).
    Lines (n, m, 3) that a periodic v needs again are counted from the first.
    """
    bu, bv = np.empty((3, MOST)), np.empty((3, MOST))
    columns = starts.shape[1]
    size = (degree_u + 1) * (degree_v + 1)
    number, row = np.empty(size, dtype=np.int64), np.empty(size)
    for n in range(len(uv)):
        first_u = _basis(knots_u, degree_u, uv[n, 0], bu)
        first_v = _basis(knots_v, degree_v, uv[n, 1], bv)
        d, right = directions[n], 0.0
        for k in range(3):
            right += d[k] * points[n, k]
        a = 0
        for i in range(degree_u + 1):
            for j in range(degree_v + 1):
                at = (first_v + j) % columns
                start, spoke = starts[first_u + i, at], spokes[first_u + i, at]
                share = bu[0, i] * bv[0, j]
                right -= share * (d[0] * start[0] + d[1] * start[1] + d[2] * start[2])
                row[a] = share * (d[0] * spoke[0] + d[1] * spoke[1] + d[2] * spoke[2])
                number[a] = (first_u + i) * columns + at
                a += 1
        for a in range(size):
            vector[number[a]] += row[a] * right
            for b in range(size):
                matrix[number[a], number[b]] += row[a] * row[b]
