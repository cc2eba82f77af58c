"""Compiled: the angle from the axis of a fisheye lens at which a pixel looks."""

# pyright: basic
from __future__ import annotations

from palpate.surfaces._jit import exact

__all__ = ["angles"]


@exact
def angles(bent, lens, reach, steps, theta, low, high):
    """Theta from theta_d: Newton's steps, halving where one leaves the bracket, until all have settled.

    Args:
        bent: (n,) theta_d, of the pixels.
        lens: (4,) k1 to k4.
        reach: the largest theta.
        steps: at most.
        theta: (n,) is filled.
        low: (n,) scratch, the bracket.
        high: (n,) scratch.
    """
    k1, k2, k3, k4 = lens[0], lens[1], lens[2], lens[3]
    for i in range(len(bent)):
        low[i], high[i] = 0.0, reach
        theta[i] = min(bent[i], reach) if bent[i] == bent[i] else bent[i]
    step = theta.copy()
    for _ in range(steps):
        settled = True
        for i in range(len(bent)):
            at = theta[i]
            t = at * at
            value = at * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))))
            slope = 1.0 + t * (3 * k1 + t * (5 * k2 + t * (7 * k3 + t * 9 * k4)))
            if value <= bent[i]:
                low[i] = at
            if value >= bent[i]:
                high[i] = at
            new = at - (value - bent[i]) / slope
            if not (new >= low[i] and new <= high[i]):
                new = (low[i] + high[i]) / 2
            step[i] = new
            if not abs(new - at) <= 1e-15 * (1.0 + at):
                settled = False
        if settled:
            break
        for i in range(len(bent)):
            theta[i] = step[i]
