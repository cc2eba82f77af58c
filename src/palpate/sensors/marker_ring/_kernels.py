"""Compiled loops that find a few radial contacts, each with angle, force, width and shear, in a ring's displacements.

Minimised over the contacts c of an image, each with (phi, F, z, t), see `palpate.optical.ring_response`:

    sum over i of (u_i - sum over c of F (v0 + z v1 + z^2 v2 + t s)_i(phi))^2 / var_i
    + sum over c of ((z - m) / Z)^2 + ((t - h) / T)^2

by Gauss-Newton steps that are shortened until the sum decreases. var_i is the variance of the pixels' noise and of the
response's misfit; m and Z are from the calibration; h is the shear of a contact that its neighbours cause, T its
deviation, see `_held`. During the search for contacts, and for a single one, h is 0 and T that of dragged presses; t is
then corrected if the presses of the calibration were of two kinds, see `_told`.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.optical._fisheye import displaced
from palpate.surfaces._jit import inner, released
from palpate.surfaces._vectors import solve_positive

MOST = 6  # contacts at once
STATE = 9  # angle, force, width z, shear / force t, deviations of angle, force and depth, evidence, shear's deviation
_STEPS = 12  # of Gauss-Newton
_TRIALS = 180  # angles at which an additional contact is tried
_FAR = (2.25, 4.0)  # standard deviations of width and of shear: bounds of both; two tips look like one that is wider
_BESIDE = 0.02  # share of the force: its deviation by a neighbour 30 degrees away, and the shear's
_ROUNDS = 2  # of computing the shears by neighbours and fitting again
_RESISTS = (
    0.4  # share of the largest resistance that is expected: of 0.3 to 0.5 the best for three barrels, three rings
)
_FITS = 12.0  # squared standard deviations of a marker: if all lie below, no contact is missing


@inner
def _shapes(table, slope, phi, z, t, value, by_phi, by_z, shear):
    """Compute displacements per newton of one contact, and their derivatives, by Hermite interpolation of the table."""
    angles, count, terms = table.shape
    at = phi / (2.0 * np.pi)
    at = (at - np.floor(at)) * angles
    k = int(at)
    x = at - k
    k, after = k % angles, (k + 1) % angles
    h = 2.0 * np.pi / angles
    a, b = (1.0 + 2.0 * x) * (1.0 - x) ** 2, x * x * (3.0 - 2.0 * x)
    c, d = x * (1.0 - x) ** 2 * h, x * x * (x - 1.0) * h
    a1, c1, d1 = 6.0 * x * (x - 1.0) / h, (1.0 - x) * (1.0 - 3.0 * x), x * (3.0 * x - 2.0)
    for i in range(count):
        value[i] = by_phi[i] = by_z[i] = shear[i] = 0.0
        for q in range(terms):
            y0, y1, s0, s1 = table[k, i, q], table[after, i, q], slope[k, i, q], slope[after, i, q]
            v = a * y0 + b * y1 + c * s0 + d * s1
            w = a1 * (y0 - y1) + c1 * s0 + d1 * s1
            if q == 3:
                shear[i] = v
            factor = t if q == 3 else (1.0 if q == 0 else z if q == 1 else z * z)
            value[i] += factor * v
            by_phi[i] += factor * w
            if q == 1:
                by_z[i] += v
            elif q == 2:
                by_z[i] += 2.0 * z * v


@inner
def _copy(one, other):
    """Copy contacts from one array to another: a loop is compiled faster than an assignment of slices."""
    for c in range(one.shape[0]):
        for k in range(one.shape[1]):
            other[c, k] = one[c, k]


@inner
def _variances(state, count, markers, misfit, steep, noise, variance):
    """Write the variance of each displacement: that of the pixels, and the misfit of each contact's response.

    A shear of t times the force adds `steep` t times the misfit.
    """
    parts, each = misfit.shape[1], 2 * len(markers) // len(misfit)
    for m in range(len(markers)):
        ring = 2 * (m // each)
        for e in range(2):
            i = 2 * m + e
            variance[i] = noise[i]
            for c in range(count):
                turn = (markers[m] - state[c, 0]) / (2.0 * np.pi)
                k = int((turn - np.floor(turn)) * parts) % parts
                variance[i] += (state[c, 1] * misfit[ring + e, k]) ** 2 * (1.0 + (steep * state[c, 3]) ** 2)


@inner
def _cost(displacement, used, variance, state, count, model, held, residual, jacobian):
    """Return the sum that is minimised; write residuals, and derivatives where `jacobian` has columns."""
    table, slope, priors = model
    size = len(displacement)
    value, by_phi = np.empty(size), np.empty(size)
    by_z, shear = np.empty(size), np.empty(size)
    cost = 0.0
    for i in range(size):
        residual[i] = displacement[i]
    for c in range(count):
        force, z, t = state[c, 1], state[c, 2], state[c, 3]
        _shapes(table, slope, state[c, 0], z, t, value, by_phi, by_z, shear)
        for i in range(size):
            residual[i] -= force * value[i]
            if jacobian.shape[1]:
                jacobian[i, 4 * c] = force * by_phi[i]
                jacobian[i, 4 * c + 1] = value[i]
                jacobian[i, 4 * c + 2] = force * by_z[i]
                jacobian[i, 4 * c + 3] = force * shear[i]
        cost += ((z - priors[2]) / priors[0]) ** 2 + ((t - held[c, 0]) / held[c, 1]) ** 2
    for i in range(size):
        if used[i]:
            cost += residual[i] ** 2 / variance[i]
    return cost


@inner
def _refine(problem, used, state, count, work):
    """Refine `state` in place by Gauss-Newton steps; return the final cost. The normal matrix remains in work[2].

    `problem`: displacements, markers, model, misfit and noise of `frames`, the shears of `_held`, and the deviation of
    those of several contacts: only a single one is thought to be dragged. `work`: residuals, their derivatives, the
    normal matrix, variances.
    """
    residual, jacobian, normal, variance = work
    displacement, markers, model, misfit, noise, held, several = problem
    held[:, 1] = model[2][1] if count == 1 else several
    priors, size = model[2], 4 * count
    gradient, step = np.empty(size), np.empty(size)
    factor, trial = np.empty((size, size)), np.empty((len(state), STATE))
    _copy(state, trial)
    no_jacobian = np.empty((len(residual), 0))
    _variances(state, count, markers, misfit, model[2][3], noise, variance)
    cost, damping = _cost(displacement, used, variance, state, count, model, held, residual, jacobian), 1e-4
    for turn in range(_STEPS):
        for a in range(size):
            gradient[a] = 0.0
            for b in range(a + 1):
                normal[a, b] = 0.0
        for i in range(len(residual)):
            if not used[i]:
                continue
            weight = 1.0 / variance[i]
            for a in range(size):
                scaled = weight * jacobian[i, a]
                gradient[a] += scaled * residual[i]
                for b in range(a + 1):
                    normal[a, b] += scaled * jacobian[i, b]
        for c in range(count):
            for e in range(2):
                a = 4 * c + 2 + e
                middle, wide = (held[c, 0], held[c, 1]) if e else (priors[2], priors[0])
                gradient[a] -= (state[c, 2 + e] - middle) / wide**2
                normal[a, a] += 1.0 / wide**2
        if turn == _STEPS - 1:
            break
        better, moved = False, 0.0
        for _ in range(6):
            for a in range(size):
                for b in range(a + 1):
                    factor[a, b] = normal[a, b] * (1.0 + damping) if a == b else normal[a, b]
            if solve_positive(factor, gradient, size, step):
                for c in range(count):
                    trial[c, 0] = state[c, 0] + min(max(step[4 * c], -0.15), 0.15)
                    trial[c, 1] = max(state[c, 1] + step[4 * c + 1], 1e-3)
                    for e in range(2):
                        middle, wide = (held[c, 0], held[c, 1]) if e else (priors[2], priors[0])
                        bound = _FAR[e] * wide
                        moved_to = state[c, 2 + e] + step[4 * c + 2 + e]
                        trial[c, 2 + e] = min(max(moved_to, middle - bound), middle + bound)
                found = _cost(displacement, used, variance, trial, count, model, held, residual, no_jacobian)
                if found < cost:
                    better = True
                    break
            damping *= 10.0
        if not better:
            _cost(displacement, used, variance, state, count, model, held, residual, jacobian)
            break
        for c in range(count):
            moved = max(moved, abs(trial[c, 0] - state[c, 0]) / 1e-4, abs(trial[c, 1] - state[c, 1]) / 1e-4)
            for k in range(4):
                state[c, k] = trial[c, k]
        damping = max(0.1 * damping, 1e-7)
        _variances(state, count, markers, misfit, model[2][3], noise, variance)
        cost = _cost(displacement, used, variance, state, count, model, held, residual, jacobian)
        if moved < 1.0:
            break
    return cost


@inner
def _apart(a, b):
    """Return the angle between two directions [rad], 0 to pi."""
    turn = (a - b) / (2.0 * np.pi)
    return 2.0 * np.pi * abs(turn - np.round(turn))


@inner
def _candidate(used, state, count, table, work, nearest):
    """Return angle, force and width of the additional contact that explains most of the residual, and its gain."""
    residual, _, _, variance = work
    best, phi, force, width = 0.0, 0.0, 0.0, 0.0
    step = max(1, len(table) // _TRIALS)
    for k in range(0, len(table), step):
        angle, near = 2.0 * np.pi * k / len(table), False
        for c in range(count):
            near = near or _apart(angle, state[c, 0]) < nearest
        if near:
            continue
        aa = ab = bb = ra = rb = 0.0
        for i in range(len(residual)):
            if used[i]:
                weight, a, b = 1.0 / variance[i], table[k, i, 0], table[k, i, 1]
                aa += weight * a * a
                ab += weight * a * b
                bb += weight * b * b
                ra += weight * a * residual[i]
                rb += weight * b * residual[i]
        bb += 1e-9 * aa
        det = aa * bb - ab * ab
        if not det > 0.0 or ra <= 0.0:
            continue
        f, g = (bb * ra - ab * rb) / det, (aa * rb - ab * ra) / det
        if not (f > 0.0 and abs(g) < 2.0 * f):  # too wide or too narrow for anything: the usual width
            f, g = ra / aa, 0.0
        gain = f * ra + g * rb
        if gain > best:
            best, phi, force, width = gain, angle, f, g / f
    return phi, force, width, best


@inner
def _drop(state, count, which):
    """Remove one contact; return the number of those remaining."""
    for c in range(which, count - 1):
        for k in range(STATE):
            state[c, k] = state[c + 1, k]
    return count - 1


@inner
def _worst(used, work):
    """Return the marker with the largest residual, and its square in squared standard deviations."""
    residual, _, _, variance = work
    worst, far = -1, 0.0
    for m in range(len(residual) // 2):
        if used[2 * m]:
            off = residual[2 * m] ** 2 / variance[2 * m] + residual[2 * m + 1] ** 2 / variance[2 * m + 1]
            if off > far:
                worst, far = m, off
    return worst, far


@inner
def _explained(used, state, which, model, work):
    """Return the squared displacements over their variance that one contact explains."""
    residual, _, _, variance = work
    size = len(residual)
    value, spare = np.empty(size), np.empty(size)
    _shapes(model[0], model[1], state[which, 0], state[which, 2], state[which, 3], value, spare, spare, spare)
    total = 0.0
    for i in range(size):
        if used[i]:
            total += (state[which, 1] * value[i]) ** 2 / variance[i]
    return total


@inner
def _weakest(problem, used, state, count, work, cost, off):
    """Return the contact that explains least, and the rise of the cost without it; strong ones are not tried."""
    least, which = np.inf, -1
    other = np.empty((len(state), STATE))
    spare = (np.empty(len(work[0])), work[1], np.empty((4 * MOST, 4 * MOST)), np.empty(len(work[0])))
    for c in range(count):
        rise = _explained(used, state, c, problem[2], work)
        if rise < 25.0 * off:
            _copy(state, other)
            left = _drop(other, count, c)
            rise = _refine(problem, used, other, left, spare) - cost
        state[c, 7] = rise
        if rise < least:
            least, which = rise, c
    return which, least


@inner
def _added(problem, used, state, count, work, cost, nearest, on, trial):
    """Write the contacts with one added into `trial`; return their number and cost, unchanged if none helps."""
    more, after = count, cost
    phi, force, width, gain = _candidate(used, state, count, problem[2][0], work, nearest)
    if gain > 0.5 * on:
        _copy(state, trial)
        trial[count, 0], trial[count, 1], trial[count, 2], trial[count, 3] = phi, force, width, 0.0
        more, after = count + 1, _refine(problem, used, trial, count + 1, work)
    halves = np.empty((len(state), STATE))
    for c in range(count):  # or two that stand so near that one was taken for both
        _copy(state, halves)
        for k in range(STATE):
            halves[count, k] = state[c, k]
        halves[c, 0], halves[count, 0] = state[c, 0] - 0.6 * nearest, state[c, 0] + 0.6 * nearest
        halves[c, 1] = halves[count, 1] = 0.5 * state[c, 1]
        halves[c, 2], halves[count, 2] = problem[2][2][2], problem[2][2][2]
        split = _refine(problem, used, halves, count + 1, work)
        if split < after:
            more, after = count + 1, split
            _copy(halves, trial)
    for c in range(more):
        for d in range(c):
            if _apart(trial[c, 0], trial[d, 0]) < nearest:
                return count, cost
    return more, after


@inner
def _merged(problem, used, state, count, work, cost, nearest):
    """Keep the stronger of two contacts nearer than `nearest`, as a wide body is one; return number and cost."""
    c = 1
    while c < count:
        other = -1
        for d in range(c):
            if _apart(state[c, 0], state[d, 0]) < nearest:
                other = d
        if other < 0:
            c += 1
            continue
        count = _drop(state, count, c if state[c, 1] < state[other, 1] else other)
        cost = _refine(problem, used, state, count, work)
        c = 1
    return count, cost


@inner
def _retried(problem, used, state, count, work, cost, nearest, on):
    """Remove each contact in turn and search for it again; return the final cost.

    A contact first fitted as one wide body between two stays in another local minimum when the second is added.
    """
    other, trial = np.empty((len(state), STATE)), np.empty((len(state), STATE))
    for c in range(count):
        _copy(state, other)
        left = _drop(other, count, c)
        without = _refine(problem, used, other, left, work)
        more, after = _added(problem, used, other, left, work, without, nearest, on, trial)
        if more == count and after < cost - 1.0:
            _copy(trial, state)
            cost = after
    return _refine(problem, used, state, count, work)


@inner
def _found(problem, used, state, count, work, settings):
    """Find the contacts of an image, starting from those of the one before; return their number and the cost."""
    on, off, nearest, dropped = settings[0] ** 2, settings[1] ** 2, settings[2], settings[3]
    cost, before = _refine(problem, used, state, count, work), count
    trial = np.empty((len(state), STATE))
    for _ in range(2 * MOST + int(dropped)):
        worst, far = _worst(used, work)
        if far < _FITS:
            break
        more, after = count, cost
        if count < MOST:
            more, after = _added(problem, used, state, count, work, cost, nearest, on, trial)
        if dropped > 0 and far > 25.0 and far > 0.8 * (cost - after):  # one marker that is wrong is no contact
            used[2 * worst] = used[2 * worst + 1] = False
            dropped -= 1
        elif more > count and cost - after > on:
            _copy(trial, state)
            count = more
        else:
            cost = _refine(problem, used, state, count, work)
            break
        cost = _refine(problem, used, state, count, work)
    count, cost = _merged(problem, used, state, count, work, cost, nearest)
    if count > 1 and count != before:
        cost = _retried(problem, used, state, count, work, cost, nearest, on)
    while count:
        which, least = _weakest(problem, used, state, count, work, cost, off)
        if least > off:
            break
        count = _drop(state, count, which)
        cost = _refine(problem, used, state, count, work)
    return count, cost


@inner
def _covariance(normal, size, covariance):
    """Write the inverse of a normal matrix, whose lower half is filled, into `covariance`; NaN if it is singular."""
    factor, column, unit = np.empty((size, size)), np.empty(size), np.zeros(size)
    for a in range(size):
        for b in range(size):
            unit[b] = 1.0 if a == b else 0.0
            for c in range(size):
                factor[b, c] = normal[b, c] * (1.0 + 1e-12 if b == c else 1.0)
        known = solve_positive(factor, unit, size, column)
        for b in range(size):
            covariance[a, b] = column[b] if known else np.nan


@inner
def _told(t, variance, usual, kinds):
    """Return mean and variance of a contact's shear / force, where contacts are of two kinds.

    The fit used one normal distribution as a prior; the markers' information is the result without that prior. With
    the prior of each kind it gives another mean and variance, and a weight: the share of the kind, times the likelihood
    of the markers' information under it. The moments are those of the mixture.

    Args:
        t: shear / force of the fit.
        variance: variance of t.
        usual: standard deviation of the one prior.
        kinds: `dragged` of a `RingResponse`.
    """
    sure = max(1.0 / variance - 1.0 / usual**2, 1e-6 / variance)  # of the markers alone
    seen = t / (variance * sure)
    odds, mean, spread = np.empty(2), np.empty(2), np.empty(2)
    for k in range(2):
        wide = kinds[1 + k] ** 2
        both = wide + 1.0 / sure
        odds[k] = -0.5 * (seen**2 / both + np.log(both)) + np.log(kinds[0] if k else 1.0 - kinds[0])
        mean[k], spread[k] = seen * wide / both, wide / (sure * both)
    dragged = 1.0 / (1.0 + np.exp(min(odds[0] - odds[1], 700.0)))
    between = dragged * (1.0 - dragged) * (mean[1] - mean[0]) ** 2
    at = mean[0] + dragged * (mean[1] - mean[0])
    return at, spread[0] + dragged * (spread[1] - spread[0]) + between


@inner
def _weighed(state, usual, kinds, covariance):
    """Correct a single contact's shear as in `_told`, and its other values by their covariance with shear, in place."""
    variance, t, gain = covariance[3, 3], state[0, 3], np.empty(4)
    if not variance > 0.0:
        return
    mean, left = _told(t, variance, usual, kinds)
    for a in range(4):
        gain[a] = covariance[a, 3] / variance
    for a in range(4):
        state[0, a] += gain[a] * (mean - t)
        for b in range(4):
            covariance[a, b] += gain[a] * gain[b] * (left - variance)
    state[0, 1] = max(state[0, 1], 1e-3)


@inner
def _deviations(state, count, covariance, width, spread, carry, shift):
    """Write standard deviations of angle, force, depth and shear of each contact into `state`.

    A neighbour's dent turns the skin, so that responses do not quite add up: it shifts a contact 30 degrees away by
    about `shift` [rad], and less if farther away. `spread` is that of a `RingResponse`, then its `sheared`.
    """
    for c in range(count):
        force, z, t, at, near = state[c, 1], state[c, 2], state[c, 3], 4 * c, 0.0
        deep, more = width[0] + z * width[1], force * width[1]
        for d in range(count):
            gap = _apart(state[c, 0], state[d, 0])
            if d != c and gap < 0.5 * np.pi:
                near += min(1.0, np.pi / 6.0 / gap) ** 2
        beside = spread[0] ** 2 + (t * spread[2]) ** 2 + near * shift**2
        share = spread[1] ** 2 + (t * spread[3]) ** 2 + near * _BESIDE**2
        of_force, of_both, of_width = covariance[at + 1, at + 1], covariance[at + 1, at + 2], covariance[at + 2, at + 2]
        of_angle = covariance[at, at] + 2.0 * (carry[0] + carry[1] * deep) * (
            t * covariance[at, at + 1] + force * covariance[at, at + 3]
        )
        state[c, 5] = np.sqrt(of_force + share * force**2)
        depth = deep * deep * of_force + 2.0 * deep * more * of_both + more * more * of_width
        state[c, 6] = np.sqrt(max(depth, 0.0) + share * (force * deep) ** 2)
        shear = t * t * of_force + 2.0 * t * force * covariance[at + 1, at + 3] + force**2 * covariance[at + 3, at + 3]
        state[c, 8] = np.sqrt(max(shear, 0.0) + (share + (t * spread[4]) ** 2) * force**2)
        state[c, 4] = np.sqrt(max(of_angle + (carry[0] + carry[1] * deep) ** 2 * shear, 0.0) + beside)


@inner
def _skin(skin, delta, phi, moved):
    """Write the outer skin's motion at an angle delta from a contact at phi, per newton, into `moved` (2, b)."""
    moved[:] = 0.0
    for k in range(skin.shape[2]):
        turn = (k + 1) // 2 * delta
        of_delta = np.sin(turn) if k % 2 == 0 and k else np.cos(turn)
        for m in range(skin.shape[3]):
            turn = (m + 1) // 2 * phi
            both = of_delta * (np.sin(turn) if m % 2 == 0 and m else np.cos(turn))
            for e in range(2):
                for q in range(skin.shape[1]):
                    moved[e, q] += skin[e, q, k, m] * both


@inner
def _dents(state, count, which, skin, moved):
    """Return the skin's motion under a contact by its neighbours: along rising angles [m], and slope [m/rad]."""
    along = slope = 0.0
    for d in range(count):
        if d != which:
            _skin(skin, state[which, 0] - state[d, 0], state[d, 0], moved)
            for q in range(skin.shape[1]):
                weight = state[d, 1] * (state[d, 3] if q == 3 else state[d, 2] ** q)
                along += weight * moved[0, q]
                slope += weight * moved[1, q]
    return along, slope


@inner
def _turn(state, which, along, outer, width, carry):
    """Return by how much the skin under a contact is turned about the axis [rad]: its shear and neighbours move it."""
    deep = width[0] + state[which, 2] * width[1]
    pulled = (carry[0] + carry[1] * deep) * state[which, 3]
    return along / (outer - state[which, 1] * deep) + state[which, 1] * pulled


@inner
def _carried(state, count, skin, outer, width, carry, found):
    """Write the contacts' angles, forces and shears, corrected for the motion of the skin under them, into `found`.

    The response gives the pressed part of the skin, and forces along the axes there, at its angle where nothing moves
    it along.

    Args:
        state: contacts.
        count: number of contacts.
        skin: (2, b, 2 K + 1, 2 M + 1) [m/N] of `RingResponse.skin`.
        outer: outer radius [m].
        width: (2,) of a `RingResponse`.
        carry: `carried` of a `RingResponse`.
        found: (n, STATE), angles, forces and shear / force are written.
    """
    moved = np.empty(skin.shape[:2])
    for c in range(count):
        along, _ = _dents(state, count, c, skin, moved)
        turn, t = _turn(state, c, along, outer, width, carry), state[c, 3]
        force = np.cos(turn) - t * np.sin(turn)
        found[c, 0] = state[c, 0] + turn
        found[c, 1], found[c, 3] = state[c, 1] * force, (t * np.cos(turn) + np.sin(turn)) / force


@inner
def _held(state, count, skin, outer, width, carry, grips, held):
    """Write each contact's shear / force that its neighbours cause into `held`, and how far it may be off.

    Neighbours tilt the skin under a contact, which presses along the skin's normal. They also move the skin along, and
    friction resists: at least not at all, at most until the skin does not move, or up to a share of the force that the
    body's friction allows. Markers determine the shears of near contacts poorly: two that pull at each other look much
    like two that press harder. So what the calibration's friction leads one to expect is held to, and intervals have
    what bodies of other friction do, see `_widened`.

    Args:
        state: contacts.
        count: number of contacts.
        skin: see `_carried`, with the motion by shear.
        outer: outer radius [m].
        width: (2,) of a `RingResponse`.
        carry: `carried` of a `RingResponse`.
        grips: (2,) largest shear / force: in the calibration, and of any body, see `RingLocator`.
        held: (MOST, 3), first and last written: mean, standard deviation without neighbours, and that by friction.
    """
    moved = np.empty(skin.shape[:2])
    for c in range(count):
        along, slope = _dents(state, count, c, skin, moved)
        tilt = slope / outer - _turn(state, c, along, outer, width, carry)
        _skin(skin, 0.0, state[c, 0], moved)
        gives = state[c, 1] * moved[0, 3]
        most = -along / gives if gives > 0.0 else 0.0
        held[c, 0] = tilt + _RESISTS * min(max(most, -grips[0]), grips[0])
        held[c, 2] = 0.5 * min(max(most, -grips[1]), grips[1])


@inner
def _widened(held, count, covariance):
    """Add what another friction than expected does to the covariance; contacts at once are of one friction."""
    off = np.zeros(4 * count)
    for a in range(4 * count):
        for c in range(count):
            off[a] += covariance[a, 4 * c + 3] * held[c, 2] / held[c, 1] ** 2
    for a in range(4 * count):
        for b in range(4 * count):
            covariance[a, b] += off[a] * off[b]


@released(
    """
    displacements n d, markers m, model (a d b, a d b, 4), misfit r q, noise d, settings 5, learned (2, 5, 2 s t
    u, float, 2, float, 2, 3), states out n 6 9, counts out int64 n, left out 7 9, cost out n
    """
)
def frames(displacements, markers, model, misfit, noise, settings, learned, states, counts, left, cost):
    """Find the contacts of successive images, each starting from those of the one before.

    Args:
        displacements: (n, 2 m) [m] outwards and along rising angles, marker by marker; NaN: not seen.
        markers: (m,) [rad] angles at rest, ring by ring, the same number in each.
        model: table and slope (a, 2 m, b) of `RingResponse.tables`, and (4,) standard deviations of z and t, z's
            mean, and the misfit's multiple by shear.
        misfit: (2 r, B) [m/N] of r rings.
        noise: (2 m,) [m^2] variances from the pixels.
        settings: (5,) on and off in standard deviations, least angle between contacts [rad], number of markers that may
            be omitted, and shift of a contact by a neighbour [rad].
        learned: width (2,) of a `RingResponse`, its spread with the first three of `sheared` (5,), its `skin`, the
            outer radius [m], grips (2,) of `_held` (0: neighbours cause no shear), usual deviation of shear / force,
            its `carried`, and its kinds of contacts, see `_told` (a share of 0: one kind).
        states: (n, MOST, STATE), written, like all that follow.
        counts: (n,) number of contacts; -1: fewer than half of the markers are seen.
        left: (MOST + 1, STATE) contacts of the last image, their count in the last row's first place; changed.
        cost: (n,) root of each image's chi-square over its degrees of freedom.
    """
    size = displacements.shape[1]
    work = (np.empty(size), np.empty((size, 4 * MOST)), np.empty((4 * MOST, 4 * MOST)), np.empty(size))
    state, used = np.zeros((MOST, STATE)), np.empty(size, dtype=np.bool_)
    _copy(left[:MOST], state)
    count, here, held = int(left[MOST, 0]), np.empty(size), np.zeros((MOST, 3))
    covariance = np.empty((4 * MOST, 4 * MOST))
    width, spread, skin, outer, grips, usual, carry, kinds = learned
    for n in range(len(displacements)):
        seen = 0
        for i in range(size):
            used[i] = np.isfinite(displacements[n, i])
            seen += used[i]
        if 2 * seen < size:
            counts[n], cost[n] = -1, np.nan
            count = 0
            continue
        for i in range(size):
            here[i] = displacements[n, i] if used[i] else 0.0
        held[:, 0] = 0.0
        problem = (here, markers, model, misfit, noise, held, usual)
        count, cost[n] = _found(problem, used, state, count, work, settings)
        neighbours = count > 1 and grips[1] > 0.0
        for _ in range(_ROUNDS if neighbours else 0):
            _held(state, count, skin, outer, width, carry, grips, held)
            cost[n] = _refine(problem, used, state, count, work)
        _covariance(work[2], 4 * count, covariance)
        if neighbours:
            _widened(held, count, covariance)
        if kinds[0] > 0.0 and count == 1:
            _weighed(state, model[2][1], kinds, covariance)
        _deviations(state, count, covariance, width, spread, carry, settings[4])
        seen = 0
        for i in range(size):
            seen += used[i]
        free = max(seen - 2 * count, 1)
        cost[n] = np.sqrt(cost[n] / free)
        counts[n] = count
        _copy(state, states[n])
        _carried(state, count, skin, outer, width, carry, states[n])
        for c in range(count):
            turn = states[n, c, 0] / (2.0 * np.pi)
            states[n, c, 0] = 2.0 * np.pi * (turn - np.floor(turn))
    _copy(state, left[:MOST])
    left[MOST, 0] = count


@released(
    """
    pixels p 2, ring (10, 12, m, m 2, m 2 2), steps int, known (m, (a d b, a d b, 4), r q, d, 5, (2, 5, 2 s t u,
    float, 2, float, 2, 3)), states out n 6 9, counts out int64 n, left out 7 9, cost out n, many out int64 n
    """
)
def shown(pixels, ring, steps, known, states, counts, left, cost, many):
    """Compute displacements from markers' pixels, as `MarkerRing.displacements` does, and call `frames` with them.

    Args:
        pixels: (n m, 2), NaN: not seen.
        ring: lens, pose, heights, resting and axes of `_fisheye.displaced`.
        steps: see `_fisheye.displaced`.
        known: the arguments markers to learned of `frames`.
        states: see `frames`.
        counts: see `frames`.
        left: see `frames`.
        cost: see `frames`.
        many: (n,) int64, written: number of markers seen.
    """
    moved, m = np.empty(pixels.shape), len(pixels) // len(counts)
    displaced(pixels, *ring[:3], steps, *ring[3:], moved)
    for n in range(len(counts)):
        many[n] = 0
        for i in range(n * m, n * m + m):
            many[n] += np.isfinite(pixels[i, 0]) and np.isfinite(pixels[i, 1])
    frames(moved.reshape(len(counts), 2 * m), *known, states, counts, left, cost)
