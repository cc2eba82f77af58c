"""Planes of all facets of a mesh, a test for points inside facets, and the `probe` paper's 4 x 4 systems."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.mesh import Mesh

INSIDE = -1e-8  # barycentric coordinates of a facet's own points
Planes = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
Systems = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # a wrench (6,) to matrices (f, 4, 4) and rights (f, 4)


def facet_planes(mesh: Mesh) -> Planes:
    """Return each facet's normal N, offset d of N . p + d = 0, and two barycentric coordinates as g . p + e.

    The shapes are N (f, 3), d (f,) [m], g (2, f, 3) [1/m] and e (2, f).
    """
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    normal = mesh.normals
    offset = -np.einsum("fk,fk->f", normal, a)
    double = np.einsum("fk,fk->f", normal, np.cross(b - a, c - a))[:, None]
    slopes = np.stack([np.cross(normal, c - b) / double, np.cross(normal, a - c) / double])
    rests = 1.0 - np.einsum("ifk,ifk->if", slopes, np.stack([a, b]))
    return normal, offset, slopes, rests


@takes_arrays
def within(
    points: Float[np.ndarray, "f 3"], slopes: Float[np.ndarray, "2 f 3"], rests: Float[np.ndarray, "2 f"]
) -> Bool[np.ndarray, " f"]:
    """Return a bool for each facet, (f,), True where the point (f, 3) on its plane lies inside it.

    `slopes` and `rests` are g and e of `facet_planes`.

    Raises:
        InputError: arrays of other shapes.
    """
    first, second = np.einsum("ifk,fk->if", slopes, points) + rests
    return (first >= INSIDE) & (second >= INSIDE) & (first + second <= 1 - INSIDE)


def system_filler(mesh: Mesh) -> Systems:
    """Return a function from a wrench (6,) to the paper's 4 x 4 system of every facet.

    It returns the matrices (f, 4, 4) and the right sides (f, 4) for the unknowns p and tau.

    The systems are -[F]x p + tau N = M, with p x F = -[F]x p, and N . p = -d. Each call fills the same two arrays.
    """
    normal, offset, _, _ = facet_planes(mesh)
    matrices, rights = np.zeros((len(normal), 4, 4)), np.zeros((len(normal), 4))
    matrices[:, :3, 3], matrices[:, 3, :3], rights[:, 3] = normal, normal, -offset

    def fill(wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        fx, fy, fz = wrench[:3]
        matrices[:, :3, :3] = [[0.0, fz, -fy], [-fz, 0.0, fx], [fy, -fx, 0.0]]
        rights[:, :3] = wrench[3:]
        return matrices, rights

    return fill


def paper_systems(
    mesh: Mesh,
) -> Callable[[np.ndarray], tuple[Int[np.ndarray, " k"], Float[np.ndarray, "k 3"], Float[np.ndarray, " k"]]]:
    """Return a function that solves all systems for a wrench (6,) in one call.

    It returns the facets (k,) that the wrench can touch, the points (k, 3) [m] and the torques (k,) [N m].
    It raises LinAlgError if a system is singular, as without a force.
    """
    fill, (normal, _, slopes, rests) = system_filler(mesh), facet_planes(mesh)

    def solve(wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        matrices, rights = fill(wrench)
        found = np.linalg.solve(matrices, rights[..., None])[..., 0]
        facets = np.flatnonzero(within(found[:, :3], slopes, rests) & (normal @ wrench[:3] < 0))
        return facets, found[facets, :3], found[facets, 3]

    return solve
