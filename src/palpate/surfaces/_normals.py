"""Compute vertex normals that are smooth within a crease angle and split across it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

_LARGE = 5.0  # times the area that is usual at a corner


def blocks(count: int) -> Iterator[slice]:
    """Return slices of an array of `count` facets, small enough for a processor's cache with the results for them."""
    size = 1 << 13
    return (slice(begin, min(begin + size, count)) for begin in range(0, count, size))


def facet_normals(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "f 3"], Float[np.ndarray, " f"]]:
    """Return unit normals of the facets (f, 3), zero without an area, and areas (f,)."""
    normals, areas = np.empty((len(faces), 3)), np.empty(len(faces))
    for block in blocks(len(faces)):
        a, b, c = np.moveaxis(vertices.take(faces[block], axis=0), 1, 0)
        cross = np.cross(b - a, c - a)
        length = np.linalg.norm(cross, axis=1)
        normals[block] = cross / np.where(length > 0, length, 1.0)[:, None]
        areas[block] = 0.5 * length
    return normals, areas


def sort_half_edges(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, " h"], Int[np.ndarray, " h"]]:
    """Return half-edges 3 f + i (from corner i to i + 1 of facet f) in the order of their edges, and their twins.

    The twin is the opposite half-edge; -1 at a rim, and where more than two facets share an edge or two run through it
    in the same sense.
    """
    from palpate.surfaces import _topology  # compiled: loaded when first needed

    order, twins = np.empty(faces.size, dtype=np.int64), np.empty(faces.size, dtype=np.int64)
    _topology.pair_edges(
        np.array(faces, dtype=np.int64, order="C", copy=None), int(faces.max(initial=-1)) + 1, order, twins
    )
    return order, twins


def half_edge_twins(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, " h"]:
    """Return the twins of `sort_half_edges`."""
    return sort_half_edges(faces)[1]


def next_corner(half_edges: Int[np.ndarray, " h"]) -> Int[np.ndarray, " h"]:
    """Return the corner at which a half-edge ends; half-edge and corner numbers are the same 3 f + i."""
    return half_edges - half_edges % 3 + (half_edges + 1) % 3


def corner_normals(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    twins: Int[np.ndarray, " h"],
    crease: float,
) -> Float[np.ndarray, "f 3 3"]:
    """Return unit normals at the corners of the facets, (f, 3, 3).

    Facets that meet at an edge by less than `crease` [rad] share the normals of its ends: the angle-weighted mean of
    theirs [Thurmer and Wuthrich 1998]. Facets much larger than the adjacent ones, like a wall that ends in a fillet,
    are flat and keep their normals, which the mean would tilt by degrees.
    """
    from palpate.surfaces import _topology

    normals, areas = facet_normals(vertices, faces)
    groups = np.empty(faces.size, dtype=np.int64)
    least = np.cos(max(crease, 0.0) + 1e-6)  # coplanar facets are never split
    count = _topology.group_corners(normals, twins, least, groups)
    groups = groups.reshape(-1, 3)
    usual, sums = _usual_areas(areas, groups, count), np.zeros((count, 3))
    for block in blocks(len(faces)):
        group = groups[block]
        prominence = 1.0 + (areas[block, None] / (_LARGE * usual[group])) ** 3
        weights = _corner_angles(vertices, faces[block]) * prominence
        weighted = normals[block, None, :] * weights[:, :, None]
        _topology.add_by_group(group.reshape(-1), weighted.reshape(-1, 3), sums)
    length = np.linalg.norm(sums, axis=1)
    sums /= np.where(length > 1e-12, length, 1.0)[:, None]
    shared = sums[groups]
    for block in blocks(len(faces)):
        alone = length[groups[block]] <= 1e-12
        shared[block][alone] = np.repeat(normals[block, None], 3, axis=1)[alone]
    return shared


def _usual_areas(areas: Float[np.ndarray, " f"], groups: Int[np.ndarray, "f 3"], count: int) -> Float[np.ndarray, " g"]:
    """Return the geometric mean of the areas of the facets at each shared corner."""
    from palpate.surfaces import _topology

    sums = np.zeros((count, 2))  # of logarithms, and how many
    for block in blocks(len(areas)):
        there = areas[block] > 0.0
        each = np.stack([np.log(areas[block], where=there, out=np.zeros(len(there))), there], axis=1)
        _topology.add_by_group(groups[block].reshape(-1), np.repeat(each, 3, axis=0), sums)
    return np.exp(sums[:, 0] / np.maximum(sums[:, 1], 1.0))


def _corner_angles(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    points = vertices.take(faces, axis=0)
    ahead = np.roll(points, -1, axis=1) - points
    behind = np.roll(points, 1, axis=1) - points
    sine = np.linalg.norm(np.cross(ahead, behind), axis=2)
    return np.arctan2(sine, np.einsum("fij,fij->fi", ahead, behind))
