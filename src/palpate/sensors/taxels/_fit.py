"""Compiled: fit the place of a touch between taxels that stand anywhere, and lift it onto the body.

A centroid lies inside the taxels that feel a touch, so next to an edge of the skin, a hole or a module it is pulled
towards the taxels. Here a round Gaussian of unknown place, height and width is fitted to their readings instead, by
Gauss-Newton steps with Marquardt's damping: places without taxels add no information, and a taxel that feels nothing
does. Lengths are in spacings of taxels.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner
from palpate.surfaces._vectors import solve_positive

# prior of a touch: the spacing of taxels is about as large as their reach
_WIDTH, _WIDER = 0.5, 0.5  # standard deviation of its pressure, and that of the logarithm of it
_BESIDE = 0.5  # standard deviation of its distance from the hardest pressed taxel, along each axis
# share of its height by which pressure differs from a Gaussian: Hertz's, one spacing wide, 1 to 3 %, a flat disc 1 to 6
_SHAPE = 0.04
_STEPS = 20
_RIDGE = 1e-3  # squared spacings: damps a bend along which there are no taxels


@inner
def fit_touch(cells, count, end, own, numbers, at, start, out):
    """Fit a touch; write its place (2), its variances along both axes and their covariance into out (5,).

    `start` (2,) is the centroid. Of an area's cells those from `count` to `end` are its rim; `own` is the share of each
    that belongs to this touch, and `numbers` are the forces of all cells, and their standard deviations by noise, and
    by noise and gain.
    """
    force, noise, error = numbers
    hardest, peak = cells[0], 0.0
    for i in range(end):
        k = cells[i]
        if own[i] * force[k] > peak:
            hardest, peak = k, own[i] * force[k]
    prior = np.array([at[0, hardest], at[1, hardest], 0.0, np.log(_WIDTH)])
    sure = np.array([_BESIDE**-2, _BESIDE**-2, 0.0, _WIDER**-2])
    shape = (_SHAPE * peak) ** 2
    x, trial = np.array([start[0], start[1], np.log(peak), prior[3]]), np.empty(4)
    normal, factor, pull, step = np.empty((4, 4)), np.empty((4, 4)), np.empty(4), np.empty(4)
    touch = (cells, count, end, own, force, noise, error, at, shape)
    cost, damping = _normal(touch, x, prior, sure, normal, pull), 1e-3
    for _ in range(_STEPS):
        for a in range(4):
            for b in range(4):
                factor[a, b] = normal[a, b] * (1.0 + damping) if a == b else normal[a, b]
        solve_positive(factor, pull, 4, step)
        for a in range(4):
            trial[a] = x[a] + (step[a] if a < 2 else min(max(step[a], -1.0), 1.0))
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
    # what the model cannot explain widens all
    scale = max(1.0, _cost(touch, x, prior, np.zeros(4)) / max(end - 4, 1))
    out[0], out[1] = x[0], x[1]
    for a in range(2):
        pull[:] = 0.0
        pull[a] = scale
        factor[:] = normal
        if not solve_positive(factor, pull, 4, step):
            step[:] = np.nan
        out[2 + a] = step[a]
        out[4] = step[0]


@inner
def _cost(touch, x, prior, sure):
    """Return the sum of squared residuals in standard deviations, including those from the prior."""
    cells, count, end, own, force, noise, error, at, shape = touch
    cost, narrow = 0.0, 0.5 * np.exp(-2.0 * x[3])
    for i in range(end):
        k = cells[i]
        square = (at[0, k] - x[0]) ** 2 + (at[1, k] - x[1]) ** 2
        spread = error[k] if i < count else noise[k]
        cost += (own[i] * force[k] - np.exp(x[2] - narrow * square)) ** 2 / (spread * spread + shape)
    for a in range(4):
        cost += sure[a] * (x[a] - prior[a]) ** 2
    return cost


@inner
def _normal(touch, x, prior, sure, normal, pull):
    """Write the normal equations about x into `normal` and `pull`, and return the cost there."""
    cells, count, end, own, force, noise, error, at, shape = touch
    cost, narrow, slope = 0.0, np.exp(-2.0 * x[3]), np.empty(4)
    normal[:], pull[:] = 0.0, 0.0
    for i in range(end):
        k = cells[i]
        a, b = at[0, k] - x[0], at[1, k] - x[1]
        value = np.exp(x[2] - 0.5 * narrow * (a * a + b * b))
        slope[0], slope[1] = value * narrow * a, value * narrow * b
        slope[2], slope[3] = value, value * narrow * (a * a + b * b)
        spread = error[k] if i < count else noise[k]
        weight, left = 1.0 / (spread * spread + shape), own[i] * force[k] - value
        cost += weight * left * left
        for c in range(4):
            pull[c] += weight * slope[c] * left
            for d in range(4):
                normal[c, d] += weight * slope[c] * slope[d]
    for c in range(4):
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
