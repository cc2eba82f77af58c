"""Compiled: joints that follow a line, critically damped, in closed form."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inner


@inner
def _along(state, line, begun, ramp, lag, start, end):
    """Advance state (3, n), joints, speeds, accelerations, from `start` to `end` [s]; the reference r is one line.

    line (2, n): r goes from the first to the second within `ramp` from `begun` on, and stays. With w = 2/lag

        q = r - 2 r'/w + (a + b t) exp(-w t),

    with a and b from q and q' at the start.
    """
    moving = start < begun + ramp
    step = end - start
    before = (start - begun) / ramp if moving else 1.0
    after = min(1.0, (end - begun) / ramp) if moving else 1.0
    w = 2.0 / lag if lag > 0.0 else 0.0
    decay = np.exp(-w * step)
    for j in range(state.shape[1]):
        whole = line[1, j] - line[0, j]
        slope = whole / ramp if moving else 0.0
        goal = line[0, j] + after * whole
        if lag == 0.0:
            state[0, j], state[1, j], state[2, j] = goal, slope, 0.0
            continue
        a = state[0, j] - line[0, j] - before * whole + 2.0 / w * slope
        b = state[1, j] - slope + w * a
        free = (a + b * step) * decay
        change = b * decay - w * free
        state[0, j] = goal - 2.0 / w * slope + free
        state[1, j] = slope + change
        state[2, j] = -w * b * decay - w * change


@entry("state out 3 n, line 2 n, begun float, ramp float, lag float, start float, end float")
def follow(state, line, begun, ramp, lag, start, end):
    """Advance state (3, n) from `start` to `end` [s] as `_along` does, also across the end of the ramp."""
    middle = begun + ramp
    if start < middle < end:
        _along(state, line, begun, ramp, lag, start, middle)
        start = middle
    if start < end:
        _along(state, line, begun, ramp, lag, start, end)


@entry("past k n, times k, time float, joints n, offset n, out out n")
def separate(past, times, time, joints, offset, out):
    """Write feedback (n,) less offset (n,) and the past (m, n) at the nearest of the times (m,) into out (n,).

    The root mean square of out is returned; NaN if the feedback is not finite.
    """
    nearest, total = 0, 0.0
    for k in range(1, len(times)):
        if abs(times[k] - time) < abs(times[nearest] - time):
            nearest = k
    for j in range(len(joints)):
        out[j] = joints[j] - past[nearest, j] - offset[j]
        total += out[j] * out[j]
    return np.sqrt(total / len(joints)) if total < np.inf else np.nan
