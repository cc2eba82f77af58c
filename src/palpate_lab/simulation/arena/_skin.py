"""Compiled: add up the movements of a ring's markers under touches, from tables over angle and force."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import released


@released("rest r, presses float32 k a l r, shears float32 k a r, largest k, touches t 5, out out r")
def superposed(rest, presses, shears, largest, touches, out):
    """Compute the positions of points under several touches at once.

    Args:
        rest: (r,) [m] coordinates, unloaded.
        presses: (kinds, angles, levels + 1, r) float32 [m] movements at `largest` (i / levels)^2 [N].
        shears: (kinds, angles, r) float32 [m/N] movements per newton of shear.
        largest: (kinds,) [N] largest force of the tables.
        touches: (k, 5) angle [rad], inward force [N], shear [N], depth, kind; only with a force above 0.
        out: (r,) is filled.
    """
    angles, last = presses.shape[1], presses.shape[2] - 1
    turn, steep = np.empty(4), np.empty(4)
    for r in range(len(out)):
        out[r] = rest[r]
    for t in range(len(touches)):
        force, kind = touches[t, 1], min(max(int(touches[t, 4]), 0), len(presses) - 1)
        if not force > 0.0:
            continue
        at = touches[t, 0] / (2.0 * np.pi)
        at = (at - np.floor(at)) * angles
        first = int(at)
        x = at - first
        turn[0], turn[1] = 0.5 * x * (x * (2.0 - x) - 1.0), 1.0 + x * x * (1.5 * x - 2.5)
        turn[2], turn[3] = 0.5 * x * (1.0 + x * (4.0 - 3.0 * x)), 0.5 * x * x * (x - 1.0)
        beyond = max(1.0, force / largest[kind])
        rung = last * np.sqrt(min(1.0, force / largest[kind]))
        low = min(max(int(rung) - 1, 0), last - 3)
        y = rung - low  # Lagrange's cubics on 0, 1, 2, 3
        steep[0] = -beyond * (y - 1.0) * (y - 2.0) * (y - 3.0) / 6.0
        steep[1] = beyond * y * (y - 2.0) * (y - 3.0) / 2.0
        steep[2] = -beyond * y * (y - 1.0) * (y - 3.0) / 2.0
        steep[3] = beyond * y * (y - 1.0) * (y - 2.0) / 6.0
        for i in range(4):
            column = (first + i - 1) % angles
            a, b, c, d = (
                presses[kind, column, low],
                presses[kind, column, low + 1],
                presses[kind, column, low + 2],
                presses[kind, column, low + 3],
            )
            side, along = shears[kind, column], turn[i] * touches[t, 2]
            p, q, u, v = turn[i] * steep[0], turn[i] * steep[1], turn[i] * steep[2], turn[i] * steep[3]
            for r in range(len(out)):
                out[r] += p * a[r] + q * b[r] + u * c[r] + v * d[r] + along * side[r]
