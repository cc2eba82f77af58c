"""Compiled: from the voltages of load cells to contacts on an elliptic cylinder, x^2/a^2 + z^2/b^2 = 1, in closed form.

A point of it is c = (a sin t, y, b cos t), with h = |dc/dt|, normal n = (b sin t, 0, a cos t)/h and tangent
u = (n_z, 0, -n_x). A soft finger with its force at e = c - d n satisfies M - e x F = tau n. As n has no part along y,
the second row knows neither y nor tau,

    e_z F_x - e_x F_z = M_y        for d = 0:  b F_x cos t - a F_z sin t = M_y,

a line that meets the ellipse twice; the force presses at one of the two, F . n < 0. Then u . (M - e x F) = 0 gives

    y = (u . M + F_y (a b/h - d))/(F . n),    tau = F . M/(F . n).
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inlined, inner

__all__ = [
    "ACCURACY",
    "DEPTH",
    "DRIFT",
    "EXPONENT",
    "FRICTION",
    "HALF",
    "MISFIT",
    "OFF",
    "ON",
    "PURE",
    "SETTINGS",
    "TORSION",
    "UPPER",
    "A",
    "B",
    "contacts",
    "one_contact",
]

A, B, HALF, DEPTH, EXPONENT, FRICTION, TORSION, ON, OFF, ACCURACY, PURE, DRIFT, MISFIT, UPPER, SETTINGS = range(15)
_CONTACT, _NO_CONTACT, _TOO_LIGHT, _OFF_SURFACE, _IMPLAUSIBLE, _SATURATED, _INVALID = 0, 2, 3, 4, 5, 6, 7
_RESIDUAL, _CANDIDATES, _STATUS = 19, 20, 21  # estimate._Row, which compiled code cannot read
_LARGEST = 1e9
_NEWTON = 8  # steps to where an indented force acts
_TOLERANCE = 3.0  # standard deviations by which a contact may lie beyond an end, and is put there
_ROUNDING = 1e-9  # of the size
_FADES, _ENOUGH, _DOUBTFUL = 0.999, 10.0, 0.01  # of blame a sample; to be left out; of what several cells explain


@inlined
def _blank(row):
    """Nothing known; a slice that is set takes the compiler ten times as long as a loop."""
    for k in range(len(row)):
        row[k] = np.nan
    row[_CANDIDATES] = 0.0


@inlined
def _mapped(readings, n, bias, mappings, subset, out):
    """Reading n less bias, mapped: six of a wrench, then what no wrench can make. The sums run along the outputs.

    Whole arrays and numbers, not parts of arrays: each part would count its references.
    """
    count = mappings.shape[2]
    for i in range(count):
        out[i] = 0.0
    for j in range(readings.shape[1]):
        value = readings[n, j] - bias[j]
        for i in range(count):
            out[i] += mappings[subset, j, i] * value


@inlined
def _left(out, expected):
    """Squares that no wrench makes, over what is expected of each."""
    total = 0.0
    for i in range(6, len(out)):
        total += out[i] * out[i]
    return total / expected


@inlined
def _saturated(readings, n, limits):
    """The cell at its range: its number, -1 where none is, -2 where several are."""
    full = -1
    for j in range(readings.shape[1]):
        if readings[n, j] <= limits[j, 0] or readings[n, j] >= limits[j, 1]:
            if full >= 0 and full != j // 3:
                return -2
            full = j // 3
    return full


@inner
def _stuck(readings, n, state, first):
    """Of the samples that contradict: one more than the cell of which a channel repeats itself exactly, -1 if not one.

    That is how a channel at a range that nobody stated looks, and a dead one. Coarse voltages repeat themselves too,
    but rarely in one cell alone.
    """
    found = -1
    for j in range(readings.shape[1]):
        if readings[n, j] == state[first + j]:
            if found >= 0 and found != 1 + j // 3:
                return -1
            found = 1 + j // 3
    return found


@inlined
def _chosen(readings, n, bias, limits, mappings, metrics, bounds, settings, state, out, work):
    """Which subset answers: 0 all, 1 + i without cell i, -1 and -2 none; the mapped reading is left in out.

    A cell at its range is left out. Where what is left has too little chance, so is the cell without which it has: of
    several, the one blamed most so far. Blame grows by what is not in doubt and fades; a cell that has enough of it is
    left out for as long as it has.
    """
    full = _saturated(readings, n, limits)
    if full != -1:
        if full == -2 or bounds[1 + full] < 0.0:
            return -1
        _mapped(readings, n, bias, mappings, 1 + full, out)
        return 1 + full
    _mapped(readings, n, bias, mappings, 0, out)
    expected = 1.0 + settings[DRIFT] ** 2
    if settings[MISFIT] > 0.0:
        square = 0.0
        for i in range(6):
            for j in range(6):
                square += out[i] * metrics[i, j] * out[j]
        expected += settings[MISFIT] ** 2 * square
    agreed = _left(out, expected) <= bounds[0]
    most, suspect = 0.0, -1
    for cell in range(1, len(bounds)):
        state[cell] *= _FADES
        if state[cell] > most:
            most, suspect = state[cell], cell
    if agreed and most < _ENOUGH:
        return 0
    if most >= _ENOUGH:
        _mapped(readings, n, bias, mappings, suspect, work)
        if _left(work, expected) <= bounds[suspect]:
            for i in range(len(out)):
                out[i] = work[i]
            if not agreed:
                state[suspect] += 1.0
            return suspect
        if agreed:
            return 0
    best, least, passing = _stuck(readings, n, state, len(bounds)), np.inf, 1
    if best > 0:
        _mapped(readings, n, bias, mappings, best, work)
        if bounds[best] < 0.0 or (bounds[best] > 0.0 and _left(work, expected) > bounds[best]):
            best = -1
    if best < 0:
        passing = 0
    for cell in range(1, len(bounds) if best < 0 else 0):
        if bounds[cell] <= 0.0:
            continue
        _mapped(readings, n, bias, mappings, cell, work)
        left = _left(work, expected) / bounds[cell]
        if left > 1.0:
            continue
        passing += 1
        if best < 0 or state[cell] > state[best] or (state[cell] == state[best] and left < least):
            best, least = cell, left
    if best < 0:
        return -2
    state[best] += 1.0 if passing == 1 else _DOUBTFUL
    _mapped(readings, n, bias, mappings, best, out)
    return best


@inner
def _pure(wrench, spread, work):
    """To the nearest wrench without moment along its force, F . M = 0, in the metric of its spread; and what is left.

    Two steps of Newton on one equation, with slope (M, F).
    """
    for _ in range(2):
        left, square = 0.0, 0.0
        for i in range(3):
            left += wrench[i] * wrench[3 + i]
        for i in range(6):
            work[i] = 0.0
            for j in range(6):
                work[i] += spread[i, j] * wrench[(j + 3) % 6]
        for i in range(6):
            square += work[i] * wrench[(i + 3) % 6]
        if not square > 0.0:
            return
        for i in range(6):
            wrench[i] -= work[i] * left / square
    for i in range(6):
        work[i] = 0.0
        for j in range(6):
            work[i] += spread[i, j] * wrench[(j + 3) % 6]
    square = 0.0
    for i in range(6):
        square += work[i] * wrench[(i + 3) % 6]
    for i in range(6):
        for j in range(6):
            spread[i, j] -= work[i] * work[j] / square


@inlined
def _meeting(w, settings):
    """Cosine and sine of t where the force presses; False where its line misses, with the nearest t."""
    a, b = settings[A], settings[B]
    p, q = b * w[0], -a * w[2]
    size = np.sqrt(p * p + q * q)
    if size == 0.0:
        return False, 1.0, 0.0
    cosine = w[4] / size
    met = abs(cosine) <= 1.0
    cosine = min(1.0, max(-1.0, cosine))
    sine = -np.sqrt(1.0 - cosine * cosine)
    c, s = (p * cosine - q * sine) / size, (q * cosine + p * sine) / size
    if settings[DEPTH] == 0.0 or not met:
        return met, c, s
    for _ in range(_NEWTON):
        h = np.sqrt(b * b * s * s + a * a * c * c)
        fn, ft = (w[0] * b * s + w[2] * a * c) / h, (w[0] * a * c - w[2] * b * s) / h
        fn = min(fn, -1e-6)
        nu = a * b / (h * h)
        d = settings[DEPTH] * (-fn) ** settings[EXPONENT]
        rate = settings[EXPONENT] * d / -fn
        g = b * c * w[0] - a * s * w[2] - d * ft - w[4]
        slope = -fn * (h - d * nu) + rate * nu * ft * ft
        step = -g / slope
        step = min(0.5, max(-0.5, step))
        c, s = c - s * step, s + c * step
        length = np.sqrt(c * c + s * s)
        c, s = c / length, s / length
        if abs(step) < _ROUNDING:
            break
    return True, c, s


@inlined
def _locate(w, settings, c, s, row, slopes):
    """Point, normal, torque into a row, and d(arc length, y)/dw into slopes (2, 6); False where it only pulls."""
    a, b = settings[A], settings[B]
    h = np.sqrt(b * b * s * s + a * a * c * c)
    nx, nz = b * s / h, a * c / h
    fn, ft = w[0] * nx + w[2] * nz, w[0] * nz - w[2] * nx
    if not fn < 0.0:
        return False
    d, rate = 0.0, 0.0
    if settings[DEPTH] > 0.0:
        d = settings[DEPTH] * (-fn) ** settings[EXPONENT]
        rate = settings[EXPONENT] * d / -fn
    nu = a * b / (h * h)
    reach = a * b / h - d
    along = nz * w[3] - nx * w[5]
    y = (along + w[1] * reach) / fn
    row[0], row[1], row[2] = a * s, y, b * c
    row[3], row[4], row[5] = nx, 0.0, nz
    row[9] = (w[0] * w[3] + w[1] * w[4] + w[2] * w[5]) / fn
    ex, ez = a * s - d * nx, b * c - d * nz
    slope = -fn * (h - d * nu) + rate * nu * ft * ft
    bend = (b * b - a * a) * s * c / h  # dh/dt
    by_t = -nu * (nx * w[3] + nz * w[5]) + w[1] * (-a * b * bend / (h * h) + rate * nu * ft) - y * nu * ft
    turn = rate * ft
    slopes[0, 0] = -(ez + turn * nx) / slope
    slopes[0, 1] = 0.0
    slopes[0, 2] = -(-ex + turn * nz) / slope
    slopes[0, 3] = slopes[0, 5] = 0.0
    slopes[0, 4] = 1.0 / slope
    direct = w[1] * rate - y
    slopes[1, 0], slopes[1, 1], slopes[1, 2] = direct * nx, reach, direct * nz
    slopes[1, 3], slopes[1, 4], slopes[1, 5] = nz, 0.0, -nx
    for k in range(6):
        slopes[1, k] = (slopes[1, k] + by_t * slopes[0, k]) / fn
        slopes[0, k] *= h
    return True


@inlined
def _spread(w, slopes, spreads, subset, doubts, plane, first, second):
    """Covariance (2, 2) of the point along u and y: of the wrench, and of the calibration's E w."""
    plane[0, 0] = plane[0, 1] = plane[1, 1] = 0.0
    for m in range(6):
        one, other = 0.0, 0.0
        for k in range(6):
            one += spreads[subset, m, k] * slopes[0, k]
            other += spreads[subset, m, k] * slopes[1, k]
        plane[0, 0] += slopes[0, m] * one
        plane[0, 1] += slopes[0, m] * other
        plane[1, 1] += slopes[1, m] * other
    plane[1, 0] = plane[0, 1]
    count = doubts.shape[1]
    if count == 0:
        return
    for r in range(count):
        first[r] = second[r] = 0.0
    for m in range(6):
        for k in range(6):
            row = 6 * m + k
            one, other = slopes[0, m] * w[k], slopes[1, m] * w[k]
            for r in range(count):
                value = doubts[row, r]
                first[r] += value * one
                second[r] += value * other
    for r in range(count):
        plane[0, 0] += first[r] * first[r]
        plane[1, 1] += second[r] * second[r]
        plane[0, 1] += first[r] * second[r]
    plane[1, 0] = plane[0, 1]


@inlined
def _bounded(row, plane, settings):
    """Puts a point that is hardly beyond an end there; False where it is farther out, with the nearest point."""
    inside = True
    beyond = abs(row[1]) - settings[HALF]
    if beyond > 0.0:
        inside = beyond <= _TOLERANCE * np.sqrt(max(0.0, plane[1, 1]))
        row[1] = settings[HALF] if row[1] > 0.0 else -settings[HALF]
    if row[2] < 0.0 and settings[UPPER] == 1.0:
        inside = inside and -row[2] <= _TOLERANCE * np.sqrt(max(0.0, plane[0, 0]))
        row[0], row[2] = (settings[A] if row[0] > 0.0 else -settings[A]), 0.0
        row[3], row[5] = (1.0 if row[3] > 0.0 else -1.0), 0.0
    return inside


@inlined
def _answer(w, spreads, subset, doubts, settings, state, row, slopes, plane, first, second):
    """One wrench with its covariance to a row; state[0] is whether it touched before."""
    force = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    row[6], row[7], row[8] = w[0], w[1], w[2]
    if force >= settings[ON] and force > 0.0:
        state[0] = 1.0
    elif force < settings[OFF] or force == 0.0:
        state[0] = 0.0
        row[_STATUS] = _NO_CONTACT
        return
    if state[0] == 0.0:
        row[_STATUS] = _TOO_LIGHT
        return
    if settings[PURE] == 1.0:
        sharper = spreads[subset : subset + 1].copy()
        _pure(w, sharper[0], np.empty(6))
        spreads, subset = sharper, 0
        row[6], row[7], row[8] = w[0], w[1], w[2]
    met, c, s = _meeting(w, settings)
    if not met or not _locate(w, settings, c, s, row, slopes):
        row[_STATUS] = _OFF_SURFACE
        h = np.sqrt((settings[B] * s) ** 2 + (settings[A] * c) ** 2)
        row[0], row[2] = settings[A] * s, settings[B] * c
        row[3], row[4], row[5] = settings[B] * s / h, 0.0, settings[A] * c / h
        row[1] = 0.0
        row[9] = np.nan
        return
    _spread(w, slopes, spreads, subset, doubts, plane, first, second)
    if settings[ACCURACY] > 0.0 and plane[0, 0] + plane[1, 1] > settings[ACCURACY] ** 2:
        for k in range(6):
            row[k] = np.nan
        row[9] = np.nan
        row[_STATUS] = _TOO_LIGHT
        return
    if not _bounded(row, plane, settings):
        row[9] = np.nan
        row[_STATUS] = _OFF_SURFACE
        return
    ux, uz = row[5], -row[3]
    row[10] = ux * ux * plane[0, 0]
    row[11] = row[13] = ux * plane[0, 1]
    row[12] = row[16] = ux * uz * plane[0, 0]
    row[14] = plane[1, 1]
    row[15] = row[17] = uz * plane[0, 1]
    row[18] = uz * uz * plane[0, 0]
    pressing = -(w[0] * row[3] + w[2] * row[5])
    side = np.sqrt(max(0.0, force * force - pressing * pressing))
    within = side <= settings[FRICTION] * pressing and abs(row[9]) <= settings[TORSION] * pressing
    row[_CANDIDATES] = 1.0 if within else 0.0
    row[_STATUS] = _CONTACT if within else _IMPLAUSIBLE
    row[_RESIDUAL] = 0.0 if within else np.nan


@entry
def contacts(readings, bias, limits, mappings, metrics, spreads, bounds, doubts, settings, state, rows, subsets):
    """Voltages (n, m) to rows (n, 22) of `estimate.ROW`, and which subset answered (n,): 0 all, 1 + i without cell i.

    bias (m,); limits (m, 2). Of all cells, and without each: mappings (1 + k, m, 6 + r, and zeros), spreads (1 + k, 6,
    6) of the noise, and bounds (1 + k,) of what may be left, negative where they tell no wrench, 0 where nothing is
    left to judge by. metrics (6, 6), the squared length of a wrench in whitened voltages, a degree of freedom; doubts
    (36, q), D D' the covariance of E; settings as named above; state (1 + k + m,), whether it touched before, the blame
    of each cell, and the last voltages.
    """
    outputs = mappings.shape[2]
    out, work, w = np.empty(outputs), np.empty(outputs), np.empty(6)
    slopes, plane = np.zeros((2, 6)), np.zeros((2, 2))
    first, second = np.empty(doubts.shape[1]), np.empty(doubts.shape[1])
    for i in range(len(readings)):
        row = rows[i]
        _blank(row)
        sound = True
        for j in range(readings.shape[1]):
            sound = sound and abs(readings[i, j]) <= _LARGEST
        if not sound:
            row[_STATUS] = _INVALID
            subsets[i] = -2
            continue
        chosen = _chosen(readings, i, bias, limits, mappings, metrics, bounds, settings, state, out, work)
        subsets[i] = chosen
        for j in range(readings.shape[1]):
            state[len(bounds) + j] = readings[i, j]
        if chosen < 0:
            row[_STATUS] = _SATURATED if chosen == -1 else _INVALID
            continue
        for k in range(6):
            w[k] = out[k]
        _answer(w, spreads, chosen, doubts, settings, state, row, slopes, plane, first, second)


@entry
def one_contact(w, spread, doubts, settings, row, slopes):
    """One wrench (6,) with a covariance (1, 6, 6) to a row (22,), and the slopes (2, 6) of the point along u and y."""
    state, plane = np.zeros(1), np.zeros((2, 2))
    first, second = np.empty(doubts.shape[1]), np.empty(doubts.shape[1])
    _blank(row)
    _answer(w, spread, 0, doubts, settings, state, row, slopes, plane, first, second)
