"""Find the facets of a mesh that can be touched from outside.

Tools are drawn with their inner shells, and as bodies that stand inside each other. A facet is open if the rays along
its normal, from two of the samples on it (or the only one), leave the body; or if one of them reaches, before another
facet, a place that a ball of a fifth of the body's size can reach from outside (the space around the body, opened by a
ball [serra]): the inner walls of a mug, not those of a tube too narrow for a finger, or behind a gap.

Between two fingers there is less room. A facet there is open if it is in a passage, in which a quarter of the lines
over it lead out at both ends, or if its ray reaches a ball that fits between the two sides of a passage. A bore or a
cup has one end, and a passage is wider than 4 % of the body's size (some cells of the grid).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

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
    _rays.open_facets(tree.corners, tree.nodes, np.zeros(3), _STEP, np.empty((0, 0, 0), np.int8), found)
    if not found.all():  # else there is nothing to ask the ball
        low, cells = _cells(tree.corners)
        _rays.open_facets(tree.corners, tree.nodes, low, _STEP, cells, found)
        if (cells == _rays.PASSAGE).any():  # also those that the balls found in passages can reach
            _rays.open_facets(tree.corners, tree.nodes, low, _STEP, cells, found)
    result = np.empty_like(found)
    result[tree.corners[:, -1].astype(np.int64)] = found
    return result if areas[result].sum() > 0.01 * areas.sum() else np.ones_like(result)


def _cells(corners: Float[np.ndarray, "f 20"]) -> tuple[Float[np.ndarray, "3"], Int8[np.ndarray, "a b c"]]:
    """Return the grid's start, and its cells: of the body, those that a ball from outside fills, others."""
    from scipy.ndimage import distance_transform_edt, label

    from palpate.surfaces import _rays

    points, reach = corners[:, :18].reshape(-1, 3, 6)[:, :, :3], _BALL / _STEP
    room = _BALL + 3.0 * _STEP  # for the ball to pass around the body
    low = points.min(axis=(0, 1)) - room
    count = np.ceil((points.max(axis=(0, 1)) + room - low) / _STEP).astype(np.int64)
    cells = np.full(tuple(count), _rays.FREE, dtype=np.int8)
    _rays.mark_facets(corners, low, _STEP, cells)
    middles = np.asarray(distance_transform_edt(cells == _rays.FREE)) >= reach
    places, _ = label(middles)
    middles = places == places[0, 0, 0]
    cells[np.asarray(distance_transform_edt(~middles)) <= reach - 1.0] = _rays.SWEPT
    return low, cells
