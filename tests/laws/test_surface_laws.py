"""Laws that every surface obeys, whatever it is made of: projection and normals."""

import numpy as np
import pytest

from palpate.surfaces import Mesh
from palpate_lab.simulation.shapes import Body
from tests.support.bodies import BODIES, PLACE, Surfaced, on_mesh


@pytest.fixture(params=BODIES.values(), ids=BODIES.keys())
def row(request: pytest.FixtureRequest) -> Surfaced:
    return request.param


def nearest_by_brute_force(mesh: Mesh, point: np.ndarray) -> float:
    """Distance to every facet: its plane where the foot lies inside, else its three sides."""
    corners = mesh.vertices[mesh.faces]
    edges = np.roll(corners, -1, axis=1) - corners
    along = np.einsum("fik,fik->fi", point - corners, edges) / np.einsum("fik,fik->fi", edges, edges)
    feet = corners + np.clip(along, 0, 1)[..., None] * edges
    best = np.linalg.norm(point - feet, axis=2).min()
    inward = np.cross(mesh.normals[:, None, :], edges)
    inside = (np.einsum("fik,fik->fi", point - corners, inward) >= 0).all(axis=1)
    heights = np.abs(np.einsum("fk,fk->f", point - corners[:, 0], mesh.normals))
    return float(min(best, heights[inside].min(initial=np.inf)))


def test_projection_lands_on_the_named_facet_and_is_the_closest(row: Surfaced) -> None:
    mesh, rng = row.mesh, np.random.default_rng(0)
    points = mesh.centre + rng.normal(size=(300, 3)) * mesh.size * rng.choice([0.1, 0.4, 3.0], (300, 1))
    closest, normals, facet = mesh.project(points)
    tiny = 1e-12 * mesh.size * 10  # the largest numbers are points 10 sizes away, good to 1e-16 of that, squared apart
    brute = np.array([nearest_by_brute_force(mesh, p) for p in points])
    assert np.abs(np.linalg.norm(points - closest, axis=1) - brute).max() < tiny
    corners = mesh.vertices[mesh.faces[facet]]
    height = np.einsum("nk,nk->n", closest - corners[:, 0], mesh.normals[facet])
    assert np.abs(height).max() < tiny
    weights = np.linalg.solve(  # the facet's own coordinates of the answer: two sides and the normal
        np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], mesh.normals[facet]], axis=2),
        (closest - corners[:, 0])[..., None],
    )[:, :2, 0]
    assert weights.min() > -1e-9
    assert weights.sum(axis=1).max() < 1 + 1e-9  # in shares of a facet, whose sides are 1/50 of the body
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=0, atol=1e-14)


def test_points_of_the_surface_project_onto_themselves_with_their_normal(row: Surfaced) -> None:
    points, normals, facet = on_mesh(row.mesh, 300, np.random.default_rng(1))
    closest, found, where = row.mesh.project(points)
    assert np.abs(closest - points).max() < 1e-12 * row.mesh.size
    same = where == facet  # a point on a shared side may be given to the neighbour, whose normal agrees only if smooth
    assert same.mean() > 0.99
    assert np.abs(found - normals)[same].max() < 1e-10  # 1e-12 of the size over a facet's 1/50 of it


def test_facet_normal_is_the_gradient_of_the_distance(row: Surfaced) -> None:
    """Exactly so where the foot of a point is inside a facet: distance is linear there."""
    mesh, rng = row.mesh, np.random.default_rng(2)
    points, _, facet = on_mesh(mesh, 200, rng)
    middles = mesh.vertices[mesh.faces[facet]].mean(axis=1)
    above = middles + 0.05 * (points - middles)  # well inside the facet
    step, normals = 1e-3 * np.sqrt(mesh.areas[facet]).min(), mesh.normals[facet]
    above += 3 * step * normals  # out of reach of the neighbours, as seen from a convex or a gently concave facet

    def distance(p: np.ndarray) -> np.ndarray:
        return np.linalg.norm(p - mesh.project(p)[0], axis=1)

    gradient = np.stack([(distance(above + step * e) - distance(above - step * e)) / (2 * step) for e in np.eye(3)], 1)
    assert np.abs(gradient - normals).max() < 1e-7  # 1e-12 of the size over a step of 1e-5 of it


@pytest.mark.parametrize("name", [name for name, row in BODIES.items() if row.analytic])
def test_smooth_mesh_is_within_the_chord_error_of_its_analytic_parent(name: str) -> None:
    """Angle e/R and distance e^2/6R, with the longest edge e and the tightest radius R.

    An edge is e^2/8R off its arc, the middle of an even triangle, e/sqrt(3) from its corners, e^2/6R.
    """
    mesh, body = BODIES[name].mesh, BODIES[name].analytic
    assert body is not None
    rng = np.random.default_rng(3)
    points = body.sample(2000, rng)
    closest, normals, _ = mesh.project(points + PLACE)
    corners = mesh.vertices[mesh.faces]
    edge, radius = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(), tightest_radius(body, rng)
    distance = np.linalg.norm(points + PLACE - closest, axis=1)
    angle = np.arccos(np.clip(np.einsum("nk,nk->n", normals, body.normals(points)), -1, 1))
    assert distance.max() < edge**2 / (6 * radius)
    assert angle.max() < edge / radius


def tightest_radius(body: Body, rng: np.random.Generator) -> float:
    """The smallest radius of curvature [m]: how fast the analytic normal turns between near points."""
    points = body.sample(20000, rng)
    near = body.on_ray(points + 1e-4 * body.radius * rng.normal(size=points.shape))
    turn = np.linalg.norm(body.normals(near) - body.normals(points), axis=1)
    return float((np.linalg.norm(near - points, axis=1) / turn).min())
