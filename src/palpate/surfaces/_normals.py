"""Vertex normals that are smooth within a crease angle and split across it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

__all__ = ["corner_normals", "facet_normals", "half_edge_twins"]

_LARGE = 5.0  # times the area that is usual at a corner


def facet_normals(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "f 3"], Float[np.ndarray, " f"]]:
    """Unit normals of the facets and their areas; a facet without area gets a zero normal."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    return cross / np.where(length > 0, length, 1.0)[:, None], 0.5 * length


def half_edge_twins(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, " h"]:
    """For half-edge 3 f + i (from corner i to i + 1 of facet f) the opposite one, or -1.

    An edge that more than two facets share, or that two facets run through in the same sense, has no twin: the surface
    is cut open there.
    """
    start = faces.reshape(-1).astype(np.int64)
    end = np.roll(faces, -1, axis=1).reshape(-1).astype(np.int64)
    base = int(faces.max()) + 1
    forward, backward = start * base + end, end * base + start
    order = np.argsort(forward, kind="stable")
    keys = forward[order]
    at = np.minimum(np.searchsorted(keys, backward), len(keys) - 1)
    single = np.ones(len(keys), dtype=bool)
    single[1:] &= keys[1:] != keys[:-1]
    single[:-1] &= keys[:-1] != keys[1:]
    found = (keys[at] == backward) & single[at]
    twins = np.where(found, order[at], -1)
    lonely = (twins >= 0) & (np.where(twins >= 0, twins[twins], -1) != np.arange(len(twins)))
    return np.where(lonely, -1, twins)


def corner_normals(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], crease: float
) -> tuple[Float[np.ndarray, "f 3 3"], Int[np.ndarray, "f 3"]]:
    """Normals at the corners of the facets, and which corners share one.

    Facets that meet at an edge by less than `crease` [rad] share the normals of its two ends; a shared normal is the
    angle-weighted mean of its facets' (Thurmer and Wuthrich 1998), where they are of a size. Facets that are much
    larger than those beside them are flat because they were meant to be, as a wall is that ends in a fillet: they keep
    their normals, which would tilt by degrees else, and with them the wall.

    Returns:
        normals (f, 3, 3), unit; groups (f, 3), equal where the normal is shared.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    normals, areas = facet_normals(vertices, faces)
    twins = half_edge_twins(faces)
    half = np.flatnonzero(twins > np.arange(len(twins)))
    other = twins[half]
    bend = np.einsum("ij,ij->i", normals[half // 3], normals[other // 3])
    smooth = bend >= np.cos(max(crease, 0.0) + 1e-6)  # coplanar facets are never split
    half, other = half[smooth], other[smooth]
    left = np.concatenate([half, _next_corner(half)])
    right = np.concatenate([_next_corner(other), other])
    count = faces.size
    graph = coo_array((np.ones(len(left), dtype=np.int8), (left, right)), shape=(count, count))
    _, groups = connected_components(graph, directed=False)
    weights = _corner_angles(vertices, faces) * _prominence(areas, groups.reshape(-1, 3))
    weighted = normals[:, None, :] * weights[:, :, None]
    sums = np.stack([np.bincount(groups, weighted[..., k].reshape(-1)) for k in range(3)], axis=1)
    length = np.linalg.norm(sums, axis=1)
    shared = sums[groups] / np.where(length > 1e-12, length, 1.0)[groups, None]
    own = np.repeat(normals, 3, axis=0)
    shared = np.where((length[groups] > 1e-12)[:, None], shared, own)
    return shared.reshape(-1, 3, 3), groups.reshape(-1, 3)


def _prominence(areas: Float[np.ndarray, " f"], groups: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """By how much more than its angle a facet counts at a corner: nearly 1 where those that meet there are of a size.

    The usual size at a corner is the geometric mean of the areas.
    """
    each = np.repeat(areas[:, None], 3, axis=1)
    there = each > 0.0
    logarithms = np.log(each, where=there, out=np.zeros_like(each))
    count = np.maximum(np.bincount(groups.reshape(-1), there.reshape(-1)), 1.0)
    usual = np.exp(np.bincount(groups.reshape(-1), logarithms.reshape(-1)) / count)
    return 1.0 + (each / (_LARGE * usual[groups])) ** 3


def _next_corner(half_edges: Int[np.ndarray, " h"]) -> Int[np.ndarray, " h"]:
    """The corner at which a half-edge ends; half-edge and corner numbers are the same 3 f + i."""
    return half_edges - half_edges % 3 + (half_edges + 1) % 3


def _corner_angles(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    points = vertices[faces]
    ahead = np.roll(points, -1, axis=1) - points
    behind = np.roll(points, 1, axis=1) - points
    sine = np.linalg.norm(np.cross(ahead, behind), axis=2)
    return np.arctan2(sine, np.einsum("fij,fij->fi", ahead, behind))
