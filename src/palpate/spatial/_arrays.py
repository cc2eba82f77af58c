"""Turning what a caller gives into arrays that nobody can change afterwards."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

__all__ = ["frozen"]


def frozen(values: ArrayLike, *, tail: tuple[int, ...] = (), name: str = "array") -> Float[np.ndarray, "..."]:
    """A read-only float64 copy of `values` whose last axes are `tail`.

    Raises:
        ValueError: the last axes are not `tail`.
    """
    array = np.array(values, dtype=np.float64)
    if array.shape[array.ndim - len(tail) :] != tail or array.ndim < len(tail):
        raise ValueError(f"{name} must end in shape {tail}, not {array.shape}")
    array.flags.writeable = False
    return array
