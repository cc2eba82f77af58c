"""Compiled: turn frames of taxels into contacts by baseline, force, areas, split areas, centroids and identities.

Cells know their neighbours by a table. `at` is the place of an area's cell, in cells: row and column on a sheet, which
continue over the seam of a ring; else in the tangent plane of the hardest pressed cell, about it.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.contact._track import follow
from palpate.sensors.taxels import _loads
from palpate.sensors.taxels._fit import chart, fit_touches, lift
from palpate.sensors.taxels._rest import (
    AT,
    BASELINE,
    CELLS,
    CURVE,
    ERROR,
    FADING,
    FORCE,
    GOOD,
    HARD,
    HELD,
    LABEL,
    LAST,
    LATEST,
    LIMIT,
    LIVE,
    LOAD,
    MISFITS,
    NOISE,
    OWN,
    PARENT,
    PEAK,
    RECOVERS,
    ROUGH,
    SIDEWAYS,
    SLOW,
    SPREAD,
    STILL,
    TOUCHES,
    TURNS,
    UNUSED,
    USED,
    VARIANCE,
    WRAPPED,
    Z,
    enter_window,
    fade,
    keep_window,
    least,
    moves,
    recover,
    settle,
)
from palpate.signals._filters import smooth
from palpate.surfaces._jit import inner, released, uncounted

MOST = 64  # contacts of a frame
PARTS = 16  # of an area
AREA = 22  # where the numbers behind a row of an estimate begin
NO_CONTACT, SATURATED, INVALID = 2, 6, 7  # palpate.contact.estimate.Status
_ROUNDS = 8  # of expectation maximisation
_NARROW = 0.12  # squared cells: no contact is seen narrower than its cell
_HARD = 10.0  # thresholds of a hard touch
# what the edges of cells make of a centroid, in cells: see `_narrow`
_SMALLER = 1.0 / 3.0  # mean of (1 - w)^2 over all widths w of touches narrower than a cell
# the others are measured on discs without noise, Hertz's and flat
_ALIKE = 0.025  # the same of touches one to one and a half cells wide: 0.001 to 0.055
_ONE_ROW = 0.02  # squared cells: the second moment below which a touch lies in one row of cells
_WIDE = 0.0045  # deviation times the second moment, of touches wider than that: 0.0027 (Hertz's) to 0.0062 (flat)
_LEAST_WIDE = 0.2  # squared cells


@uncounted
def _force(counts, table, step):
    """Return the force [N] of counts above the baseline: linear between entries, beyond them by the end slopes."""
    at = counts / step
    k = min(max(int(at), 0), len(table) - 2)
    return table[k] + (at - k) * (table[k + 1] - table[k])


@uncounted
def _wraps(raw, rest, noise, neighbours, turn, last, turns, wrapped):
    """Count turns of readings that wrapped around the range alone, because a touch moves neighbours too.

    A reading may wrap below 0 only where a cell rests that low, and over the top only while a neighbour is pressed.
    """
    for k in range(len(raw)):
        moved = raw[k] - (last[k] if np.isfinite(last[k]) else rest[k])
        jumped, quiet, pressed = abs(moved) > 0.85 * turn, True, False
        if jumped or turns[k] != 0:
            for j in neighbours[k]:
                if j < 0:
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


@uncounted
def _take(raw, sideways, rest, neighbours, turn, numbers, whole, value, aside):
    """Write unwrapped readings to `value`, the last ones for those not finite; return False if over 1/4 of them is.

    Write tangential readings to `aside` (2 k,), the baseline for those not finite; `rest` (3, k): normal, tangential.
    """
    last, held, good, turns = numbers[LAST], numbers[HELD], whole[GOOD], whole[TURNS]
    for k in range(len(aside)):
        aside[k] = sideways[k] if np.isfinite(sideways[k]) else rest[1 + k // len(raw), k % len(raw)]
    missing, count = 0, 0
    for k in range(len(raw)):
        count += good[k]
        missing += good[k] != 0 and not np.isfinite(raw[k])
    if 4 * missing > count:
        return False
    if turn > 0.0:
        _wraps(raw, rest[0], numbers[NOISE], neighbours, turn, last, turns, whole[WRAPPED])
    for k in range(len(raw)):
        last[k] = raw[k]
        value[k] = raw[k] + turns[k] * turn
        if not np.isfinite(value[k]):
            value[k] = held[k]
        held[k] = value[k]
    return True


@uncounted
def _fill(z, force, live, neighbours, between):
    """Give bad cells the mean of the good cells that touch them, if there are two, else 0."""
    for k in range(len(force)):
        if live[k]:
            continue
        count, total, level = 0, 0.0, 0.0
        for m in range(neighbours.shape[1]):
            j = neighbours[k, m]
            if j >= 0 and between[k, m, 0] < 0 and live[j]:
                count += 1
                total += force[j]
                level += z[j]
        force[k] = total / count if count >= 2 else 0.0
        z[k] = level / count if count >= 2 else 0.0


@uncounted
def _grow(seed, name, z, off, columns, neighbours, steps, label, at, cells):
    """Join cells above the threshold to a seed; return the number of cells."""
    label[seed], cells[0] = name, seed
    at[0, seed], at[1, seed] = seed // columns, seed % columns
    done, count = 0, 1
    while done < count:
        k = cells[done]
        done += 1
        for m in range(neighbours.shape[1]):
            j = neighbours[k, m]
            if j >= 0 and label[j] == 0 and z[j] > off:
                label[j] = name
                at[0, j], at[1, j] = at[0, k] + steps[k, m, 0], at[1, k] + steps[k, m, 1]
                cells[count] = j
                count += 1
    return count


@uncounted
def _rim(name, count, live, neighbours, steps, label, at, cells):
    """Append the cells around an area to `cells`, because a touch reaches below the threshold; return the new end."""
    end = count
    for i in range(count):
        k = cells[i]
        for m in range(neighbours.shape[1]):
            j = neighbours[k, m]
            if j >= 0 and label[j] == 0 and live[j]:
                label[j] = -name
                at[0, j], at[1, j] = at[0, k] + steps[k, m, 0], at[1, k] + steps[k, m, 1]
                cells[end] = j
                end += 1
    return end


@uncounted
def _root(parent, k):
    while parent[k] != k:
        k = parent[k]
    return k


@inner
def _split(cells, count, name, force, spread, neighbours, between, sure, share, label, parent):
    """Split an area into basins: a peak counts if it exceeds its saddle by more than noise and unequal cells explain.

    Cells are taken from the hardest pressed down. Where two basins meet, the lower is merged unless it stands out;
    across a corner, the saddle is the higher of the two cells between. Afterwards parent[k] is the peak of each cell's
    basin.
    """
    order = np.argsort(-force[cells[:count]])
    for i in range(count):
        parent[cells[i]] = -1
    for i in range(count):
        k = cells[order[i]]
        parent[k] = k
        for corner in range(2):  # sides first
            for m in range(neighbours.shape[1]):
                j = neighbours[k, m]
                if j < 0 or (between[k, m, 0] >= 0) != (corner == 1) or label[j] != name or parent[j] < 0:
                    continue
                saddle = force[k]
                if corner:
                    saddle = min(saddle, max(force[between[k, m, 0]], force[between[k, m, 1]]))
                high, low = _root(parent, k), _root(parent, j)
                if force[low] > force[high]:
                    high, low = low, high
                if force[low] - saddle < max(sure * spread[low], share * force[low]):
                    parent[low] = high
    for i in range(count):
        parent[cells[i]] = _root(parent, cells[i])


@uncounted
def _charts(cells, count, end, origin, place, at, parent, origins, charts):
    """Find the peaks of an area's basins, and write the places of its cells in `charts`; return how many there are.

    One chart serves a sheet, and an area with one peak. On a curved body each peak has its own, as a chart is true
    about its origin alone.
    """
    number = 0
    for i in range(count):
        k = cells[i]
        if parent[k] == k and number < PARTS:
            origins[number] = k
            number += 1
    own = len(place[2]) == 0
    many = number if own else 1
    for q in range(many):
        if own:
            chart(cells, end, origins[q] if number > 1 else origin, place, at)
        if number > 1 or own:
            for i in range(end):
                charts[q, 0, i], charts[q, 1, i] = at[0, cells[i]], at[1, cells[i]]
    return number, many


@inner
def _mixture(cells, count, end, force, charts, many, parent, parts, origins, number, shares):
    """Fit round Gaussians to an area's force; write parts (p, 4): place, variance, weight; and shares (p, end).

    Each part's place is in its own chart, if there are so many.
    """
    if number == 1:
        shares[0, :end] = 1.0
        return
    for i in range(count):
        k = cells[i]
        for p in range(number):
            if origins[p] == k:
                q = min(p, many - 1)
                parts[p, 0], parts[p, 1], parts[p, 2], parts[p, 3] = charts[q, 0, i], charts[q, 1, i], 0.5, force[k]
    sums = np.empty((PARTS, 4))
    for step in range(_ROUNDS):
        sums[:] = 0.0
        for i in range(count):
            k = cells[i]
            weight = max(force[k], 0.0)
            if step == 0:  # begin with the basins
                for p in range(number):
                    shares[p, i] = 1.0 if parent[k] == origins[p] else 0.0
            else:
                _shares(charts, many, i, parts, number, shares)
            for p in range(number):
                q = min(p, many - 1)
                own, row, column = weight * shares[p, i], charts[q, 0, i], charts[q, 1, i]
                sums[p, 0] += own
                sums[p, 1] += own * row
                sums[p, 2] += own * column
                sums[p, 3] += own * (row * row + column * column)
        for p in range(number):
            if sums[p, 0] > 0.0:
                row, column = sums[p, 1] / sums[p, 0], sums[p, 2] / sums[p, 0]
                parts[p, 0], parts[p, 1], parts[p, 3] = row, column, sums[p, 0]
                parts[p, 2] = max(0.5 * (sums[p, 3] / sums[p, 0] - row * row - column * column), _NARROW)
    for i in range(end):
        _shares(charts, many, i, parts, number, shares)


@uncounted
def _shares(charts, many, i, parts, number, shares):
    """Write the share of an area's i-th cell that belongs to each contact."""
    least = np.inf
    for p in range(number):
        q = min(p, many - 1)
        square = ((charts[q, 0, i] - parts[p, 0]) ** 2 + (charts[q, 1, i] - parts[p, 1]) ** 2) / parts[p, 2]
        shares[p, i] = 0.5 * square - np.log(parts[p, 3] / parts[p, 2])
        least = min(least, shares[p, i])
    total = 0.0
    for p in range(number):
        shares[p, i] = np.exp(least - shares[p, i])
        total += shares[p, i]
    for p in range(number):
        shares[p, i] /= total


@uncounted
def _cubic(t, weights):
    """Write Catmull and Rom's weights of four values around t in [0, 1]."""
    s, q = t * t, t * t * t
    weights[0] = 0.5 * (-t + 2.0 * s - q)
    weights[1] = 0.5 * (2.0 - 5.0 * s + 3.0 * q)
    weights[2] = 0.5 * (t + 4.0 * s - 3.0 * q)
    weights[3] = 0.5 * (-s + q)


@inner
def _between_cells(grid, row, column, out):
    """Interpolate position and normal (not yet unit) between cell centres; `grid` has two more cells at each end."""
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
def _on_sheet(grid, row, column, here, ways):
    """Write position and unit normal of a place on a sheet, and the steps (2, 3) [m] of a row and of a column there."""
    there = np.empty(6)
    _between_cells(grid, row, column, here)
    here[3:] /= np.sqrt(here[3] ** 2 + here[4] ** 2 + here[5] ** 2)
    for axis in range(2):
        _between_cells(grid, row + 0.25 * (axis == 0), column + 0.25 * (axis == 1), there)
        ways[axis] = there[:3]
        _between_cells(grid, row - 0.25 * (axis == 0), column - 0.25 * (axis == 1), there)
        ways[axis] = 2.0 * (ways[axis] - there[:3])


@inner
def _write(here, ways, moments, variances, out, first):
    """Write a contact's place and covariance; from `first` the axes of its pressure [m] and their angle [rad]."""
    out[:6] = here
    sizes = np.zeros(2)
    for a in range(3):
        sizes[0] += ways[0, a] ** 2
        sizes[1] += ways[1, a] ** 2
        for b in range(3):
            out[10 + 3 * a + b] = (
                variances[0] * ways[0, a] * ways[0, b]
                + variances[1] * ways[1, a] * ways[1, b]
                + variances[2] * (ways[0, a] * ways[1, b] + ways[1, a] * ways[0, b])
            )
    out[9], out[19], out[20] = np.nan, 0.0, 1.0
    one, other, both = moments[0] * sizes[0], moments[1] * sizes[1], moments[2] * np.sqrt(sizes[0] * sizes[1])
    mean, half = 0.5 * (one + other), 0.5 * (one - other)
    root = np.sqrt(half * half + both * both)
    out[first], out[first + 1] = np.sqrt(max(mean + root, 0.0)), np.sqrt(max(mean - root, 0.0))
    out[first + 2] = 0.5 * np.arctan2(2.0 * both, one - other)


@inner
def _add_places(cells, count, own, force, inside, covariances, out):
    """Add the covariance of the taxels' positions to that of a contact, in its tangent plane.

    The errors d of nearby taxels are mostly equal, as on one module. Whatever they have in common, the centroid's
    covariance is at most the mean of theirs, since E (sum w d) (sum w d)' <= sum w E d d' [Jensen, for shares w], and
    equal to it if they are the same.
    """
    known, half = np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(count):
        share = own[i] * force[cells[i]] / inside
        for a in range(3):
            for b in range(3):
                known[a, b] += share * covariances[cells[i], a, b]
    normal = out[3:6]
    for a in range(3):
        across = known[a, 0] * normal[0] + known[a, 1] * normal[1] + known[a, 2] * normal[2]
        for b in range(3):
            half[a, b] = known[a, b] - across * normal[b]
    for b in range(3):
        across = normal[0] * half[0, b] + normal[1] * half[1, b] + normal[2] * half[2, b]
        for a in range(3):
            out[10 + 3 * a + b] += half[a, b] - normal[a] * across


@uncounted
def _narrow(moment, least):
    """Return the variance of a centroid along an axis from the unknown place of the force in its cells; squared cells.

    A touch w < 1 wide lies across an edge with a share q of its force: it is (1/2 - q) (1 - w) from the centroid, whose
    square is (1/4 - m) (1 - w)^2 with the second moment m = q (1 - q). Only a touch that lies within one row of cells,
    along this axis or the other (`least`, the smallest moment), may have any such width.
    """
    inside = max(0.25 - moment, 0.0) * (_ALIKE + _SMALLER * np.exp(-max(least, 0.0) / _ONE_ROW))
    return inside + (_WIDE / max(moment, _LEAST_WIDE)) ** 2


@uncounted
def _vary(cells, end, own, error, inside, at, row, column, moments, out):
    """Write a centroid's variances along both axes and their covariance to out (3,), by errors and cell sizes."""
    out[:] = 0.0
    for i in range(end):
        k = cells[i]
        a, b = at[0, k] - row, at[1, k] - column
        square = (own[i] * error[k] / inside) ** 2
        out[0] += square * a * a
        out[1] += square * b * b
        out[2] += square * a * b
    rr, cc, rc = moments
    least = 0.5 * (rr + cc) - np.sqrt(0.25 * (rr - cc) ** 2 + rc * rc)
    out[0] += _narrow(rr, least)
    out[1] += _narrow(cc, least)


@uncounted
def _deviation(noise, variance):
    """Return the standard deviation of a reading above its baseline, whose variance is 0 without a Kalman filter."""
    return noise if variance == 0.0 else np.sqrt(noise * noise + variance)


@uncounted
def _errors(cells, count, end, scale, curves, settings, value, numbers, whole):
    """Write the force of each cell of an area and its rim that the centroid uses, and its standard deviation [N].

    Write it by noise, and by noise and gain. Cells of the rim may have any reading up to the threshold: their readings
    shrink by 1 - (n - 2) / sum z^2 [James and Stein, 1961], so that hardly any noise is used at a sharp edge, and the
    force below the threshold of a wide and light touch is. The variance of the excluded part is (off spread)^2 / 12.
    """
    off, sign, unequal = settings[1], settings[4], settings[5]
    tables, gaps = curves
    noise, baseline, spread, error = numbers[NOISE], numbers[BASELINE], numbers[SPREAD], numbers[ERROR]
    force, z, used, variance = numbers[FORCE], numbers[Z], numbers[USED], numbers[VARIANCE]
    which, live = whole[CURVE], whole[LIVE]
    squares = 0.0
    for i in range(count, end):
        squares += z[cells[i]] ** 2
    taken = max(1.0 - (end - count - 2) / squares, 0.0) if end - count > 2 and squares > 0.0 else 0.0
    left = np.sqrt(taken + (1.0 - taken) * off * off / 12.0)
    for i in range(end):
        k = cells[i]
        above = max(sign * (value[k] - baseline[k]), 0.0) if live[k] else 0.0
        curve, gap = tables[which[k]], gaps[which[k]]
        slope = (_force(above + gap, curve, gap) - _force(above, curve, gap)) / gap
        spread[k] = _deviation(noise[k] * scale, variance[k]) * slope
        gain = unequal * above * slope
        used[k] = force[k] if i < count else taken * force[k]
        error[k] = np.sqrt(spread[k] ** 2 + gain**2) if i < count else left * spread[k]


@inner
def _measure(cells, count, end, shares, fit, raw, value, numbers, sign, place, origin, model, touch, spread, out):
    """Write one contact of an area: sums over its share of each cell, with the centroid over the sum of forces."""
    force, error, used = numbers[FORCE], numbers[ERROR], numbers[USED]
    bears = used if len(model) > 0 else force
    own, limit, at = numbers[OWN], numbers[LIMIT], numbers[AT:]
    vectors, sizes, grid, ring, covariances = place
    normals, areas = vectors[1], sizes[0]
    total, row, column, push, covered, peak, held, full = 0.0, 0.0, 0.0, np.zeros(3), 0.0, 0.0, 0.0, False
    inside, pressed = 0.0, 0.0
    for i in range(end):
        k = cells[i]
        own[i] = shares[i]
        total += own[i] * force[k]
        for c in range(3):
            push[c] -= own[i] * force[k] * normals[k, c]
        row += own[i] * used[k] * at[0, k]
        column += own[i] * used[k] * at[1, k]
        inside += own[i] * used[k]
        if i < count:
            pressed += own[i] * bears[k]
            covered += own[i] * areas[k]
            held += own[i]
            if own[i] > 0.5:
                peak = max(peak, force[k] / areas[k])
                full = full or sign * value[k] >= sign * limit[k] or sign * raw[k] >= sign * limit[k]
    if inside <= 0.0 or pressed <= 0.0 or (total <= 0.0 and len(model) == 0):
        return False
    row, column = row / inside, column / inside
    rr, cc, rc = 0.0, 0.0, 0.0
    for i in range(count):
        k = cells[i]
        a, b = at[0, k] - row, at[1, k] - column
        rr += own[i] * bears[k] * a * a
        cc += own[i] * bears[k] * b * b
        rc += own[i] * bears[k] * a * b
    moments = np.array([rr / pressed, cc / pressed, rc / pressed])
    here, ways, first = np.empty(6), np.empty((2, 3)), AREA
    if len(grid) > 0:
        _vary(cells, end, own, error, inside, at, row, column, moments, fit[2:])
        column = column % ring if ring > 0 else column
        _on_sheet(grid, row, column, here, ways)
        out[AREA], out[AREA + 1], first = row, column, AREA + 2
    else:
        lift(cells, end, own, used, inside, origin, at, fit[0], fit[1], place, here, ways)
    _write(here, ways, moments, fit[2:], out, first + 4)
    if len(covariances) > 0:
        _add_places(cells, end, own, used, inside, covariances, out)
    out[6:9] = push
    out[21] = SATURATED if full else 0.0
    out[first], out[first + 1], out[first + 2], out[first + 3] = covered, total, peak, pressed / covered
    out[first + 7] = held
    if len(model) > 0:
        _loads.write_force(touch, spread, model, here, ways, out, first + 8)
    return True


@uncounted
def _catch_up(raw, value, sideways, model, passed, sign, numbers, whole):
    """Take off readings what follows late of the loads before, and let these follow."""
    share, pace, cells = model[_loads.LATE + 1], 1.0 - np.exp(-passed / model[_loads.LATE]), len(raw)
    for k in range(cells):
        if whole[GOOD, k] != 0 and np.isfinite(raw[k]):
            value[k] -= sign * share * numbers[SLOW + 2, k]
            numbers[SLOW + 2, k] += pace * (sign * (value[k] - numbers[BASELINE, k]) - numbers[SLOW + 2, k])
            for a in range(2):
                sideways[a * cells + k] -= share * numbers[SLOW + a, k]
                load = sideways[a * cells + k] - numbers[SIDEWAYS + a, k]
                numbers[SLOW + a, k] += pace * (load - numbers[SLOW + a, k])


@uncounted
def _couple(neighbours, coupling, numbers, live):
    """Add to the loads of each taxel what `coupling` makes of those that its neighbours read."""
    added, loads = numbers[ERROR : ERROR + 3], numbers[LOAD : LOAD + 3]
    added[:] = 0.0
    for k in range(len(live)):
        for m in range(neighbours.shape[1] if live[k] else 0):
            j = neighbours[k, m]
            if j >= 0 and live[j]:
                for a in range(3):
                    for b in range(3):
                        added[a, k] += coupling[k, m, a, b] * loads[b, j]
    loads += added


@uncounted
def _sense(raw, value, sideways, scale, curves, sign, numbers, whole, neighbours, between, coupling):
    """Write the height of each cell above its baseline, in standard deviations and in newtons; `sideways` (2 k,)."""
    tables, gaps = curves
    baseline, noise, z, force = numbers[BASELINE], numbers[NOISE], numbers[Z], numbers[FORCE]
    variance = numbers[VARIANCE]
    good, which, label, live = whole[GOOD], whole[CURVE], whole[LABEL], whole[LIVE]
    lacking = False
    for k in range(len(raw)):
        live[k] = good[k] != 0 and np.isfinite(raw[k])
        lacking = lacking or not live[k]
        above = sign * (value[k] - baseline[k]) if live[k] else 0.0
        z[k] = above / _deviation(noise[k] * scale, variance[k])
        force[k] = _force(above, tables[which[k]], gaps[which[k]])
        label[k] = 0
        for a in range(2 if len(sideways) > 0 else 0):
            numbers[LOAD + a, k] = sideways[a * len(raw) + k] - numbers[SIDEWAYS + a, k] if live[k] else 0.0
    if len(coupling) > 0:
        _couple(neighbours, coupling, numbers, live)
    if lacking:
        _fill(z, force, live, neighbours, between)


@uncounted
def _contacts(time, raw, value, sideways, model, scale, passed, drift, recovers, place, table, curves, settings, zeros,
              numbers, whole, clock, work, out):  # fmt: skip
    """Write a frame's contacts to `out` and return their number, -1 while the zero of all cells moves.

    Baselines of untouched cells follow the readings.
    """
    on, off, sure, share, sign = settings[:5]
    neighbours, steps, between, columns, coupling = table
    baseline, z, force, spread = numbers[BASELINE], numbers[Z], numbers[FORCE], numbers[SPREAD]
    label, live, cells, parent = whole[LABEL], whole[LIVE], whole[CELLS], whole[PARENT]
    at = numbers[AT:]
    peak, three = numbers[PEAK], len(model) > 0
    if three:
        _catch_up(raw, value, sideways, model, passed, sign, numbers, whole)
    _sense(raw, value, sideways, scale, curves, sign, numbers, whole, neighbours, between, coupling)
    moving = moves(z, live, on, off, value, three, numbers, clock)
    if moving or clock[STILL] > 0.0:
        settle(time, moving, value, sideways, zeros, numbers, whole, clock)
        return -1
    parts, shares, charts, fits, touches, unsure, origins = work
    found, name, most = 0, 0, min(MOST, len(out))
    for seed in range(len(raw)):
        if z[seed] <= on or label[seed] != 0 or not live[seed] or z[seed] <= least(on, off, peak[seed]):
            continue
        name += 1
        count = _grow(seed, name, z, off, columns, neighbours, steps, label, at, cells)
        if fade(cells, count, passed, off, z, numbers, label):
            continue
        origin = seed
        for i in range(count):
            k = cells[i]
            origin = k if force[k] > force[origin] else origin
        if three and _loads.is_known(origin, out[:found], place, force, model):
            continue
        end = _rim(name, count, live, neighbours, steps, label, at, cells)
        _errors(cells, count, end, scale, curves, settings, value, numbers, whole)
        _split(cells, count, name, force, spread, neighbours, between, sure, share, label, parent)
        number, many = _charts(cells, count, end, origin, place, at, parent, origins, charts)
        if three:
            fitted = (scale, place, numbers, whole, model, touches, unsure)
            cost = _loads.fit_forces(cells, end, origins, number, *fitted)
            if z[origin] > _HARD * on:
                clock[HARD] += 1.0
                clock[MISFITS] += np.log(cost / (3 * end) + 1e-9)
            if number == 1 and cost > _loads.UNEXPLAINED:
                far = _rim(name, end, live, neighbours, steps, label, at, cells)
                _errors(cells, count, far, scale, curves, settings, value, numbers, whole)
                if _loads.add_force(cells, far, origins, out[:found], *fitted):
                    number, end = 2, far
                for i in range(end, far):
                    label[cells[i]] = 0
                _errors(cells, count, end, scale, curves, settings, value, numbers, whole)
            for i in range(end):
                numbers[USED, cells[i]] = max(numbers[USED, cells[i]], 0.0)  # a touch may pull at some
            _loads.share_loads(cells, end, origins, number, *fitted, shares, fits)
        else:
            _mixture(cells, count, end, force, charts, many, parent, parts, origins, number, shares)
        if len(place[2]) == 0 and not three:
            given = (force, numbers[USED], spread, numbers[ERROR])
            fit_touches(cells, count, end, shares[:number], given, charts, fits)
        for part in range(number):
            origin = origins[part] if three or many > 1 else origin
            if three:
                chart(cells, end, origin, place, at)
            elif many > 1:
                for i in range(end):
                    at[0, cells[i]], at[1, cells[i]] = charts[part, 0, i], charts[part, 1, i]
            if found < most and _measure(cells, count, end, shares[part], fits[part], raw, value, numbers, sign,
                                         place, origin, model, touches[part], unsure[part], out[found]):  # fmt: skip
                found += 1
    for k in range(len(raw)):
        if label[k] == 0 and live[k] and not (three and _loads.feels(k, out[:found], place, model)):
            baseline[k] += drift * (value[k] - baseline[k])
            for a in range(2 if three else 0):
                numbers[SIDEWAYS + a, k] += drift * numbers[LOAD + a, k]
    if name > 0 or clock[FADING] > 0.0:
        recover(passed, off, recovers, value, sideways, numbers, whole, clock)
    clock[TOUCHES] += found > 0
    return found


@uncounted
def _all(time, raw, sideways, model, values, status, left, place, table, curves, settings, smoothing, clock, zeros,
         numbers, whole, tracks, following, out, rows, forces, work, names):  # fmt: skip
    """Do what `frames` does, in work space that is there.

    `work`: parts, shares, charts, fits, and of `fit_forces` touches, covariances and cells; `names`: age of a reading
    and identities.
    """
    drift, turn, resting, reach, speed, patience, walk = settings[6:]
    sections, start, gains, gap, since, state, shares = smoothing
    age, identity = names
    used = 0
    for i in range(len(time)):
        if i > 0 and len(out) - used < MOST:
            return i, used
        passed, follows, recovers = time[i] - clock[LATEST], 0.0, 0.0
        passed = max(passed, 0.0) if passed == passed else 0.0  # no NaN
        if drift < np.inf and walk == 0.0:
            follows = 1.0 - np.exp(-min(passed, drift) / drift)
        if drift < np.inf:
            recovers = min(passed / RECOVERS, 1.0)
        if time[i] == time[i]:
            clock[LATEST] = time[i]
        which = i if len(left) > 0 else 0
        value, aside, scale = values[which, : raw.shape[1]], values[which, raw.shape[1] :], 1.0
        if len(left) > 0:
            scale = np.sqrt(left[i] + resting)
        else:
            known = numbers[BASELINE:ROUGH], table[0], turn, numbers, whole
            status[0] = -1 if _take(raw[i], sideways[i], *known, value, aside) else INVALID
            if len(shares) > 0:
                smooth(time[i : i + 1], status, values, sections, start, gains, gap, since, state, age)
                scale = np.sqrt(shares[min(max(age[0], 0), len(shares) - 1)] + resting)
        here, found, settling = out[used:], 0, False
        if status[which] < 0:
            if walk > 0.0:
                enter_window(time[i], walk, settings[4], zeros, numbers, whole)
            found = _contacts(time[i], raw[i], value, aside, model, scale, passed, follows, recovers, place, table,
                              curves, settings, zeros, numbers, whole, clock, work, here)  # fmt: skip
            if walk > 0.0 and found >= 0:
                keep_window(time[i], value, zeros, whole)
            settling, found = found < 0, max(found, 0)
            follow(time[i], here[:, :3], found, tracks, following, reach, speed, patience, identity)
            for contact in range(found):
                here[contact, -1] = identity[contact]
        else:
            numbers[FORCE] = 0.0
            clock[UNUSED] += 1.0
        if found == 0:
            here[0] = np.nan
            here[0, 20], here[0, -1] = 0.0, 0.0
            here[0, 21] = NO_CONTACT if status[which] < 0 and not settling else INVALID
        for k in range(numbers.shape[1] if len(forces) > 0 else 0):
            forces[i, k] = numbers[FORCE, k]
        rows[i] = max(found, 1)
        used += rows[i]
    return len(time), used


@released(
    """
    raw n m, sideways n w, rest 3 m, neighbours int64 m d, turn float, numbers out 25 m, whole out int64 9 m,
    values out n v, status out int8 n
    """
)
def prepare(raw, sideways, rest, neighbours, turn, numbers, whole, values, status):
    """Prepare frames for a filter of zero phase: write `values`, normal and tangential, to filter, and status (n,)."""
    for i in range(len(raw)):
        into = values[i, : raw.shape[1]], values[i, raw.shape[1] :]
        status[i] = -1 if _take(raw[i], sideways[i], rest, neighbours, turn, numbers, whole, *into) else INVALID


@released(
    """
    time n, raw n m, sideways n o, model u, values out k v, status out int8 k, left out w, place (3 m 3, 2 m, a b 6,
    int, c 3 3), table (int64 m d, m d 2, int64 m d 2, int, i d 3 3), curves (e 2048, e), settings 13*float,
    smoothing (out f 6, out f 2, out g, float, out 2, out h p, out q), clock out 13, zeros (out 11 m, out 11 3, out 2),
    numbers out 25 m, whole out int64 9 m, tracks out 128 8, following out int64 1, out out r s, rows out int64 n,
    forces out t m
    """
)
def frames(time, raw, sideways, model, values, status, left, place, table, curves, settings, smoothing, clock, zeros,
           numbers, whole, tracks, following, out, rows, forces):  # fmt: skip
    """Turn frames into contacts, at least one row of `out` for each; return the numbers of frames and of rows.

    It stops before a frame for which `out` could be too short, unless that is the first.

    time, raw: (n,) [s] and (n, k) readings.
    sideways, model: (n, 2 k) tangential loads [N] of taxels with three axes, and their response; (n, 0) and (0,) else.
    values, status, left: (n, k or 3 k), (n,), (n,) of frames that are filtered already, and the remaining share of the
        variance of their noise; (1, k or 3 k), (1,) as work space and (0,) where not.
    place: (3, k, 3) positions, normals and tangents, (2, k) areas and spacings, grid (0, 0, 6 if none), columns of a
        ring (0: none), (k, 3, 3) covariances of the positions ((0, 3, 3): not known).
    table: neighbours, steps, between, columns (1 if no sheet), and what neighbours' loads add to those of each taxel,
        (k, m, 3, 3) or (0, m, 3, 3).
    curves: (c, t) forces [N], (c,) counts between two.
    settings: on, off, sure, share, sign, unequal, drift [s], turn (0: none), share of the noise's variance in the
        baseline, reach, speed, patience, walk [counts/sqrt(s)] (0: the baseline follows exponentially, within `drift`).
    smoothing: sections, start, gains, gap, clock, state of `signals._filters.smooth`, and shares by age ((0,) if there
        is no filter).
    clock: (CLOCK,) numbers of the skin: changed, as all that follows.
    zeros: waiting data of baselines with a walk: sums of readings (SLOTS, k), of each window its number, its number of
        frames and the sum of their times (SLOTS, 3), and (2,) number and start of the last window (NaN: none).
    numbers, whole: (NUMBERS, k) and (WHOLE, k) of the cells.
    tracks, following: of `contact._track.follow`.
    out: (r, w) rows: of an estimate, then features, then identity. rows: (n,) number of rows of each frame.
    forces: (n, k) [N] of each cell; (0, k): not requested.
    """
    cells = numbers.shape[1]
    size, origins = _loads.UNKNOWN, np.empty(PARTS, dtype=np.int64)
    touches = np.empty((PARTS, size)), np.empty((PARTS, size, size)), origins
    parts = np.empty((PARTS, 4)), np.empty((PARTS, cells)), np.empty((PARTS, 2, cells)), np.empty((PARTS, 5))
    work = (*parts, *touches)
    names = np.empty(1, dtype=np.int64), np.empty(MOST, dtype=np.int64)
    return _all(time, raw, sideways, model, values, status, left, place, table, curves, settings, smoothing, clock,
                zeros, numbers, whole, tracks, following, out, rows, forces, work, names)  # fmt: skip
