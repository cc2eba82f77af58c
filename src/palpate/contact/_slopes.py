"""Compiled: compute the change of a located point with the wrench.

A contact at p with unit normal n and torsion tau satisfies M - p x F - tau n = 0 with tau = F . M/(F . n).
Differentiated along the surface, dn = S dp with S the shape operator, and projected on two tangents t_a:

    (F . n) J dp - tau S dp = t . (-dM + p x dF),   J = [[0, -1], [1, 0]],

so dp/dW is a 2 x 2 solve, and the covariance of p is that of W carried through it: rank 2, in the tangent plane. On
facets, edges and corners S is 0: there the plane across n replaces the surface, and the covariance is rather too wide.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.contact._settings import CENTRE, DEPTH, EXPONENT, SCALE, SOFT
from palpate.surfaces._jit import inner
from palpate.surfaces._kernels import shape_operator
from palpate.surfaces._vectors import cross_into, dot, tangents


@inner
def slopes_at(wrench, place, t, shape, soft, slopes):
    """Write d(p . t)/dW into slopes (2, 6); return False if the wrench does not determine the point.

    For the wrench axis (soft = 0) the remaining moment is along F instead of n: the same equations, projected across F
    instead of across n, with the pitch in place of tau S.
    """
    # Numbers instead of parts of arrays: each part would count its references, which takes longer than the arithmetic.
    fx, fy, fz = wrench[0], wrench[1], wrench[2]
    square = fx * fx + fy * fy + fz * fz
    along = fx * wrench[3] + fy * wrench[4] + fz * wrench[5]
    across = t
    tau, pitch = 0.0, 0.0
    if soft == 1.0:
        tau = along / (fx * place[3] + fy * place[4] + fz * place[5])
    else:
        across = np.empty((2, 3))
        tangents(wrench[:3] / np.sqrt(square), across)
        pitch = along / square
    for a in range(2):
        ax, ay, az = across[a, 0], across[a, 1], across[a, 2]
        slopes[a, 0] = ay * place[2] - az * place[1] + pitch * ax  # t . (p x dF) = (t x p) . dF
        slopes[a, 1] = az * place[0] - ax * place[2] + pitch * ay
        slopes[a, 2] = ax * place[1] - ay * place[0] + pitch * az
        slopes[a, 3], slopes[a, 4], slopes[a, 5] = -ax, -ay, -az
    g00 = _turned(fx, fy, fz, across, 0, t, 0) - soft * tau * shape[0, 0]
    g01 = _turned(fx, fy, fz, across, 0, t, 1) - soft * tau * shape[0, 1]
    g10 = _turned(fx, fy, fz, across, 1, t, 0) - soft * tau * shape[1, 0]
    g11 = _turned(fx, fy, fz, across, 1, t, 1) - soft * tau * shape[1, 1]
    det = g00 * g11 - g01 * g10
    if abs(det) < 1e-14 * square:
        return False
    for k in range(6):
        first, second = slopes[0, k], slopes[1, k]
        slopes[0, k] = (g11 * first - g01 * second) / det
        slopes[1, k] = (g00 * second - g10 * first) / det
    return True


@inner
def _turned(fx, fy, fz, across, a, t, c):
    """Return row a of `across` times F x (row c of t)."""
    x, y, z = fy * t[c, 2] - fz * t[c, 1], fz * t[c, 0] - fx * t[c, 2], fx * t[c, 1] - fy * t[c, 0]
    return across[a, 0] * x + across[a, 1] * y + across[a, 2] * z


@inner
def sandwich(left, middle, right):
    """Return left (i, 6) middle (6, 6) right (j, 6)^T in a new array (i, j)."""
    out = np.empty((len(left), len(right)))
    sandwich_into(left, middle, right, out)
    return out


@inner
def sandwich_into(left, middle, right, out):
    """Write left (i, 6) middle (6, 6) right (j, 6)^T into out (i, j); small matrices, so without BLAS."""
    for i in range(len(left)):
        for j in range(len(right)):
            out[i, j] = 0.0
        for k in range(6):
            half = 0.0
            for m in range(6):
                half += left[i, m] * middle[m, k]
            for j in range(len(right)):
                out[i, j] += half * right[j, k]


@inner
def softened(force, n, t, shape, settings, slopes):
    """Change slopes G (2, 6) by the wrench at the surface into those by the measured wrench W, under a soft layer.

    W' = W + h with h = (0, d n x F), d = depth |F . n|^exponent, where n changes with the point: dn = S dp. So
    dp = G (dW + h_W dW + h_p dp) = (1 - G h_p)^-1 G (1 + h_W) dW.
    """
    work, arm, turn = np.empty(3), np.empty(3), np.empty(3)
    pressing = -dot(force, n)
    depth = settings[DEPTH] * abs(pressing) ** settings[EXPONENT]
    rate = settings[EXPONENT] * depth / pressing
    cross_into(n, force, arm)
    g = np.eye(2)
    for j in range(2):
        for k in range(3):
            turn[k] = shape[0, j] * t[0, k] + shape[1, j] * t[1, k]
        cross_into(turn, force, work)
        for a in range(2):
            for k in range(3):
                g[a, j] -= slopes[a, 3 + k] * (depth * work[k] - rate * dot(force, turn) * arm[k])
    for a in range(2):
        moment = slopes[a, 3:]
        along = dot(moment, arm)
        cross_into(moment, n, work)  # m . (n x dF) = (m x n) . dF
        for k in range(3):
            slopes[a, k] += depth * work[k] - rate * along * n[k]
    det = g[0, 0] * g[1, 1] - g[0, 1] * g[1, 0]
    for k in range(6):
        first, second = slopes[0, k], slopes[1, k]
        slopes[0, k] = (g[1, 1] * first - g[0, 1] * second) / det
        slopes[1, k] = (g[0, 0] * second - g[1, 0] * first) / det


@inner
def to_metres(candidate, settings, place):
    """Write point p [m] and normal n of a candidate into place (6,)."""
    for k in range(3):
        place[k] = candidate[8 + k] * settings[SCALE] + settings[CENTRE + k]
        place[3 + k] = candidate[11 + k]


@inner
def to_unit(wrench, settings, out):
    """Write the wrench about the tree's centre, in the tree's unit size, into out (6,)."""
    cross_into(settings[CENTRE : CENTRE + 3], wrench[:3], out[3:])
    for k in range(3):
        out[k] = wrench[k]
        out[3 + k] = (wrench[3 + k] - out[3 + k]) / settings[SCALE]


@inner
def sensitivity(wrench, candidate, place, nodes, corners, settings, t, shape, slopes):
    """Write tangents, shape operator and slopes of a candidate; return False if the point is not determined."""
    tangents(place[3:], t)
    if settings[SOFT] == 1.0:
        shape_operator(candidate, t, settings[SCALE], nodes, corners, shape)
    else:
        shape[:] = 0.0
    return slopes_at(wrench, place, t, shape, settings[SOFT], slopes)
