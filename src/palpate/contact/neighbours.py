"""In which order many wrenches find a large tree in the processor's cache."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

__all__ = ["in_space"]

_CELLS = 32  # along each side of the box around the body
_BITS = np.arange(5)
_SPREAD = (((np.arange(_CELLS)[:, None] >> _BITS) & 1) << (3 * _BITS)).sum(axis=1).astype(np.uint16)


def in_space(wrenches: Float[np.ndarray, "n 6"], centre: Float[np.ndarray, "3"], scale: float) -> Int[np.ndarray, " n"]:
    """The numbers of the wrenches, those whose axes enter a ball around the body close to each other side by side.

    The places of entry go by cells of a grid in Morton's order, whose keys of 15 bits are sorted by digits.

    Args:
        wrenches: (n, 6) force first, in the surface's frame; what is NaN or without a force comes anywhere.
        centre: (3,) of the ball [m].
        scale: its radius [m].
    """
    with np.errstate(all="ignore"):
        force = wrenches[:, :3]
        size = np.sqrt(np.einsum("ni,ni->n", force, force))[:, None]
        along, moment = force / size, (wrenches[:, 3:] - np.cross(centre, force)) / (scale * size)
        foot = np.cross(along, moment)
        height = np.sqrt(np.maximum(0.0, 1.0 - np.einsum("ni,ni->n", foot, foot)))
        cells = 0.5 * _CELLS * (foot - along * height[:, None] + 1.0)
        x, y, z = np.clip(np.nan_to_num(cells), 0, _CELLS - 1).astype(np.intp).T
    return np.argsort(_SPREAD[x] << 2 | _SPREAD[y] << 1 | _SPREAD[z], kind="stable")
