"""Pictures of markers drawn at known places: discs, antialiased to 1/16 px, blurred, with noise."""

from collections.abc import Sequence

import cv2
import numpy as np

from palpate.optical.fisheye import Fisheye, RingView
from palpate.spatial.pose import Pose

_PARTS = 16


def nominal_view(m: int = 24, rings: tuple[float, ...] = (0.0,)) -> RingView:
    """Markers on a circle of 51 mm, seen from 40 mm above its middle; of several rings every other one is staggered."""
    pose = Pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 0.04])
    angles = 2 * np.pi * (np.arange(m) + 0.5 * (np.arange(len(rings))[:, None] % 2)) / m
    return RingView(Fisheye(204.0, 204.0, 319.5, 239.5), pose, 0.051, angles.ravel(), rings)


def drawn(
    pixels: np.ndarray,
    radii: np.ndarray | Sequence[float] | float = 5.0,
    *,
    marker: tuple[int, int, int] = (40, 40, 200),
    skin: tuple[int, int, int] = (150, 150, 150),
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> np.ndarray:
    """A BGR picture of 640 x 480."""
    image = np.empty((480, 640, 3), np.uint8)
    image[:] = skin
    for (x, y), radius in zip(pixels, np.broadcast_to(radii, len(pixels)), strict=True):
        middle = (round(float(x) * _PARTS), round(float(y) * _PARTS))
        cv2.circle(image, middle, round(float(radius) * _PARTS), marker, -1, cv2.LINE_AA, 4)
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    if rng is None:
        return image
    return np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)
