"""In which order many wrenches find a large tree in the processor's cache."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays

__all__ = ["in_space"]


@takes_arrays
def in_space(wrenches: Float[np.ndarray, "n 6"], centre: Float[np.ndarray, "3"], scale: float) -> Int[np.ndarray, " n"]:
    """The numbers of the wrenches, those whose axes enter a ball around the body close to each other side by side.

    The places of entry go by cells of a grid in Morton's order, whose keys of 15 bits are sorted by digits.

    Args:
        wrenches: (n, 6) force first, in the surface's frame; what is NaN or without a force comes anywhere.
        centre: (3,) of the ball [m].
        scale: its radius [m].
    """
    from palpate.contact import _neighbours as kernel  # compiled: loaded when first needed

    keys = np.empty(len(wrenches), dtype=np.uint16)
    kernel.keys(wrenches, centre, scale, keys)
    return np.argsort(keys, kind="stable")
