"""Place a camera so that it sees all points, clear of what the panel and the legend cover."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays

VIEW = float(np.radians(45.0))  # angle of view from top to bottom
MARGIN = 0.14  # of half the picture, on each side: the words at the end of an arrow have room there
NARROW = 0.8  # width over height: narrower pictures are those of phones
PHONE, PANEL = 600, 388  # px: wider windows lose so much to the panel, which is not docked yet when a browser comes
SHEET, STRIP = 0.46, 0.1  # shares of the height that are covered: by a phone's panel, by the legend


@takes_arrays
def fit(
    points: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "3"], aspect: float, covered: float | None = None
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Return the nearest camera position from which all points are seen, and the point that it looks at, (3,) each.

    A point is within an edge if right * x <= a * depth, which is linear in the camera's place: of the points only the
    largest right * x + a * forward * x matters, for each of the four edges.

    Args:
        points: must be seen; at least one.
        direction: unit vector from the points to the camera; z is up in the picture.
        aspect: width over height of the picture.
        covered: share of the height, from below, that is hidden; None: what legend and panel cover.

    Raises:
        InputError: arrays of other shapes.
    """
    above = STRIP if covered is None and aspect < NARROW else 0.0
    covered = (SHEET if aspect < NARROW else STRIP) if covered is None else covered
    right = np.cross([0.0, 0.0, 1.0], direction)
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else np.array([1.0, 0.0, 0.0])
    upward, way = np.cross(direction, right), points @ direction
    top, foot = (np.tan(VIEW / 2) * (1.0 - 2.0 * hidden - MARGIN * (1.0 - hidden)) for hidden in (above, covered))
    side = np.tan(VIEW / 2) * (1.0 - MARGIN) * aspect
    x, y = points @ right, points @ upward
    easts, wests = float((x + side * way).max()), float((side * way - x).max())
    norths, souths = float((y + top * way).max()), float((foot * way - y).max())
    far = max((easts + wests) / (2.0 * side), (norths + souths) / (top + foot), float(way.max()) + 1e-3)
    across, up = 0.5 * (easts - wests), 0.5 * (norths - souths + (foot - top) * far)
    position = across * right + up * upward + far * direction
    return position, position - (far - float(way.mean())) * direction
