"""Compiled: compute keys of wrenches that are close to each other if their axes enter a ball at close points."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner, released

CELLS = 32  # along each side of the box around the ball


@inner
def _spread(x):
    """Return the number of the cell at x, -1 to 1 across the box, with two empty bits before each of its five bits."""
    cell = 0.5 * CELLS * (x + 1.0)
    number = 0 if not cell > 0.0 else CELLS - 1 if cell >= CELLS else int(cell)  # NaN is the first
    key = 0
    for bit in range(5):
        key |= ((number >> bit) & 1) << (3 * bit)
    return key


@released("wrenches n 6, centre 3, scale float, out out uint16 n")
def keys(wrenches, centre, scale, out):
    """Write keys of wrenches (n, 6), force first, into out (n,): Morton's order of where they enter a ball."""
    for i in range(len(wrenches)):
        fx, fy, fz = wrenches[i, 0], wrenches[i, 1], wrenches[i, 2]
        size = np.sqrt(fx * fx + fy * fy + fz * fz)
        mx = (wrenches[i, 3] - (centre[1] * fz - centre[2] * fy)) / (scale * size)
        my = (wrenches[i, 4] - (centre[2] * fx - centre[0] * fz)) / (scale * size)
        mz = (wrenches[i, 5] - (centre[0] * fy - centre[1] * fx)) / (scale * size)
        fx, fy, fz = fx / size, fy / size, fz / size
        x, y, z = fy * mz - fz * my, fz * mx - fx * mz, fx * my - fy * mx  # of the axis nearest to the centre
        ahead = np.sqrt(max(0.0, 1.0 - x * x - y * y - z * z))
        out[i] = _spread(x - fx * ahead) << 2 | _spread(y - fy * ahead) << 1 | _spread(z - fz * ahead)
