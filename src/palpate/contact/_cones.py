"""Compiled: how far a wrench is from those that a contact at a sharp edge or corner within the bounds can make.

For a given normal n those wrenches are a cone: some linear equations and inequalities (`_at_edge`, `_at_corner`), the
friction |F| <= -sqrt(1 + mu^2) F . n, and the torsion |F . M| <= c (F . n)^2, as tau = F . M/(F . n). The nearest
of them in the metric of S is found by linearising the last two and solving for the multipliers one by one (Hildreth
1957). The multipliers say how the distance changes with n, and so where to go among the normals.
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
_SEARCHED = 32  # edges and corners, the likeliest first
_TURNS, _SECANTS = 8, 8
_NEAR_ENOUGH = 0.02  # of a distance: what a better normal could gain
_SLACK = 2.0  # the gap bounds convex functions; these are nearly so


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
def _nearest_at(wrench, noise, n, rows, linear, equal, settings, near, lift):
    """Distance to the cone of a normal; the nearest wrench into near (6,), the multipliers into lift (5,).

    Rows (5, 6): the first `equal` are zero, those up to `linear` not positive; the last two are friction and torsion.
    """
    values, bound = np.zeros(_ROWS), np.empty(_ROWS)
    lift[:] = 0.0
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
def _at_edge(wrench, noise, line, n, settings, rows, near, lift, slope):
    """Distance to the contacts of an edge with one normal; by how much its half square changes with n into slope (3,).

    By the multipliers of what depends on the normal: with u = e x n, d(u . m) = (m x e) . dn.
    """
    u, m, turn = np.empty(3), np.empty(3), np.empty(3)
    cross_into(line[3:6], n, u)
    _moment_row(line[3:6], line[:3], rows[0])
    _moment_row(u, line[:3], rows[1])  # (F . n) s
    for k in range(6):
        rows[2, k] = -rows[1, k] + (line[6] * n[k] if k < 3 else 0.0)
    distance = _nearest_at(wrench, noise, n, rows, 3, 1, settings, near, lift)
    _moment_about(line[:3], near, m)
    cross_into(m, line[3:6], turn)
    by_force = lift[2] * line[6] + _turning(near, n, settings, lift)
    for k in range(3):
        slope[k] = (lift[1] - lift[2]) * turn[k] + by_force * near[k]
    return distance


@inner
def _at_corner(wrench, noise, point, n, settings, rows, near, lift, slope):
    """The same of a corner: with tangents t, d(t . m) = -(t . dn)(n . m)."""
    t, m = np.empty((2, 3)), np.empty(3)
    tangents(n, t)
    _moment_row(t[0], point, rows[0])
    _moment_row(t[1], point, rows[1])
    distance = _nearest_at(wrench, noise, n, rows, 2, 2, settings, near, lift)
    _moment_about(point, near, m)
    along, by_force = dot(n, m), _turning(near, n, settings, lift)
    for k in range(3):
        slope[k] = by_force * near[k] - along * (lift[0] * t[0, k] + lift[1] * t[1, k])
    return distance


@inner
def _moment_about(point, w, out):
    """M - p x F."""
    cross_into(point, w[:3], out)
    for k in range(3):
        out[k] = w[3 + k] - out[k]


@inner
def _turning(w, n, settings, lift):
    """Friction and torsion by the normal: the factor of F in the slope."""
    size, pressing = np.sqrt(dot(w[:3], w[:3])), dot(w[:3], n)
    if not size > 0.0:
        return 0.0
    c = min(settings[TORSION], _UNBOUND * settings[SCALE])
    return (lift[3] * np.sqrt(1.0 + settings[FRICTION] ** 2) - 2.0 * lift[4] * c * pressing) / size


@inner
def _off_edge(wrench, noise, row, settings):
    """No contact of an edge is nearer than this: its moment about the edge is zero."""
    line, g = np.empty(14), np.empty((1, 6))
    read_edge(row, settings, line)
    _moment_row(line[3:6], line[:3], g[0])
    return abs(dot(g[0, :3], wrench[:3]) + dot(g[0, 3:], wrench[3:])) / np.sqrt(sandwich(g, noise, g)[0, 0])


@inner
def _place_of(row, settings, point):
    for k in range(3):
        point[k] = row[k] * settings[SCALE] + settings[CENTRE + k]


@inner
def _off_corner(wrench, noise, row, settings):
    """No contact of a corner is nearer than about this.

    The moment there is tau n, |tau| <= c |F|: what of it lies across the mean of the normals is c |F| sin(their angle)
    at most.
    """
    point, mean, moment, g = np.empty(3), np.empty(3), np.empty(3), np.empty((1, 6))
    length = 0.0
    _place_of(row, settings, point)
    for k in range(3):
        mean[k] = row[3 + k] + row[9 + k] + row[15 + k]
        length += mean[k] ** 2
    _moment_about(point, wrench, moment)
    widest = 1.0
    for k in range(3):
        mean[k] /= np.sqrt(length)
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
def _at(wrench, noise, row, line, n, settings, rows, near, lift, slope):
    """The distance at one normal, and its slope across that."""
    if row[KIND] == SHARP:
        distance = _at_edge(wrench, noise, line, n, settings, rows, near, lift, slope)
    else:
        distance = _at_corner(wrench, noise, line[:3], n, settings, rows, near, lift, slope)
    along = dot(slope, n)
    for k in range(3):
        slope[k] -= along * n[k]
    return distance


@inner
def _between(n, row, which, share, out):
    """A unit normal, some share of the way from n to a normal of the patch."""
    length = 0.0
    for k in range(3):
        out[k] = (1.0 - share) * n[k] + share * row[3 + 6 * which + k]
        length += out[k] ** 2
    for k in range(3):
        out[k] /= np.sqrt(length)


@inner
def _descend(wrench, noise, row, line, settings, most, rows, near, lift, n):
    """Distance to an edge's or a corner's contacts, and the normal where it is attained; inf beyond `most`.

    From the mean of its normals towards the one that promises most (Frank and Wolfe 1956), along a secant. What is
    promised, the gap, bounds what can be gained: it ends where that is within `_NEAR_ENOUGH`, or not enough.
    """
    corners = 2 if row[KIND] == SHARP else 3
    slope, best_slope, tried, start = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    _between(row[3:6], row, 1, 0.5, n)
    if corners == 3:
        _between(n, row, 2, 1.0 / 3.0, n)
    pressed = dot(wrench[:3], n)
    for i in range(corners):  # nothing leads away from a normal that the force pulls at
        here = dot(wrench[:3], row[3 + 6 * i : 6 + 6 * i])
        if pressed >= 0.0 and here < pressed:
            pressed = here
            copy_into(row[3 + 6 * i : 6 + 6 * i], n)
    best = _at(wrench, noise, row, line, n, settings, rows, near, lift, best_slope)
    for _ in range(_TURNS):
        which, gap = 0, 0.0
        for i in range(corners):
            promised = 0.0
            for k in range(3):
                promised -= best_slope[k] * (row[3 + 6 * i + k] - n[k])
            if promised > gap:
                which, gap = i, promised
        if best * best - 2.0 * gap > (_SLACK * most) ** 2:
            return np.inf
        if gap <= _NEAR_ENOUGH * best * best:
            break
        low, high, falling, rising, share, moved = 0.0, 1.0, gap, 0.0, 1.0, False
        copy_into(n, start)
        for _ in range(_SECANTS):
            _between(start, row, which, share, tried)
            distance = _at(wrench, noise, row, line, tried, settings, rows, near, lift, slope)
            ahead = 0.0
            for k in range(3):
                ahead += slope[k] * (row[3 + 6 * which + k] - start[k])
            if distance < best:
                best, moved = distance, True
                copy_into(tried, n)
                copy_into(slope, best_slope)
            if ahead > 0.0:
                high, rising = share, ahead
            else:
                low, falling = share, -ahead
            if high == low or abs(ahead) * (high - low) <= _NEAR_ENOUGH * best * best:
                break
            share = low + (high - low) * min(0.9, max(0.1, falling / (falling + rising)))
        if not moved:
            break
    return best


@inner
def _to(wrench, noise, row, settings, most, rows, near, place):
    """Distance to an edge's or a corner's contacts, and the nearest into place (6,), where that is less than `most`."""
    line, lift, slope = np.empty(14), np.empty(_ROWS), np.empty(3)
    if row[KIND] == SHARP:
        read_edge(row, settings, line)
    else:
        _place_of(row, settings, line)
    n = place[3:]
    best = _descend(wrench, noise, row, line, settings, most, rows, near, lift, n)
    if not best < most + _SAME:
        return np.inf
    best = _at(wrench, noise, row, line, n, settings, rows, near, lift, slope)
    along = 0.0
    if row[KIND] == SHARP:
        pressing = dot(near[:3], n)
        for k in range(6):
            along += rows[1, k] * near[k]
        along = min(line[6], max(0.0, along / pressing)) if pressing < 0.0 else 0.0
    for k in range(3):
        place[k] = line[k] + (along * line[3 + k] if along > 0.0 else 0.0)
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
    work, near, spot = np.zeros((_ROWS, 6)), np.empty(6), np.empty(6)
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
        distance = _to(wrench, noise, row, settings, most, work, near, spot)
        tied = abs(distance - most) <= _SAME and dot(wrench[:3], spot) < dot(wrench[:3], place)
        if distance < most - _SAME or tied:  # of those as near, the one met first
            copy_into(spot, place)
        most = min(most, distance)
    return most
