"""Compiled: contacts at sharp edges, whose normal n can be any between those of the two facets.

A contact at p = r + s e, 0 <= s <= L, of an edge along e makes M - p x F = tau n with n across e. Along e this gives

    g W = e . (M - r x F) = 0,

one equation: a wrench of covariance S lies |g W|/sqrt(g S g') standard deviations from the edge, and the nearest that
fits is W - S g' (g W)/(g S g'). Across e, with m = M - r x F and u = e x n, it gives for each normal

    s = u . m/(F . n),   tau = F . m/(F . n).

So a wrench determines neither n nor s. Every n is weighted by how well the wrench keeps the bounds there and by
1/(F . n)^2, the density of (s, tau) in (u . m, F . m). If no facet has a contact within the bounds, the mean and the
spread of s over n are the answer along e; across e it is that of the facet on whose side the noise put it: its error is
the noise of g W. A contact on a facet next to an edge stays, but its ellipse includes the edge's places as well.
"""

# pyright: basic
from __future__ import annotations

from math import erf

import numpy as np

from palpate.contact._settings import CENTRE, FRICTION, HAS_PREVIOUS, PREVIOUS, SCALE, TORSION
from palpate.contact._slopes import sandwich
from palpate.surfaces._edges import SHARP
from palpate.surfaces._jit import chosen_for, inner
from palpate.surfaces._kernels import is_mesh
from palpate.surfaces._nearest import edges_near, nearest_to_point
from palpate.surfaces._patches import KIND
from palpate.surfaces._vectors import copy_into, cross_into, dot

_NORMALS = 16  # of a fan that are weighed
_FAR = 4.0  # standard deviations from an edge beyond which it is none
_BESIDE = 0.05  # weight of the facet or corner beside an edge: as that of an edge 2.5 standard deviations off
_EVEN = (1.645 / 1.96) ** 2  # 95 % of an even spread lie within 1.645 rms, from its middle or end; of a normal 1.96
_VAGUE = 10.0  # of the body's size: noise that tells no edge from another
_MOST = 64  # edges looked at
_EXACT = 1e-7  # of force and size: how far off a wrench without noise may be
EXPLAINED = 3.0  # standard deviations within which a wrench is one that a contact within the bounds makes
_SUMS = 20  # weight 0, w p 1-3, w n 4-6, w p p' 7-15, likelihood 16, distance 17, heaviest edge 18, its weight 19


@inner
def exact(wrench, settings, noise):
    """Write into noise (6, 6) a covariance that stands for rounding, for use when the noise is not known."""
    force = _EXACT * np.sqrt(dot(wrench[:3], wrench[:3]))
    centre = settings[CENTRE : CENTRE + 3]
    arm = settings[SCALE] + np.sqrt(dot(centre, centre))
    noise[:] = 0.0
    for k in range(3):
        noise[k, k], noise[3 + k, 3 + k] = force * force, force * force * arm * arm


@inner
def edges_of(wrench, unit, noise, nodes, corners, settings, far, least, rows):
    """Write rows of edges (and corners, by kind `least`) within `far` standard deviations; return the number."""
    centre, force = settings[CENTRE : CENTRE + 3], np.sqrt(dot(wrench[:3], wrench[:3]))
    lever = turn = 0.0
    for k in range(3):
        lever += noise[k, k]
        turn += noise[3 + k, 3 + k]
    off = np.sqrt(dot(centre, centre)) + settings[SCALE]
    wide = far * (np.sqrt(turn) + off * np.sqrt(lever)) * (1.0 + settings[FRICTION]) / (force * settings[SCALE])
    if least == SHARP and not wide < _VAGUE:
        return 0
    wide = min(wide, _VAGUE)
    return edges_near(unit, settings[FRICTION] + 0.5, wide, least, nodes, corners, rows)


@inner
def reach(wrench, noise, settings):
    """Return how far noise moves a contact [m]: `_FAR` standard deviations."""
    force = noise[0, 0] + noise[1, 1] + noise[2, 2]
    moment = noise[3, 3] + noise[4, 4] + noise[5, 5] + settings[SCALE] ** 2 * force
    return _FAR * np.sqrt(moment / dot(wrench[:3], wrench[:3]))


@inner
def near_previous(wrench, noise, corners, settings, state, rows, count):
    """Keep the edges and corners in rows that the last contact, if any, may have reached; return the number."""
    if state[HAS_PREVIOUS] == 0.0:
        return count
    line, kept = np.empty(14), 0
    far = reach(wrench, noise, settings) + 2.0 * settings[TORSION] + 0.05 * settings[SCALE]
    for i in range(count):
        row = corners[rows[i]]
        if row[KIND] == SHARP:
            read_edge(row, settings, line)
            _, gap = _nearest(state[PREVIOUS : PREVIOUS + 3], line)
        else:
            gap = 0.0
            for k in range(3):
                gap += (row[k] * settings[SCALE] + settings[CENTRE + k] - state[PREVIOUS + k]) ** 2
        if gap <= far * far:
            rows[kept] = rows[i]
            kept += 1
    return kept


@inner
def read_edge(row, settings, line):
    """Write start 0-2 [m], direction e 3-5, length 6 [m], first normal n 7-9, e x n 10-12, angle to the second 13."""
    length = 0.0
    for k in range(3):
        line[k] = row[k] * settings[SCALE] + settings[CENTRE + k]
        line[3 + k] = (row[6 + k] - row[k]) * settings[SCALE]
        length += line[3 + k] ** 2
        line[7 + k] = row[3 + k]
    line[6] = np.sqrt(length)
    for k in range(3):
        line[3 + k] /= line[6]
    cross_into(line[3:6], line[7:10], line[10:13])
    line[13] = np.arctan2(dot(row[9:12], line[10:13]), dot(row[9:12], line[7:10]))


@inner
def _misfit(wrench, noise, line, g, fitted):
    """Return the moment about the edge and its variance; write the nearest wrench without it into fitted (6,)."""
    cross_into(line[:3], line[3:6], g)  # e . (r x F) = (e x r) . F
    for k in range(3):
        g[3 + k] = line[3 + k]
    off = variance = 0.0
    for i in range(6):
        fitted[i] = 0.0
        for j in range(6):
            fitted[i] += noise[i, j] * g[j]
        variance += g[i] * fitted[i]
        off += g[i] * wrench[i]
    for i in range(6):
        fitted[i] = wrench[i] - fitted[i] * off / variance
    return off, variance


@inner
def _below(z):
    """Return the normal distribution's share below z."""
    if abs(z) > _FAR:
        return 1.0 if z > 0.0 else 0.0
    return 0.5 * (1.0 + erf(0.7071067811865476 * z))


@inner
def _weigh(wrench, noise, row, number, settings, sums):
    """Add an edge's normals to the sums."""
    line, g, w = np.empty(14), np.empty(6), np.empty(6)
    read_edge(row, settings, line)
    off, variance = _misfit(wrench, noise, line, g, w)
    square = off * off / variance
    if not square < _FAR * _FAR:
        return
    e, first, second = line[3:6], line[7:10], line[10:13]
    m = np.empty(3)
    cross_into(line[:3], w[:3], m)
    for k in range(3):
        m[k] = w[3 + k] - m[k]
    f1, f2, m1, m2 = dot(first, w[:3]), dot(second, w[:3]), dot(first, m), dot(second, m)
    size, moment = np.sqrt(dot(w[:3], w[:3])), f1 * m1 + f2 * m2
    across = np.sqrt(f1 * f1 + f2 * f2)
    if across < 1e-3 * size:
        return
    # noise of the bounds: of a moment across the edge about the middle of what is possible, and of a force
    a = np.empty((1, 6))
    at = 0.5 * line[6]
    for k in range(3):
        a[0, 3 + k] = (first[k] * f1 + second[k] * f2) / across
        m[k] = line[k] + at * e[k]
    cross_into(m, a[0, 3:], a[0, :3])
    turning = np.sqrt(sandwich(a, noise, a)[0, 0])
    pushing = np.sqrt((noise[0, 0] + noise[1, 1] + noise[2, 2]) / 3.0)
    mu, c = settings[FRICTION], settings[TORSION]
    wide = np.sqrt(1.0 + mu * mu)
    likely = np.exp(-0.5 * square)
    step = line[13] / _NORMALS
    n1, n2, cosine, sine = np.cos(0.5 * step), np.sin(0.5 * step), np.cos(step), np.sin(step)
    total = first_s = second_s = along = beside = 0.0
    for _ in range(_NORMALS):
        pressing = -(f1 * n1 + f2 * n2)
        if pressing > 1e-3 * size:
            s = -(n1 * m2 - n2 * m1) / pressing
            grip = (wide * pressing - size) / (mu * pushing)
            hold = (c * pressing * pressing - abs(moment)) / (across * turning)
            start, end = s * pressing / turning, (line[6] - s) * pressing / turning
            least = min(min(grip, hold), min(start, end))
            if least >= 0.0:
                sums[17] = min(sums[17], np.sqrt(square))
            if least >= -_FAR:
                share = _below(grip) * _below(hold) * (_below(start) + _below(end) - 1.0)
                sums[16] = max(sums[16], likely * share)
                weight = likely * share * step * across * across / (pressing * pressing * np.sqrt(variance))
                s = min(line[6], max(0.0, s))
                total += weight
                first_s += weight * s
                second_s += weight * s * s
                along += weight * n1
                beside += weight * n2
        n1, n2 = n1 * cosine - n2 * sine, n2 * cosine + n1 * sine
    for k in range(3):
        sums[1 + k] += total * line[k] + first_s * e[k]
        sums[4 + k] += along * first[k] + beside * second[k]
        for j in range(3):
            both = line[k] * e[j] + e[k] * line[j]
            sums[7 + 3 * k + j] += total * line[k] * line[j] + first_s * both + second_s * e[k] * e[j]
    sums[0] += total
    if total > sums[19]:
        sums[18], sums[19] = number, total


@inner
def _nearest(point, line):
    """Return where along an edge it is nearest to a point [m], and the squared distance [m^2]."""
    along = 0.0
    for k in range(3):
        along += (point[k] - line[k]) * line[3 + k]
    along = min(line[6], max(0.0, along))
    gap = 0.0
    for k in range(3):
        gap += (point[k] - line[k] - along * line[3 + k]) ** 2
    return along, gap


@inner
def _beside(wrench, noise, place, rows, count, corners, settings):
    """Return whether a candidate is a contact at one of these edges, within the noise across it."""
    line, g, w = np.empty(14), np.empty(6), np.empty(6)
    pressing = abs(dot(wrench[:3], place[3:]))
    for i in range(count):
        read_edge(corners[rows[i]], settings, line)
        _, gap = _nearest(place, line)
        off, _ = _misfit(wrench, noise, line, g, w)
        if np.sqrt(gap) * pressing <= 2.0 * abs(off) + 1e-6 * settings[SCALE] * pressing:
            return True
    return False


@inner
def _wins(wrench, place, point, state):
    """Return whether the edge at `point` is preferred to a candidate elsewhere, by the rule of `_kernel._choose`."""
    if state[HAS_PREVIOUS] == 1.0:
        here = there = 0.0
        for k in range(3):
            here += (point[k] - state[PREVIOUS + k]) ** 2
            there += (place[k] - state[PREVIOUS + k]) ** 2
        return here < there
    return dot(wrench[:3], point) < dot(wrench[:3], place)


def at_edge(wrench, unit, noise, nodes, corners, settings, state, plausible, place, t, spread):
    """Change an answer if a sharp edge is near; a surface with an equation has no edges.

    Args:
        wrench: (6,).
        unit: (6,) the wrench about the tree's centre, in its unit size.
        noise: (6, 6) its covariance.
        nodes: of the tree.
        corners: of the tree.
        settings: of the Locator.
        state: the last contact decides between edge and candidate.
        plausible: number of candidates within the bounds.
        place: (6,) point and normal of the candidate; changed.
        t: (2, 3) tangents; changed.
        spread: (2, 2) covariance in them [m^2]; changed.

    Returns:
        0: the answer stays; 1: the edge's replaces it; 2: it stays, but the edge's is possible too; 3: the edge's
        replaces it, but the old one is possible too. Then the distance to the edges within the bounds, in standard
        deviations of the wrench; inf without any.
    """
    raise NotImplementedError("compiled code only")


@chosen_for(at_edge)
def _at_edge(wrench, unit, noise, nodes, corners, settings, state, plausible, place, t, spread):
    return _of_mesh if is_mesh(nodes) else _of_equation


def _of_equation(wrench, unit, noise, nodes, corners, settings, state, plausible, place, t, spread):
    return 0, np.inf


def _of_mesh(wrench, unit, noise, nodes, corners, settings, state, plausible, place, t, spread):
    rows = np.empty(_MOST, dtype=np.int64)
    count = edges_of(wrench, unit, noise, nodes, corners, settings, _FAR, SHARP, rows)
    count = near_previous(wrench, noise, corners, settings, state, rows, count)
    if count == 0:
        return 0, np.inf
    sums = np.empty(_SUMS)
    answer = _decide(wrench, noise, rows, count, corners, settings, state, plausible, place, t, spread, sums)
    if answer == 1 or answer == 3:
        _onto(place, nodes, corners, settings)
    return answer, sums[17]


@inner
def _onto(place, nodes, corners, settings):
    """Move place to the nearest point of the surface: noise may put an answer past the far side of a narrow facet."""
    point, found = np.empty((1, 3)), np.empty((1, 4))
    for k in range(3):
        point[0, k] = (place[k] - settings[CENTRE + k]) / settings[SCALE]
    nearest_to_point(point, nodes, corners, found)
    row = corners[int(found[0, 0])]
    for k in range(3):
        near = found[0, 1] * row[k] + found[0, 2] * row[6 + k] + found[0, 3] * row[12 + k]
        place[k] = near * settings[SCALE] + settings[CENTRE + k]


@inner
def _decide(wrench, noise, rows, count, corners, settings, state, plausible, place, t, spread, sums):
    """Return the first value that `at_edge` returns, and change the answer accordingly."""
    sums[:] = 0.0
    sums[17], sums[18] = np.inf, -1.0
    for i in range(count):
        _weigh(wrench, noise, corners[rows[i]], rows[i], settings, sums)
    total = sums[0]
    if not (total > 0.0 and sums[16] > 1e-4):
        return 0
    if plausible == 0 and not sums[17] < EXPLAINED:
        return 0
    mean = np.empty(3)
    for k in range(3):
        mean[k] = sums[1 + k] / total
    answer = 1
    if plausible > 0:
        if _beside(wrench, noise, place, rows, count, corners, settings):
            _widen(sums, mean, place, corners[int(sums[18])], settings, t, spread)
            return 0
        if sums[16] < _BESIDE or sums[17] == np.inf:
            return 0
        if not _wins(wrench, place, mean, state):
            return 2
        answer = 3
    length, n = 0.0, np.empty(3)
    for k in range(3):
        n[k] = sums[4 + k] / total
        length += n[k] ** 2
    square = np.empty((3, 3))
    for k in range(3):
        n[k] /= np.sqrt(length)
        for j in range(3):
            square[k, j] = _EVEN * (sums[7 + 3 * k + j] / total - mean[k] * mean[j])
    heaviest = int(sums[18])
    _answer(wrench, noise, rows, count, corners, settings, heaviest, mean, n, square, place, t, spread)
    return answer


@inner
def _widen(sums, mean, place, row, settings, t, spread):
    """Widen the ellipse of a candidate next to an edge, which stays, to include the edge's places by their likelihood.

    Along the edge only: across it they differ by the noise of the moment about it, which the ellipse contains already.
    """
    line, along = np.empty(14), 0.0
    read_edge(row, settings, line)
    e = line[3:6]
    for k in range(3):
        for j in range(3):
            square = sums[7 + 3 * k + j] / sums[0] - mean[k] * mean[j]
            square += (mean[k] - place[k]) * (mean[j] - place[j])
            along += e[k] * square * e[j]
    along *= _EVEN * sums[16] / (sums[16] + _BESIDE)
    for a in range(2):
        for c in range(2):
            spread[a, c] += dot(t[a], e) * along * dot(t[c], e)


@inner
def _answer(wrench, noise, rows, count, corners, settings, heaviest, mean, n, square, place, t, spread):
    """Write point, normal, tangents and covariance from the mean along the edges, on the nearest of them."""
    line, best, g, w = np.empty(14), np.empty(14), np.empty(6), np.empty(6)
    least, along, tie = np.inf, 0.0, (1e-6 * settings[SCALE]) ** 2
    for i in range(count):
        read_edge(corners[rows[i]], settings, line)
        s, gap = _nearest(mean, line)
        if gap < least - tie or (gap < least + tie and rows[i] == heaviest):  # of those that meet there
            least, along = gap, s
            copy_into(line, best)
    e = best[3:6]
    tilt, length = dot(n, e), 0.0
    for k in range(3):
        n[k] -= tilt * e[k]
        length += n[k] * n[k]
    for k in range(3):
        place[k], place[3 + k] = best[k] + along * e[k], n[k] / np.sqrt(length)
        t[0, k] = e[k]
    cross_into(e, place[3:], t[1])
    off, _ = _misfit(wrench, noise, best, g, w)
    # The facet on whose side the noise put it, where the wrench presses that one: x = -(g W)(n . n_side)/(F . n_side).
    turn = best[13] if off > 0.0 else 0.0
    side = np.empty(3)
    for k in range(3):
        side[k] = np.cos(turn) * best[7 + k] + np.sin(turn) * best[10 + k]
    pressing, force = dot(wrench[:3], place[3:]), np.sqrt(dot(wrench[:3], wrench[:3]))
    reach, ratio = dot(wrench[:3], side), -1.0 / pressing
    if -reach * np.sqrt(1.0 + settings[FRICTION] ** 2) >= force:
        ratio = -max(0.3, dot(side, place[3:])) / reach
        # along n x e of the first side; against it of the second
        inward = min(settings[SCALE], max(-settings[SCALE], off / reach))
        for k in range(3):
            place[k] += inward * (np.sin(turn) * best[7 + k] - np.cos(turn) * best[10 + k])
    slopes = np.empty((2, 6))
    cross_into(place[:3], t[1], slopes[0, :3])
    for k in range(3):
        slopes[0, k], slopes[0, 3 + k] = slopes[0, k] / pressing, t[1, k] / pressing
    for k in range(6):
        slopes[1, k] = ratio * g[k]
    noisy = sandwich(slopes, noise, slopes)
    for a in range(2):
        for c in range(2):
            total = noisy[a, c]
            for k in range(3):
                for j in range(3):
                    total += t[a, k] * square[k, j] * t[c, j]
            spread[a, c] = total
    spread[1, 0] = spread[0, 1]
