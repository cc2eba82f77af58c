"""Compiled: sum normal equations of rows that each depend on a few of many unknowns."""

# pyright: basic
from __future__ import annotations

from palpate.surfaces._jit import released


@released("rows n 3 m, right n 3, columns int64 n m, square out k k, vector out k")
def add_squares(rows, right, columns, square, vector):
    """Add J' J to square (p, p), its upper triangle, and J' r to vector (p,).

    rows (n, 3, l): values of three lines of J each, in columns (n, l), which may repeat; negative: none. right (n, 3).
    """
    for n in range(len(rows)):
        for a in range(columns.shape[1]):
            i = columns[n, a]
            if i < 0:
                continue
            x, y, z = rows[n, 0, a], rows[n, 1, a], rows[n, 2, a]
            if x == 0.0 and y == 0.0 and z == 0.0:
                continue
            vector[i] += x * right[n, 0] + y * right[n, 1] + z * right[n, 2]
            for b in range(columns.shape[1]):
                j = columns[n, b]
                if j >= i:
                    square[i, j] += x * rows[n, 0, b] + y * rows[n, 1, b] + z * rows[n, 2, b]
