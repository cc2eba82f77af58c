"""Find the point of a surface that is closest in the metric of a taxel's normal equations."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.mesh import Mesh
from palpate.surfaces.surface import Surface

__all__ = ["nearest_in_metric"]

LEAST = 1e-6  # share of the largest eigenvalue that each direction has at least: parallel lines leave one without any
ROUNDS = 20  # of Newton's steps on a surface that is no mesh
REACHED = 1e-12  # m


@takes_arrays
def nearest_in_metric(
    matrix: Float[np.ndarray, "k 3 3"],
    vector: Float[np.ndarray, "k 3"],
    pressing: Float[np.ndarray, "k 3"],
    surface: Surface,
) -> Float[np.ndarray, "k 3"]:
    """Return the points of the surface with the least p' A p / 2 - b' p, (k, 3) [m].

    Args:
        matrix: (k, 3, 3) A, positive semidefinite.
        vector: (k, 3) b.
        pressing: (k, 3) mean direction of the forces; facets at which they would pull are ignored.
        surface: on a mesh the answer is exact; on another it starts from the mesh that a viewer would draw.
    """
    from palpate.sensors.taxels.poking._closest_point import nearest

    values, axes = np.linalg.eigh(matrix)
    values = np.maximum(values, LEAST * values[:, -1:])
    raised: Float[np.ndarray, "k 3 3"] = np.einsum("kia,ka,kja->kij", axes, values, axes)
    centre = np.einsum("kij,kj->ki", np.linalg.inv(raised), vector)
    drawn = surface.drawn()
    facets = ~drawn.covered
    corners = np.ascontiguousarray(drawn.vertices[drawn.faces[facets]])
    middles = corners.mean(axis=1)
    radii = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    root = np.sqrt(values)[:, :, None] * np.swapaxes(axes, 1, 2)  # A = root' root
    found = np.full(centre.shape, np.nan)
    balls = np.column_stack([middles, radii, drawn.normals[facets]])
    nearest(centre, np.ascontiguousarray(root), np.sqrt(values[:, 0]), pressing, corners, balls, found)
    return found if isinstance(surface, Mesh) else _refined(raised, vector, surface, found)


def _refined(
    matrix: Float[np.ndarray, "k 3 3"],
    vector: Float[np.ndarray, "k 3"],
    surface: Surface,
    points: Float[np.ndarray, "k 3"],
) -> Float[np.ndarray, "k 3"]:
    """Minimise by steps in the tangent plane, each projected back onto the surface."""
    for _ in range(ROUNDS):
        points, normals, _ = surface.project(points)
        first = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        tangents = np.stack([first, np.cross(normals, first)], axis=2)
        downhill = vector - np.einsum("kij,kj->ki", matrix, points)
        small: Float[np.ndarray, "k 2 2"] = np.einsum("kia,kij,kjb->kab", tangents, matrix, tangents)
        moved = np.einsum("kia,kab,kjb,kj->ki", tangents, np.linalg.inv(small), tangents, downhill)
        points = points + moved
        if np.abs(moved).max(initial=0.0) < REACHED:
            break
    return surface.project(points)[0]
