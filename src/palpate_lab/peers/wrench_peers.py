"""Find the contact point of one wrench on a mesh: by lines, vertices, planes and least squares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.contact.locate import Locator
from palpate.surfaces.mesh import Mesh
from palpate_lab.peers.facet_planes import facet_planes, paper_systems, within

__all__ = ["WRENCH_PEERS", "Answer", "first_hit", "least_squares", "nearest_vertex", "paper_planes", "pseudo_inverse"]

Answer = Callable[[np.ndarray], np.ndarray]  # a wrench (6,) to a point (3,) [m]
NOWHERE = np.full(3, np.nan)
CONVERGED = 1e-6  # of |F| times the body's size, and of that size
FAR = 1e3  # m: a bound that bounds nothing


def line_of_action(mesh: Mesh) -> Answer:
    """Return a peer that intersects the wrench's axis with the mesh [bicchi].

    The peer is a function from a wrench (6,) to a point (3,) [m]; NaN if it finds none.

    Of several intersections it takes the one that Palpate's `wrench_axis` takes.
    """
    locator = Locator(mesh, "wrench_axis", friction=FAR, torsion=FAR)
    out = locator.empty()

    def answer(wrench: np.ndarray) -> np.ndarray:
        locator.reset()
        locator(wrench, out)
        return out[:3].copy()

    return answer


def first_hit(mesh: Mesh) -> Answer:
    """Return a peer that finds the facet the axis meets first by testing all facets, as a ray caster does.

    The peer is a function from a wrench (6,) to a point (3,) [m]; NaN if it finds none.
    """
    normal, offset, slopes, rests = facet_planes(mesh)

    def answer(wrench: np.ndarray) -> np.ndarray:
        force = wrench[:3]
        foot, pressing = np.cross(force, wrench[3:]) / (force @ force), normal @ force
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = -(offset + normal @ foot) / pressing
            points = foot + reach[:, None] * force
        hit = within(points, slopes, rests) & (pressing < 0)
        return points[np.argmin(np.where(hit, reach, np.inf))] if hit.any() else NOWHERE

    return answer


def nearest_vertex(mesh: Mesh) -> Answer:
    """Return a peer that finds the pressed vertex with the least remaining moment, |M - p x F|.

    The peer is a function from a wrench (6,) to a point (3,) [m].
    """
    vertices, normals = mesh.vertices, np.zeros(mesh.vertices.shape)
    np.add.at(normals, mesh.faces, mesh.corner_normals)

    def answer(wrench: np.ndarray) -> np.ndarray:
        force, moment = wrench[:3], wrench[3:]
        left = np.linalg.norm(moment - np.cross(vertices, force), axis=1)
        return vertices[np.argmin(np.where(normals @ force < 0, left, np.inf))]

    return answer


def paper_planes(mesh: Mesh) -> Answer:
    """Return the `probe` paper's peer: a 4 x 4 system for the plane of every facet, and the point of least torque.

    The peer is a function from a wrench (6,) to a point (3,) [m]; NaN if it finds none.

    Only points inside their facets count. The paper leaves open which of several to take.
    """
    solve, size = paper_systems(mesh), mesh.size

    def answer(wrench: np.ndarray) -> np.ndarray:
        if np.linalg.norm(wrench[:3]) < 1e-12:
            return NOWHERE
        facets, points, torques = solve(np.r_[wrench[:3], wrench[3:]])
        if not len(facets) or not np.isfinite(points).all() or np.abs(points).max() > FAR * size:
            return NOWHERE
        return points[np.argmin(np.abs(torques))]

    return answer


def pseudo_inverse(mesh: Mesh) -> Answer:
    """Return a peer that finds the shortest p of p x F = M by the pseudo-inverse, F x M / |F|^2, without the body.

    The peer is a function from a wrench (6,) to p (3,) [m]; NaN without a force.
    """
    del mesh

    def answer(wrench: np.ndarray) -> np.ndarray:
        force = wrench[:3]
        return np.cross(force, wrench[3:]) / (force @ force)

    return answer


def least_squares(mesh: Mesh) -> Answer:
    """Return a peer that solves M - p x F - k n(p) = 0 with p on the mesh by SciPy's Levenberg-Marquardt.

    The peer is a function from a wrench (6,) to a point (3,) [m]; NaN if it does not converge, or to a point where F
    does not press.

    It starts at the vertex of `nearest_vertex`. Unknown are p and k; normal and distance are those of the mesh's
    nearest point, derivatives are finite differences.
    """
    from scipy import optimize

    begin, size = nearest_vertex(mesh), mesh.size

    def residuals(x: np.ndarray, force: np.ndarray, moment: np.ndarray) -> np.ndarray:
        point = size * x[:3]
        closest, normal, _ = mesh.project(point[None])
        left = moment - np.cross(point, force) / size - x[3] * normal[0]
        return np.append(left, (point - closest[0]) @ normal[0] / size)

    def answer(wrench: np.ndarray) -> np.ndarray:
        length = np.linalg.norm(wrench[:3])
        force, moment = wrench[:3] / length, wrench[3:] / (length * size)
        start = np.append(begin(wrench) / size, 0.0)
        found = optimize.least_squares(residuals, start, method="lm", args=(force, moment), max_nfev=200)
        closest, normal, _ = mesh.project(size * found.x[None, :3])
        converged = np.abs(found.fun).max() < CONVERGED and normal[0] @ force < 0
        return closest[0] if converged else NOWHERE

    return answer


WRENCH_PEERS: dict[str, Callable[[Mesh], Answer]] = {
    "line of action (wrench axis)": line_of_action,
    "first hit of the line of action": first_hit,
    "nearest vertex by torque residual": nearest_vertex,
    "planes of the probe paper, 4 x 4 a facet": paper_planes,
    "scipy LM, least squares on the mesh": least_squares,
    "minimum norm, pseudo-inverse of p x F = M": pseudo_inverse,
}
