"""Order many wrenches so that the parts of a large tree that they need stay in the processor's cache."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays

__all__ = ["in_space"]


@takes_arrays
def in_space(wrenches: Float[np.ndarray, "n 6"], centre: Float[np.ndarray, "3"], scale: float) -> Int[np.ndarray, " n"]:
    """Return indices (n,) int that put wrenches next to each other if their axes enter a ball around the body close by.

    The points of entry are sorted by the cells of a grid in Morton's order, with keys of 15 bits (a radix sort).

    Args:
        wrenches: (n, 6) force first, in the surface's frame; rows of NaN or without a force are placed anywhere.
        centre: (3,) of the ball [m].
        scale: its radius [m].
    """
    from palpate.contact import _neighbours as kernel  # compiled: loaded when first needed

    keys = np.empty(len(wrenches), dtype=np.uint16)
    kernel.keys(wrenches, centre, scale, keys)
    return np.argsort(keys, kind="stable")
