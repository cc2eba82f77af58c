"""Compiled: a wrench in the frame of the surface, and the effect of the mounting's error on it there."""

# pyright: basic
from __future__ import annotations

from palpate.surfaces._jit import inner
from palpate.surfaces._vectors import cross_into


@inner
def row(array, i):
    """Return row i of a channel, or the one row that stands for all samples."""
    return array[i] if len(array) > 1 else array[0]


@inner
def to_surface(matrix, wrench, out):
    """Multiply a wrench by the 6 x 6 matrix of a pose, skipping its block of zeros, into `out` (6,)."""
    for k in range(3):
        out[k] = matrix[k, 0] * wrench[0] + matrix[k, 1] * wrench[1] + matrix[k, 2] * wrench[2]
        out[3 + k] = matrix[3 + k, 0] * wrench[0] + matrix[3 + k, 1] * wrench[1] + matrix[3 + k, 2] * wrench[2]
    for k in range(3, 6):
        out[k] += matrix[k, 3] * wrench[3] + matrix[k, 4] * wrench[4] + matrix[k, 5] * wrench[5]


@inner
def mounting_errors(wrench, factor, work, errors):
    """Compute `pose_noise_on_wrench` from factor (q, 6) into errors: dF = omega x F, dM = omega x M + rho x F."""
    moment = work[1]
    for i in range(len(factor)):
        column, error = factor[i], errors[i]
        cross_into(column[:3], wrench[:3], error[:3])
        cross_into(column[:3], wrench[3:], error[3:])
        cross_into(column[3:], wrench[:3], moment)
        for k in range(3):
            error[3 + k] += moment[k]
