"""Compiled: Kalman filters on each of several series, combined as interacting multiple models."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inner

STATE = 10  # of a filter: value, rate, its rate; the six entries of their covariance; its probability


@inner
def _predict(s, dt, jerk, jump):
    """Predict one filter over dt: white noise of these densities on the third derivative and on the value."""
    h = 0.5 * dt * dt
    p00, p01, p02, p11, p12, p22 = s[3], s[4], s[5], s[6], s[7], s[8]
    a0, a1, a2 = p00 + dt * p01 + h * p02, p01 + dt * p11 + h * p12, p02 + dt * p12 + h * p22  # first row of F P
    b1, b2 = p11 + dt * p12, p12 + dt * p22
    s[0] += dt * s[1] + h * s[2]
    s[1] += dt * s[2]
    s[3] = a0 + dt * a1 + h * a2 + jerk * dt**5 / 20.0 + jump * dt
    s[4] = a1 + dt * a2 + jerk * dt**4 / 8.0
    s[5] = a2 + jerk * dt**3 / 6.0
    s[6] = b1 + dt * b2 + jerk * dt**3 / 3.0
    s[7] = b2 + jerk * dt**2 / 2.0
    s[8] = p22 + jerk * dt


@inner
def _correct(s, z, variance):
    """Correct one filter by one reading; return the log-likelihood of the reading, up to a constant."""
    total = s[3] + variance
    missed = z - s[0]
    k0, k1, k2 = s[3] / total, s[4] / total, s[5] / total
    p0, p1, p2 = s[3], s[4], s[5]
    s[0] += k0 * missed
    s[1] += k1 * missed
    s[2] += k2 * missed
    s[3] -= k0 * p0
    s[4] -= k0 * p1
    s[5] -= k0 * p2
    s[6] -= k1 * p1
    s[7] -= k1 * p2
    s[8] -= k2 * p2
    return -0.5 * (missed * missed / total + np.log(total))


@entry("dt float, rates 3, out out n n")
def changed(dt, rates, out):
    """Write the probabilities (k, k) that the row's filter is right now and the column's after dt [s].

    The last filter is for jumps. rates (3,) [1/s]: of a smooth motion being drawn anew from its k - 1 kinds, of the
    begin of a jump, and of its end in any of these kinds. With S the total probability of all smooth kinds, dS/dt =
    -begins S + ends (1 - S), and the excess of one over its share of S decays by exp(-(changes + begins) t).
    """
    changes, begins, ends = rates[0], rates[1], rates[2]
    k = len(out)
    settled = begins / (begins + ends) if begins > 0.0 else 0.0
    left = np.exp(-(begins + ends) * dt)
    same = np.exp(-(changes + begins) * dt)
    for i in range(k):
        jumps = settled * (1.0 - left) if i < k - 1 else settled + (1.0 - settled) * left
        out[i, k - 1] = jumps
        for j in range(k - 1):
            out[i, j] = (1.0 - jumps) / (k - 1)
            if i < k - 1:
                out[i, j] += ((1.0 if i == j else 0.0) - 1.0 / (k - 1)) * same


@inner
def _mix(filters, shares, mixed):
    """Write the mixed state and covariance (9,) of the filters (k, STATE), each weighted by its share (k,)."""
    for j in range(9):
        mixed[j] = 0.0
    for i in range(len(filters)):
        for j in range(3):
            mixed[j] += shares[i] * filters[i, j]
    for i in range(len(filters)):
        k = 3
        for a in range(3):
            for b in range(a, 3):
                apart = (filters[i, a] - mixed[a]) * (filters[i, b] - mixed[b])
                mixed[k] += shares[i] * (filters[i, k] + apart)
                k += 1


@inner
def _interact(filters, change, old, shares):
    """Start each filter from the mixture of all, by their earlier probabilities, and predict its probability."""
    for i in range(len(filters)):
        for j in range(STATE):
            old[i, j] = filters[i, j]
    for j in range(len(filters)):
        total = 0.0
        for i in range(len(filters)):
            shares[i] = change[i, j] * old[i, 9]
            total += shares[i]
        for i in range(len(filters)):
            shares[i] = shares[i] / total if total > 0.0 else 1.0 if i == j else 0.0  # impossible: as it was
        _mix(old, shares, filters[j])
        filters[j, 9] = total


@inner
def _weigh(filters, likely):
    """Update probabilities by the log-likelihoods (k,) of the reading in each filter; they sum to one."""
    best, total = likely[0], 0.0
    for i in range(1, len(filters)):
        best = max(best, likely[i])
    for i in range(len(filters)):
        filters[i, 9] *= np.exp(likely[i] - best)
        total += filters[i, 9]
    for i in range(len(filters)):
        filters[i, 9] /= total


@entry("readings n, variances n, dt float, densities n m 2, rates 3, filters out n m 10, mixed out n 9")
def advance(readings, variances, dt, densities, rates, filters, mixed):
    """Advance filters (c, k, STATE) by dt [s] and by the readings (c,) that are not NaN; write their mixtures (c, 9).

    densities (c, k, 2): of the noise that drives each filter, see `_predict`; rates (3,): see `changed`.
    """
    count = filters.shape[1]
    change, old = np.empty((count, count)), np.empty((count, STATE))
    shares, likely = np.empty(count), np.empty(count)
    changed(dt, rates, change)
    for c in range(len(readings)):
        _interact(filters[c], change, old, shares)
        seen = readings[c] == readings[c]
        for i in range(count):
            _predict(filters[c, i], dt, densities[c, i, 0], densities[c, i, 1])
            if seen:
                likely[i] = _correct(filters[c, i], readings[c], variances[c])
        if seen:
            _weigh(filters[c], likely)
        for i in range(count):
            shares[i] = filters[c, i, 9]
        _mix(filters[c], shares, mixed[c])


@entry("mixed n 9, ahead float, value out n, rate out n")
def foresee(mixed, ahead, value, rate):
    """Write the values (c,) that the mixtures (c, 9) predict `ahead` [s] from now, and their rates (c,)."""
    for c in range(len(mixed)):
        value[c] = mixed[c, 0] + ahead * mixed[c, 1] + 0.5 * ahead * ahead * mixed[c, 2]
        rate[c] = mixed[c, 1] + ahead * mixed[c, 2]
