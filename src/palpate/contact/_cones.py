"""Compiled: how far a wrench is from those that a contact at a sharp edge or corner within the bounds can make.

For a given normal n those wrenches are a cone: some linear equations and inequalities (`_edge_rows`, `_corner_rows`),
the friction |F| <= -sqrt(1 + mu^2) F . n, and the torsion |F . M| <= c (F . n)^2, as tau = F . M/(F . n). The nearest
of them in the metric of S is found by linearising the last two and solving for the multipliers one by one (Hildreth
1957); over the normals of an edge or of a corner it is searched.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.contact._edges import MOST, edges_of, near_previous, read_edge
from palpate.contact._settings import CENTRE, FRICTION, SCALE, TORSION
from palpate.contact._slopes import sandwich, tangents
from palpate.surfaces._bvh import KIND
from palpate.surfaces._edges import SHARP
from palpate.surfaces._jit import chosen_for, inner
from palpate.surfaces._kernels import is_mesh
from palpate.surfaces._patches import VERTEX
from palpate.surfaces._vectors import copy_into, cross_into, dot

__all__ = ["distance_to_edges"]

_ROWS = 5  # three of an edge at most, friction, torsion
_STEPS, _SWEEPS = 12, 60
_SAME = 2e-3  # distances that the search cannot tell apart
_UNBOUND = 1e3  # of the body's size: a torsion that no contact has, in the place of an infinite bound
_GOLDEN = 0.3819660112501051
_TRIED, _NARROWED = 5, 10  # normals of a fan, and how often the best of them is narrowed
_SEARCHED = 16  # edges and corners, the likeliest first
_HALVED = 9  # how often a step over a corner's normals is halved


@inner
def _moment_row(axis, point, out):
    """The moment about an axis through a point: axis . (M - p x F) = out . W."""
    cross_into(point, axis, out[:3])
    for k in range(3):
        out[3 + k] = axis[k]


@inner
def _bounds_at(w, n, settings, rows, values):
    """Friction and torsion at w: their slopes into the last two rows, their values into the last two of `values`."""
    size, wide = np.sqrt(dot(w[:3], w[:3])), np.sqrt(1.0 + settings[FRICTION] ** 2)
    pressing, both = dot(w[:3], n), dot(w[:3], w[3:])
    sign, c = 1.0 if both >= 0.0 else -1.0, min(settings[TORSION], _UNBOUND * settings[SCALE])
    values[3] = (size + wide * pressing) / size
    values[4] = (sign * both - c * pressing * pressing) / size
    for k in range(3):
        rows[3, k], rows[3, 3 + k] = (w[k] / size + wide * n[k]) / size, 0.0
        rows[4, k] = (sign * w[3 + k] - 2.0 * c * pressing * n[k]) / size
        rows[4, 3 + k] = sign * w[k] / size


@inner
def _nearest_at(wrench, noise, n, rows, linear, equal, settings, near):
    """Distance to the cone of a normal; the nearest wrench into near (6,).

    Rows (5, 6): the first `equal` are zero, those up to `linear` not positive; the last two are friction and torsion.
    """
    values, lift, bound = np.zeros(_ROWS), np.zeros(_ROWS), np.empty(_ROWS)
    copy_into(wrench, near)
    distance = np.inf
    for _ in range(_STEPS):
        _bounds_at(near, n, settings, rows, values)
        gram = sandwich(rows, noise, rows)
        for j in range(_ROWS):  # rows . (W' - wrench) <= bound
            bound[j] = -values[j]
            for k in range(6):
                bound[j] += rows[j, k] * (near[k] if j >= 3 else 0.0) - rows[j, k] * wrench[k]
        for _ in range(_SWEEPS):
            change = 0.0
            for j in range(_ROWS):
                if (j >= linear and j < 3) or gram[j, j] <= 0.0:
                    continue
                short = bound[j]
                for k in range(_ROWS):
                    short += gram[j, k] * lift[k]
                trial = lift[j] - short / gram[j, j]
                if j >= equal:
                    trial = max(0.0, trial)
                change = max(change, abs(trial - lift[j]) * np.sqrt(gram[j, j]))
                lift[j] = trial
            if change < 1e-4:
                break
        square = 0.0
        for j in range(_ROWS):
            for k in range(_ROWS):
                square += lift[j] * gram[j, k] * lift[k]
        for i in range(6):
            near[i] = wrench[i]
            for j in range(6):
                for k in range(_ROWS):
                    near[i] -= noise[i, j] * rows[k, j] * lift[k]
        before, distance = distance, np.sqrt(max(0.0, square))
        if abs(before - distance) < 1e-3 * distance + 1e-3 or dot(near[:3], near[:3]) == 0.0:
            break
    return distance


@inner
def _at_normal(wrench, noise, line, turn, settings, rows, near, n):
    """Distance to the contacts of an edge with one normal of its fan."""
    u = np.empty(3)
    for k in range(3):
        n[k] = np.cos(turn) * line[7 + k] + np.sin(turn) * line[10 + k]
        u[k] = np.cos(turn) * line[10 + k] - np.sin(turn) * line[7 + k]
    _moment_row(line[3:6], line[:3], rows[0])
    _moment_row(u, line[:3], rows[1])  # (F . n) s
    for k in range(6):
        rows[2, k] = -rows[1, k] + (line[6] * n[k] if k < 3 else 0.0)
    return _nearest_at(wrench, noise, n, rows, 3, 1, settings, near)


@inner
def _off_edge(wrench, noise, row, settings):
    """No contact of an edge is nearer than this: its moment about the edge is zero."""
    line, g = np.empty(14), np.empty((1, 6))
    read_edge(row, settings, line)
    _moment_row(line[3:6], line[:3], g[0])
    return abs(dot(g[0, :3], wrench[:3]) + dot(g[0, 3:], wrench[3:])) / np.sqrt(sandwich(g, noise, g)[0, 0])


@inner
def _off_corner(wrench, noise, row, settings):
    """No contact of a corner is nearer than about this.

    The moment there is tau n, |tau| <= c |F|: what of it lies across the mean of the normals is c |F| sin(their angle)
    at most.
    """
    point, mean, moment, g = np.empty(3), np.empty(3), np.empty(3), np.empty((1, 6))
    length = 0.0
    for k in range(3):
        point[k] = row[k] * settings[SCALE] + settings[CENTRE + k]
        mean[k] = row[3 + k] + row[9 + k] + row[15 + k]
        length += mean[k] ** 2
    cross_into(point, wrench[:3], moment)
    widest = 1.0
    for k in range(3):
        mean[k] /= np.sqrt(length)
        moment[k] = wrench[3 + k] - moment[k]
    for i in range(3):
        widest = min(widest, dot(mean, row[3 + 6 * i : 6 + 6 * i]))
    along, across = dot(moment, mean), 0.0
    for k in range(3):
        moment[k] -= along * mean[k]
        across += moment[k] ** 2
    across = np.sqrt(across)
    if not across > 0.0:
        return 0.0
    for k in range(3):
        moment[k] /= across
    _moment_row(moment, point, g[0])
    twist = min(settings[TORSION], _UNBOUND * settings[SCALE]) * np.sqrt(dot(wrench[:3], wrench[:3]))
    twist *= np.sqrt(1.0 - min(1.0, max(0.0, widest)) ** 2)
    return max(0.0, across - twist) / np.sqrt(sandwich(g, noise, g)[0, 0])


@inner
def _to_edge(wrench, noise, row, settings, most, rows, near, n, place):
    """Distance to the contacts of an edge, and the nearest of them into place (6,), where that is less than `most`."""
    line = np.empty(14)
    read_edge(row, settings, line)
    best, at, step = np.inf, 0.0, line[13] / (_TRIED - 1)
    for i in range(_TRIED):
        distance = _at_normal(wrench, noise, line, i * step, settings, rows, near, n)
        if distance < best:
            best, at = distance, i * step
    if best > 1.5 * most + 1.0:
        return np.inf
    low, high = max(0.0, at - step), min(line[13], at + step)
    left, right = low + _GOLDEN * (high - low), high - _GOLDEN * (high - low)
    one = _at_normal(wrench, noise, line, left, settings, rows, near, n)
    two = _at_normal(wrench, noise, line, right, settings, rows, near, n)
    for _ in range(_NARROWED):
        if min(one, two) < best:
            best, at = min(one, two), left if one < two else right
        if one < two:
            high, right, two = right, left, one
            left = low + _GOLDEN * (high - low)
            one = _at_normal(wrench, noise, line, left, settings, rows, near, n)
        else:
            low, left, one = left, right, two
            right = high - _GOLDEN * (high - low)
            two = _at_normal(wrench, noise, line, right, settings, rows, near, n)
    best = _at_normal(wrench, noise, line, at, settings, rows, near, n)
    pressing, along = dot(near[:3], n), 0.0
    for k in range(6):
        along += rows[1, k] * near[k]
    along = min(line[6], max(0.0, along / pressing)) if pressing < 0.0 else 0.0
    for k in range(3):
        place[k], place[3 + k] = line[k] + along * line[3 + k], n[k]
    return best


@inner
def _at_weights(wrench, noise, row, a, b, point, settings, rows, near, n):
    """Distance to the contacts of a corner with the normal at weights a, b of its patch; inf outside."""
    if a < -1e-12 or b < -1e-12 or a + b > 1.0 + 1e-12:
        return np.inf
    t, length = np.empty((2, 3)), 0.0
    for k in range(3):
        n[k] = a * row[3 + k] + b * row[9 + k] + (1.0 - a - b) * row[15 + k]
        length += n[k] * n[k]
    for k in range(3):
        n[k] /= np.sqrt(length)
    tangents(n, t)
    _moment_row(t[0], point, rows[0])
    _moment_row(t[1], point, rows[1])
    return _nearest_at(wrench, noise, n, rows, 2, 2, settings, near)


@inner
def _to_corner(wrench, noise, row, settings, most, rows, near, n, place):
    """Distance to the contacts of a corner, and the nearest of them into place (6,), where that is less than `most`."""
    point = np.empty(3)
    for k in range(3):
        point[k] = row[k] * settings[SCALE] + settings[CENTRE + k]
    best, a, b, step = np.inf, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
    best = _at_weights(wrench, noise, row, a, b, point, settings, rows, near, n)
    for _ in range(_HALVED):
        moved = True
        while moved:
            moved = False
            from_a, from_b = a, b
            for i in range(6):
                da = step if i == 0 or i == 2 else -step if i == 1 or i == 3 else 0.0
                db = step if i == 3 or i == 4 else -step if i == 2 or i == 5 else 0.0
                one = _at_weights(wrench, noise, row, from_a + da, from_b + db, point, settings, rows, near, n)
                if one < best - 1e-3:
                    best, a, b, moved = one, from_a + da, from_b + db, True
        step *= 0.5
    if best < most:
        best = _at_weights(wrench, noise, row, a, b, point, settings, rows, near, n)
        copy_into(point, place[:3])
        copy_into(n, place[3:])
    return best


def distance_to_edges(wrench, unit, noise, nodes, corners, settings, state, most, place):
    """The least of `most` and the distances to edges and corners; the nearest contact there goes into place (6,)."""
    raise NotImplementedError("compiled code only")


@chosen_for(distance_to_edges)
def _distance_to_edges(wrench, unit, noise, nodes, corners, settings, state, most, place):
    return _of_mesh if is_mesh(nodes) else _of_equation


def _of_equation(wrench, unit, noise, nodes, corners, settings, state, most, place):
    return most


def _of_mesh(wrench, unit, noise, nodes, corners, settings, state, most, place):
    rows = np.empty(MOST, dtype=np.int64)
    count = edges_of(wrench, unit, noise, nodes, corners, settings, most, VERTEX, rows)
    count = near_previous(wrench, noise, corners, settings, state, rows, count)
    work, near, n, spot = np.zeros((_ROWS, 6)), np.empty(6), np.empty(3), np.empty(6)
    bounds = np.empty(count)
    for i in range(count):
        row = corners[rows[i]]
        if row[KIND] == SHARP:
            bounds[i] = _off_edge(wrench, noise, row, settings)
        else:
            bounds[i] = _off_corner(wrench, noise, row, settings)
    for _ in range(min(count, _SEARCHED)):
        i = np.argmin(bounds)
        if not bounds[i] < most + _SAME:
            break
        bounds[i] = np.inf
        row = corners[rows[i]]
        if row[KIND] == SHARP:
            distance = _to_edge(wrench, noise, row, settings, most, work, near, n, spot)
        else:
            distance = _to_corner(wrench, noise, row, settings, most, work, near, n, spot)
        tied = abs(distance - most) <= _SAME and dot(wrench[:3], spot) < dot(wrench[:3], place)
        if distance < most - _SAME or tied:  # of those as near, the one met first
            copy_into(spot, place)
        most = min(most, distance)
    return most
