"""What can safely be repaired in a mesh as it comes, and what to say about it.

Vertices that coincide are merged (STL has no shared ones), facets without area or with a doubled twin are dropped, and
the winding is made consistent over each body and outward. Nothing is moved, filled or remeshed.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.errors import GeometryError
from palpate.spatial._arrays import shaped
from palpate.surfaces._normals import facet_normals, half_edge_twins

__all__ = ["bodies", "repair"]

_FARTHEST = 1e12  # in any unit: what is beyond is a fault of the file, and its powers would overflow


def repair(
    vertices: ArrayLike, faces: ArrayLike
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"], tuple[str, ...]]:
    """Merged, cleaned and oriented arrays, and notes on what was done.

    Raises:
        GeometryError: wrong shapes, vertex numbers out of range, or no facet with an area.
    """
    points, triangles = _checked(vertices, faces)
    notes: list[str] = []
    finite = np.all(np.abs(points) <= _FARTHEST, axis=1)  # not NaN
    if not finite.all():
        usable = np.all(finite[triangles], axis=1)
        notes.append(f"{np.count_nonzero(~usable)} facets with vertices that are NaN, infinite or beyond 1e12 dropped")
        triangles = triangles[usable]
        points = np.where(finite[:, None], points, 0.0)
    if len(triangles) == 0:
        raise GeometryError("the mesh has no facets")
    points, triangles = _merged(points, triangles)
    triangles, dropped = _without_slivers(points, triangles)
    if dropped:
        notes.append(f"{dropped} facets without area dropped")
    if len(triangles) == 0:
        raise GeometryError("the mesh has no facet with an area")
    triangles, doubled = _without_doubles(triangles)
    if doubled:
        notes.append(f"{doubled} doubled facets dropped")
    triangles, turned = _outward(points, triangles)
    if turned:
        notes.append(f"{turned} facets turned over so that normals agree and point outward")
    open_edges = int(np.count_nonzero(half_edge_twins(triangles) < 0))
    if open_edges and not _sheet(points, triangles):
        notes.append(f"the mesh is not closed: {open_edges} edges have no single neighbour")
    return points, triangles, tuple(notes)


def bodies(triangles: Int[np.ndarray, "f 3"]) -> int:
    """How many there are, joined over edges with exactly two facets."""
    return int(_winding(triangles)[1].max()) + 1


def _sheet(points: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"]) -> bool:
    """Do all facets face one side, as a pad's or a dome's do?

    A force that comes in through the opening of such a mesh presses on none of its facets: there is nothing to doubt.
    """
    normals, areas = facet_normals(points, triangles)
    out = areas @ normals
    return bool(np.all(normals @ out > -0.1 * np.linalg.norm(out)) and np.any(out))


def _checked(vertices: ArrayLike, faces: ArrayLike) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    points, triangles = shaped(vertices, (None, 3), "vertices"), np.array(faces, order="C")
    if triangles.size == 0:
        raise GeometryError("the mesh has no facets")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or not np.issubdtype(triangles.dtype, np.integer):
        raise GeometryError(f"faces must be (f, 3) whole numbers, not {triangles.shape} {triangles.dtype}")
    worst = triangles.min() if triangles.min() < 0 else triangles.max()
    if not 0 <= worst < len(points):
        raise GeometryError(f"faces name vertex {worst}; there are {len(points)}, counted from 0")
    return points, triangles.astype(np.int64)


def _merged(
    points: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "f 3"]]:
    """Vertices that one step of float32 in each coordinate can tell apart, or 1e-7 of the size, become one.

    The step is that of the largest coordinate, as STL writes it in whatever unit; at most 1e-4 of the size, so that a
    body far from its origin keeps its shape.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    needed = np.unique(triangles)
    used, same = _distinct(points[needed])
    size = float(np.linalg.norm(used.max(axis=0) - used.min(axis=0)))
    step = np.sqrt(3.0) * float(np.finfo(np.float32).eps) * float(np.abs(used).max())
    near = KDTree(used).query_pairs(max(1e-7 * size, min(step, 1e-4 * size)), output_type="ndarray")
    graph = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(used), len(used)))
    count, group = connected_components(graph, directed=False)
    first = np.full(count, len(used))
    np.minimum.at(first, group, np.arange(len(used)))
    renamed = np.zeros(len(points), dtype=np.int64)
    renamed[needed] = group[same]
    return used[first], renamed[triangles]


def _distinct(points: Float[np.ndarray, "v 3"]) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, " v"]]:
    """Points that differ, in order, and which of them each is: a quick start for meshes that share no vertices."""
    order = np.lexsort(points.T[::-1])
    sorted_ = points[order]
    new = np.ones(len(points), dtype=bool)
    new[1:] = np.any(sorted_[1:] != sorted_[:-1], axis=1)
    number = np.empty(len(points), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    return sorted_[new], number


def _without_slivers(
    points: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"]
) -> tuple[Int[np.ndarray, "g 3"], int]:
    """A facet needs three different corners and a height above rounding of its longest edge."""
    _, area = facet_normals(points, triangles)
    sides = points[triangles] - np.roll(points[triangles], 1, axis=1)
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    good = area > 1e-9 * longest**2
    return triangles[good], int(np.count_nonzero(~good))


def _without_doubles(triangles: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "g 3"], int]:
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return triangles[np.sort(first)], len(triangles) - len(first)


def _outward(points: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "f 3"], int]:
    """Consistent winding over each connected body, and positive volume where the body is closed.

    An open body keeps the sense of most of its facets: which side is out is then the file's word.
    """
    flipped, body = _winding(triangles)
    result = np.where(flipped[:, None], triangles[:, ::-1], triangles)
    closed = np.ones(body.max() + 1, dtype=bool)
    closed[body[np.flatnonzero(half_edge_twins(result) < 0) // 3]] = False
    a, b, c = (points[result[:, i]] - points.mean(axis=0) for i in range(3))
    volume = np.bincount(body, np.einsum("ij,ij->i", a, np.cross(b, c)))
    changed = np.bincount(body, flipped.astype(np.float64)) / np.bincount(body)
    turn = np.where(closed, volume < 0, changed > 0.5)
    result = np.where(turn[body][:, None], result[:, ::-1], result)
    return np.ascontiguousarray(result), int(np.count_nonzero(flipped ^ turn[body]))


def _winding(triangles: Int[np.ndarray, "f 3"]) -> tuple[np.ndarray, Int[np.ndarray, " f"]]:
    """Which facets to flip so that neighbours agree, and the body each belongs to.

    Bodies are joined over edges with exactly two facets. Signs by a walk over a spanning forest of the facet graph.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    start = triangles.reshape(-1)
    end = np.roll(triangles, -1, axis=1).reshape(-1)
    key = np.minimum(start, end) * (int(triangles.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    _, begin, counts = np.unique(key[order], return_index=True, return_counts=True)
    pair = begin[counts == 2]
    one, two = order[pair], order[pair + 1]
    agree = start[one] != start[two]  # run through in opposite senses
    count = len(triangles)
    left, right = one // 3, two // 3
    graph = coo_array((np.ones(len(left)), (left, right)), shape=(count, count)).tocsr()
    bodies, body = connected_components(graph, directed=False)
    if agree.all():
        return np.zeros(count, dtype=bool), body
    against = coo_array((~agree * 1.0, (left, right)), shape=(count, count)).tocsr()
    against = against + against.T
    flipped = np.zeros(count, dtype=bool)
    for first in np.unique(body, return_index=True)[1][:bodies]:
        walk, before = breadth_first_order(graph, int(first), directed=False)
        for facet in walk[1:]:
            flipped[facet] = flipped[before[facet]] ^ bool(against[facet, before[facet]])
    return flipped, body
