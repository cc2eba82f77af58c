"""Sharp convex edges and corners of a mesh, where a contact can have any normal between those of the adjacent facets.

Facets alone do not cover them: between two flat facets the pairs of position and normal have no area in any view, so
a wrench with noise misses them. They are in a second tree after that of the patches, so that those near a wrench are
found as quickly as patches are; a body without sharp edges costs one comparison.
"""

from __future__ import annotations

from math import cos, radians

import numpy as np
from jaxtyping import Float

from palpate.surfaces._normals import next_corner
from palpate.surfaces._patches import VERTEX, Split, patch_rows

SHARP = 4  # beside the kinds of `_patches`
_SHARPEST = cos(radians(20))  # facets of a rounded body that was meshed coarsely meet by less; an edge meets by more
_SOLID = 0.02  # volume of three normals below which a corner is no more than its edges


def sharp_edges(split: Split) -> Float[np.ndarray, "n 20"]:
    """Return convex edges with split normals, and convex corners between them, as rows (n, 20) of patches without area.

    An edge has its two ends, with one side's normal at the first and the other's at the second, both across the edge;
    the third corner is their middle. Along the edge the inside of the first side is n x e. None are between covered
    facets.
    """
    half, covered = split.half_edges(1), split.covered
    other = split.twins[half]
    near, far, beyond, back = (split.at(corner) for corner in (half, next_corner(half), other, next_corner(other)))
    start, end = near[:, :3], far[:, :3]
    along = end - start
    first = _across(near[:, 3:] + far[:, 3:], along)
    second = _across(beyond[:, 3:] + back[:, 3:], along)
    outward = np.einsum("ij,ij->i", second, np.cross(first, along))  # < 0 where convex
    bent = np.einsum("ij,ij->i", first, second) < _SHARPEST
    kept = bent & (outward < 0.0) & ~(covered[half // 3] & covered[other // 3])
    middle = _across(first[kept] + second[kept], along[kept])
    edges = np.stack(
        [
            np.concatenate([start[kept], first[kept]], axis=1),
            np.concatenate([end[kept], second[kept]], axis=1),
            np.concatenate([0.5 * (start + end)[kept], middle], axis=1),
        ],
        axis=1,
    )
    hollow = np.concatenate([start[bent & ~kept], end[bent & ~kept]])
    fans, beside = split.fans
    solid = np.abs(np.linalg.det(fans[:, :, 3:])) > _SOLID
    solid &= ~covered[beside]
    fans, beside = fans[solid], beside[solid]
    at = _keys(fans[:, 0, :3])
    solid = ~np.isin(at, _keys(hollow)) & np.isin(at, _keys(np.concatenate([start[kept], end[kept]])))
    kind = np.concatenate([np.full(len(edges), SHARP), np.full(np.count_nonzero(solid), VERTEX)])
    return patch_rows(np.concatenate([edges, fans[solid]]), kind, np.concatenate([half[kept] // 3, beside[solid]]))


def _across(normals: Float[np.ndarray, "n 3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return unit vectors without their parts along an edge; NaN, which no comparison keeps, where nothing remains."""
    e = along / np.linalg.norm(along, axis=1, keepdims=True)
    left = normals - np.einsum("ij,ij->i", normals, e)[:, None] * e
    length = np.linalg.norm(left, axis=1, keepdims=True)
    return left / np.where(length > 1e-9, length, np.nan)


def _keys(points: Float[np.ndarray, "n 3"]) -> np.ndarray:
    """Return one value for each point, equal where all three numbers are."""
    return np.ascontiguousarray(points).view([("x", float), ("y", float), ("z", float)])[:, 0]
