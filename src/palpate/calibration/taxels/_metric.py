"""Compiled: the closest point of triangles in the metric of a matrix, which is the closest one to stretched triangles."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry
from palpate.surfaces._nearest import point_to_triangle

__all__ = ["nearest"]


@entry
def nearest(centre, root, least, corners, middles, radii, found):
    """For each centre (k, 3) the point that minimises |root (p - centre)|, of triangles (f, 3, 3) with their balls.

    `least` is the smallest factor by which a root stretches: a ball that lies further off than the best so far even
    then is passed over.
    """
    row, origin, weights, flat = np.zeros(18), np.zeros(3), np.zeros(3), np.empty(3)  # a row as the tree's patches are
    for k in range(len(centre)):
        best = np.inf
        first = 0
        for t in range(len(corners)):  # the nearest by its middle first: the rest are mostly passed over then
            away = 0.0
            for a in range(3):
                flat[a] = root[k, a, 0] * (middles[t, 0] - centre[k, 0]) + root[k, a, 1] * (middles[t, 1] - centre[k, 1])
                flat[a] += root[k, a, 2] * (middles[t, 2] - centre[k, 2])
                away += flat[a] * flat[a]
            if away < best:
                best, first = away, t
        best = np.inf
        for u in range(-1, len(corners)):
            t = first if u < 0 else u
            away = 0.0
            for a in range(3):
                away += (middles[t, a] - centre[k, a]) ** 2
            gap = np.sqrt(away) - radii[t]
            if gap > 0.0 and (gap * least[k]) ** 2 > best:
                continue
            for c in range(3):
                for a in range(3):
                    total = 0.0
                    for b in range(3):
                        total += root[k, a, b] * (corners[t, c, b] - centre[k, b])
                    row[6 * c + a] = total
            square = point_to_triangle(row, origin, weights)
            if square < best:
                best = square
                for a in range(3):
                    found[k, a] = (
                        weights[0] * corners[t, 0, a] + weights[1] * corners[t, 1, a] + weights[2] * corners[t, 2, a]
                    )
