"""Compiled: several Kalman filters side by side on each of some series, mixed by how well they foresee it."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inner

__all__ = ["STATE", "advance", "foresee"]

STATE = 10  # of a filter: value, rate, its rate; the six entries of their covariance; the logarithm of its weight
FEWEST = 1e-3  # a filter that weighs less begins anew from the mixture
LEAST = np.log(FEWEST)


@inner
def _predict(s, dt, density):
    """One filter over dt: white noise of this density on the third derivative, or, negative, on the first alone."""
    if density < 0.0:
        s[1] = s[2] = 0.0
        s[4] = s[5] = s[6] = s[7] = s[8] = 0.0
        s[3] -= density * dt
        return
    h = 0.5 * dt * dt
    p00, p01, p02, p11, p12, p22 = s[3], s[4], s[5], s[6], s[7], s[8]
    a0, a1, a2 = p00 + dt * p01 + h * p02, p01 + dt * p11 + h * p12, p02 + dt * p12 + h * p22  # first row of F P
    b1, b2 = p11 + dt * p12, p12 + dt * p22
    s[0] += dt * s[1] + h * s[2]
    s[1] += dt * s[2]
    s[3] = a0 + dt * a1 + h * a2 + density * dt**5 / 20.0
    s[4] = a1 + dt * a2 + density * dt**4 / 8.0
    s[5] = a2 + density * dt**3 / 6.0
    s[6] = b1 + dt * b2 + density * dt**3 / 3.0
    s[7] = b2 + density * dt**2 / 2.0
    s[8] = p22 + density * dt


@inner
def _correct(s, z, variance):
    """One filter by one reading; twice the logarithm of how likely that was, but for a constant."""
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
    return -missed * missed / total - np.log(total)


@inner
def _mix(filters, mixed):
    """State and covariance of the mixture."""
    for j in range(9):
        mixed[j] = 0.0
    for i in range(len(filters)):
        weight = np.exp(filters[i, 9])
        for j in range(3):
            mixed[j] += weight * filters[i, j]
    for i in range(len(filters)):
        weight = np.exp(filters[i, 9])
        k = 3
        for a in range(3):
            for b in range(a, 3):
                apart = (filters[i, a] - mixed[a]) * (filters[i, b] - mixed[b])
                mixed[k] += weight * (filters[i, k] + apart)
                k += 1


@inner
def _weigh(filters):
    """Weights that sum to one."""
    best = filters[0, 9]
    for i in range(1, len(filters)):
        best = max(best, filters[i, 9])
    total = 0.0
    for i in range(len(filters)):
        total += np.exp(filters[i, 9] - best)
    for i in range(len(filters)):
        filters[i, 9] -= best + np.log(total)


@entry
def advance(readings, variances, dt, densities, memory, filters, mixed):
    """All filters (c, k, STATE) by dt [s], and by the readings (c,) that are not NaN; the mixtures (c, 9) of them.

    densities (c, k): of the noise that drives each, see `_predict`. A filter's past counts by exp(-age/memory); one
    that weighs next to nothing begins anew from the mixture, so that a step does not linger in the slow ones.
    """
    kept = np.exp(-dt / memory)
    for c in range(len(readings)):
        seen = readings[c] == readings[c]
        for i in range(filters.shape[1]):
            s = filters[c, i]
            _predict(s, dt, densities[c, i])
            if seen:
                s[9] = kept * s[9] + 0.5 * _correct(s, readings[c], variances[c])
        if seen:
            _weigh(filters[c])
        _mix(filters[c], mixed[c])
        for i in range(filters.shape[1]):
            if filters[c, i, 9] < LEAST:
                for j in range(9):
                    filters[c, i, j] = mixed[c, j]
                filters[c, i, 9] = LEAST


@entry
def foresee(mixed, ahead, value, rate):
    """What the mixtures (c, 9) expect `ahead` [s] from now, and how fast it then moves, into (c,) each."""
    for c in range(len(mixed)):
        value[c] = mixed[c, 0] + ahead * mixed[c, 1] + 0.5 * ahead * ahead * mixed[c, 2]
        rate[c] = mixed[c, 1] + ahead * mixed[c, 2]
