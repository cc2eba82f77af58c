"""Compiled: distance from a wrench to the nearest that a contact within the friction and torsion bounds can make."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.contact._settings import FRICTION, SOFT, TORSION
from palpate.contact._slopes import sandwich, sensitivity, to_metres, to_unit
from palpate.surfaces._bvh import CANDIDATE, CAPACITY, room
from palpate.surfaces._jit import inner
from palpate.surfaces._kernels import search_in
from palpate.surfaces._vectors import copy_into, cross_into, dot, tangents

_STEPS = 30  # of the search for the nearest wrench within the bounds


@inner
def _solve_two(matrix, right, count):
    """Return right^T matrix^-1 right and the solution, for one or two equations; (-1, 0, 0) when singular."""
    if count == 1:
        if matrix[0, 0] <= 0.0:
            return -1.0, 0.0, 0.0
        x = right[0] / matrix[0, 0]
        return right[0] * x, x, 0.0
    det = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
    if det <= 1e-14 * matrix[0, 0] * matrix[1, 1] or det <= 0.0:
        return -1.0, 0.0, 0.0
    x = (matrix[1, 1] * right[0] - matrix[0, 1] * right[1]) / det
    y = (matrix[0, 0] * right[1] - matrix[1, 0] * right[0]) / det
    return right[0] * x + right[1] * y, x, y


@inner
def _bounds(wrench, place, t, shape, slopes, settings, values, rows):
    """Write tan(theta) - mu and |tau| - c |F . n| into values (2,), and their slopes by the wrench into rows (2, 6)."""
    force, moment, n = wrench[:3], wrench[3:], place[3:]
    size = np.sqrt(dot(force, force))
    pressing = dot(force, n)
    cosine = -pressing / size
    sine = np.sqrt(max(1e-300, 1.0 - cosine * cosine))
    tau = dot(force, moment) / pressing
    values[0] = sine / cosine - settings[FRICTION]
    values[1] = abs(tau) - settings[TORSION] * abs(pressing)
    sign = 1.0 if tau >= 0.0 else -1.0
    turn = np.zeros(6)  # F . dn
    for k in range(6):
        for i in range(2):
            dn = shape[i, 0] * slopes[0, k] + shape[i, 1] * slopes[1, k]
            turn[k] += dot(force, t[i]) * dn
    for k in range(6):
        dpress = turn[k] + (n[k] if k < 3 else 0.0)
        dsize = force[k] / size if k < 3 else 0.0
        dcos = -dpress / size - cosine * dsize / size
        rows[0, k] = -dcos / (cosine * cosine * sine)
        dboth = moment[k] if k < 3 else force[k - 3]
        rows[1, k] = sign * (dboth - tau * dpress) / pressing + settings[TORSION] * dpress


@inner
def inverse(matrix):
    """Return the inverse of a covariance by Gauss-Jordan elimination; NaN if it has none."""
    size = len(matrix)
    work, out = matrix.copy(), np.eye(size)
    for i in range(size):
        pivot = work[i, i]
        if not pivot > 0.0:
            out[:] = np.nan
            return out
        for k in range(size):
            work[i, k] /= pivot
            out[i, k] /= pivot
        for j in range(size):
            factor = work[j, i]
            if j != i and factor != 0.0:
                for k in range(size):
                    work[j, k] -= factor * work[i, k]
                    out[j, k] -= factor * out[i, k]
    return out


@inner
def _allowed(wrench, place, settings, out):
    """Write a wrench near this one that a contact within the bounds makes at this point; False if it only pulls."""
    force, n = wrench[:3], place[3:]
    mu, normal = settings[FRICTION], -dot(force, n)
    side = np.empty(3)
    for k in range(3):
        side[k] = force[k] + normal * n[k]
    slip = np.sqrt(dot(side, side))
    grip = normal
    if slip > mu * normal:  # onto the friction cone, along the shortest way
        grip = (normal + mu * slip) / (1.0 + mu * mu)
        if grip <= 0.0:
            return False
    keep = 1.0 if slip <= mu * normal else mu * grip / slip
    for k in range(3):
        out[k] = keep * side[k] - grip * n[k]
    cross_into(place[:3], out[:3], out[3:])
    cross_into(place[:3], force, side)
    tau = dot(wrench[3:], n) - dot(side, n)
    most = settings[TORSION] * grip
    tau = min(most, max(-most, tau))
    for k in range(3):
        out[3 + k] += tau * n[k]
    return True


@inner
def _metric(a, b, inverse):
    """Return sqrt((a - b)' inverse (a - b))."""
    total = 0.0
    for i in range(6):
        for j in range(6):
            total += (a[i] - b[i]) * inverse[i, j] * (a[j] - b[j])
    return np.sqrt(max(0.0, total))


@inner
def distance_to_bounds(wrench, noise, nodes, corners, settings, first, place, nearest):
    """Return the distance, in the metric of `noise`, from a wrench to the nearest of a contact within the bounds.

    The point and normal of that contact are written into `nearest` (6,); NaN is returned if there is none.

    The point is a function of the wrench, so the bounds are two functions g(W), and the nearest W' with
    g(W') <= 0 is found by the damped iteration of Hasofer, Lind, Rackwitz and Fiessler,
    y <- S A' (A S A')^-1 (A y - g).
    Every step also gives a contact within the bounds; the nearest of those is returned, so that a contact
    really attains the distance; if the iteration does not converge (on facets g jumps) it is rather too large.
    """
    t, shape, slopes = np.empty((2, 3)), np.empty((2, 2)), np.empty((2, 6))
    values, rows, active = np.empty(2), np.empty((2, 6)), np.zeros((2, 6))
    right, near = np.empty(2), np.empty(6)
    current, unit, spot = wrench.copy(), np.empty(6), place.copy()
    found, candidate, free = np.empty((CAPACITY + 1, CANDIDATE)), first.copy(), room()
    metric = inverse(noise)
    best, step_size = np.inf, 1.0
    use0 = use1 = False
    for step in range(_STEPS):
        if step > 0:
            to_unit(current, settings, unit)
            count = search_in(unit, settings[SOFT], 0.5 + 2.0 * candidate[4], nodes, corners, found, free)
            if count == 0:
                break
            chosen = 0
            for i in range(1, count):
                if found[i, 4] < found[chosen, 4]:
                    chosen = i
            copy_into(found[chosen], candidate)
            to_metres(candidate, settings, spot)
        if _allowed(current, spot, settings, near):
            distance = _metric(wrench, near, metric)
            if distance > 0.999 * best:
                step_size *= 0.5
            if distance < best:
                best = distance
                copy_into(spot, nearest)
            if step_size < 0.1:
                break
        if not sensitivity(current, candidate, spot, nodes, corners, settings, t, shape, slopes):
            break
        _bounds(current, spot, t, shape, slopes, settings, values, rows)
        use0, use1 = use0 or values[0] > 0.0, use1 or values[1] > 0.0
        count = 0
        for i in range(2):
            if (i == 0 and use0) or (i == 1 and use1):
                copy_into(rows[i], active[count])
                right[count] = -values[i]
                for k in range(6):
                    right[count] += rows[i, k] * (current[k] - wrench[k])
                count += 1
        square, x, y = _solve_two(sandwich(active[:count], noise, active[:count]), right, count)
        if square < 0.0:
            break
        for k in range(6):
            target = wrench[k]
            for m in range(6):
                target += noise[k, m] * (active[0, m] * x + (active[1, m] * y if count == 2 else 0.0))
            current[k] += step_size * (target - current[k])
        if dot(current[:3], current[:3]) == 0.0:
            break
    return best if best < np.inf else np.nan


@inner
def distance_to_point(wrench, noise, place):
    """Return the distance from a wrench to the nearest that a soft finger at a point can make; NaN if degenerate."""
    t, work, rows, right = np.empty((2, 3)), np.empty(3), np.empty((2, 6)), np.empty(2)
    tangents(place[3:], t)
    for a in range(2):
        cross_into(t[a], place[:3], work)
        for k in range(3):
            rows[a, k], rows[a, 3 + k] = -work[k], t[a, k]
        right[a] = 0.0
        for k in range(6):
            right[a] += rows[a, k] * wrench[k]
    square, _, _ = _solve_two(sandwich(rows, noise, rows), right, 2)
    return np.sqrt(square) if square >= 0.0 else np.nan
