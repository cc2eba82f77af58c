"""Compiled: forces of several contacts from what a skin says of each and the total wrench of a sensor.

Of contact i, at p_i with outward normal n_i, the skin says a normal force s_i. Before the wrench is looked at,

    f_i = -n_i x_i + t_i,   x_i ~ N(s_i, d_i^2),   t_i ~ N(0, u^2 (s_i^2 + d_i^2) I),

t_i in the tangent plane. Sensor k feels W_k = sum over i of c_ki (f_i; p_i x f_i) + noise. An error of the place, of
covariance Q_i, adds a moment of covariance Q_i xx E[f_i f_i^T], the cross product of two matrices:

    A xx B = (tr A tr B - tr AB) I + AB + BA - tr(A) B - tr(B) A    (symmetric A, B).

It is the same error in every sensor that feels the contact. The posterior comes measurement after measurement by
Potter's square root filter ([potter]): the covariance is S S^T, so it stays symmetric and positive whatever the noise.
"""

# pyright: basic
from __future__ import annotations

import math

import numpy as np

from palpate.surfaces._jit import entry, inner

__all__ = ["NORMAL", "OUT", "ROW", "fuse"]

ROW = 17  # of a contact: point, outward normal, normal force, its deviation, covariance of the place row by row
NORMAL = 3  # where the normal begins in it
OUT = 5  # of a contact: force, deviation of the tangential force now over before, slack of the cone


@inner
def _frame(normal, frame):
    """Rows: minus the normal, and two tangents (Duff et al. 2017)."""
    x, y, z = normal[0], normal[1], normal[2]
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    frame[0, 0], frame[0, 1], frame[0, 2] = -x, -y, -z
    frame[1, 0], frame[1, 1], frame[1, 2] = 1.0 + sign * x * x * a, sign * b, -sign * x
    frame[2, 0], frame[2, 1], frame[2, 2] = b, sign + y * y * a, -y


@inner
def _added_moment(spread, second, weight, out):
    """Adds weight (spread xx second), each (3, 3) and symmetric, to `out`."""
    ta = spread[0, 0] + spread[1, 1] + spread[2, 2]
    tb = second[0, 0] + second[1, 1] + second[2, 2]
    tab = 0.0
    for i in range(3):
        for j in range(3):
            tab += spread[i, j] * second[i, j]
    for i in range(3):
        for j in range(3):
            total = -ta * second[i, j] - tb * spread[i, j]
            for k in range(3):
                total += spread[i, k] * second[k, j] + second[i, k] * spread[k, j]
            if i == j:
                total += ta * tb - tab
            out[i, j] += weight * total


@inner
def _prior(contacts, settings, frames, mean, root):
    """Frames, means and deviations of each contact's (normal, tangential, tangential) force."""
    tangential, gain, floor = settings[0], settings[1], settings[2]
    for i in range(len(contacts)):
        _frame(contacts[i, 3:6], frames[i])
        force, own = contacts[i, 6], contacts[i, 7]
        variance = own * own + gain * gain * force * force + floor * floor
        mean[3 * i], mean[3 * i + 1], mean[3 * i + 2] = force, 0.0, 0.0
        root[3 * i] = np.sqrt(variance)
        root[3 * i + 1] = root[3 * i + 2] = tangential * np.sqrt(force * force + variance)


@inner
def _felt(contacts, frames, rows):
    """(6, 3n) wrench of a unit of each component."""
    for i in range(len(contacts)):
        p0, p1, p2 = contacts[i, 0], contacts[i, 1], contacts[i, 2]
        for e in range(3):
            a, b, c = frames[i, e, 0], frames[i, e, 1], frames[i, e, 2]
            rows[0, 3 * i + e], rows[1, 3 * i + e], rows[2, 3 * i + e] = a, b, c
            rows[3, 3 * i + e] = p1 * c - p2 * b
            rows[4, 3 * i + e] = p2 * a - p0 * c
            rows[5, 3 * i + e] = p0 * b - p1 * a


@inner
def _noise(contacts, frames, mean, root, covariances, carries, noise):
    """(6k, 6k) covariance of the wrenches' noise, with what the places err by."""
    count, sensors = len(contacts), len(covariances)
    noise[:, :] = 0.0
    for k in range(sensors):
        for r in range(6):
            for q in range(6):
                noise[6 * k + r, 6 * k + q] = 0.5 * (covariances[k, r, q] + covariances[k, q, r])
    second, moment, spread = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for i in range(count):
        for r in range(3):
            for q in range(3):
                spread[r, q] = 0.5 * (contacts[i, 8 + 3 * r + q] + contacts[i, 8 + 3 * q + r])
                second[r, q] = 0.0
                for e in range(3):
                    of_two = root[3 * i + e] ** 2 + mean[3 * i + e] ** 2
                    second[r, q] += of_two * frames[i, e, r] * frames[i, e, q]
        moment[:, :] = 0.0
        _added_moment(spread, second, 1.0, moment)
        for k in range(sensors):
            for m in range(sensors):
                if carries[k, i] and carries[m, i]:
                    for r in range(3):
                        for q in range(3):
                            noise[6 * k + 3 + r, 6 * m + 3 + q] += moment[r, q]


@inner
def _split(matrix, least):
    """L D L^T in place: D on the diagonal, L below it; a pivot at or below `least` of its entry is taken as 0."""
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
    """(6k, 6k) covariance of the wrenches before they are looked at."""
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
    """Potter's step: one measurement row . x = left + row . mean with a noise of `variance`; square, mean change."""
    size = len(mean)
    total = variance
    for c in range(size):
        work[c] = 0.0
        for r in range(size):
            work[c] += square[r, c] * row[r]
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
def _posterior(rows, carries, noise, left, mean, square, vectors, whitened):
    """All measurements one after the other. `noise` becomes L D L^T; `left` is measured minus expected, changed."""
    sensors, count = carries.shape
    size, before, row = 3 * count, vectors[0], vectors[1]
    _split(noise, 1e-13)
    for e in range(size):
        before[e] = mean[e]
    for j in range(6 * sensors):
        k, r = j // 6, j % 6
        for e in range(size):
            whitened[j, e] = rows[r, e] if carries[k, e // 3] else 0.0
        for m in range(j):
            if noise[j, m] != 0.0:
                left[j] -= noise[j, m] * left[m]
                for e in range(size):
                    whitened[j, e] -= noise[j, m] * whitened[m, e]
        residual = left[j]
        for e in range(size):
            row[e] = whitened[j, e]
            residual -= row[e] * (mean[e] - before[e])
        _update(square, mean, row, residual, noise[j, j], vectors[2])


@inner
def _results(contacts, frames, mean, root, square, friction, out, covariance):
    """Forces, shares and slacks; the covariance in the surface's frame."""
    count = len(contacts)
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
        out[i, 3] = np.sqrt(now / before) if before > 0.0 else 1.0
        out[i, 4] = friction * mean[3 * i] - np.hypot(mean[3 * i + 1], mean[3 * i + 2])
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


@inner
def _chance(surprise, dof, variance):
    """Share of a gamma distribution of this mean and variance above `surprise` ([wilson-hilferty])."""
    spread = variance / (9.0 * dof * dof)
    if not spread > 0.0:
        return 1.0
    return 0.5 * math.erfc(((surprise / dof) ** (1.0 / 3.0) - (1.0 - spread)) / np.sqrt(2.0 * spread))


@inner
def _surprise(innovation, rows, root, carries, left, k, factor, column, found):
    """How far sensor k's wrench lies from what was expected, in `found`: squared, degrees of freedom, its variance.

    The variance of a chi-square is 2 dof; that of a source that is uniform in a disc lacks tr G^2 + 2/3 det G, with G
    (2, 2) what its components are worth in deviations.
    """
    for r in range(6):
        for q in range(6):
            factor[r, q] = innovation[6 * k + r, 6 * k + q]
    _split(factor, 1e-13)
    total, dof = 0.0, 0
    for r in range(6):
        column[0, r] = left[6 * k + r]
        for q in range(r):
            column[0, r] -= factor[r, q] * column[0, q]
        if factor[r, r] > 0.0:
            total += column[0, r] ** 2 / factor[r, r]
            dof += 1
    variance = 2.0 * dof
    for i in range(carries.shape[1]):
        if not carries[k, i]:
            continue
        aa = ab = bb = 0.0
        for r in range(6):
            for e in range(1, 3):
                column[e, r] = rows[r, 3 * i + e] * root[3 * i + e]
                for q in range(r):
                    column[e, r] -= factor[r, q] * column[e, q]
            if factor[r, r] > 0.0:
                aa += column[1, r] ** 2 / factor[r, r]
                ab += column[1, r] * column[2, r] / factor[r, r]
                bb += column[2, r] ** 2 / factor[r, r]
        variance -= aa * aa + bb * bb + 2.0 * ab * ab + 2.0 / 3.0 * (aa * bb - ab * ab)
    found[0], found[1], found[2] = total, dof, variance
    found[3] = _chance(total, dof, variance) if dof > 0 else np.nan


@entry
def fuse(contacts, wrenches, covariances, carries, settings, work, out, covariance, totals, innovation):
    """The forces of contacts (n, 17) felt by sensors (k, 6).

    Args:
        contacts: (n, 17) rows, see `ROW`.
        wrenches: (k, 6), finite.
        covariances: (k, 6, 6) of their noise.
        carries: (k, n) whether a sensor feels a contact.
        settings: (4,) tangential deviation, gain, floor, friction.
        work: frames (n, 3, 3), mean (3n,), root (3n,), square (3n, 3n), felt (6, 3n), noise (6k, 6k), left (6k,), then
            (3, 3n) and (6k, 3n).
        out: (n, 5) rows, see `OUT`.
        covariance: (3n, 3n) of the forces.
        totals: (k, 10) the wrenches that the skin alone lets expect; how far they are off: squared, degrees of
            freedom, its variance, share of such distances that are as large.
        innovation: (6k, 6k) covariance of the wrenches about them.

    Returns:
        How many contacts violate their cone.
    """
    frames, mean, root, square, rows, noise, left, vectors, whitened = work
    count, sensors = len(contacts), len(wrenches)
    _prior(contacts, settings, frames, mean, root)
    _felt(contacts, frames, rows)
    _noise(contacts, frames, mean, root, covariances, carries, noise)
    _innovation(noise, rows, root, carries, innovation)
    factor, column = np.empty((6, 6)), np.empty((3, 6))
    for k in range(sensors):
        for r in range(6):
            totals[k, r] = 0.0
            for i in range(count):
                if carries[k, i]:
                    totals[k, r] += rows[r, 3 * i] * mean[3 * i]
            left[6 * k + r] = wrenches[k, r] - totals[k, r]
        _surprise(innovation, rows, root, carries, left, k, factor, column, totals[k, 6:])
    for a in range(3 * count):
        for b in range(3 * count):
            square[a, b] = root[a] if a == b else 0.0
    _posterior(rows, carries, noise, left, mean, square, vectors, whitened)
    _results(contacts, frames, mean, root, square, settings[3], out, covariance)
    broken = 0
    for i in range(count):
        if out[i, 4] < 0.0 or mean[3 * i] < 0.0:
            broken += 1
    return broken
