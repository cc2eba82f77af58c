"""Repair a mesh where that is safe, and note the repairs; nothing is moved, filled or remeshed."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from palpate.errors import GeometryError
from palpate.spatial._arrays import shaped
from palpate.surfaces._normals import blocks, facet_normals, half_edge_twins, sort_half_edges

_FARTHEST = 1e12  # in any unit: what is beyond is a fault of the file, and its powers would overflow


def repair(
    vertices: ArrayLike, faces: ArrayLike
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"], Int[np.ndarray, " h"], tuple[str, ...]]:
    """Return merged, cleaned and oriented arrays, the twins of their half-edges, and notes on the repairs.

    Raises:
        GeometryError: faces of a wrong shape or out of range, or no facet with an area.
        InputError: vertices that are not numbers (v, 3).
    """
    points, triangles = _checked(vertices, faces)
    notes: list[str] = []
    finite = np.all(np.abs(points) <= _FARTHEST, axis=1)  # not NaN
    if not finite.all():
        usable = np.all(finite[triangles], axis=1)
        notes.append(
            f"{np.count_nonzero(~usable)} facets with vertices that are NaN, infinite or beyond 1e12 were dropped"
        )
        triangles = triangles[usable]
        points = np.where(finite[:, None], points, 0.0)
    if len(triangles) == 0:
        raise GeometryError("the mesh has no facets.")
    points, triangles = _merged(points, triangles)
    triangles, dropped = _without_slivers(points, triangles)
    if dropped:
        notes.append(f"{dropped} facets without area were dropped")
    if len(triangles) == 0:
        raise GeometryError("the mesh has no facet with an area.")
    triangles, doubled = _without_doubles(triangles)
    if doubled:
        notes.append(f"{doubled} doubled facets were dropped")
    triangles, twins, turned = _outward(points, triangles)
    if turned:
        notes.append(f"{turned} facets were turned over so that normals agree and point outward")
    open_edges = int(np.count_nonzero(twins < 0))
    if open_edges and not _sheet(points, triangles):
        notes.append(f"the mesh is not closed: {open_edges} sides of facets do not have exactly one neighbour")
    return points, triangles, twins, tuple(notes)


def bodies(triangles: Int[np.ndarray, "f 3"]) -> int:
    """Return the number of bodies, joined over edges with exactly two facets."""
    return int(_winding(triangles, sort_half_edges(triangles)[0])[1].max()) + 1


def _sheet(points: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"]) -> bool:
    """Return whether all facets face one side, as of a pad or a dome: no force through its opening presses on one."""
    normals, areas = facet_normals(points, triangles)
    out = areas @ normals
    return bool(np.all(normals @ out > -0.1 * np.linalg.norm(out)) and np.any(out))


def _checked(vertices: ArrayLike, faces: ArrayLike) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    points, triangles = shaped(vertices, (None, 3), "vertices"), np.array(faces, order="C")
    if triangles.size == 0:
        raise GeometryError("the mesh has no facets.")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or not np.issubdtype(triangles.dtype, np.integer):
        raise GeometryError(f"faces must be (f, 3) whole numbers, not {triangles.shape} {triangles.dtype}.")
    worst = triangles.min() if triangles.min() < 0 else triangles.max()
    if not 0 <= worst < len(points):
        raise GeometryError(f"faces name vertex {worst}, but there are {len(points)} vertices, counted from 0.")
    return points, triangles.astype(np.int64)


def _merged(
    points: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "f 3"]]:
    """Merge vertices within one float32 step in each coordinate, or 1e-7 of the size.

    The step is that of the largest coordinate; at most 1e-4 of the size, so that a body far from its origin keeps its
    shape.
    """
    from palpate.surfaces import _topology  # compiled: loaded when first needed

    there = np.zeros(len(points), dtype=np.bool_)
    there[triangles] = True
    needed = np.flatnonzero(there)
    used, same = _distinct(points[needed])
    size = float(np.linalg.norm(used.max(axis=0) - used.min(axis=0)))
    step = np.sqrt(3.0) * float(np.finfo(np.float32).eps) * float(np.abs(used).max())
    group = np.zeros(len(used), dtype=np.int64)
    if size > 0.0:
        count = _topology.join_near(used, max(1e-7 * size, min(step, 1e-4 * size)), group)
        if count < len(used):
            used, same = used[np.unique(group, return_index=True)[1]], group[same]
    renamed = np.zeros(len(points), dtype=np.int64)
    renamed[needed] = same
    return used, renamed[triangles]


def _distinct(points: Float[np.ndarray, "v 3"]) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, " v"]]:
    """Return the distinct points in ascending order, and the index of each."""
    number, first = _numbered((points + 0.0).view(np.int64))  # 0.0 and -0.0 are one
    points = points[first]
    order = np.lexsort(points.T[::-1])
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return points[order], rank[number]


def _numbered(rows: Int[np.ndarray, "n 3"]) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " k"]]:
    """Return for each row its number among the distinct rows, in order of appearance, and the first of each."""
    from palpate.surfaces import _topology

    number, first = np.empty(len(rows), dtype=np.int64), np.empty(len(rows), dtype=np.int64)
    return number, first[: _topology.number_rows(rows, number, first)].copy()


def _without_slivers(
    points: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"]
) -> tuple[Int[np.ndarray, "g 3"], int]:
    """Drop facets without an area above rounding, and count them."""
    good = np.empty(len(triangles), dtype=np.bool_)
    for block in blocks(len(triangles)):
        corners = points.take(triangles[block], axis=0)
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        longest = np.maximum(np.maximum(sides[:, 0], sides[:, 1]), sides[:, 2])
        good[block] = facet_normals(points, triangles[block])[1] > 1e-9 * longest**2
    dropped = int(np.count_nonzero(~good))
    return triangles[good] if dropped else triangles, dropped


def _without_doubles(triangles: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "g 3"], int]:
    first = _numbered(np.sort(triangles, axis=1))[1]
    doubled = len(triangles) - len(first)
    return triangles[first] if doubled else triangles, doubled


def _outward(
    points: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"]
) -> tuple[Int[np.ndarray, "f 3"], Int[np.ndarray, " h"], int]:
    """Make the winding consistent over each body, and the volume of closed ones positive.

    An open body keeps the sense of most of its facets. The last value is the number of facets turned over.
    """
    order, twins = sort_half_edges(triangles)
    flipped, body = _winding(triangles, order)
    if flipped.any():
        triangles = np.where(flipped[:, None], triangles[:, ::-1], triangles)
        twins = half_edge_twins(triangles)
    closed = np.ones(body.max() + 1, dtype=bool)
    closed[body[np.flatnonzero(twins < 0) // 3]] = False
    middle, volumes = points.mean(axis=0), np.empty(len(triangles))
    for block in blocks(len(triangles)):
        a, b, c = np.moveaxis(points.take(triangles[block], axis=0) - middle, 1, 0)
        volumes[block] = np.einsum("ij,ij->i", a, np.cross(b, c))
    volume = np.bincount(body, volumes)
    changed = np.bincount(body, flipped.astype(np.float64)) / np.bincount(body)
    turn = np.where(closed, volume < 0, changed > 0.5)[body]
    if turn.any():
        triangles = np.ascontiguousarray(np.where(turn[:, None], triangles[:, ::-1], triangles))
        twins = half_edge_twins(triangles)
    return triangles, twins, int(np.count_nonzero(flipped ^ turn))


def _winding(
    triangles: Int[np.ndarray, "f 3"], order: Int[np.ndarray, " h"]
) -> tuple[Bool[np.ndarray, " f"], Int[np.ndarray, " f"]]:
    """Return which facets to flip so that neighbours agree, and each one's body."""
    from palpate.surfaces import _topology

    flipped, body = np.zeros(len(triangles), dtype=np.bool_), np.empty(len(triangles), dtype=np.int64)
    _topology.walk_facets(triangles, order, flipped, body)
    return flipped, body
