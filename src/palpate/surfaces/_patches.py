"""A mesh as patches: triangles that carry a position *and* a normal at each corner.

Facets are patches. Where normals are split, the surface of (position, normal) pairs would have holes, and a wrench
that falls in one has no contact (kernels.md: no refinement closes them). So the holes are filled: a crease edge becomes
two patches whose corners lie on the edge and whose normals run from one side's to the other's, a corner where creases
meet becomes a fan of patches at one point. What is left is a closed surface of pairs, on which every wrench that
presses on a closed body has a solution; and edges and vertices need no code of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.surfaces._normals import half_edge_twins

__all__ = ["EDGE", "FLAT", "SMOOTH", "VERTEX", "Patches", "build_patches", "vertex_fans"]

FLAT, SMOOTH, EDGE, VERTEX = 0, 1, 2, 3  # what a patch is: the kind decides its tangent plane
_SAME = 1e-12  # 1 - cos of normals that count as one


@dataclass(frozen=True)
class Patches:
    """Corners (m, 3, 6): position [m] and unit normal; kind (m,); facet (m,), the facet a patch is or touches."""

    corners: Float[np.ndarray, "m 3 6"]
    kind: Int[np.ndarray, " m"]
    facet: Int[np.ndarray, " m"]


def build_patches(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    corner: Float[np.ndarray, "f 3 3"],
    covered: Bool[np.ndarray, " f"] | None = None,
) -> Patches:
    """The patches of a mesh with corner normals; none of covered facets, nor of edges and corners between such."""
    covered = np.zeros(len(faces), dtype=np.bool_) if covered is None else covered
    facets = np.concatenate([vertices[faces], corner], axis=2)
    spread = np.einsum("fik,fk->fi", corner, corner[:, 0]).min(axis=1)
    parts = [(facets, np.where(spread > 1.0 - _SAME, FLAT, SMOOTH), np.arange(len(faces)))]
    twins = half_edge_twins(faces)
    parts.append(_edge_strips(facets, twins, covered))
    parts.append(vertex_fans(facets, twins, covered))
    corners, kind, facet = (np.concatenate(part) for part in zip(*parts, strict=True))
    if covered.any():
        rest = ~covered[facet]
        corners, kind, facet = corners[rest], kind[rest], facet[rest]
    return Patches(np.ascontiguousarray(corners), kind.astype(np.int64), facet.astype(np.int64))


_Part = tuple[Float[np.ndarray, "m 3 6"], Int[np.ndarray, " m"], Int[np.ndarray, " m"]]


def _edge_strips(
    facets: Float[np.ndarray, "f 3 6"], twins: Int[np.ndarray, " h"], covered: Bool[np.ndarray, " f"]
) -> _Part:
    """Two patches a crease edge.

    Between flat facets they are skipped: there the strip has no area in any view, because the shift between two normals
    runs exactly along their edge.
    """
    flat = facets.reshape(-1, 6)
    half = np.flatnonzero(twins > np.arange(len(twins)))
    ahead = half - half % 3 + (half + 1) % 3
    other = twins[half]
    other_ahead = other - other % 3 + (other + 1) % 3
    a1, b1, b2, a2 = flat[half], flat[ahead], flat[other], flat[other_ahead]
    split = (_apart(a1, a2) | _apart(b1, b2)) & (_apart(a1, b1) | _apart(a2, b2))
    a1, b1, b2, a2 = a1[split], b1[split], b2[split], a2[split]
    corners = np.concatenate([np.stack([a1, a2, b2], axis=1), np.stack([a1, b2, b1], axis=1)])
    left, right = half[split] // 3, other[split] // 3
    facet = np.tile(np.where(covered[left], right, left), 2)
    return corners, np.full(len(corners), EDGE), facet


def vertex_fans(
    facets: Float[np.ndarray, "f 3 6"], twins: Int[np.ndarray, " h"], covered: Bool[np.ndarray, " f"]
) -> _Part:
    """At a corner where three or more normals meet, a fan over them in their order around the corner."""
    flat = facets.reshape(-1, 6)
    corner = np.arange(len(flat))
    crossing = twins[corner]  # leave the corner over its outgoing edge
    onward = np.where(crossing >= 0, crossing - crossing % 3 + (crossing + 1) % 3, -1)
    changes = np.zeros(len(flat), dtype=bool)
    inner = onward >= 0
    changes[inner] = _apart(flat[corner[inner]], flat[onward[inner]])
    rings: dict[int, list[list[int]]] = {}
    seen = np.zeros(len(flat), dtype=bool)
    for start in np.flatnonzero(changes):
        if not seen[start]:
            ring = _ring(int(start), onward, changes, seen)
            rings.setdefault(len(ring), []).append(ring)
    corners = [np.zeros((0, 3, 6))]
    facet = [np.zeros(0, dtype=np.int64)]
    for size, members in rings.items():
        if size > 2:
            index = np.array(members)
            fans = _fan(flat[index])
            corners.append(fans.reshape(-1, 3, 6))
            open_one = np.argmin(covered[index // 3], axis=1)
            facet.append(np.repeat(index[np.arange(len(index)), open_one] // 3, len(fans[0])))
    both = np.concatenate(corners)
    return both, np.full(len(both), VERTEX), np.concatenate(facet)


def _fan(ring: Float[np.ndarray, "r k 6"]) -> Float[np.ndarray, "r t 3 6"]:
    """Triangles over rings of k normals at one point each, about the middle of the normals.

    Where the ring is convex on the sphere of normals any triangles would do. Where it is not (at a saddle), the middle
    makes the patches the same whatever the order of the facets.
    """
    if ring.shape[1] == 3:
        return ring[:, None]
    hub = ring.mean(axis=1)
    length = np.linalg.norm(hub[:, 3:], axis=1, keepdims=True)
    hub[:, 3:] = np.where(length > 1e-6, hub[:, 3:] / np.maximum(length, 1e-6), ring[:, 0, 3:])
    middle = np.broadcast_to(hub[:, None], ring.shape)
    return np.stack([middle, ring, np.roll(ring, -1, axis=1)], axis=2)


def _ring(start: int, onward: np.ndarray, changes: np.ndarray, seen: np.ndarray) -> list[int]:
    """One corner for each distinct normal around a vertex, in the order of the walk `onward`."""
    ring: list[int] = []
    at = start
    while at >= 0 and not seen[at]:
        seen[at] = True
        if changes[at]:
            ring.append(int(onward[at]))
        at = int(onward[at])
    return ring


def _apart(a: Float[np.ndarray, "n 6"], b: Float[np.ndarray, "n 6"]) -> np.ndarray:
    return np.einsum("ij,ij->i", a[:, 3:], b[:, 3:]) < 1.0 - _SAME
