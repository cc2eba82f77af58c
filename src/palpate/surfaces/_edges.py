"""Sharp convex edges and corners of a mesh, where any normal between those of the facets beside can be met.

Facets alone do not say so: between two flat facets the pairs of position and normal have no area in any view, so a
wrench with noise falls beside them. They stand in a tree of their own behind that of the patches, so that those near a
wrench are found as quickly as patches are; a body without sharp edges pays one comparison.
"""

from __future__ import annotations

from math import cos, radians

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.surfaces._normals import half_edge_twins
from palpate.surfaces._patches import VERTEX, Patches, vertex_fans

__all__ = ["SHARP", "sharp_edges"]

SHARP = 4  # beside the kinds of `_patches`
_SHARPEST = cos(radians(20))  # facets of a rounded body that was meshed coarsely meet by less; an edge meets by more
_SOLID = 0.02  # volume of three normals below which a corner is no more than its edges


def sharp_edges(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    corner: Float[np.ndarray, "f 3 3"],
    covered: Bool[np.ndarray, " f"] | None = None,
) -> Patches:
    """Convex edges over which normals are split, and convex corners between them, as patches without area.

    An edge has its two ends, with one side's normal at the first and the other's at the second, both across the edge;
    the third corner is their middle. Along the edge the inside of the first side is n x e. None are between covered
    facets.
    """
    covered = np.zeros(len(faces), dtype=np.bool_) if covered is None else covered
    facets = np.concatenate([vertices[faces], corner], axis=2)
    flat, twins = facets.reshape(-1, 6), half_edge_twins(faces)
    half = np.flatnonzero(twins > np.arange(len(twins)))
    ahead, other = _next(half), twins[half]
    start, end = flat[half, :3], flat[ahead, :3]
    along = end - start
    first = _across(flat[half, 3:] + flat[ahead, 3:], along)
    second = _across(flat[other, 3:] + flat[_next(other), 3:], along)
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
    fans, _, beside = vertex_fans(facets, twins, covered)
    solid = np.abs(np.linalg.det(fans[:, :, 3:])) > _SOLID
    at = _keys(fans[:, 0, :3])
    solid &= ~covered[beside]
    solid &= ~np.isin(at, _keys(hollow)) & np.isin(at, _keys(np.concatenate([start[kept], end[kept]])))
    kind = np.concatenate([np.full(len(edges), SHARP), np.full(np.count_nonzero(solid), VERTEX)])
    return Patches(np.concatenate([edges, fans[solid]]), kind, np.concatenate([half[kept] // 3, beside[solid]]))


def _next(half_edges: Int[np.ndarray, " h"]) -> Int[np.ndarray, " h"]:
    """The corner at which a half-edge ends."""
    return half_edges - half_edges % 3 + (half_edges + 1) % 3


def _across(normals: Float[np.ndarray, "n 3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit vectors without their parts along an edge; NaN, which no comparison keeps, where nothing is left."""
    e = along / np.linalg.norm(along, axis=1, keepdims=True)
    left = normals - np.einsum("ij,ij->i", normals, e)[:, None] * e
    length = np.linalg.norm(left, axis=1, keepdims=True)
    return left / np.where(length > 1e-9, length, np.nan)


def _keys(points: Float[np.ndarray, "n 3"]) -> np.ndarray:
    """One value a point, equal where all three numbers are."""
    return np.ascontiguousarray(points).view([("x", float), ("y", float), ("z", float)])[:, 0]
