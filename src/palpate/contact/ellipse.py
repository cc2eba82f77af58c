"""The 95 % ellipse of a point on a surface."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.contact.estimate import CHI2_95

__all__ = ["ellipse"]


def ellipse(
    covariance: Float[np.ndarray, "3 3"], normal: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "3 3"]]:
    """The 95 % ellipse of a point in its tangent plane.

    With B two tangents, the half-axes are sqrt(5.991 eigenvalues of B^T C B).

    Returns:
        Half-axes [m], the longer first (NaN without a covariance), and the rotation whose columns are the long axis,
        the short axis and the normal.
    """
    if not np.isfinite(normal).all():
        return np.full(2, np.nan), np.eye(3)
    along = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    along /= np.linalg.norm(along)
    tangents = np.column_stack([along, np.cross(normal, along)])
    if not np.isfinite(covariance).all():
        return np.full(2, np.nan), np.column_stack([tangents, normal])
    values, vectors = np.linalg.eigh(tangents.T @ covariance @ tangents)
    long = tangents @ vectors[:, 1]
    return np.sqrt(CHI2_95 * np.maximum(values[::-1], 0.0)), np.column_stack([long, np.cross(normal, long), normal])
