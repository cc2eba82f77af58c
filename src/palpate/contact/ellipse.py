"""The 95 % ellipse of a point on a surface."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.contact.estimate import CHI2_95

__all__ = ["ellipse"]


def ellipse(
    covariance: Float[np.ndarray, "*batch 3 3"], normal: Float[np.ndarray, "*batch 3"]
) -> tuple[Float[np.ndarray, "*batch 2"], Float[np.ndarray, "*batch 3 3"]]:
    """The 95 % ellipse of a point in its tangent plane.

    With B two tangents, the half-axes are sqrt(5.991 eigenvalues of B^T C B), which for two rows have a closed form.

    Args:
        covariance: (*batch, 3, 3) [m^2] of points.
        normal: (*batch, 3), unit.

    Returns:
        Half-axes (*batch, 2) [m], the longer first (NaN without a covariance or a normal), and rotations
        (*batch, 3, 3) whose columns are the long axis, the short axis and the normal (the identity without a normal).
    """
    tangents = _tangents(normal)
    finite = np.where(np.isfinite(covariance), covariance, np.nan)  # products make one NaN all of them
    plane = np.swapaxes(tangents, -1, -2) @ finite @ tangents
    middle, half = 0.5 * (plane[..., 0, 0] + plane[..., 1, 1]), 0.5 * (plane[..., 0, 0] - plane[..., 1, 1])
    radius = np.hypot(half, plane[..., 0, 1])
    axes = np.sqrt(CHI2_95 * np.maximum(np.stack([middle + radius, middle - radius], axis=-1), 0.0))
    turn = np.nan_to_num(0.5 * np.arctan2(plane[..., 0, 1], half))[..., None, None]
    spin = np.concatenate([np.cos(turn), -np.sin(turn), np.sin(turn), np.cos(turn)], axis=-1)
    flat = tangents @ spin.reshape(*spin.shape[:-2], 2, 2)
    frame = np.concatenate([flat, normal[..., None]], axis=-1)
    known = np.asarray(np.isfinite(normal).all(axis=-1))[..., None, None]
    return axes, np.where(known, frame, np.eye(3))


def _tangents(normal: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 2"]:
    """Two that are right-handed with the normal: Duff et al., Building an Orthonormal Basis, Revisited (2017)."""
    x, y, z = normal[..., 0], normal[..., 1], normal[..., 2]
    sign = np.copysign(1.0, z)
    share = -1.0 / (sign + z)
    both = x * y * share
    first = (1.0 + sign * x * x * share, both, sign * both, sign + y * y * share, -sign * x, -y)
    return np.stack(first, axis=-1).reshape(*normal.shape[:-1], 3, 2)
