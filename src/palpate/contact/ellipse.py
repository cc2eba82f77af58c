"""Compute the 95 % ellipse of a point on a surface."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from palpate.contact.estimate import CHI2_95
from palpate.spatial.arguments import takes_arrays


@takes_arrays
def ellipse(
    covariance: Float[np.ndarray, "*batch 3 3"], normal: Float[np.ndarray, "*batch 3"]
) -> tuple[Float[np.ndarray, "*batch 2"], Float[np.ndarray, "*batch 3 3"]]:
    """Compute the 95 % ellipse of a point in its tangent plane.

    With B two tangents, its half-axes are sqrt(5.991 eigenvalues of B^T C B).

    Args:
        covariance: (*batch, 3, 3) [m^2] of points.
        normal: (*batch, 3), unit.

    Returns:
        Half-axes (*batch, 2) [m], the longer first (NaN without a covariance or a normal), and rotations
        (*batch, 3, 3) whose columns are the long axis, the short axis and the normal (the identity without a normal).

    Raises:
        InputError: other shapes.
    """
    shape = normal.shape[:-1]
    pairs = zip(covariance.reshape(-1, 9).tolist(), normal.reshape(-1, 3).tolist(), strict=True)
    found = np.array([_single(*pair) for pair in pairs]).reshape(*shape, 11)
    return found[..., :2], found[..., 2:].reshape(*shape, 3, 3)


def _single(covariance: list[float], normal: list[float]) -> tuple[float, ...]:
    """Return half-axes, then the frame row by row; without arrays, for pages that draw it thirty times a second.

    The tangents are right-handed with the normal: Duff et al., Building an Orthonormal Basis, Revisited (2017).
    """
    x, y, z = normal
    if not math.isfinite(x + y + z):
        return math.nan, math.nan, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    sign = math.copysign(1.0, z)
    share = -1.0 / (sign + z)
    first = (1.0 + sign * x * x * share, sign * x * y * share, -sign * x)
    second = (x * y * share, sign + y * y * share, -y)
    xx, xy, yy = (_between(covariance, *pair) for pair in ((first, first), (first, second), (second, second)))
    long = short = math.nan
    cosine, sine = 1.0, 0.0
    if math.isfinite(xx + xy + yy):
        middle, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
        radius, turn = math.hypot(half, xy), 0.5 * math.atan2(xy, half)
        long, short = (math.sqrt(CHI2_95 * max(part, 0.0)) for part in (middle + radius, middle - radius))
        cosine, sine = math.cos(turn), math.sin(turn)
    rows = ((cosine * a + sine * b, cosine * b - sine * a, n) for a, b, n in zip(first, second, normal, strict=True))
    return long, short, *(value for row in rows for value in row)


def _between(c: list[float], a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    return (
        a[0] * (c[0] * b[0] + c[1] * b[1] + c[2] * b[2])
        + a[1] * (c[3] * b[0] + c[4] * b[1] + c[5] * b[2])
        + a[2] * (c[6] * b[0] + c[7] * b[1] + c[8] * b[2])
    )
