"""Find the contact of an image without a model: by the calibration image that looks most alike."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, UInt8

from palpate.spatial.arguments import takes_arrays

BLOCK = 8  # pixels, whose mean is compared


@takes_arrays
def shrunk(image: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, " n"]:
    """Return red less the mean of green and blue, one number per block of 8 x 8 pixels, (n,), row by row."""
    red = image[..., 2].astype(np.float64) - image[..., :2].mean(axis=2)  # OpenCV's order: blue, green, red
    high, wide = (size - size % BLOCK for size in red.shape)
    return red[:high, :wide].reshape(high // BLOCK, BLOCK, wide // BLOCK, BLOCK).mean(axis=(1, 3)).ravel()


@takes_arrays
def nearest_image(
    seen: Float[np.ndarray, "n m"], rows: Float[np.ndarray, "n 6"]
) -> Callable[[UInt8[np.ndarray, "h w 3"]], Float[np.ndarray, "k 6"]]:
    """Return a function from an image to the contact (1, 6) of the calibration image that is most similar to it.

    The function takes an image (h, w, 3), blue first, and compares it, as `shrunk` returns it, with each calibration
    image: the least sum of squared differences is the most similar. It returns (0, 6) if nothing touched in that one.

    Args:
        seen: (n, m) calibration images, as `shrunk` returns them.
        rows: (n, 6) point [m] and force [N] of each, NaN where nothing touched.

    Raises:
        InputError: arrays of other shapes.
    """

    def answer(image: np.ndarray) -> np.ndarray:
        row = rows[np.argmin(np.sum((seen - shrunk(image)) ** 2, axis=1))]
        return row[None] if np.isfinite(row).all() else np.empty((0, 6))

    return answer
