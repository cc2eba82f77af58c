"""A mesh as patches: triangles that have a position *and* a normal at each corner.

Facets are patches. Where normals are split, the surface of (position, normal) pairs would have holes, and a wrench
that falls in one has no contact (no refinement closes them). So the holes are filled: a crease edge becomes two
patches whose corners lie on the edge and whose normals run from one side's to the other's, a corner where creases meet
becomes a fan of patches at one point. The result is a closed surface of pairs, on which every wrench that presses on a
closed body has a solution; and edges and vertices need no extra code.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.surfaces._normals import blocks, half_edge_twins, next_corner

FLAT, SMOOTH, EDGE, VERTEX = 0, 1, 2, 3  # what a patch is: the kind decides its tangent plane
KIND, FACET = 18, 19  # behind the three corners of a patch
_SAME = 1e-12  # 1 - cos of normals that count as one


def patch_rows(
    corners: Float[np.ndarray, "m 3 6"], kind: Int[np.ndarray, " m"] | int, facet: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "m 20"]:
    """Return rows of patches: corners, of position [m] and unit normal; kind; the facet that each is or touches."""
    rows = np.empty((len(corners), 20))
    rows[:, :KIND], rows[:, KIND], rows[:, FACET] = corners.reshape(-1, 18), kind, facet
    return rows


def facet_rows(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    corner: Float[np.ndarray, "f _ 3"],
    used: Int[np.ndarray, " m"],
    spare: int = 0,
) -> Float[np.ndarray, "n 20"]:
    """Return the used facets as rows of patches, with normals at their corners; `spare` rows follow them."""
    rows = np.empty((len(used) + spare, 20))
    for block in blocks(len(used)):
        facet, part = used[block], rows[: len(used)][block]
        corners = part[:, :KIND].reshape(-1, 3, 6)
        corners[:, :, :3], corners[:, :, 3:] = vertices.take(faces.take(facet, axis=0), axis=0), corner[facet]
        flat = np.einsum("fik,fk->fi", corners[:, :, 3:], corners[:, 0, 3:]) > 1.0 - _SAME
        part[:, KIND], part[:, FACET] = np.where(flat[:, 0] & flat[:, 1] & flat[:, 2], FLAT, SMOOTH), facet
    return rows


@dataclass(frozen=True)
class Split:
    """Corners of a mesh at which its normals are split.

    Attributes:
        vertices: (v, 3) [m].
        point: (3 f,) vertex at each corner.
        flat: (3 f, 3) normals at the corners.
        twins: (3 f,) of the half-edges.
        changes: (3 f,) of the normals, from `compare_normals`.
        covered: (f,) facets that give no contacts.
    """

    vertices: Float[np.ndarray, "v 3"]
    point: Int[np.ndarray, " h"]
    flat: Float[np.ndarray, "h 3"]
    twins: Int[np.ndarray, " h"]
    changes: Int[np.ndarray, " h"]
    covered: Bool[np.ndarray, " f"]

    @classmethod
    def of(
        cls,
        vertices: Float[np.ndarray, "v 3"],
        faces: Int[np.ndarray, "f 3"],
        corner: Float[np.ndarray, "f 3 3"],
        covered: Bool[np.ndarray, " f"] | None = None,
    ) -> Split:
        """Return the split normals of a mesh, from its corner normals."""
        from palpate.surfaces import _topology  # compiled: loaded when first needed

        covered = np.zeros(len(faces), dtype=np.bool_) if covered is None else covered
        twins, flat = half_edge_twins(faces), corner.reshape(-1, 3)
        changes = np.empty(len(twins), dtype=np.int64)
        _topology.compare_normals(flat, twins, _SAME, changes)
        return cls(vertices, faces.reshape(-1), flat, twins, changes, covered)

    def at(self, corner: Int[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 6"]:
        """Return position and normal at corners, (*n, 6)."""
        return np.concatenate([self.vertices[self.point[corner]], self.flat[corner]], axis=-1)

    def half_edges(self, least: int) -> Int[np.ndarray, " n"]:
        """Return the first half-edge of each edge whose `changes` at one end are `least` or more, in order."""
        changed = np.flatnonzero(self.changes >= least)
        return np.unique(np.minimum(changed, self.twins[changed]))

    @functools.cached_property
    def fans(self) -> tuple[Float[np.ndarray, "k 3 6"], Int[np.ndarray, " k"]]:
        """Patches over corners where three or more normals meet, in order around the corner, and a facet of each."""
        from palpate.surfaces import _topology

        members, sizes = np.empty_like(self.twins), np.empty_like(self.twins)
        sizes = sizes[: _topology.walk_rings(self.twins, self.changes, members, sizes)].copy()
        begin = np.cumsum(sizes) - sizes
        corners = [np.zeros((0, 3, 6))]
        facet = [np.zeros(0, dtype=np.int64)]
        for size in dict.fromkeys(sizes.tolist()):
            if size > 2:
                index = members[begin[sizes == size][:, None] + np.arange(size)]
                fans = _fan(self.at(index))
                corners.append(fans.reshape(-1, 3, 6))
                open_one = np.argmin(self.covered[index // 3], axis=1)
                facet.append(np.repeat(index[np.arange(len(index)), open_one] // 3, len(fans[0])))
        return np.concatenate(corners), np.concatenate(facet)


def build_patches(faces: Int[np.ndarray, "f 3"], split: Split, spare: int = 0) -> Float[np.ndarray, "m 20"]:
    """Return the patches of a mesh as rows; none of covered facets, nor of edges and corners between such facets.

    Behind them are `spare` rows to be written.
    """
    corners, facet = _edge_strips(split)
    fans, beside = split.fans
    kind = np.repeat([EDGE, VERTEX], [len(corners), len(fans)])
    corners, facet = np.concatenate([corners, fans]), np.concatenate([facet, beside])
    rest = np.flatnonzero(~split.covered[facet])
    used = np.flatnonzero(~split.covered)
    rows = facet_rows(split.vertices, faces, split.flat.reshape(-1, 3, 3), used, len(rest) + spare)
    rows[len(used) : len(used) + len(rest)] = patch_rows(corners[rest], kind[rest], facet[rest])
    return rows


def _edge_strips(split: Split) -> tuple[Float[np.ndarray, "m 3 6"], Int[np.ndarray, " m"]]:
    """Return two patches for each crease edge.

    Between flat facets they are skipped: there the strip has no area in any view, because the shift between two normals
    runs exactly along their edge.
    """
    half = split.half_edges(2)
    other = split.twins[half]
    a1, b1, b2, a2 = (split.at(corner) for corner in (half, next_corner(half), other, next_corner(other)))
    bent = _apart(a1, b1) | _apart(a2, b2)
    a1, b1, b2, a2 = a1[bent], b1[bent], b2[bent], a2[bent]
    corners = np.concatenate([np.stack([a1, a2, b2], axis=1), np.stack([a1, b2, b1], axis=1)])
    left, right = half[bent] // 3, other[bent] // 3
    return corners, np.tile(np.where(split.covered[left], right, left), 2)


def _fan(ring: Float[np.ndarray, "r k 6"]) -> Float[np.ndarray, "r t 3 6"]:
    """Return triangles over rings of k normals at one point each, about the middle of the normals.

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


def _apart(a: Float[np.ndarray, "n 6"], b: Float[np.ndarray, "n 6"]) -> np.ndarray:
    return np.einsum("ij,ij->i", a[:, 3:], b[:, 3:]) < 1.0 - _SAME
