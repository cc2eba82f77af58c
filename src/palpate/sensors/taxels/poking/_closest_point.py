"""Compiled: find the closest point of triangles in the metric of a matrix, i.e. after they are stretched by it."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner, released
from palpate.surfaces._nearest import point_to_triangle


@released("centre k 3, root k 3 3, least k, pressing k 3, corners f 3 3, balls f 7, found out k 3")
def nearest(centre, root, least, pressing, corners, balls, found):
    """Find for each centre (k, 3) the point of pressed triangles (f, 3, 3) that minimises |root (p - centre)|.

    A triangle is pressed if the force points against its normal. `least` is the smallest factor by which a root
    stretches: a triangle is skipped if its ball (f, 7: middle, radius, normal) is further away than the best so far
    even then.
    """
    row, origin, weights = np.zeros(18), np.zeros(3), np.zeros(3)  # a row as the tree's patches are
    for k in range(len(centre)):
        best, first = np.inf, -1
        for t in range(len(corners)):  # the nearest by its middle first: the rest are mostly passed over then
            away = 0.0
            for a in range(3):
                flat = 0.0
                for b in range(3):
                    flat += root[k, a, b] * (balls[t, b] - centre[k, b])
                away += flat * flat
            if away < best and _presses(pressing[k], balls[t]):
                best, first = away, t
        if first < 0:
            continue
        best = np.inf
        for u in range(-1, len(corners)):
            t = first if u < 0 else u
            away = 0.0
            for a in range(3):
                away += (balls[t, a] - centre[k, a]) ** 2
            gap = np.sqrt(away) - balls[t, 3]
            if (gap > 0.0 and (gap * least[k]) ** 2 > best) or not _presses(pressing[k], balls[t]):
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


@inner
def _presses(force, ball):
    return force[0] * ball[4] + force[1] * ball[5] + force[2] * ball[6] < 0.0
