"""Compiled loops from the voltages of load cells to wrenches in the surface's frame, with their covariances.

Loops run along the outputs, sample by sample, in one order: the last bits do not depend on how samples are cut.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.signals._placing import mounting_errors, row, to_surface
from palpate.surfaces._jit import inlined, inner, released

_SATURATED, _INVALID = 6, 7
_LARGEST = 1e9
_FADES, _ENOUGH = 0.999, 10.0  # of blame per sample; blame with which an explanation that fits is used before others
_STUCK = 5  # samples in which a channel repeats itself exactly


@inlined
def _mapped(readings, n, channels, mapping, out):
    """Write reading n less zero, mapped, into out: six of a wrench, then the combinations that no wrench can make."""
    count = mapping.shape[1]
    for i in range(count):
        out[i] = 0.0
    for j in range(readings.shape[1]):
        value = readings[n, j] - channels[j, 0]
        for i in range(count):
            out[i] += mapping[j, i] * value


@inner
def _saturated(readings, n, channels, bounds):
    """Return the explanation that omits the channels at their range; -1 if there are none, -2 if none omits all."""
    full, cell, axes = -1, -1, len(channels) // (len(bounds) - 1 - len(channels))
    for j in range(len(channels)):
        if readings[n, j] <= channels[j, 1] or readings[n, j] >= channels[j, 2]:
            if full >= 0 and cell != j // axes:
                return -2
            full = len(channels) // axes + j if full < 0 else j // axes
            cell = j // axes
    if full >= 0 and bounds[1 + full] < 0.0:
        full = cell
    return -2 if full >= 0 and bounds[1 + full] < 0.0 else full


@inner
def _stuck(readings, n, last, repeats, axes):
    """Return the explanation of the one channel that repeats itself exactly, or of its cell if several do; else -1.

    A channel at a range that the model does not state does so, and a dead one. Coarse voltages repeat themselves too,
    but hardly so often, and not in one cell alone.
    """
    channels = readings.shape[1]
    found, cell, many = -1, -1, False
    for j in range(channels):
        repeats[j] = repeats[j] + 1.0 if readings[n, j] == last[j] else 0.0
        last[j] = readings[n, j]
        if repeats[j] >= _STUCK:
            if found >= 0 and cell != j // axes:
                many = True
            found = channels // axes + j if found < 0 else j // axes
            cell = j // axes
    return -1 if many else found


@inner
def _expected(w, settings):
    """Return the expected square of a combination that no wrench makes: noise, drift, and the misfit under load w."""
    expected = 1.0 + settings[6, 0] * settings[6, 0]
    if settings[6, 1] > 0.0:
        square = 0.0
        for i in range(6):
            for j in range(6):
                square += w[i] * settings[i, j] * w[j]
        expected += settings[6, 1] * settings[6, 1] * square
    return expected


@inner
def _without(out, e, ways, w):
    """Write the wrench without the channels that explanation e omits into w; return the square that it explains."""
    for i in range(6):
        w[i] = out[i]
    explained = 0.0
    for a in range(3):
        share = 0.0
        for k in range(6, ways.shape[2]):
            share += ways[e, a, k] * out[k]
        explained += share * share
        for i in range(6):
            w[i] -= ways[e, a, i] * share
    return explained


@inner
def _fits(out, square, e, ways, bounds, settings, w):
    """Return whether the channels that explanation e keeps agree; write their wrench into w."""
    if not bounds[1 + e] > 0.0:
        return False
    left = square - _without(out, e, ways, w)
    return left <= bounds[1 + e] * _expected(w, settings)


@inner
def _believed(out, square, cells, ways, bounds, settings, found, fitting):
    """Write which explanations fit into fitting, and their wrenches into found; return the number that fit.

    Explanations of complete cells are tried only if none of a single channel fits.
    """
    count, total = len(ways), 0
    fitting[:cells] = False
    for e in range(cells, count):
        fitting[e] = _fits(out, square, e, ways, bounds, settings, found[e])
        total += fitting[e]
    if total > 0:
        return total
    for e in range(cells):
        fitting[e] = _fits(out, square, e, ways, bounds, settings, found[e])
        total += fitting[e]
    return total


@inner
def _mixed(found, fitting, total, covariances, factor, w, extra):
    """Write the mean of the wrenches that fit into w, and its covariance beyond that of all channels into extra."""
    w[:] = 0.0
    for e in range(len(found)):
        if fitting[e]:
            for i in range(6):
                w[i] += found[e, i] / total
    for i in range(6):
        for j in range(6):
            extra[i, j] = 0.0
    for e in range(len(found)):
        if fitting[e]:
            for i in range(6):
                for j in range(6):
                    more = factor * (covariances[1 + e, i, j] - covariances[0, i, j])
                    extra[i, j] += (more + (found[e, i] - w[i]) * (found[e, j] - w[j])) / total


@inner
def _judged(out, square, stuck, agreed, cells, ways, covariances, bounds, settings, blame, w, extra, found, fitting):
    """Return the explanation used, its wrench in w: 0 none is needed, 1 + e, 1 + s several; -2 nothing fits.

    Blame grows where one explanation alone fits, and fades; an explanation with enough blame, or a channel that repeats
    itself, is used where it fits, even if others fit too.
    """
    count, most, suspect = len(ways), 0.0, 0
    for e in range(count):
        blame[e] *= _FADES
        if blame[e] > most:
            most, suspect = blame[e], e
    if agreed and most < _ENOUGH:
        return 0
    sure = most >= _ENOUGH and _fits(out, square, suspect, ways, bounds, settings, w)
    if agreed:
        return 1 + suspect if sure else 0
    total = _believed(out, square, cells, ways, bounds, settings, found, fitting)
    alone = -1
    if total == 1:
        for e in range(count):
            if fitting[e]:
                alone = e
    if stuck >= 0 and _fits(out, square, stuck, ways, bounds, settings, found[stuck]):
        alone = stuck
    if alone >= 0:
        blame[alone] += 1.0
    if sure:
        _without(out, suspect, ways, w)
        return 1 + suspect
    if alone >= 0:
        _without(out, alone, ways, w)
        return 1 + alone
    if total == 0:
        return -2
    _mixed(found, fitting, total, covariances, settings[6, 2], w, extra)
    return 1 + count


@released(
    """
    readings n m, channels m 3, mapping m w, ways e 3 v, covariances a 6 6, bounds a, settings 7 6, state out s,
    wrenches out n 6, statuses out int8 n, which out int64 n, extra out n 6 6
    """
)
def measure(readings, channels, mapping, ways, covariances, bounds, settings, state, wrenches, statuses, which, extra):
    """Compute wrenches (n, 6) from voltages (n, m), and the status of each sample (-1: to be located).

    channels (m, 3): zero, lowest, highest; mapping (m, 6 + r, and zeros), of A and Q. From `Explanations`: ways (s, 3,
    6 + r), corrections and directions; covariances, bounds; settings (7, 6), its metric, then drift, misfit, and the
    variance of a wrench over that of a reading. state (s + 2 m,): blame of each explanation, last voltages, and for how
    many samples each has repeated itself. Writes statuses (n,); which (n,): 0 all channels are used, 1 + e all but
    those that explanation e omits, 1 + s several explanations, negative none; extra (n, 6, 6), the additional
    covariance where several fit.
    """
    width, count = readings.shape[1], len(ways)
    cells = count - width
    blame, last, repeats = state[:count], state[count : count + width], state[count + width :]
    out, found, fitting = np.empty(mapping.shape[1]), np.empty((count, 6)), np.zeros(count, np.bool_)
    for n in range(len(readings)):
        sound = True
        for j in range(width):
            sound = sound and abs(readings[n, j]) <= _LARGEST
        w, chosen = wrenches[n], -2
        if sound:
            stuck = _stuck(readings, n, last, repeats, width // cells)
            full = _saturated(readings, n, channels, bounds)
            _mapped(readings, n, channels, mapping, out)
            for i in range(6):
                w[i] = out[i]
            if full == -2:
                chosen = -1
            elif full >= 0:
                _without(out, full, ways, w)
                chosen = 1 + full
            else:
                square = 0.0
                for i in range(6, len(out)):
                    square += out[i] * out[i]
                agreed = square <= bounds[0] * _expected(w, settings)
                chosen = _judged(
                    out,
                    square,
                    stuck,
                    agreed,
                    cells,
                    ways,
                    covariances,
                    bounds,
                    settings,
                    blame,
                    w,
                    extra[n],
                    found,
                    fitting,
                )
            if chosen == 0:
                for i in range(6):
                    w[i] = out[i]
        which[n] = chosen
        statuses[n] = -1
        if chosen < 0:
            statuses[n] = _SATURATED if chosen == -1 else _INVALID
            for i in range(6):
                w[i] = np.nan


@inlined
def _unsure(wrench, unsure, squares, out):
    """Write the covariance of E w into out, as its upper triangle row by row, from that of w w'."""
    k = 0
    for i in range(6):
        for j in range(i, 6):
            squares[k] = wrench[i] * wrench[j]
            k += 1
    for i in range(len(out)):
        out[i] = 0.0
    for k in range(21):
        value = squares[k]
        for i in range(len(out)):
            out[i] += unsure[k, i] * value


@inner
def _turned(matrix, extra, work, covariance):
    """Add matrix extra matrix' to covariance."""
    for i in range(6):
        for k in range(6):
            total = 0.0
            for m in range(6):
                total += matrix[i, m] * extra[m, k]
            work[i, k] = total
    for i in range(6):
        for j in range(6):
            for k in range(6):
                covariance[i, j] += work[i, k] * matrix[j, k]


@released(
    """
    wrenches n 6, which int64 n, extra n 6 6, share n|1, slow float, covariances a 6 6, unsure 21 24, mounting k
    6, matrix 6 6, located out n 6, covariance out n 6 6
    """
)
def place(wrenches, which, extra, share, slow, covariances, unsure, mounting, matrix, located, covariance):
    """Transform wrenches (n, 6) to the surface's frame, and compute their covariances (n, 6, 6).

    which (n,) and extra (n, 6, 6) are from `measure`; share (n,) or (1,) is that of a reading's noise after a filter,
    and slow that of zero and drift, which a filter does not reduce. In the surface's frame: covariances (1 + s, 6, 6)
    of a reading's noise, unsure (21, 21 and zeros) from w w' to the calibration's covariance, mounting (q, 6), a factor
    of the mounting's; matrix (6, 6) from sensor to surface.
    """
    several = len(covariances)
    triangle, squares, turn = np.empty(unsure.shape[1]), np.empty(21), np.empty((6, 6))
    work, errors = np.empty((2, 6)), np.empty((len(mounting), 6))
    for n in range(len(wrenches)):
        to_surface(matrix, wrenches[n], located[n])
        mounting_errors(located[n], mounting, work, errors)
        _unsure(wrenches[n], unsure, squares, triangle)
        chosen = which[n] if 0 <= which[n] < several else 0
        factor, k = row(share, n) + slow, 0
        for i in range(6):
            for j in range(i, 6):
                total = factor * covariances[chosen, i, j] + triangle[k]
                for q in range(len(errors)):
                    total += errors[q, i] * errors[q, j]
                covariance[n, i, j] = covariance[n, j, i] = total
                k += 1
        if which[n] == several:
            _turned(matrix, extra[n], turn, covariance[n])
