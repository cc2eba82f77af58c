"""Compiled: estimate the places of pokes by the responses of the taxels about them."""

# pyright: basic
from __future__ import annotations

from math import erfc, exp, hypot, log, log1p, sqrt

import numpy as np

from palpate.surfaces._jit import inner, released

_FAR = 30.0  # deviations beyond which nothing becomes less likely
_NOTHING = 40.0  # below the largest logarithm: e^-40 of it
_SURE = 8.5  # deviations beyond which the logarithm of the normal distribution is 0 to the last bit


@inner
def _log_below(x):
    """Return the logarithm of the normal distribution."""
    return 0.0 if x > _SURE else log(0.5 * erfc(-max(x, -_FAR) / sqrt(2.0)))


@inner
def _fit(x, y, told, count, at, answers, shares, weight, quiet, model, least):
    """Return the log-likelihood of the answers for a poke at x, y, with the level that fits best under its prior.

    The first `told` of `count` taxels answered. Below `least` the sum stops: silent taxels only make a place less
    likely.
    """
    level, reach, power, spread = model
    total, squares = 0.0, 0.0
    for i in range(told):
        square = (at[i, 0] - x) ** 2 + (at[i, 1] - y) ** 2
        gap = answers[i] - level + power * log1p(square / (2.0 * power * reach * reach))
        total += shares[i] * gap
        squares += shares[i] * gap * gap
    shift = total / weight
    found = -0.5 * (squares - total * shift)
    for i in range(told, count):
        if found < least:
            break
        square = (at[i, 0] - x) ** 2 + (at[i, 1] - y) ** 2
        there = level - power * log1p(square / (2.0 * power * reach * reach))
        found += _log_below((quiet - there - shift) / spread)
    return found


@released(
    """
    taxels int64 n m, flat n m 2, logs n m, quiet n, model (float, float, float, float, float, float), search
    (int, float, float), mean out n 2, covariance out n 2 2
    """
)
def posterior(taxels, flat, logs, quiet, model, search, mean, covariance):
    """Write mean (n, 2) and covariance (n, 2, 2) of each poke's place, under a uniform prior.

    Integrate on a grid about the strongest answer, and again on a grid about the probable part of it. Grids are fine
    enough for narrow peaks: two taxels that answer alone cause one on either side of them, which a coarse grid weighs
    by chance.

    taxels, flat, logs, quiet: of `response.LocalTaxels`.
    model: level, reach, power, scatter, rough and uneven of `response`.
    search: points along each side, half of the first side's length [m], standard deviations about the mean searched
    again.
    """
    side, first, left = search
    scatter, rough, uneven = model[3:]
    shape = model[0], model[1], model[2], hypot(scatter, rough)
    wide = taxels.shape[1]
    at, answers, shares = np.empty((wide, 2)), np.empty(wide), np.empty(wide)
    fits, half, middle = np.empty((side, side)), np.empty(2), np.empty(2)
    for n in range(len(taxels)):
        count, told, weight = 0, 0, 1.0 / (uneven * uneven)
        for silent in (False, True):
            for i in range(wide):
                if taxels[n, i] < 0 or np.isfinite(logs[n, i]) == silent:
                    continue
                at[count, 0], at[count, 1] = flat[n, i, 0], flat[n, i, 1]
                if not silent:
                    over = rough * exp(quiet[n] - logs[n, i])
                    answers[count], shares[count] = logs[n, i], 1.0 / (scatter * scatter + over * over)
                    weight += shares[count]
                    told += 1
                count += 1
        half[:] = first
        middle[:] = mean[n]
        for _ in range(2):
            best = -np.inf
            for a in range(side):
                x = middle[0] + half[0] * (2.0 * a / (side - 1) - 1.0)
                for b in range(side):
                    y = middle[1] + half[1] * (2.0 * b / (side - 1) - 1.0)
                    fits[a, b] = _fit(x, y, told, count, at, answers, shares, weight, quiet[n], shape, best - _NOTHING)
                    best = max(best, fits[a, b])
            total, u, v, uu, vv, uv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # about the middle, in halves
            for a in range(side):
                p = 2.0 * a / (side - 1) - 1.0
                for b in range(side):
                    q, share = 2.0 * b / (side - 1) - 1.0, exp(fits[a, b] - best)
                    total += share
                    u += share * p
                    v += share * q
                    uu += share * p * p
                    vv += share * q * q
                    uv += share * p * q
            u, v, cell = u / total, v / total, (2.0 / (side - 1)) ** 2 / 12.0
            uu, vv, uv = uu / total - u * u, vv / total - v * v, uv / total - u * v
            middle[0] += half[0] * u
            middle[1] += half[1] * v
            covariance[n, 0, 0], covariance[n, 1, 1] = half[0] ** 2 * (uu + cell), half[1] ** 2 * (vv + cell)
            covariance[n, 0, 1] = covariance[n, 1, 0] = half[0] * half[1] * uv
            for k in range(2):
                spread = max(uu if k == 0 else vv, 0.0)
                half[k] = min(half[k], half[k] * (left * sqrt(spread) + 1.0 / (side - 1)))
        mean[n] = middle
