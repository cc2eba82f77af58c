"""Compiled loops for the forces of several contacts from the skin's normal force of each and the sensor's wrench.

For contact i, at p_i with outward normal n_i, the skin gives a normal force s_i. Before the wrench is used,

    f_i = -n_i x_i + t_i,   x_i ~ N(s_i, d_i^2),   t_i ~ N(0, u^2 (s_i^2 + d_i^2) I),

t_i in the tangent plane. A skin that feels shear adds a measurement of t_i.
Sensor k feels W_k = sum over i of c_ki (f_i; p_i x f_i) + noise. An error of the place, with
covariance Q_i, adds a moment with covariance Q_i xx E[f_i f_i^T], the cross product of two matrices:

    A xx B = (tr A tr B - tr AB) I + AB + BA - tr(A) B - tr(B) A    (symmetric A, B).

It is the same error in every sensor that feels the contact. The posterior is computed measurement after measurement by
Potter's square root filter ([potter]): the covariance is S S^T, so it stays symmetric and positive for any noise.
"""

# pyright: basic
from __future__ import annotations

import math

import numpy as np

from palpate.surfaces._jit import entry, inlined, inner, released
from palpate.surfaces._vectors import cross_into

# of a contact: point, outward normal, normal force, its standard deviation, covariance of the place by rows, tangential
ROW = 21  # force that the skin feels, and one over the variance of each of its components: 0 where it feels none
OUT = 5  # of a contact: force, standard deviation of the tangential force now over before, slack of the cone


@inner
def _frame(normal, frame):
    """Write minus the normal, and two tangents (Duff et al. 2017), into the rows of `frame`."""
    x, y, z = normal[0], normal[1], normal[2]
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    frame[0, 0], frame[0, 1], frame[0, 2] = -x, -y, -z
    frame[1, 0], frame[1, 1], frame[1, 2] = 1.0 + sign * x * x * a, sign * b, -sign * x
    frame[2, 0], frame[2, 1], frame[2, 2] = b, sign + y * y * a, -y


@inner
def _place_moment(contact, second, out):
    """Write the covariance of the moment from the error of a contact's place, spread xx second, into `out`."""
    ta = contact[8] + contact[12] + contact[16]
    tb = second[0, 0] + second[1, 1] + second[2, 2]
    tab = 0.0
    for i in range(3):
        for j in range(3):
            tab += contact[8 + 3 * i + j] * second[i, j]
    for i in range(3):
        for j in range(3):
            total = -ta * second[i, j] - 0.5 * tb * (contact[8 + 3 * i + j] + contact[8 + 3 * j + i])
            for k in range(3):
                total += 0.5 * (contact[8 + 3 * i + k] + contact[8 + 3 * k + i]) * second[k, j]
                total += 0.5 * second[i, k] * (contact[8 + 3 * k + j] + contact[8 + 3 * j + k])
            if i == j:
                total += ta * tb - tab
            out[i, j] = total


@inner
def _first(contacts, settings, frames, mean, variance, second):
    """Write frames, means, variances of the normal force and E f f^T, from the skin alone."""
    for i in range(len(contacts)):
        _frame(contacts[i, 3:6], frames[i])
        force = contacts[i, 6]
        variance[i] = contacts[i, 7] ** 2 + (settings[1] * force) ** 2 + settings[2] ** 2
        across = settings[0] ** 2 * (force * force + variance[i])
        share, along, aside = _sheared(contacts[i], frames[i], across)
        across *= 1.0 - share
        for r in range(3):
            for q in range(3):
                second[i, r, q] = (force * force + variance[i] - across) * frames[i, 0, r] * frames[i, 0, q]
            second[i, r, r] += across
        mean[3 * i], mean[3 * i + 1], mean[3 * i + 2] = force, share * along, share * aside
        if share > 0.0:
            for r in range(3):
                for q in range(3):
                    one, other = frames[i, 0], share * (along * frames[i, 1] + aside * frames[i, 2])
                    second[i, r, q] += force * (one[r] * other[q] + other[r] * one[q]) + other[r] * other[q]


@inner
def _sheared(contact, frame, across):
    """Return the share that a felt tangential force has against a prior of variance `across`, and both components."""
    share = across * contact[20] / (1.0 + across * contact[20])
    along = frame[1, 0] * contact[17] + frame[1, 1] * contact[18] + frame[1, 2] * contact[19]
    return share, along, frame[2, 0] * contact[17] + frame[2, 1] * contact[18] + frame[2, 2] * contact[19]


@inner
def _prior(contacts, settings, frames, level, variance, root, before):
    """Write prior standard deviations of each contact's (normal, tangential, tangential) force into `root`.

    `level` is the normal force to which they are proportional. Tangential forces that the skin feels go to `before`.
    """
    for i in range(len(contacts)):
        square = contacts[i, 7] ** 2 + (settings[1] * level[i]) ** 2 + settings[2] ** 2
        root[3 * i] = np.sqrt(square)
        root[3 * i + 1] = root[3 * i + 2] = settings[0] * np.sqrt(level[i] ** 2 + variance[i])
        share, along, aside = _sheared(contacts[i], frames[i], root[3 * i + 1] ** 2)
        root[3 * i + 1] = root[3 * i + 2] = root[3 * i + 1] * np.sqrt(1.0 - share)
        before[3 * i + 1], before[3 * i + 2] = share * along, share * aside


@inner
def _again(contacts, frames, mean, square, level, variance, second):
    """Compute `_first` again from the posterior forces; a contact's level is at least a fifth of the skin's force."""
    count = len(contacts)
    world = np.empty((3, 3))
    for i in range(count):
        for r in range(3):
            for q in range(r + 1):
                total = mean[3 * i + r] * mean[3 * i + q]
                for c in range(3 * count):
                    total += square[3 * i + r, c] * square[3 * i + q, c]
                world[r, q] = world[q, r] = total
        variance[i] = world[0, 0] - mean[3 * i] ** 2
        level[i] = max(mean[3 * i], 0.2 * contacts[i, 6])
        for r in range(3):
            for q in range(3):
                total = 0.0
                for a in range(3):
                    for b in range(3):
                        total += frames[i, a, r] * world[a, b] * frames[i, b, q]
                second[i, r, q] = total


@inner
def _felt(contacts, frames, rows):
    """Write the wrench of a unit of each force component, (6, 3n), into `rows`."""
    for i in range(len(contacts)):
        p0, p1, p2 = contacts[i, 0], contacts[i, 1], contacts[i, 2]
        for e in range(3):
            a, b, c = frames[i, e, 0], frames[i, e, 1], frames[i, e, 2]
            rows[0, 3 * i + e], rows[1, 3 * i + e], rows[2, 3 * i + e] = a, b, c
            rows[3, 3 * i + e] = p1 * c - p2 * b
            rows[4, 3 * i + e] = p2 * a - p0 * c
            rows[5, 3 * i + e] = p0 * b - p1 * a


@inner
def _noise(contacts, second, covariances, carries, noise):
    """Write the covariance (6k, 6k) of the wrenches' noise, with the errors of the places, into `noise`."""
    count, sensors = len(contacts), len(covariances)
    for a in range(6 * sensors):
        for b in range(6 * sensors):
            noise[a, b] = 0.0
    for k in range(sensors):
        for r in range(6):
            for q in range(6):
                noise[6 * k + r, 6 * k + q] = 0.5 * (covariances[k, r, q] + covariances[k, q, r])
    moment = np.empty((3, 3))
    for i in range(count):
        _place_moment(contacts[i], second[i], moment)
        for k in range(sensors):
            for m in range(sensors):
                if carries[k, i] and carries[m, i]:
                    for r in range(3):
                        for q in range(3):
                            noise[6 * k + 3 + r, 6 * m + 3 + q] += moment[r, q]


@inner
def _split(matrix, least):
    """Factor a matrix as L D L^T in place: D on the diagonal, L below; a pivot up to `least` of its entry becomes 0."""
    size = len(matrix)
    for j in range(size):
        scale = abs(matrix[j, j])
        for k in range(j):
            matrix[j, j] -= matrix[j, k] ** 2 * matrix[k, k]
        if not matrix[j, j] > least * scale:
            matrix[j, j] = 0.0
        for i in range(j + 1, size):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k] * matrix[k, k]
            matrix[i, j] = matrix[i, j] / matrix[j, j] if matrix[j, j] > 0.0 else 0.0


@inner
def _innovation(noise, rows, root, carries, out):
    """Write the prior covariance (6k, 6k) of the wrenches, with their noise, into `out`."""
    sensors, count = carries.shape
    for k in range(sensors):
        for m in range(k + 1):
            for r in range(6):
                for q in range(6):
                    total = noise[6 * k + r, 6 * m + q]
                    for i in range(count):
                        if carries[k, i] and carries[m, i]:
                            for e in range(3 * i, 3 * i + 3):
                                total += root[e] ** 2 * rows[r, e] * rows[q, e]
                    out[6 * k + r, 6 * m + q] = out[6 * m + q, 6 * k + r] = total


@inner
def _update(square, mean, row, left, variance, work):
    """Update square and mean by one measurement row . x = left + row . mean with noise `variance` (Potter's step)."""
    size = len(mean)
    total = variance
    for c in range(size):
        work[c] = 0.0
    for r in range(size):
        for c in range(size):
            work[c] += square[r, c] * row[r]
    for c in range(size):
        total += work[c] * work[c]
    if not total > 0.0:
        return
    share = 1.0 / (1.0 + np.sqrt(variance / total)) / total
    for r in range(size):
        gain = 0.0
        for c in range(size):
            gain += square[r, c] * work[c]
        mean[r] += gain * left / total
        gain *= share
        for c in range(size):
            square[r, c] -= gain * work[c]


@inner
def _posterior(rows, carries, noise, left, mean, before, square, product, whitened):
    """Update by all measurements in turn; `noise` becomes L D L^T, and `left`, measured minus expected, is changed."""
    sensors, count = carries.shape
    size = 3 * count
    _split(noise, 1e-13)
    for j in range(6 * sensors):
        k, r = j // 6, j % 6
        row = whitened[j]
        for e in range(size):
            row[e] = rows[r, e] if carries[k, e // 3] else 0.0
        for m in range(j):
            if noise[j, m] != 0.0:
                left[j] -= noise[j, m] * left[m]
                for e in range(size):
                    row[e] -= noise[j, m] * whitened[m, e]
        residual = left[j]
        for e in range(size):
            residual -= row[e] * (mean[e] - before[e])
        _update(square, mean, row, residual, noise[j, j], product)


@inner
def _results(frames, mean, root, square, friction, out, covariance):
    """Write forces, shares, slacks and their covariance in the surface's frame; return the number of violated cones."""
    count, broken = len(out), 0
    for i in range(count):
        now = before = 0.0
        for e in range(3):
            out[i, e] = 0.0
            for c in range(3):
                out[i, e] += frames[i, c, e] * mean[3 * i + c]
        for e in range(1, 3):
            before += root[3 * i + e] ** 2
            for c in range(3 * count):
                now += square[3 * i + e, c] ** 2
        out[i, 3] = min(np.sqrt(now / before), 1.0) if before > 0.0 else 1.0
        out[i, 4] = friction * mean[3 * i] - np.hypot(mean[3 * i + 1], mean[3 * i + 2])
        if out[i, 4] < 0.0 or mean[3 * i] < 0.0:
            broken += 1
        for c in range(3 * count):  # the root, turned into the surface's frame
            a, b, d = square[3 * i, c], square[3 * i + 1, c], square[3 * i + 2, c]
            for e in range(3):
                square[3 * i + e, c] = frames[i, 0, e] * a + frames[i, 1, e] * b + frames[i, 2, e] * d
    for r in range(3 * count):
        for q in range(r + 1):
            total = 0.0
            for c in range(3 * count):
                total += square[r, c] * square[q, c]
            covariance[r, q] = covariance[q, r] = total
    return broken


@inner
def _whiten(factor, column):
    """Replace column by D^-1/2 L^-1 column; 0 where D is 0."""
    for r in range(6):
        for q in range(r):
            column[r] -= factor[r, q] * column[q]
    for r in range(6):
        column[r] = column[r] / np.sqrt(factor[r, r]) if factor[r, r] > 0.0 else 0.0


@inner
def _surprise(rows, root, carries, factor, column, found):
    """Write a wrench's squared distance from the expected one, its degrees of freedom, variance and share to `found`.

    `factor`: L D L^T of the wrench's covariance; column[0]: whitened. The variance of a chi-square is 2 dof; that of a
    force uniform in a disc is less by tr G^2 + 2/3 det G, with G (2, 2) the Gram matrix of its whitened components.
    """
    total, dof = 0.0, 0
    for r in range(6):
        total += column[0, r] ** 2
        dof += factor[r, r] > 0.0
    variance = 2.0 * dof
    for i in range(len(carries)):
        if carries[i]:
            aa = ab = bb = 0.0
            for e in range(1, 3):
                for r in range(6):
                    column[e, r] = rows[r, 3 * i + e] * root[3 * i + e]
                _whiten(factor, column[e])
            for r in range(6):
                aa += column[1, r] ** 2
                ab += column[1, r] * column[2, r]
                bb += column[2, r] ** 2
            variance -= aa * aa + bb * bb + 2.0 * ab * ab + 2.0 / 3.0 * (aa * bb - ab * ab)
    found[0], found[1], found[2] = total, dof, variance
    found[3] = rarity(total, dof, variance)


@entry("total float, dof float, variance float")
def rarity(total, dof, variance):
    """Return the share of a gamma distribution, of mean `dof` and this variance, beyond `total` (Wilson and Hilferty).

    NaN if `dof` or `variance` is not positive.
    """
    if not (dof > 0 and variance > 0.0):
        return np.nan
    spread = variance / (9.0 * dof * dof)
    return 0.5 * math.erfc(((total / dof) ** (1.0 / 3.0) - (1.0 - spread)) / np.sqrt(2.0 * spread))


@inner
def _expected(rows, carries, wrenches, mean, totals, off):
    """Write the wrenches expected from the skin alone into `totals`, and the measured less the expected into `off`."""
    sensors, count = carries.shape
    for k in range(sensors):
        for r in range(6):
            totals[k, r] = 0.0
            for i in range(count):
                if carries[k, i]:
                    totals[k, r] += rows[r, 3 * i] * mean[3 * i]
                    totals[k, r] += rows[r, 3 * i + 1] * mean[3 * i + 1] + rows[r, 3 * i + 2] * mean[3 * i + 2]
            off[6 * k + r] = wrenches[k, r] - totals[k, r]


@inner
def _whitened(innovation, off, k, factor, column):
    """Whiten sensor k's `off` into column[0] by L D L^T of its covariance, which is written into `factor`."""
    for r in range(6):
        column[0, r] = off[6 * k + r]
        for q in range(6):
            factor[r, q] = innovation[6 * k + r, 6 * k + q]
    _split(factor, 1e-13)
    _whiten(factor, column[0])


@inner
def _taken(work, begin, size):
    """Return the next `size` numbers of `work`, and their end."""
    return work[begin : begin + size], begin + size


@entry(
    """
    contacts n 21, wrench 6, covariance 6 6, settings 5, work out w, out out n 5, out_covariance out 3n 3n, total
    out 16
    """
)
def fuse_one(contacts, wrench, covariance, settings, work, out, out_covariance, total):
    """Compute `fuse` for one sensor that feels all contacts: (6,), (6, 6), (16,) for (1, 6), (1, 6, 6), (1, 16).

    A wrench that is not finite is not used, and `total` becomes NaN. `work` has 36 numbers more than `room`; the first
    36 are the `factors` of `fuse`. There are fewer arrays, because a call takes 0.15 us for each.
    """
    heard = 1
    for r in range(6):
        heard = heard if np.isfinite(wrench[r]) else 0
        for q in range(6):
            heard = heard if np.isfinite(covariance[r, q]) else 0
    if not heard:
        for r in range(16):
            total[r] = np.nan
    carries = np.ones((heard, len(contacts)), np.bool_)
    wrenches, covariances = wrench.reshape((1, 6))[:heard], covariance.reshape((1, 6, 6))[:heard]
    totals, factors = total.reshape((1, 16))[:heard], work[:36].reshape((1, 6, 6))[:heard]
    given = (contacts, wrenches, covariances, carries, settings)
    return _fuse(given, work[36:], out, out_covariance, totals, factors)


@released(
    """
    contacts n 21, counts int64 k, wrenches k 6, covariances k 6 6, settings 5, out out n 5, spreads out n 6,
    covariance out c, totals out k 16, factors out k 6 6, broken out int64 k
    """
)
def fuse_frames(contacts, counts, wrenches, covariances, settings, out, spreads, covariance, totals, factors, broken):
    """Compute `fuse_one` for each frame in turn.

    `counts` are the numbers of contacts in the frames; `spreads` the covariances of the single forces: xx, xy, xz, yy,
    yz, zz; `covariance` those of all forces of a frame, 9 counts^2 numbers, frame by frame; `broken` the return values
    of `fuse_one`. For a wrench that is not finite `totals` and `factors` are NaN.
    """
    most = 0
    for k in range(len(counts)):
        most = max(most, counts[k])
    work = np.zeros(36 + room(most, 1))
    begin = at = 0
    for k in range(len(counts)):
        count, size = counts[k], 3 * counts[k]
        whole = covariance[at : at + size * size].reshape((size, size))
        here = slice(begin, begin + count)
        work[:36] = np.nan
        broken[k] = fuse_one(contacts[here], wrenches[k], covariances[k], settings, work, out[here], whole, totals[k])
        factors[k] = work[:36].reshape((6, 6))
        for i in range(count):
            place = 0
            for r in range(3):
                for q in range(r, 3):
                    spreads[begin + i, place] = whole[3 * i + r, 3 * i + q]
                    place += 1
        begin, at = begin + count, at + size * size


@inner
def room(count, sensors):
    """Return the length of `work` that `fuse` needs; `fuse_one` needs 36 more."""
    n, k = 3 * count, 6 * sensors
    return 20 * count + 5 * n + n * n + 6 * n + 2 * k * k + 2 * k + k * n


@released(
    """
    contacts n 21, wrenches k 6, covariances k 6 6, carries bool k n, settings 5, work out w, out out n 5,
    covariance out 3n 3n, totals out k 16, factors out k 6 6
    """
)
def fuse(contacts, wrenches, covariances, carries, settings, work, out, covariance, totals, factors):
    """Compute the forces of contacts (n, 17) felt by sensors (k, 6).

    Args:
        contacts: (n, 17) rows, see `ROW`.
        wrenches: (k, 6), finite.
        covariances: (k, 6, 6) of the wrenches' noise.
        carries: (k, n) whether a sensor feels a contact.
        settings: (5,) tangential standard deviation, gain, floor, friction, number of times the prior is recomputed.
        work: array of the length of `room`.
        out: (n, 5) rows, see `OUT`, written.
        covariance: (3n, 3n) of the forces, written.
        totals: (k, 16), written: the wrenches expected from the skin alone; the squared distance of the measured ones,
            its degrees of freedom, its variance, the share of distances that are as large, all by the last prior, to
            whose forces misplaced contacts and friction are proportional; and the difference whitened by `factors`.
        factors: (k, 6, 6), written: L D L^T of the wrenches' covariance by the first prior, since an unseen contact
            biases the forces found.

    Returns:
        The number of contacts that violate their cone.
    """
    return _fuse((contacts, wrenches, covariances, carries, settings), work, out, covariance, totals, factors)


@inner
def _fuse(given, work, out, covariance, totals, factors):
    contacts, wrenches, covariances, carries, settings = given
    count, sensors = len(contacts), len(wrenches)
    size, height = 3 * count, 6 * sensors
    flat, at = _taken(work, 0, 9 * count)
    frames = flat.reshape((count, 3, 3))
    flat, at = _taken(work, at, 9 * count)
    second = flat.reshape((count, 3, 3))
    level, at = _taken(work, at, count)
    variance, at = _taken(work, at, count)
    mean, at = _taken(work, at, size)
    before, at = _taken(work, at, size)
    root, at = _taken(work, at, size)
    product, at = _taken(work, at, size)
    flat, at = _taken(work, at, size * size)
    square = flat.reshape((size, size))
    flat, at = _taken(work, at, 6 * size)
    rows = flat.reshape((6, size))
    flat, at = _taken(work, at, height * height)
    noise = flat.reshape((height, height))
    flat, at = _taken(work, at, height * height)
    innovation = flat.reshape((height, height))
    off, at = _taken(work, at, height)
    left, at = _taken(work, at, height)
    flat, at = _taken(work, at, height * size)
    whitened = flat.reshape((height, size))
    _first(contacts, settings, frames, mean, variance, second)
    _felt(contacts, frames, rows)
    column, last = np.empty((3, 6)), np.empty((6, 6))
    for i in range(count):
        level[i] = contacts[i, 6]
    for a in range(3 * count):
        before[a] = mean[a]
    turns = int(settings[4])
    for turn in range(turns + 1):
        _prior(contacts, settings, frames, level, variance, root, before)
        _noise(contacts, second, covariances, carries, noise)
        if turn == 0:
            _expected(rows, carries, wrenches, mean, totals, off)
        if turn == 0 or turn == turns:
            _innovation(noise, rows, root, carries, innovation)
        for k in range(sensors):
            if turn == turns:
                _whitened(innovation, off, k, last, column)
                _surprise(rows, root, carries[k], last, column, totals[k, 6:10])
            if turn == 0:
                _whitened(innovation, off, k, factors[k], column)
                for r in range(6):
                    totals[k, 10 + r] = column[0, r]
        for a in range(3 * count):
            mean[a] = before[a]
            for b in range(3 * count):
                square[a, b] = root[a] if a == b else 0.0
        for a in range(6 * sensors):
            left[a] = off[a]
        _posterior(rows, carries, noise, left, mean, before, square, product, whitened)
        if turn < turns:
            _again(contacts, frames, mean, square, level, variance, second)
    return _results(frames, mean, root, square, settings[3], out, covariance)


@released("places c 8, whitened 6, factor 6 6, tangential float, magnitudes m, out out c 4")
def explained(places, whitened, factor, tangential, magnitudes, out):
    """Compute the evidence of one more contact that explains a wrench, place by place.

    Its normal force is one of `magnitudes` m, with a standard deviation of a quarter; the error of a place is that of
    its spacing. With y the whitened wrench and G m the effect of (normal, tangential, tangential, place, place) with
    standard deviation 1 on it, the evidence is that of y ~ N(m g, I + m^2 G G^T).

    Args:
        places: (c, 8) points [m], outward normals, log of the share of the area, standard deviation [m] of the place.
        whitened: (6,) wrench less the expected one, whitened, from `fuse`.
        factor: (6, 6) from `fuse`.
        tangential: standard deviation of a tangential component over the normal force.
        magnitudes: (m,) [N], equally likely.
        out: (c, 4) log evidence with the share of the area, and the force [N] there, written.
    """
    frame, columns, push, off = np.empty((3, 3)), np.empty((5, 6)), np.empty(6), np.empty(6)
    products, split, right, best = np.empty((5, 5)), np.empty((5, 5)), np.empty(5), np.empty(3)
    weights, pushes = np.empty(len(magnitudes)), np.empty((len(magnitudes), 3))
    for c in range(len(places)):
        _frame(places[c, 3:6], frame)
        for e in range(5):
            tangent = frame[e] if e < 3 else frame[e - 2]
            for r in range(3):
                columns[e, r] = tangent[r] if e < 3 else 0.0
            if e < 3:
                cross_into(places[c, :3], tangent, columns[e, 3:])
            else:
                cross_into(tangent, frame[0], columns[e, 3:])
            _whiten(factor, columns[e])
            for r in range(6):
                if e == 0:
                    push[r] = columns[0, r]
                columns[e, r] *= 0.25 if e == 0 else tangential if e < 3 else places[c, 7]
        for a in range(5):
            for b in range(a + 1):
                products[a, b] = 0.0
                for r in range(6):
                    products[a, b] += columns[a, r] * columns[b, r]
        for j in range(len(magnitudes)):
            weights[j] = _evidence(columns, products, push, whitened, magnitudes[j], split, right, off)
            pushes[j, 0] = magnitudes[j] + 0.25 * magnitudes[j] * right[0]
            pushes[j, 1] = tangential * magnitudes[j] * right[1]
            pushes[j, 2] = tangential * magnitudes[j] * right[2]
        top, total = weights.max(), 0.0
        best[:] = 0.0
        for j in range(len(magnitudes)):
            part = np.exp(weights[j] - top)
            total += part
            for e in range(3):
                best[e] += part * pushes[j, e]
        out[c, 0] = top + np.log(total) - np.log(len(magnitudes)) + places[c, 6]
        for e in range(3):
            out[c, 1 + e] = 0.0
            for q in range(3):
                out[c, 1 + e] += best[q] / total * frame[q, e]


@inlined
def _evidence(columns, products, push, whitened, m, split, right, off):
    """Return the log of N(y; m g, I + m^2 G G^T) without its constant; `right` becomes x, in standard deviations.

    The square is |y - m g - m G x|^2 + |x|^2, without a difference of large numbers.
    """
    for r in range(6):
        off[r] = whitened[r] - m * push[r]
    for a in range(5):
        right[a] = 0.0
        for r in range(6):
            right[a] += columns[a, r] * off[r]
        right[a] *= m
        for b in range(a + 1):
            split[a, b] = m * m * products[a, b]
        split[a, a] += 1.0
    scale = 1.0
    for a in range(5):
        scale *= split[a, a]
        split[a, a] = 1.0 / split[a, a]
        for i in range(a + 1, 5):
            lower = split[i, a] * split[a, a]
            right[i] -= lower * right[a]
            for k in range(a + 1, i + 1):
                split[i, k] -= lower * split[k, a]
    square = 0.0
    for a in range(4, -1, -1):
        for b in range(a + 1, 5):
            right[a] -= split[b, a] * right[b]
        right[a] *= split[a, a]
        square += right[a] * right[a]
        pull = m * right[a]
        for r in range(6):
            off[r] -= pull * columns[a, r]
    for r in range(6):
        square += off[r] * off[r]
    return -0.5 * (square + np.log(scale))


@entry("points n 3, kept out int64 c, nearest out int64 n")
def spaced(points, kept, nearest):
    """Choose points one after the other, each farthest from those before; write them and each point's nearest one."""
    apart = np.full(len(points), np.inf)
    for k in range(len(kept)):
        kept[k] = 0 if k == 0 else np.argmax(apart)
        for i in range(len(points)):
            to = _square(points[i], points[kept[k]])
            if to < apart[i]:
                nearest[i], apart[i] = k, to


@entry("points n 3, near float, label out int64 n")
def clusters(points, near, label):
    """Write the number of each point's group of neighbours into `label`, numbered in the order of first points."""
    waiting = np.empty(len(points), np.int64)
    label[:] = -1
    patches = 0
    for first in range(len(points)):
        if label[first] >= 0:
            continue
        label[first], waiting[0], count = patches, first, 1
        while count > 0:
            count -= 1
            one = waiting[count]
            for other in range(len(points)):
                if label[other] < 0 and _square(points[one], points[other]) <= near * near:
                    label[other], waiting[count] = patches, other
                    count += 1
        patches += 1


@inner
def _square(a, b):
    """Return the squared distance of two points."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
