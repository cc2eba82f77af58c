"""A flat square in space, for pads, tables and the simplest of checks."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import GeometryError
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.mesh import Mesh

__all__ = ["plane"]


@called_as("palpate.plane([0, 0, 0], [0, 0, 1])")
@takes_arrays
def plane(point: ArrayLike, normal: ArrayLike, half_width: float = 1.0) -> Mesh:
    """Make a square `Mesh` of two facets through `point` [m], pressed on its `normal` side.

    Args:
        point: (3,) its middle [m].
        normal: (3,) outward, of any length but zero.
        half_width: [m]; beyond it a wrench is OFF_SURFACE.

    Raises:
        GeometryError: the normal or the half-width is zero.
    """
    middle, out = shaped(point, (3,), "point"), shaped(normal, (3,), "normal")
    length = np.linalg.norm(out)
    if not length > 0:
        raise GeometryError("the normal of a plane must not be zero.")
    out = out / length
    along = np.cross(out, np.eye(3)[np.argmin(np.abs(out))])
    along /= np.linalg.norm(along)
    across = np.cross(out, along)
    corners = [middle + half_width * (i * along + j * across) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return Mesh.from_arrays(corners, [[0, 1, 2], [0, 2, 3]])
