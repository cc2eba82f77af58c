"""Compiled: a tensor-product B-spline at scattered parameters, its geodesics, and the equations of a fit."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner, released

MOST = 6  # orders (degree + 1) up to quintic


@inner
def _basis(knots, degree, x, out):
    """Compute values, first and second derivatives of the basis functions that are not zero at x into out (3, MOST).

    Return the number of the first. Beyond the knots the polynomials at the end go on.
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


@inner
def _inside(knots, degree, x):
    """Return the nearest parameter of the domain, and the distance from it to x."""
    low, high = knots[degree], knots[len(knots) - degree - 1]
    within = min(max(x, low), high)
    return within, x - within


@inner
def _at(u, v, knots_u, knots_v, degree_u, degree_v, periodic, coefficients, work, out):
    """Compute position, r_u, r_v, r_uu, r_uv, r_vv into out (6, 3); straight beyond an open end. work is (9, MOST)."""
    if periodic:
        low = knots_v[degree_v]
        v = low + np.mod(v - low, knots_v[len(knots_v) - degree_v - 1] - low)
    u, beyond_u = _inside(knots_u, degree_u, u)
    v, beyond_v = _inside(knots_v, degree_v, v)
    bu, bv, rows = work[:3], work[3:6], work[6:]
    first_u = _basis(knots_u, degree_u, u, bu)
    first_v = _basis(knots_v, degree_v, v, bv)
    out[:] = 0.0
    for i in range(degree_u + 1):
        rows[:] = 0.0
        for j in range(degree_v + 1):
            for k in range(3):
                c = coefficients[first_u + i, first_v + j, k]
                rows[0, k] += bv[0, j] * c
                rows[1, k] += bv[1, j] * c
                rows[2, k] += bv[2, j] * c
        for k in range(3):
            out[0, k] += bu[0, i] * rows[0, k]
            out[1, k] += bu[1, i] * rows[0, k]
            out[2, k] += bu[0, i] * rows[1, k]
            out[3, k] += bu[2, i] * rows[0, k]
            out[4, k] += bu[1, i] * rows[1, k]
            out[5, k] += bu[0, i] * rows[2, k]
    if beyond_u != 0.0 or beyond_v != 0.0:
        for k in range(3):
            out[0, k] += beyond_u * out[1, k] + beyond_v * out[2, k] + beyond_u * beyond_v * out[4, k]
            out[1, k] += beyond_v * out[4, k]
            out[2, k] += beyond_u * out[4, k]
            if beyond_u != 0.0:
                out[3, k] = 0.0
            if beyond_v != 0.0:
                out[5, k] = 0.0


@released("uv n 2, knots_u m, knots_v k, degree_u int, degree_v int, periodic bool, coefficients a b 3, out out n 6 3")
def evaluate(uv, knots_u, knots_v, degree_u, degree_v, periodic, coefficients, out):
    """Compute position, r_u, r_v, r_uu, r_uv, r_vv at parameters (n, 2) into out (n, 6, 3)."""
    work = np.empty((9, MOST))
    for n in range(len(uv)):
        _at(uv[n, 0], uv[n, 1], knots_u, knots_v, degree_u, degree_v, periodic, coefficients, work, out[n])


@inner
def _slope(state, knots_u, knots_v, degree_u, degree_v, periodic, coefficients, work, r, out):
    """Compute the derivative of (u, v, u', v', J, J') along a geodesic: no tangential acceleration, J'' = -K J."""
    _at(state[0], state[1], knots_u, knots_v, degree_u, degree_v, periodic, coefficients, work, r)
    du, dv = state[2], state[3]
    n0 = r[1, 1] * r[2, 2] - r[1, 2] * r[2, 1]
    n1 = r[1, 2] * r[2, 0] - r[1, 0] * r[2, 2]
    n2 = r[1, 0] * r[2, 1] - r[1, 1] * r[2, 0]
    e = f = g = a = b = 0.0
    for k in range(3):
        bend = du * du * r[3, k] + 2.0 * du * dv * r[4, k] + dv * dv * r[5, k]
        e += r[1, k] * r[1, k]
        f += r[1, k] * r[2, k]
        g += r[2, k] * r[2, k]
        a += r[1, k] * bend
        b += r[2, k] * bend
    square = e * g - f * f
    uu = r[3, 0] * n0 + r[3, 1] * n1 + r[3, 2] * n2
    uv = r[4, 0] * n0 + r[4, 1] * n1 + r[4, 2] * n2
    vv = r[5, 0] * n0 + r[5, 1] * n1 + r[5, 2] * n2
    out[0], out[1] = du, dv
    out[2], out[3] = -(g * a - f * b) / square, -(e * b - f * a) / square
    out[4], out[5] = state[5], -(uu * vv - uv * uv) / (square * square) * state[4]


@released(
    """
    step float, knots_u m, knots_v k, degree_u int, degree_v int, periodic bool, coefficients a b 3, states out s
    n 6, slopes out s n 6
    """
)
def geodesics(step, knots_u, knots_v, degree_u, degree_v, periodic, coefficients, states, slopes):
    """Compute geodesics from states[0] (n, 6) by Runge-Kutta's fourth in equal steps, and their slopes (s, n, 6)."""
    work, r = np.empty((9, MOST)), np.empty((6, 3))
    y, k2, k3, k4 = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    for m in range(states.shape[1]):
        for s in range(states.shape[0]):
            if s > 0:
                for i in range(6):
                    states[s, m, i] = states[s - 1, m, i] + step / 6.0 * (
                        slopes[s - 1, m, i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]
                    )
            k1 = slopes[s, m]
            _slope(states[s, m], knots_u, knots_v, degree_u, degree_v, periodic, coefficients, work, r, k1)
            for i in range(6):
                y[i] = states[s, m, i] + 0.5 * step * k1[i]
            _slope(y, knots_u, knots_v, degree_u, degree_v, periodic, coefficients, work, r, k2)
            for i in range(6):
                y[i] = states[s, m, i] + 0.5 * step * k2[i]
            _slope(y, knots_u, knots_v, degree_u, degree_v, periodic, coefficients, work, r, k3)
            for i in range(6):
                y[i] = states[s, m, i] + step * k3[i]
            _slope(y, knots_u, knots_v, degree_u, degree_v, periodic, coefficients, work, r, k4)


@released(
    """
    uv n 2, points n 3, directions n 3, knots_u m, knots_v k, degree_u int, degree_v int, starts a b 3, spokes a b
    3, band out p q, vector out p
    """
)
def normal_equations(uv, points, directions, knots_u, knots_v, degree_u, degree_v, starts, spokes, band, vector):
    """Add the equations of points for the offsets s_ij along the lines A_ij + s_ij D_ij to a band matrix and a vector.

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
                if number[b] <= number[a]:
                    band[number[b], number[a] - number[b]] += row[a] * row[b]
