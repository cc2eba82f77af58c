"""Compiled: distance from a wrench to those that a contact at a sharp edge or corner within the bounds can make.

For a given normal n those wrenches are a cone: some linear equations and inequalities (`_at_edge`, `_at_corner`), the
friction |F| <= -sqrt(1 + mu^2) F . n, and the torsion |F . M| <= c (F . n)^2, as tau = F . M/(F . n). The nearest
of them in the metric of S is found by linearising the last two and solving for the multipliers one by one (Hildreth
1957). The multipliers give the change of the distance with n, and so the direction to search among the normals.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.contact._bounds import inverse
from palpate.contact._edges import edges_of, near_previous, read_edge
from palpate.contact._settings import CENTRE, FRICTION, SCALE, TORSION
from palpate.contact._slopes import sandwich
from palpate.surfaces._edges import SHARP
from palpate.surfaces._jit import chosen_for, inner
from palpate.surfaces._kernels import is_mesh
from palpate.surfaces._patches import KIND, VERTEX
from palpate.surfaces._vectors import copy_into, cross_into, dot, tangents

_ROWS = 5  # three of an edge at most, friction, torsion
_STEPS, _SWEEPS = 12, 60
_SAME = 2e-3  # distances that the search cannot tell apart
_UNBOUND = 1e3  # of the body's size: a torsion that no contact has, in the place of an infinite bound
_LOOKED, _SEARCHED = 512, 128  # edges and corners: whose bounds are compared; searched, the likeliest first
_TURNS, _SECANTS = 24, 8
_NEAR_ENOUGH = 0.02  # of a distance: what a better normal could gain
_SLACK = 2.0  # the gap bounds convex functions; these are nearly so


@inner
def _moment_row(axis, point, out):
    """Write into out (6,) the moment about an axis through a point: axis . (M - p x F) = out . W."""
    cross_into(point, axis, out[:3])
    for k in range(3):
        out[3 + k] = axis[k]


@inner
def _bounds_at(w, n, settings, rows, values):
    """Write the friction and torsion bounds at w: slopes into the last two rows, values likewise into `values`."""
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
    """Return the distance to the cone of a normal; write the nearest wrench into near (6,), multipliers into lift (5,).

    Rows (5, 6): the first `equal` must be zero, those up to `linear` not positive; the last two: friction, torsion.
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
def _at_edge(wrench, noise, line, n, settings, rows, near, lift, turns):
    """Return the distance to the contacts of an edge with one normal; write the rows' slopes by it into turns (5, 3).

    With u = e x n, d(u . m) = (m x e) . dn.
    """
    u, m = np.empty(3), np.empty(3)
    cross_into(line[3:6], n, u)
    _moment_row(line[3:6], line[:3], rows[0])
    _moment_row(u, line[:3], rows[1])  # (F . n) s
    for k in range(6):
        rows[2, k] = -rows[1, k] + (line[6] * n[k] if k < 3 else 0.0)
    distance = _nearest_at(wrench, noise, n, rows, 3, 1, settings, near, lift)
    _moment_about(line[:3], near, m)
    cross_into(m, line[3:6], turns[1])
    for k in range(3):
        turns[0, k], turns[2, k] = 0.0, line[6] * near[k] - turns[1, k]
    return distance


@inner
def _at_corner(wrench, noise, point, n, settings, rows, near, lift, turns):
    """Return the distance to the contacts of a corner with one normal; with tangents t, d(t . m) = -(t . dn)(n . m)."""
    t, m = np.empty((2, 3)), np.empty(3)
    tangents(n, t)
    _moment_row(t[0], point, rows[0])
    _moment_row(t[1], point, rows[1])
    distance = _nearest_at(wrench, noise, n, rows, 2, 2, settings, near, lift)
    _moment_about(point, near, m)
    along = dot(n, m)
    for k in range(3):
        turns[0, k], turns[1, k], turns[2, k] = -along * t[0, k], -along * t[1, k], 0.0
    return distance


@inner
def _moment_about(point, w, out):
    """Write M - p x F into out (3,)."""
    cross_into(point, w[:3], out)
    for k in range(3):
        out[k] = w[3 + k] - out[k]


@inner
def _off_edge(wrench, noise, row, settings):
    """Return a lower bound of the distance to the contacts of an edge, from the moment about it, which must be zero."""
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
    """Return an approximate lower bound of the distance to the contacts of a corner.

    The moment there is tau n, |tau| <= c |F|: its part across the mean normal is at most c |F| sin(their angle).
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
def _at(wrench, noise, row, line, mix, settings, n, rows, near, lift, turns):
    """Return the distance at the normal of this mix of shares; write the rows' slopes by the shares into turns."""
    corners = len(mix)
    length = 0.0
    for k in range(3):
        n[k] = 0.0
        for i in range(corners):
            n[k] += mix[i] * row[3 + 6 * i + k]
        length += n[k] ** 2
    length = np.sqrt(length)
    for k in range(3):
        n[k] /= length
    by = np.empty((_ROWS, 3))
    if row[KIND] == SHARP:
        distance = _at_edge(wrench, noise, line, n, settings, rows, near, lift, by)
    else:
        distance = _at_corner(wrench, noise, line[:3], n, settings, rows, near, lift, by)
    size, pressing = np.sqrt(dot(near[:3], near[:3])), dot(near[:3], n)
    c = min(settings[TORSION], _UNBOUND * settings[SCALE])
    for k in range(3):
        by[3, k] = near[k] * np.sqrt(1.0 + settings[FRICTION] ** 2) / size if size > 0.0 else 0.0
        by[4, k] = -2.0 * c * pressing * near[k] / size if size > 0.0 else 0.0
    for j in range(_ROWS):
        along = dot(by[j], n)
        for i in range(corners):
            here = row[3 + 6 * i : 6 + 6 * i]
            turns[j, i] = (dot(by[j], here) - along * dot(n, here)) / length
    return distance


@inner
def _changes(lift, turns, slope):
    """Write the derivatives of half the squared distance by the shares of the normals into slope."""
    for i in range(len(slope)):
        slope[i] = 0.0
        for j in range(_ROWS):
            slope[i] += lift[j] * turns[j, i]


@inner
def _bends(noise, rows, lift, turns, square):
    """Write second derivatives of half the squared distance (Gauss-Newton), y' (A S A')^-1 y/2 of binding rows."""
    count, corners = 0, len(square)
    active, turn = np.empty((_ROWS, 6)), np.empty((_ROWS, corners))
    for j in range(_ROWS):
        if lift[j] != 0.0:
            copy_into(rows[j], active[count])
            copy_into(turns[j], turn[count])
            count += 1
    square[:] = 0.0
    if count == 0:
        return
    weights = inverse(sandwich(active[:count], noise, active[:count]))
    if not weights[0, 0] > 0.0:  # rows that say the same
        return
    for i in range(corners):
        for k in range(corners):
            for a in range(count):
                for b in range(count):
                    square[i, k] += turn[a, i] * weights[a, b] * turn[b, k]


@inner
def _inside(slope, square, mix, out):
    """Write the minimum of the quadratic model over three shares into out; return False if one is negative there."""
    p = square[0, 0] - 2.0 * square[0, 2] + square[2, 2]
    q = square[0, 1] - square[0, 2] - square[1, 2] + square[2, 2]
    r = square[1, 1] - 2.0 * square[1, 2] + square[2, 2]
    det = p * r - q * q
    if not det > 1e-12 * p * r:
        return False
    x, y = slope[2] - slope[0], slope[2] - slope[1]
    out[0], out[1] = mix[0] + (r * x - q * y) / det, mix[1] + (p * y - q * x) / det
    out[2] = 1.0 - out[0] - out[1]
    return min(out[0], out[1], out[2]) >= 0.0


@inner
def _model_least(slope, square, mix, out):
    """Write into out the shares, none of them negative, at which the quadratic model is least."""
    corners, least = len(mix), np.inf
    if corners == 3 and _inside(slope, square, mix, out):
        return
    tried, way = np.empty(corners), np.empty(corners)
    for i in range(1, corners + corners // 3):  # sides
        j = i % corners
        tried[:] = 0.0
        tried[i - 1] = 1.0
        way[:] = 0.0
        way[i - 1], way[j] = -1.0, 1.0
        falls, bends = _along(slope, square, mix, tried, way)
        share = min(1.0, max(0.0, -falls / bends)) if bends > 0.0 else 1.0 if falls < 0.0 else 0.0
        tried[i - 1], tried[j] = 1.0 - share, share
        for k in range(corners):
            way[k] = tried[k] - mix[k]
        falls, bends = _along(slope, square, mix, mix, way)
        if falls + 0.5 * bends < least:
            least = falls + 0.5 * bends
            copy_into(tried, out)


@inner
def _along(slope, square, mix, start, way):
    """Return the first and second derivative of the model at `start` along `way`."""
    first = second = 0.0
    for i in range(len(mix)):
        first += slope[i] * way[i]
        for k in range(len(mix)):
            first += square[i, k] * way[i] * (start[k] - mix[k])
            second += square[i, k] * way[i] * way[k]
    return first, second


@inner
def _middle(wrench, row, mix):
    """Write equal shares into mix, or the normal that is pressed most if the force pulls at the mean of all normals."""
    pressed = 0.0
    for i in range(len(mix)):
        mix[i] = 1.0 / len(mix)
        pressed += dot(wrench[:3], row[3 + 6 * i : 6 + 6 * i])
    for i in range(len(mix)):
        here = dot(wrench[:3], row[3 + 6 * i : 6 + 6 * i])
        if pressed >= 0.0 and here < pressed:
            pressed = here
            mix[:] = 0.0
            mix[i] = 1.0


@inner
def _descend(wrench, noise, row, line, settings, most, mix, n, rows, near, lift):
    """Return the distance to the contacts of an edge or corner, inf beyond `most`; write the normals' shares into mix.

    The search goes from the middle of the normals to the least of a quadratic model, along a secant, repeatedly. The
    gap, the promise of the best of the normals, bounds the possible gain (Frank and Wolfe 1956): the search ends if the
    gap is within `_NEAR_ENOUGH`, or too small to reach `most`.
    """
    corners = len(mix)
    turns, square, start = np.zeros((_ROWS, corners)), np.zeros((corners, corners)), np.empty(corners)
    slope, tried, here, way = np.empty(corners), np.empty(corners), np.empty(corners), np.empty(corners)
    _middle(wrench, row, mix)
    best = _at(wrench, noise, row, line, mix, settings, n, rows, near, lift, turns)
    _changes(lift, turns, slope)
    if corners == 3:  # an edge has but one way
        _bends(noise, rows, lift, turns, square)
    for _ in range(_TURNS):
        gap = 0.0
        for i in range(corners):
            gap = max(gap, -slope[i])
        if best * best - 2.0 * gap > (_SLACK * most) ** 2:
            return np.inf
        if gap <= _NEAR_ENOUGH * best * best:
            break
        _model_least(slope, square, mix, way)
        falling = 0.0
        for i in range(corners):
            way[i] -= mix[i]
            falling -= slope[i] * way[i]
        low, high, rising, share, moved = 0.0, 1.0, 0.0, 1.0, False
        copy_into(mix, start)
        for _ in range(_SECANTS):
            for i in range(corners):
                tried[i] = start[i] + share * way[i]
            distance = _at(wrench, noise, row, line, tried, settings, n, rows, near, lift, turns)
            _changes(lift, turns, here)
            ahead = 0.0
            for i in range(corners):
                ahead += here[i] * way[i]
            if distance < best:
                best, moved = distance, True
                copy_into(tried, mix)
                copy_into(here, slope)
                if corners == 3:
                    _bends(noise, rows, lift, turns, square)
            if ahead > 0.0:
                falling = 0.5 * falling if high < 1.0 else falling  # Illinois: the side that stays counts half
                high, rising = share, ahead
            else:
                rising = 0.5 * rising if low > 0.0 else rising
                low, falling = share, -ahead
            if high == low or (moved and abs(ahead) * (high - low) <= _NEAR_ENOUGH * best * best):
                break
            share = low + (high - low) * min(0.9, max(0.1, falling / (falling + rising)))
        if not moved:
            break
    return best


@inner
def _to(wrench, noise, row, settings, most, rows, near, place):
    """Return the distance to the contacts of an edge or corner; write the nearest into place (6,) if below `most`."""
    line, lift = np.empty(14), np.empty(_ROWS)
    corners = 2 if row[KIND] == SHARP else 3
    mix, turns = np.empty(corners), np.empty((_ROWS, corners))
    if row[KIND] == SHARP:
        read_edge(row, settings, line)
    else:
        _place_of(row, settings, line)
    n = place[3:]
    best = _descend(wrench, noise, row, line, settings, most, mix, n, rows, near, lift)
    if not best < most + _SAME:
        return np.inf
    best = _at(wrench, noise, row, line, mix, settings, n, rows, near, lift, turns)
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
    """Return the least of `most` and the distances to edges and corners; write the nearest contact into place (6,)."""
    raise NotImplementedError("compiled code only")


@chosen_for(distance_to_edges)
def _distance_to_edges(wrench, unit, noise, nodes, corners, settings, state, most, place):
    return _of_mesh if is_mesh(nodes) else _of_equation


def _of_equation(wrench, unit, noise, nodes, corners, settings, state, most, place):
    return most


def _of_mesh(wrench, unit, noise, nodes, corners, settings, state, most, place):
    rows = np.empty(_LOOKED, dtype=np.int64)
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
