"""Compiled: joints that follow a line, critically damped or by a first-order lag, in closed form."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inner


@inner
def _along(state, line, begun, ramp, lag, order, start, end):
    """Advance state (3, n), joints, speeds, accelerations, from `start` to `end` [s]; the reference r is one line.

    line (2, n): r goes from the first to the second within `ramp` from `begun` on, and stays. With w = 2/lag

        q = r - 2 r'/w + (a + b t) exp(-w t),

    with a and b from q and q' at the start; of order 1, w = 1/lag, it is q = r - r'/w + a exp(-w t).
    """
    moving = start < begun + ramp
    step = end - start
    before = (start - begun) / ramp if moving else 1.0
    after = min(1.0, (end - begun) / ramp) if moving else 1.0
    w = order / lag if lag > 0.0 else 0.0
    decay = np.exp(-w * step)
    for j in range(state.shape[1]):
        whole = line[1, j] - line[0, j]
        slope = whole / ramp if moving else 0.0
        goal = line[0, j] + after * whole
        if lag == 0.0:
            state[0, j], state[1, j], state[2, j] = goal, slope, 0.0
            continue
        a = state[0, j] - line[0, j] - before * whole + lag * slope
        b = state[1, j] - slope + w * a if order > 1.0 else 0.0
        free = (a + b * step) * decay
        change = b * decay - w * free
        state[0, j] = goal - lag * slope + free
        state[1, j] = slope + change
        state[2, j] = -w * b * decay - w * change


@inner
def _follow(state, line, clock, ramp, lag, order, end):
    """Advance state (3, n) and clock, begin of the line and present time [s], to `end`, also across the ramp's end."""
    start, middle = clock[1], clock[0] + ramp
    if start < middle < end:
        _along(state, line, clock[0], ramp, lag, order, start, middle)
        start = middle
    if start < end:
        _along(state, line, clock[0], ramp, lag, order, start, end)
    clock[1] = max(clock[1], end)


@entry("state out 3 n, line out 2 n, clock out 2, times k, targets k n, span int64 3, times_of 4, end float")
def run(state, line, clock, times, targets, span, times_of, end):
    """Advance joints through the commands that begin until `end` [s]; return the index of the first one that does not.

    times (k,), targets (k, n): commands, when they were sent and where they lead. span (3,): the first that is taken,
    the first that is not, and one that is omitted, or -1. times_of (4,): delay, ramp, lag and order.
    """
    delay, ramp, lag, order = times_of[0], times_of[1], times_of[2], times_of[3]
    k = span[0]
    while k < span[1] and times[k] + delay <= end:
        begins = times[k] + delay
        if k != span[2]:
            _follow(state, line, clock, ramp, lag, order, begins)
            share = 1.0 if ramp == 0.0 else min(1.0, (begins - clock[0]) / ramp)
            for j in range(line.shape[1]):
                line[0, j] += share * (line[1, j] - line[0, j])
                line[1, j] = targets[k, j]
            clock[0] = begins
        k += 1
    _follow(state, line, clock, ramp, lag, order, end)
    return k


@entry("joints n, modelled n, slopes 2 n, variance float, values out m, covariance out m m, gain out m")
def learn(joints, modelled, slopes, variance, values, covariance, gain):
    """Correct values (2 + n,), delay, lag and the offset of each joint, by one feedback; return its chi-square.

    A joint's feedback is modelled + slopes . (delay, lag) + offset, with noise of this variance; modelled (n,) is that
    of the values as they are given. A Kalman filter takes joint after joint, whose squared innovations over their
    variances add up to the chi-square. NaN if the feedback is not finite: the values are then of no use.
    """
    m, total = len(values), 0.0
    delay, lag = values[0], values[1]
    for j in range(len(joints)):
        one, two = slopes[0, j], slopes[1, j]
        for i in range(m):
            gain[i] = one * covariance[i, 0] + two * covariance[i, 1] + covariance[i, 2 + j]
        spread = one * gain[0] + two * gain[1] + gain[2 + j] + variance
        off = joints[j] - modelled[j] - one * (values[0] - delay) - two * (values[1] - lag) - values[2 + j]
        total += off * off / spread
        for i in range(m):
            values[i] += gain[i] / spread * off
        for i in range(m):
            for k in range(m):
                covariance[i, k] -= gain[i] * gain[k] / spread
    return total if total < np.inf else np.nan
