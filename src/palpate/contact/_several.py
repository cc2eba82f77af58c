"""Compiled: one frame of a sheet of taxels into touches: rest, force, areas, the split of areas, centroids.

Cells are numbered row by row. A ring is a sheet whose columns close: column `used` is column 0 again.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inner

__all__ = ["EXTRA", "MOST", "WIDTH", "touches"]

MOST = 64  # touches of a frame
PARTS = 16  # of an area
EXTRA = 22  # where the numbers behind a row of an estimate begin
WIDTH = EXTRA + 11  # row, column, area, force, peak and mean pressure, variances along the axes, angle, cells, identity
SATURATED = 6.0  # palpate.contact.estimate.Status
_ROUNDS = 8  # of expectation maximisation
_NARROW = 0.12  # squared cells: no touch is seen narrower than its cell
_CELL = 1.0 / 12.0  # variance of a place anywhere in a cell


@inner
def _force(counts, table, step):
    """[N] of counts above rest: straight between the entries, and on with the first and the last slope."""
    at = counts / step
    k = min(max(int(at), 0), len(table) - 2)
    return table[k] + (at - k) * (table[k + 1] - table[k])


@inner
def _beside(k, step, across, columns, rows, used, ring):
    """The cell so many rows and columns from cell k, or -1."""
    row, column = k // columns + step, k % columns + across
    if row < 0 or row >= rows:
        return -1
    if ring:
        column = (column + used) % used
    elif column < 0 or column >= columns:
        return -1
    return row * columns + column


@inner
def _unwrap(raw, last, turns, value, wrapped, rest, noise, columns, rows, used, ring, turn):
    """Readings that went over one end of their range and came out at the other, alone: a touch moves neighbours too.

    Below 0 only where a cell rests that low; over the top only while a neighbour is pressed.
    """
    for k in range(len(raw)):
        moved = raw[k] - (last[k] if np.isfinite(last[k]) else rest[k])
        jumped, quiet, pressed = abs(moved) > 0.85 * turn, True, False
        if jumped or turns[k] != 0:
            for step in range(-1, 2):
                for across in range(-1, 2):
                    j = _beside(k, step, across, columns, rows, used, ring)
                    if j < 0 or j == k:
                        continue
                    past = abs(raw[j] - (last[j] if np.isfinite(last[j]) else rest[j]))
                    quiet = quiet and (past < 0.25 * turn or past > 0.85 * turn)  # those may wrap themselves
                    pressed = pressed or abs(raw[j] - rest[j]) > 0.1 * turn
        if jumped and quiet:
            low = raw[k] - turn > rest[k] - 6.0 * noise[k] - 1.0
            if moved < 0.0 or low or turns[k] > 0:
                turns[k] = min(1, max(-1, turns[k] + (1 if moved < 0.0 else -1)))
        if (turns[k] < 0 and raw[k] < 0.85 * turn) or (turns[k] > 0 and not pressed):
            turns[k] = 0
        wrapped[k] += jumped and turns[k] != 0
    for k in range(len(raw)):
        value[k] = raw[k] + turns[k] * turn
        last[k] = raw[k]


@inner
def _fill(z, force, good, columns, rows, used, ring):
    """Cells that are no good take the mean of the good ones beside them, if there are two."""
    for k in range(len(force)):
        if good[k]:
            continue
        count, total, level = 0, 0.0, 0.0
        for side in range(4):
            j = _beside(k, (side == 0) - (side == 1), (side == 2) - (side == 3), columns, rows, used, ring)
            if j >= 0 and good[j]:
                count += 1
                total += force[j]
                level += z[j]
        force[k] = total / count if count >= 2 else 0.0
        z[k] = level / count if count >= 2 else 0.0


@inner
def _grow(seed, name, z, off, label, column_of, cells, columns, rows, used, ring):
    """The cells joined to a seed, each with its column as it runs on over the seam; returns how many."""
    label[seed], column_of[seed], cells[0] = name, seed % columns, seed
    done, count = 0, 1
    while done < count:
        k = cells[done]
        done += 1
        for step in range(-1, 2):
            for across in range(-1, 2):
                j = _beside(k, step, across, columns, rows, used, ring)
                if j >= 0 and label[j] == 0 and z[j] > off:
                    label[j], column_of[j] = name, column_of[k] + across
                    cells[count] = j
                    count += 1
    return count


@inner
def _rim(name, count, label, column_of, cells, good, columns, rows, used, ring):
    """The cells around an area, behind it in `cells`: what is below the threshold there is force all the same."""
    end = count
    for i in range(count):
        k = cells[i]
        for step in range(-1, 2):
            for across in range(-1, 2):
                j = _beside(k, step, across, columns, rows, used, ring)
                if j >= 0 and label[j] == 0 and good[j]:
                    label[j], column_of[j] = -name, column_of[k] + across
                    cells[end] = j
                    end += 1
    return end


@inner
def _root(parent, k):
    while parent[k] != k:
        k = parent[k]
    return k


@inner
def _split(cells, count, name, force, spread, label, parent, columns, rows, used, ring, sure, share):
    """Basins of an area: a peak counts that stands higher over its saddle than noise and unequal cells can make it.

    Cells are taken from the hardest pressed down. Where two basins meet, the lower is given up unless it stands out;
    between cells that share a corner only, the saddle is the higher of the two others there. Afterwards parent[k] is
    the peak of each cell's basin.
    """
    order = np.argsort(-force[cells[:count]])
    for i in range(count):
        parent[cells[i]] = -1
    for i in range(count):
        k = cells[order[i]]
        parent[k] = k
        for diagonal in range(2):  # sides first
            for step in range(-1, 2):
                for across in range(-1, 2):
                    j = _beside(k, step, across, columns, rows, used, ring)
                    if abs(step) + abs(across) != 1 + diagonal or j < 0 or label[j] != name or parent[j] < 0:
                        continue
                    saddle = force[k]
                    if diagonal:
                        one = _beside(k, step, 0, columns, rows, used, ring)
                        other = _beside(k, 0, across, columns, rows, used, ring)
                        saddle = min(saddle, max(force[one], force[other]))
                    high, low = _root(parent, k), _root(parent, j)
                    if force[low] > force[high]:
                        high, low = low, high
                    if force[low] - saddle < max(sure * spread[low], share * force[low]):
                        parent[low] = high
    for i in range(count):
        parent[cells[i]] = _root(parent, cells[i])


@inner
def _mixture(cells, count, force, column_of, columns, parent, parts):
    """Shares of an area's touches: round Gaussians fitted to its force; parts (p, 5): row, column, variance, weight."""
    number = 0
    for i in range(count):
        k = cells[i]
        if parent[k] == k and number < PARTS:
            parts[number, 0], parts[number, 1] = k // columns, column_of[k]
            parts[number, 2], parts[number, 3], parts[number, 4] = 0.5, force[k], k
            number += 1
    sums = np.empty((PARTS, 4))
    share = np.empty(PARTS)
    for step in range(_ROUNDS if number > 1 else 0):
        sums[:] = 0.0
        for i in range(count):
            k = cells[i]
            weight = max(force[k], 0.0)
            row, column = k // columns, float(column_of[k])
            if step == 0:  # begin with the basins
                for p in range(number):
                    share[p] = 1.0 if parent[k] == int(parts[p, 4]) else 0.0
            else:
                _shares(row, column, parts, number, share)
            for p in range(number):
                own = weight * share[p]
                sums[p, 0] += own
                sums[p, 1] += own * row
                sums[p, 2] += own * column
                sums[p, 3] += own * (row * row + column * column)
        for p in range(number):
            if sums[p, 0] > 0.0:
                row, column = sums[p, 1] / sums[p, 0], sums[p, 2] / sums[p, 0]
                parts[p, 0], parts[p, 1], parts[p, 3] = row, column, sums[p, 0]
                parts[p, 2] = max(0.5 * (sums[p, 3] / sums[p, 0] - row * row - column * column), _NARROW)
    return number


@inner
def _shares(row, column, parts, number, share):
    """How much of a cell belongs to each touch."""
    least = np.inf
    for p in range(number):
        square = ((row - parts[p, 0]) ** 2 + (column - parts[p, 1]) ** 2) / parts[p, 2]
        share[p] = 0.5 * square - np.log(parts[p, 3] / parts[p, 2])
        least = min(least, share[p])
    total = 0.0
    for p in range(number):
        share[p] = np.exp(least - share[p])
        total += share[p]
    for p in range(number):
        share[p] /= total


@inner
def _cubic(t, weights):
    """Catmull and Rom's weights of four values around t in [0, 1]."""
    s, q = t * t, t * t * t
    weights[0] = 0.5 * (-t + 2.0 * s - q)
    weights[1] = 0.5 * (2.0 - 5.0 * s + 3.0 * q)
    weights[2] = 0.5 * (t + 4.0 * s - 3.0 * q)
    weights[3] = 0.5 * (-s + q)


@inner
def _place(grid, row, column, out):
    """Position and normal (not yet unit) between cell centres; `grid` has two more cells at each end."""
    i = min(max(int(np.floor(row)), -1), grid.shape[0] - 5)
    j = min(max(int(np.floor(column)), -1), grid.shape[1] - 5)
    u, v = np.empty(4), np.empty(4)
    _cubic(row - i, u)
    _cubic(column - j, v)
    out[:] = 0.0
    for a in range(4):
        for b in range(4):
            weight = u[a] * v[b]
            for c in range(6):
                out[c] += weight * grid[i + 1 + a, j + 1 + b, c]


@inner
def _write(row, column, total, moments, variances, grid, used, ring, out):
    """Where the touch lies on the link, and what its place is worth."""
    wrapped = column % used if ring else column
    here, there = np.empty(6), np.empty(6)
    _place(grid, row, wrapped, here)
    length = np.sqrt(here[3] ** 2 + here[4] ** 2 + here[5] ** 2)
    for c in range(3):
        out[c], out[3 + c] = here[c], here[3 + c] / length
    tangents = np.empty((2, 3))
    for axis in range(2):
        _place(grid, row + 0.25 * (axis == 0), wrapped + 0.25 * (axis == 1), there)
        tangents[axis] = there[:3]
        _place(grid, row - 0.25 * (axis == 0), wrapped - 0.25 * (axis == 1), there)
        tangents[axis] = 2.0 * (tangents[axis] - there[:3])
    for a in range(3):
        for b in range(3):
            out[10 + 3 * a + b] = (
                variances[0] * tangents[0, a] * tangents[0, b]
                + variances[1] * tangents[1, a] * tangents[1, b]
                + variances[2] * (tangents[0, a] * tangents[1, b] + tangents[1, a] * tangents[0, b])
            )
    out[9], out[19], out[20] = np.nan, 0.0, 1.0
    out[EXTRA], out[EXTRA + 1], out[EXTRA + 3] = row, wrapped, total
    mean, half = 0.5 * (moments[0] + moments[1]), 0.5 * (moments[0] - moments[1])
    root = np.sqrt(half * half + moments[2] * moments[2])
    out[EXTRA + 6], out[EXTRA + 7] = max(mean + root, 0.0), max(mean - root, 0.0)
    out[EXTRA + 8] = 0.5 * np.arctan2(2.0 * moments[2], moments[0] - moments[1])


@inner
def _measure(cells, count, end, part, number, parts, force, spread, normals, areas, saturated, column_of, columns, grid,
             used, ring, out):  # fmt: skip
    """One touch of an area: sums over its share of each cell; the centroid is divided by the sum of the forces."""
    share = np.empty(PARTS)
    share[0] = 1.0
    total, row, column, push, covered, peak, held, full = 0.0, 0.0, 0.0, np.zeros(3), 0.0, 0.0, 0.0, False
    inside = 0.0
    for i in range(end):
        k = cells[i]
        if number > 1:
            _shares(float(k // columns), float(column_of[k]), parts, number, share)
        own = share[part]
        total += own * force[k]
        for c in range(3):
            push[c] -= own * force[k] * normals[k, c]
        if i < count:
            row += own * force[k] * (k // columns)
            column += own * force[k] * column_of[k]
            inside += own * force[k]
            covered += own * areas[k]
            held += own
            if own > 0.5:
                peak = max(peak, force[k] / areas[k])
                full = full or saturated[k]
    if inside <= 0.0 or total <= 0.0:
        return False
    row, column = row / inside, column / inside
    rr, cc, rc, vr, vc, vrc = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        k = cells[i]
        if number > 1:
            _shares(float(k // columns), float(column_of[k]), parts, number, share)
        own = share[part]
        a, b = k // columns - row, column_of[k] - column
        rr += own * force[k] * a * a
        cc += own * force[k] * b * b
        rc += own * force[k] * a * b
        noise = (own * spread[k] / inside) ** 2
        vr += noise * a * a
        vc += noise * b * b
        vrc += noise * a * b
    rr, cc, rc = rr / inside, cc / inside, rc / inside
    # within one cell a touch may be anywhere; over several the cells' edges hardly matter: measured on Hertz's patches
    vr += _CELL / (1.0 + 12.0 * rr) ** 2
    vc += _CELL / (1.0 + 12.0 * cc) ** 2
    _write(row, column, total, np.array([rr, cc, rc]), np.array([vr, vc, vrc]), grid, used, ring, out)
    for c in range(3):
        out[6 + c] = push[c]
    out[21] = SATURATED if full else 0.0
    out[EXTRA + 2], out[EXTRA + 4], out[EXTRA + 5] = covered, peak, inside / covered
    out[EXTRA + 9] = held
    return True


@entry
def touches(raw, sheet, cell, state, curves, settings, grid, work, out):
    """The touches of a frame in `out` (MOST, WIDTH), and how many there are; -1: the frame cannot be used.

    Args:
        raw: (n,) readings.
        sheet: rows, columns, used columns, ring.
        cell: good (n,), noise (n,), normals (n, 3), areas (n,), number of the curve (n,), limit (n,).
        state: baseline (n,), last reading (n,), turns (n,), how often each wrapped (n,): changed.
        curves: (c, k) forces [N], (c,) counts between two, sign of the sheet.
        settings: on, off [deviations], sure [deviations], share, drift of rest in this step (0 to 1), turn (0: none).
        grid: (rows + 4, columns + 4, 6) positions and normals.
        work: value, z, force, spread, live, saturated (n,), and whole numbers label, column, cells, parent (n,).
        out: rows of an estimate, and behind them what `WIDTH` lists.
    """
    rows, columns, used, ring = sheet
    good, noise, normals, areas, which, limit = cell
    baseline, last, turns, wrapped = state
    tables, steps, sign = curves
    on, off, sure, share, drift, turn = settings
    value, z, force, spread, live, saturated, label, column_of, cells, parent = work
    missing = 0
    for k in range(len(raw)):
        live[k] = good[k] and np.isfinite(raw[k])
        missing += good[k] and not live[k]
        label[k] = 0
    if 4 * missing > len(raw):
        return -1
    if turn > 0.0:
        _unwrap(raw, last, turns, value, wrapped, baseline, noise, columns, rows, used, ring, turn)
    else:
        for k in range(len(raw)):
            value[k] = raw[k]
    for k in range(len(raw)):
        above = sign * (value[k] - baseline[k]) if live[k] else 0.0
        table, step = tables[which[k]], steps[which[k]]
        z[k], force[k] = above / noise[k], _force(above, table, step)
        spread[k] = (
            noise[k] * (_force(max(above, 0.0) + step, table, step) - _force(max(above, 0.0), table, step)) / step
        )
        saturated[k] = live[k] and sign * value[k] >= sign * limit[k]
    _fill(z, force, live, columns, rows, used, ring)
    parts = np.empty((PARTS, 5))
    found, name = 0, 0
    for seed in range(len(raw)):
        if label[seed] != 0 or z[seed] <= on or not live[seed]:
            continue
        name += 1
        count = _grow(seed, name, z, off, label, column_of, cells, columns, rows, used, ring)
        _split(cells, count, name, force, spread, label, parent, columns, rows, used, ring, sure, share)
        number = _mixture(cells, count, force, column_of, columns, parent, parts)
        end = _rim(name, count, label, column_of, cells, live, columns, rows, used, ring)
        for part in range(number):
            if found < MOST and _measure(cells, count, end, part, number, parts, force, spread, normals, areas,
                                         saturated, column_of, columns, grid, used, ring, out[found]):  # fmt: skip
                found += 1
    for k in range(len(raw)):
        if label[k] == 0 and live[k]:
            baseline[k] += drift * (value[k] - baseline[k])
    return found
