"""Compiled: fit the places of touches between taxels that stand anywhere, and lift it onto the body.

A centroid lies inside the taxels that feel a touch, so next to an edge of the skin, a hole or a module it is pulled
towards the taxels. Here a round Gaussian for each touch of an area, of unknown place, height and width, is fitted to
their readings instead, by Gauss-Newton steps with Marquardt's damping: places without taxels add no information, and a
taxel that feels nothing does. Lengths are in spacings of taxels.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner, uncounted
from palpate.surfaces._vectors import solve_positive

# prior of a touch: the spacing of taxels is about as large as their reach
_WIDTH, _WIDER = 0.5, 0.5  # standard deviation of its pressure, and that of the logarithm of it
_BESIDE = 0.5  # standard deviation of its distance from the hardest pressed taxel, along each axis
# share of its height by which pressure differs from a Gaussian, as noise that moves its place as much: 0.026 for discs,
# Hertz's and flat, 0.5 to 1.5 spacings wide, up to 0.04 for their stress under a layer
_SHAPE = 0.03
# a touch that others explain keeps its height; on its own any height is as likely
_LEAST, _ANY_HEIGHT = 1e-12, 1e-6  # N, and squared standard deviations
_STEPS = 20
_RIDGE = 1e-3  # squared spacings: damps a bend along which there are no taxels


@uncounted
def chart(cells, end, origin, place, at):
    """Place cells in the tangent plane of one of them, at the distance along an arc between both normals."""
    positions, normals, tangents, spacing = place[0][0], place[0][1], place[0][2], place[1][1]
    for i in range(end):
        k = cells[i]
        ahead, aside, chord, cosine = 0.0, 0.0, 0.0, 0.0
        for c in range(3):
            a, b = (c + 1) % 3, (c + 2) % 3
            away = positions[k, c] - positions[origin, c]
            ahead += away * tangents[origin, c]
            aside += away * (
                normals[origin, a] * tangents[origin, b] - normals[origin, b] * tangents[origin, a]
            )  # fmt: skip
            chord += away * away
            cosine += normals[k, c] * normals[origin, c]
        half = 0.5 * np.arccos(min(max(cosine, -1.0), 1.0))
        way = np.sqrt(chord) * (half / np.sin(half) if half > 1e-6 else 1.0)
        flat = np.sqrt(ahead * ahead + aside * aside)
        scale = way / flat / spacing[origin] if flat > 0.0 else 0.0
        at[0, k], at[1, k] = ahead * scale, aside * scale


@inner
def fit_touches(cells, count, end, shares, numbers, charts, fitted):
    """Fit the touches of an area together; write the place of each (2), its variances and their covariance, (p, 5).

    A reading is the sum of what all touches do, so that a place is as uncertain as its neighbours make it. Of an area's
    cells those from `count` to `end` are its rim; `shares` (p, end) and `charts` (p, 2, end) are those of each touch,
    and `numbers` the forces of all cells, those that centroids use, and their standard deviations by noise, and by
    noise and gain.
    """
    size = 4 * len(shares)
    prior, sure, x, weight = np.zeros(size), np.empty(size), np.empty(size), np.zeros(end)
    for p in range(len(shares)):
        at = slice(4 * p, 4 * p + 4)
        _start(cells, end, shares[p], numbers, charts[p], prior[at], sure[at], x[at], weight)
    force, _, noise, error = numbers
    for i in range(end):
        spread = error[cells[i]] if i < count else noise[cells[i]]
        weight[i] = 1.0 / (spread * spread + weight[i])
    touch, normal, factor = (cells, end, force, weight, charts), np.empty((size, size)), np.empty((size, size))
    pull, step = np.empty(size), np.empty(size)
    _descend(touch, x, prior, sure, normal, factor, pull, step)
    # what the model cannot explain widens all
    scale = max(1.0, _cost(touch, x, prior, np.zeros(size)) / max(end - size, 1))
    for first in range(0, size, 4):
        for a in range(2):
            pull[:] = 0.0
            pull[first + a] = scale
            factor[:] = normal
            if not solve_positive(factor, pull, size, step):
                step[:] = np.nan
            fitted[first // 4, a], fitted[first // 4, 2 + a] = x[first + a], step[first + a]
            fitted[first // 4, 4] = step[first]


@inner
def _start(cells, end, share, numbers, at, prior, sure, x, weight):
    """Write a touch's prior and its first place, the centroid; add the variance of its shape to the cells' `weight`."""
    force, used, _, _ = numbers
    hardest, peak, inside, row, column = 0, 0.0, 0.0, 0.0, 0.0
    for i in range(end):
        k = cells[i]
        if share[i] * force[k] > peak:
            hardest, peak = i, share[i] * force[k]
        inside += share[i] * used[k]
        row += share[i] * used[k] * at[0, i]
        column += share[i] * used[k] * at[1, i]
    for i in range(end):
        weight[i] += share[i] * (_SHAPE * peak) ** 2
    prior[0], prior[1], prior[2], prior[3] = at[0, hardest], at[1, hardest], np.log(max(peak, _LEAST)), np.log(_WIDTH)
    sure[0], sure[1], sure[2], sure[3] = _BESIDE**-2, _BESIDE**-2, _ANY_HEIGHT, _WIDER**-2
    x[:] = prior
    if inside > 0.0:
        x[0], x[1] = row / inside, column / inside


@inner
def _descend(touch, x, prior, sure, normal, factor, pull, step):
    """Find the least cost from x on by damped steps, in place; `normal` are the normal equations there."""
    size, trial = len(x), np.empty(len(x))
    cost, damping = _normal(touch, x, prior, sure, normal, pull), 1e-3
    for _ in range(_STEPS):
        factor[:] = normal
        for a in range(size):
            factor[a, a] *= 1.0 + damping
        solve_positive(factor, pull, size, step)
        for a in range(size):
            trial[a] = x[a] + (step[a] if a % 4 < 2 else min(max(step[a], -1.0), 1.0))
        found = _cost(touch, trial, prior, sure)
        if found < cost:
            x[:] = trial
            settled, damping = cost - found < 1e-4, 0.2 * damping
            cost = _normal(touch, x, prior, sure, normal, pull)
            if settled:
                break
        elif damping > 1e6:
            break
        else:
            damping *= 5.0


@inner
def _cost(touch, x, prior, sure):
    """Return the sum of squared residuals in standard deviations, including those from the prior."""
    cells, end, force, weight, charts = touch
    cost = 0.0
    for i in range(end):
        off = force[cells[i]]
        for q in range(0, len(x), 4):
            square = (charts[q // 4, 0, i] - x[q]) ** 2 + (charts[q // 4, 1, i] - x[q + 1]) ** 2
            off -= np.exp(x[q + 2] - 0.5 * np.exp(-2.0 * x[q + 3]) * square)
        cost += weight[i] * off * off
    for a in range(len(x)):
        cost += sure[a] * (x[a] - prior[a]) ** 2
    return cost


@inner
def _normal(touch, x, prior, sure, normal, pull):
    """Write the normal equations about x into `normal` and `pull`, and return the cost there."""
    cells, end, force, weight, charts = touch
    cost, slope = 0.0, np.empty(len(x))
    normal[:], pull[:] = 0.0, 0.0
    for i in range(end):
        off = force[cells[i]]
        for q in range(0, len(x), 4):
            a, b = charts[q // 4, 0, i] - x[q], charts[q // 4, 1, i] - x[q + 1]
            narrow = np.exp(-2.0 * x[q + 3])
            value = np.exp(x[q + 2] - 0.5 * narrow * (a * a + b * b))
            slope[q], slope[q + 1] = value * narrow * a, value * narrow * b
            slope[q + 2], slope[q + 3] = value, value * narrow * (a * a + b * b)
            off -= value
        cost += weight[i] * off * off
        for c in range(len(x)):
            pull[c] += weight[i] * slope[c] * off
            for d in range(len(x)):
                normal[c, d] += weight[i] * slope[c] * slope[d]
    for c in range(len(x)):
        off = x[c] - prior[c]
        cost += sure[c] * off * off
        pull[c] -= sure[c] * off
        normal[c, c] += sure[c]
    return cost


@inner
def lift(cells, end, own, used, inside, origin, at, row, column, place, here, ways):
    """Write position and unit normal of the body at a place of `origin`'s tangent plane, and both steps (2, 3) there.

    Normals turn evenly with the distance along the body: the turn K is fitted to those of the cells by least squares. A
    path x then ends at a chord that leans by half the turn of the normal; this is exact on a sphere and along a
    cylinder. The mean distance of the cells from that surface, weighted by their forces, is added along the normal.
    """
    positions, normals, tangents, spacing = place[0][0], place[0][1], place[0][2], place[1][1]
    size, n, along = spacing[origin], normals[origin], tangents[origin]
    aside, bend, there = np.empty(3), np.zeros((2, 2)), np.empty(3)
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        aside[c] = n[a] * along[b] - n[b] * along[a]
    _bend(cells, end, own, normals, n, along, aside, at, bend)
    height = 0.0
    for i in range(end):
        k = cells[i]
        _reach(at[0, k] * size, at[1, k] * size, bend, size, there)
        over = 0.0
        for c in range(3):
            over += (positions[k, c] - positions[origin, c]) * n[c]
        height += own[i] * used[k] / inside * (over - there[2])
    turn = _reach(row * size, column * size, bend, size, there)
    ahead = (bend[0, 0] * row + bend[0, 1] * column) * turn
    across = (bend[1, 0] * row + bend[1, 1] * column) * turn
    upright = np.sqrt(max(1.0 - ahead * ahead - across * across, 0.0))
    lean, total = 0.0, 0.0
    for c in range(3):
        here[c] = positions[origin, c] + there[0] * along[c] + there[1] * aside[c] + (there[2] + height) * n[c]
        here[3 + c] = ahead * along[c] + across * aside[c] + upright * n[c]
        lean += along[c] * here[3 + c]
    for c in range(3):
        ways[0, c] = along[c] - lean * here[3 + c]
        total += ways[0, c] ** 2
    for c in range(3):
        ways[0, c] *= size / np.sqrt(total)
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        ways[1, c] = here[3 + a] * ways[0, b] - here[3 + b] * ways[0, a]


@inner
def _bend(cells, end, own, normals, n, along, aside, at, bend):
    """Add the turn (2, 2) [rad] of the normal over one spacing along both axes to `bend`, which is 0 before.

    Each cell counts by its share `own` of the touch.
    """
    xx, xy, yy = _RIDGE, 0.0, _RIDGE
    for i in range(end):
        k = cells[i]
        ahead, across, upright = 0.0, 0.0, 0.0
        for c in range(3):
            ahead += normals[k, c] * along[c]
            across += normals[k, c] * aside[c]
            upright += normals[k, c] * n[c]
        sine = np.sqrt(ahead * ahead + across * across)
        scale = np.arctan2(sine, upright) / sine if sine > 0.0 else 1.0
        xx += own[i] * at[0, k] * at[0, k]
        xy += own[i] * at[0, k] * at[1, k]
        yy += own[i] * at[1, k] * at[1, k]
        for c in range(2):
            bend[0, c] += own[i] * scale * ahead * at[c, k]
            bend[1, c] += own[i] * scale * across * at[c, k]
    det = xx * yy - xy * xy
    for a in range(2):
        one, other = bend[a, 0], bend[a, 1]
        bend[a, 0], bend[a, 1] = (yy * one - xy * other) / det, (xx * other - xy * one) / det


@inner
def _reach(x, y, bend, size, there):
    """Write the end of a path (x, y) [m] on the body, by tangents and normal, to `there`; return sin(turn)/turn."""
    ahead, across = (bend[0, 0] * x + bend[0, 1] * y) / size, (bend[1, 0] * x + bend[1, 1] * y) / size
    way, turn = np.sqrt(x * x + y * y), np.sqrt(ahead * ahead + across * across)
    half = 0.5 * turn
    chord = np.sin(half) / half if half > 1e-6 else 1.0
    lean = 0.5 * (x * ahead + y * across) / way if way > 0.0 else 0.0
    there[0], there[1] = chord * np.cos(lean) * x, chord * np.cos(lean) * y
    there[2] = -chord * way * np.sin(lean)
    return np.sin(turn) / turn if turn > 1e-6 else 1.0
