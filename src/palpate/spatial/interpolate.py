"""Interpolate between recorded orientations."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays

__all__ = ["slerp"]


@takes_arrays
def slerp(
    first: Float[np.ndarray, "*batch 4"], second: Float[np.ndarray, "*batch 4"], share: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch 4"]:
    """Return unit quaternions (*batch, 4) from `first` (share 0) to `second` (1), the shortest way at constant speed.

    q = (sin((1 - u) a) q0 + sin(u a) q1) / sin a [Shoemake 1985], with a half of the rotation's angle, from the chords:
    a = 2 atan2(|q1 - q0|, |q1 + q0|). The arc cosine of q0 . q1 is not exact for small angles.

    Args:
        first: (*batch, 4) x, y, z, w of any length but zero; NaN gives NaN.
        second: the same.
        share: (*batch,) u; beyond 0 to 1 it extrapolates.

    Raises:
        InputError: other shapes, or batches that differ.
    """
    start, end = (q / _length(q) for q in (first, second))
    end = np.where(np.sum(start * end, axis=-1, keepdims=True) < 0, -end, end)
    angle = 2.0 * np.arctan2(_length(end - start), _length(end + start))
    u = share[..., None]
    still = angle == 0.0
    whole = np.where(still, 1.0, np.sin(angle))
    before = np.where(still, 1.0 - u, np.sin((1.0 - u) * angle) / whole)
    after = np.where(still, u, np.sin(u * angle) / whole)
    return before * start + after * end


def _length(q: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 1"]:
    return np.sqrt(np.sum(q * q, axis=-1, keepdims=True))
