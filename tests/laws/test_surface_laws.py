"""Laws of every surface: projection and normals, and location of what was made at a point."""

from collections.abc import Callable

import numpy as np
import pytest

from claims.evidence.laws import moved, shuffled, unchanged
from palpate.contact import Locator
from palpate.surfaces import Mesh
from palpate_lab.simulation.contacts import touch_wrenches
from palpate_lab.simulation.shapes import Body
from tests.support.bodies import BODIES, PLACE, R, Surfaced, on_mesh


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


NOISE = np.array([0.02] * 3 + [5e-4] * 3)
Change = Callable[..., tuple]


def touches(mesh: Mesh, pitch: float, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    points, normals, _ = on_mesh(mesh, count, rng)
    return points, normals, touch_wrenches(points, normals, rng, force=(2.0, 10.0), tan_theta=0.5, pitch=pitch)


@pytest.mark.parametrize(
    ("method", "pitch"),
    [("soft_finger", 0.0), ("soft_finger", 0.05 * R), ("soft_finger", 0.3 * R), ("wrench_axis", 0.0)],
)
def test_a_wrench_made_at_a_point_is_located_there(row: Surfaced, method: str, pitch: float) -> None:
    """Among the candidates, to 1e-9 of the body; the wrench axis only claims it without torsion."""
    points, normals, wrenches = touches(row.mesh, pitch, 100, 0)
    locator = Locator(row.mesh, method=method, friction=1.0, torsion=1.0)
    for point, normal, wrench in zip(points, normals, wrenches, strict=True):
        found = locator.candidates(wrench)
        at = np.argmin(np.linalg.norm(found.point - point, axis=1))
        assert np.linalg.norm(found.point[at] - point) < 1e-9 * row.mesh.size
        assert np.linalg.norm(found.normal[at] - normal) < 1e-7  # it turns by up to 1 in 1/50 of the body
        assert found.plausible[at]
        torsion = (wrench[3:] - np.cross(point, wrench[:3])) @ normal
        assert abs(found.torque[at] - torsion) < 1e-9 * 10 * row.mesh.size  # of up to 10 N on the body's size


def test_every_candidate_makes_the_wrench(row: Surfaced) -> None:
    """M - p x F - tau n = 0, with the point on the surface: random wrenches near the body, not made at it."""
    rng, mesh = np.random.default_rng(4), row.mesh
    locator = Locator(mesh, friction=1.0, torsion=1.0)
    for pitch in (0.0, 0.3 * R, R, 3 * R):
        seen = 0
        for _ in range(100):
            force, through = rng.normal(size=3), mesh.centre + rng.normal(size=3) * 0.15 * mesh.size
            wrench = np.concatenate([force, np.cross(through, force) + pitch * force])
            found = locator.candidates(wrench)
            torque = found.torque
            left = wrench[3:] - np.cross(found.point, force) - torque[:, None] * found.normal
            scale = np.linalg.norm(force) * mesh.size + np.abs(torque)[:, None]
            assert np.all(np.abs(left) < 1e-9 * scale)
            assert np.all(found.normal @ force < 0)  # it presses
            assert np.allclose(torque * (found.normal @ force), force @ wrench[3:], rtol=1e-7, atol=1e-12)
            if len(found.point):
                apart = np.linalg.norm(mesh.project(found.point)[0] - found.point, axis=1)
                assert apart.max() < 1e-9 * mesh.size
            seen += len(found.point)
        assert seen > 0  # the law was not kept for lack of candidates


@pytest.mark.parametrize("change", [moved, shuffled])
def test_rigid_motion_moves_the_answer_and_the_order_of_facets_does_not(row: Surfaced, change: Change) -> None:
    """But for roundings of 1e-9 of the body; covariances to 1e-6 (they carry curvature, a difference)."""
    mesh, rng = row.mesh, np.random.default_rng(5)
    _, _, wrenches = touches(mesh, 0.3 * R, 200, 1)
    found = unchanged(mesh, wrenches, *change(mesh, wrenches, rng))
    assert (found.lost, found.status) == (0, 0)
    assert found.gap < 1e-9 * mesh.size
    assert found.normal < 1e-7
    assert found.covariance < 1e-6


def test_scaling_of_units_scales_the_answer(row: Surfaced) -> None:
    """Lengths in millimetres, torques in N mm: only the numbers change."""
    mesh = row.mesh
    _, _, wrenches = touches(mesh, 0.3 * R, 200, 3)
    large = Mesh(mesh.vertices * 1e3, mesh.faces, mesh.corner_normals, mesh.crease)
    scale = np.array([1.0] * 3 + [1e3] * 3)
    one = Locator(mesh, noise=NOISE, torsion=5e-3).run(wrenches)
    two = Locator(large, noise=NOISE * scale, torsion=5.0).run(wrenches * scale)
    assert np.array_equal(one.status, two.status)
    assert np.abs(one.point * 1e3 - two.point).max() < 1e-9 * large.size
    assert np.abs(one.covariance * 1e6 - two.covariance).max() < 1e-6 * np.abs(two.covariance).max()
    implausible = one.residual > 0
    assert np.allclose(one.residual[implausible], two.residual[implausible], rtol=1e-3)  # an iteration's last figures
