"""Compiled: build the normal equations of the least Green strain of a sheet on a surface."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import released


@released(
    """
    strain n m 3, found n m 6 3, sides n m 2 2, weights n m, first_y int64 n, by n 4, dy n 4, first_x int64 m, bx
    m 4, dx m 4, stride_y int, stride_x int, band out k j, vector out k
    """
)
def normal_equations(strain, found, sides, weights, first_y, by, dy, first_x, bx, dx, stride_y, stride_x, band, vector):
    """Add J'WJ to a band matrix and -J'WE to vector, J the derivative of (E_xx, E_yy, sqrt(2) E_xy).

    At each Gauss point (n, m): strain (3), the surface and its derivatives (6, 3), the derivatives of u and v along x
    and y (2, 2), and a weight; along either side the four cubics there. Unknown 2 (a stride_y + b stride_x) + c is
    component c of control point (a, b).
    """
    root = np.sqrt(2.0)
    row, number = np.empty((3, 32)), np.empty(32, dtype=np.int64)
    rx, ry, x_by_c, y_by_c = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for n in range(strain.shape[0]):
        for m in range(strain.shape[1]):
            r, s, w = found[n, m], sides[n, m], weights[n, m]
            for k in range(3):
                rx[k] = s[0, 0] * r[1, k] + s[0, 1] * r[2, k]
                ry[k] = s[1, 0] * r[1, k] + s[1, 1] * r[2, k]
            for c in range(2):
                xx = yy = xy = edge_xx = edge_xy = 0.0
                for k in range(3):
                    x_by_c[k] = s[0, 0] * r[3 + c, k] + s[0, 1] * r[4 + c, k]
                    y_by_c[k] = s[1, 0] * r[3 + c, k] + s[1, 1] * r[4 + c, k]
                    xx += x_by_c[k] * rx[k]
                    yy += y_by_c[k] * ry[k]
                    xy += 0.5 * (x_by_c[k] * ry[k] + y_by_c[k] * rx[k])
                    edge_xx += r[1 + c, k] * rx[k]
                    edge_xy += r[1 + c, k] * ry[k]
                for a in range(4):
                    for b in range(4):
                        e = 8 * a + 2 * b + c
                        here, along, across = by[n, a] * bx[m, b], by[n, a] * dx[m, b], dy[n, a] * bx[m, b]
                        row[0, e] = xx * here + edge_xx * along
                        row[1, e] = yy * here + edge_xy * across
                        row[2, e] = root * (xy * here + 0.5 * (edge_xy * along + edge_xx * across))
                        number[e] = 2 * ((first_y[n] + a) * stride_y + (first_x[m] + b) * stride_x) + c
            for e in range(32):
                i = number[e]
                vector[i] -= w * (
                    row[0, e] * strain[n, m, 0] + row[1, e] * strain[n, m, 1] + root * row[2, e] * strain[n, m, 2]
                )
                for f in range(32):
                    j = number[f]
                    if j <= i:
                        band[j, i - j] += w * (row[0, e] * row[0, f] + row[1, e] * row[1, f] + row[2, e] * row[2, f])
