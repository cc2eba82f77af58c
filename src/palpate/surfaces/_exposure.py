"""Find the facets of a mesh that can be touched from outside.

Tools are drawn with their inner shells, and as bodies that stand inside each other. A facet is open if the rays along
its normal, from two of the samples on it (or the only one), leave the body; or if one of them reaches, before another
facet, a place that a ball of a fifth of the body's size can reach from outside (the space around the body, opened by a
ball [serra]): the inner walls of a mug, not those of a tube too narrow for a finger, or behind a gap.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.surfaces._normals import facet_normals
from palpate.surfaces._patches import facet_rows
from palpate.surfaces._tree import build_tree

_BALL = 0.2  # radius of what touches, in unit size: its diameter is a fifth of the body's
_STEP = 0.02  # of the grid: a tenth of it


def exposed(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, " f"]:
    """Return which facets can be touched, (f,); all, if next to none can, as of a mesh that is inside out."""
    from palpate.surfaces import _rays  # compiled: loaded when first needed

    normals, areas = facet_normals(vertices, faces)
    tree = build_tree(facet_rows(vertices, faces, normals[:, None], np.arange(len(faces))))
    found = np.zeros(len(faces), dtype=np.bool_)
    _rays.open_facets(tree.corners, tree.nodes, np.zeros(3), _STEP, np.empty((0, 0, 0), np.bool_), found)
    if not found.all():  # else there is nothing to ask the ball
        low, swept = _swept(tree.corners)
        _rays.open_facets(tree.corners, tree.nodes, low, _STEP, swept, found)
    result = np.empty_like(found)
    result[tree.corners[:, -1].astype(np.int64)] = found
    return result if areas[result].sum() > 0.01 * areas.sum() else np.ones_like(result)


def _swept(corners: Float[np.ndarray, "f 20"]) -> tuple[Float[np.ndarray, "3"], Bool[np.ndarray, "a b c"]]:
    """Return the grid's start, and its cells that a ball from outside can fill, less one at its rim."""
    from scipy.ndimage import distance_transform_edt, label

    from palpate.surfaces import _rays

    points, reach = corners[:, :18].reshape(-1, 3, 6)[:, :, :3], _BALL / _STEP
    room = _BALL + 3.0 * _STEP  # for the ball to pass around the body
    low = points.min(axis=(0, 1)) - room
    count = np.ceil((points.max(axis=(0, 1)) + room - low) / _STEP).astype(np.int64)
    body = np.zeros(tuple(count), dtype=np.bool_)
    _rays.mark_facets(corners, low, _STEP, body)
    middles = np.asarray(distance_transform_edt(~body)) >= reach
    places, _ = label(middles)
    middles = places == places[0, 0, 0]
    return low, np.asarray(distance_transform_edt(~middles)) <= reach - 1.0
