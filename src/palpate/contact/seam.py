"""How a sheet lies round a link: columns that lie over others, the seam, and its cells with neighbours at every end."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import InputError
from palpate.sensors.skin_map import SkinMap

__all__ = ["columns_used", "contours", "is_ring", "padded"]

_SHORTEST_RING = 6  # columns: fewer cannot go round a link
_SEAM = 1.6  # pitches between the ends of a sheet that are neighbours


def contours(areas: Bool[np.ndarray, "rows columns"]) -> list[Float[np.ndarray, "k 2"]]:
    """Outlines of connected cells, each as row and column of the cells on it, by OpenCV; for pictures.

    Raises:
        InputError: OpenCV is not installed.
    """
    try:
        import cv2
    except ImportError as problem:
        raise InputError("outlines need OpenCV.", mend="pip install opencv-python-headless") from problem
    found, _ = cv2.findContours(areas.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return [outline[:, 0, ::-1].astype(np.float64) for outline in found]


def columns_used(place: SkinMap) -> int:
    """Columns before those that lie over others: where a sheet overlaps itself a press is felt in both layers."""
    over = place.overlap.mean(axis=0) > 0.5
    over[: place.columns // 2] = False
    last = np.flatnonzero(over)
    return int(last[0]) if len(last) and over[last[0] :].all() else place.columns


def is_ring(place: SkinMap, used: int) -> bool:
    """Whether the last column in use lies beside the first."""
    if used < _SHORTEST_RING:
        return False
    gap = np.linalg.norm(place.centres[:, 0] - place.centres[:, used - 1], axis=-1)
    return bool(np.median(gap) < _SEAM * place.pitch[1])


def padded(place: SkinMap, used: int, ring: bool) -> Float[np.ndarray, "r c 6"]:
    """Centres and normals with two more cells at each end: over the seam of a ring, else as a parabola goes on."""
    values = np.concatenate([place.centres, place.normals], axis=2)
    columns = (
        np.concatenate([values[:, used - 2 : used], values[:, :used], values[:, :2]], axis=1)
        if ring
        else _continued(_continued(values.swapaxes(0, 1)))
    )
    if not ring:
        columns = columns.swapaxes(0, 1)
    return np.ascontiguousarray(_continued(_continued(columns)))


def _continued(values: Float[np.ndarray, "n k 6"]) -> Float[np.ndarray, "m k 6"]:
    """One more at each end."""
    if len(values) == 1:
        return np.concatenate([values, values, values])
    if len(values) == 2:
        return np.concatenate([2 * values[:1] - values[1:], values, 2 * values[1:] - values[:1]])
    before = 3 * values[0] - 3 * values[1] + values[2]
    after = 3 * values[-1] - 3 * values[-2] + values[-3]
    return np.concatenate([before[None], values, after[None]])
