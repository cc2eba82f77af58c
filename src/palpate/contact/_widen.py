"""Compiled: widen the covariance of the point by a placement error that the wrench does not show."""

# pyright: basic
from __future__ import annotations

from palpate.surfaces._jit import released


@released("rows out n 22, variance float")
def widen(rows, variance):
    """Add variance (1 - n n^T) [m^2] to the covariances in rows (n, 22) of `estimate.ROW`; NaN stays NaN."""
    for row in rows:
        for i in range(3):
            for j in range(3):
                across = 1.0 if i == j else 0.0
                row[10 + 3 * i + j] += variance * (across - row[3 + i] * row[3 + j])
