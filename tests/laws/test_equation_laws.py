"""Laws of surfaces with an equation, and of contacts on them."""

import numpy as np
import pytest
from numba import njit
from scipy.optimize import minimize

from claims.evidence.equations import orders
from palpate.contact import ROW, Locator, Status
from palpate.spatial.pose import Pose
from palpate.surfaces import Ellipsoid, EllipticCylinder, Surface, _equation
from palpate.surfaces._jit import register_choices
from palpate_lab.simulation.contacts import contact_wrenches, touch_wrenches
from tests.support.equations import EQUATIONS, POSE, Equation, R

NOISE = np.array([0.02] * 3 + [5e-4] * 3)
PITCHES = (0.0, 0.05 * R, 0.3 * R, R)
register_choices()  # of `_equation.evaluate`, which nothing else compiles here


@pytest.fixture(params=EQUATIONS.values(), ids=EQUATIONS.keys())
def row(request: pytest.FixtureRequest) -> Equation:
    return request.param


@njit
def compiled_evaluation(equation, table, points, out):
    for i in range(len(points)):
        _equation.evaluate(equation, table, points[i], out[i])


def touches(row: Equation, pitch: float, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points, normals = row.points(count, seed)
    rng = np.random.default_rng(seed)
    return points, normals, touch_wrenches(points, normals, rng, force=(2.0, 10.0), tan_theta=0.5, pitch=pitch)


def test_is_a_surface_through_its_points(row: Equation) -> None:
    assert isinstance(row.surface, Surface)
    points, normals = row.points(300, 0)
    gradient = row.surface.gradient(points)
    size = np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.abs(row.surface.value(points) / size[:, 0]).max() < 1e-12 * R
    assert np.abs(gradient / size - normals).max() < 1e-7  # central differences over 1e-6 R
    assert np.all(row.surface.value(row.surface.centre + 10 * row.surface.size * np.eye(3)) > 0)


def test_derivatives_are_those_of_the_value(row: Equation) -> None:
    points, step, surface = row.points(100, 1)[0] + 0.05 * R, 1e-6 * R, row.surface
    for known, found in ((surface.value, surface.gradient), (surface.gradient, surface.hessian)):
        slopes = [(known(points + step * e) - known(points - step * e)) / (2 * step) for e in np.eye(3)]
        assert np.abs(np.stack(slopes, -1) - found(points)).max() < 1e-6 * np.abs(found(points)).max()


def test_compiled_evaluation_is_its_numpy_twin(row: Equation) -> None:
    """Up to the factor that a form may have been divided by."""
    prepared = row.surface.prepared()
    middle = row.surface.box.mean(axis=0)
    unit = np.random.default_rng(2).uniform(-0.5, 0.5, (50, 3))
    out = np.empty((50, 10))
    compiled_evaluation(*prepared.arguments, unit, out)
    value, gradient, hessian = row.surface.evaluate(unit * prepared.scale + middle)
    flat = hessian[:, (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
    twin = np.c_[value, gradient * prepared.scale, flat * prepared.scale**2]
    factor = np.sum(out * twin) / np.sum(twin**2)
    assert factor > 0
    assert np.abs(out - factor * twin).max() < 1e-12 * np.abs(out).max()


def test_projection_is_the_closest_point_within_the_ends(row: Equation) -> None:
    surface, rng = row.surface, np.random.default_rng(3)
    cloud = row.points(5000, 4)[0]
    away = surface.centre + rng.normal(size=(100, 3)) * surface.size * rng.choice([0.3, 2.0], (100, 1))
    closest, normals, facets = surface.project(away)
    gradient = surface.gradient(closest)
    size = np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.abs(surface.value(closest) / size[:, 0]).max() < 1e-10 * R
    assert np.allclose(normals, gradient / size, rtol=0, atol=1e-9)
    assert np.all(facets == -1)
    own = surface.pose.inverse().apply(closest)
    assert np.all((own >= surface.ends[0] - 1e-9 * R) & (own <= surface.ends[1] + 1e-9 * R))
    distance = np.linalg.norm(away - closest, axis=1)
    sampled = np.linalg.norm(away[:, None] - cloud[None], axis=2).min(axis=1)
    assert np.all(distance < sampled + 1e-12)  # no sample is closer
    inside = np.all((own > surface.ends[0] + 1e-3 * R) & (own < surface.ends[1] - 1e-3 * R), axis=1)
    across = np.cross(away - closest, normals)
    assert np.abs(across[inside]).max() < 1e-8 * surface.size


def test_normal_is_the_gradient_of_the_distance(row: Equation) -> None:
    points, normals = row.points(100, 5)
    above, step = points + 0.02 * R * normals, 1e-4 * R

    def distance(p: np.ndarray) -> np.ndarray:
        return np.linalg.norm(p - row.surface.project(p)[0], axis=1)

    gradient = np.stack([(distance(above + step * e) - distance(above - step * e)) / (2 * step) for e in np.eye(3)], 1)
    own = row.surface.pose.inverse().apply(points)
    inside = np.all((own > row.surface.ends[0] + 0.01 * R) & (own < row.surface.ends[1] - 0.01 * R), axis=1)
    assert inside.mean() > 0.7
    assert np.abs(gradient - normals)[inside].max() < 1e-4  # third derivatives times step^2, and the paraboloid's apex


@pytest.mark.parametrize(
    ("name", "pitch"),
    [(name, pitch) for name, row in EQUATIONS.items() for pitch in (PITCHES if row.convex else PITCHES[:2])],
)
def test_a_wrench_made_at_a_point_is_located_there(name: str, pitch: float) -> None:
    """The one contact of a convex body, at any pitch; elsewhere one of the candidates, for what a finger can twist."""
    row = EQUATIONS[name]
    points, normals, wrenches = touches(row, pitch, 100, 6)
    locator = Locator(row.surface, friction=1.0, torsion=1.0)
    for point, normal, wrench in zip(points, normals, wrenches, strict=True):
        found = locator.candidates(wrench)
        assert len(found.point) == 1 or not row.convex or not row.closed
        at = np.argmin(np.linalg.norm(found.point - point, axis=1))
        assert np.linalg.norm(found.point[at] - point) < 1e-8 * R  # the fingertip's edge is ten times as sharp as R
        assert np.linalg.norm(found.normal[at] - normal) < 1e-6
        assert found.plausible[at]
    answer = locator.run(wrenches, sequential=False)
    assert answer.answered.all()


@pytest.mark.parametrize("name", [name for name, row in EQUATIONS.items() if row.closed and row.convex])
def test_every_wrench_has_an_answer_on_a_closed_convex_body(name: str) -> None:
    """At any pitch but none, even with the axis far off the body: grazing, and said to be implausible."""
    row = EQUATIONS[name]
    rng = np.random.default_rng(7)
    locator = Locator(row.surface, friction=1.0, torsion=1.0)
    for pitch in (0.1 * R, R, 10 * R):
        for _ in range(100):
            force, through = rng.normal(size=3), row.surface.centre + rng.normal(size=3) * row.surface.size
            wrench = np.r_[force, np.cross(through, force) + pitch * force]
            found = locator.candidates(wrench)
            assert len(found.point) == 1
            left = wrench[3:] - np.cross(found.point[0], force) - found.torque[0] * found.normal[0]
            assert np.abs(left).max() < 1e-8 * (np.linalg.norm(force) * row.surface.size + abs(found.torque[0]))
            assert found.normal[0] @ force < 0


def test_wrench_axis_meets_the_surface_where_the_line_does(row: Equation) -> None:
    """Torsion or not; where the line goes in first."""
    points, _, wrenches = touches(row, 0.0, 200, 8)
    wrenches = wrenches + np.concatenate([np.zeros((200, 3)), 0.3 * R * wrenches[:, :3]], axis=1)
    found = [Locator(row.surface, "wrench_axis", torsion=1.0).candidates(wrench) for wrench in wrenches]
    apart = [np.linalg.norm(f.point - p, axis=1).min() for f, p in zip(found, points, strict=True)]
    assert max(apart) < 1e-9 * R


def test_rigid_motion_moves_the_answer(row: Equation) -> None:
    _, _, wrenches = touches(row, 0.05 * R, 200, 9)
    move = Pose.from_rotation_vector((0.4, -1.1, 2.0), (0.05, -0.02, 0.11))
    matrix, covariance = move.wrench_matrix(), np.diag(NOISE**2)
    one = Locator(row.surface, noise=NOISE).run(wrenches, sequential=False)
    moved = Locator(row.surface.transformed(move), noise=NOISE)
    two = moved.run(wrenches @ matrix.T, matrix @ covariance @ matrix.T, sequential=False)
    assert np.array_equal(one.status, two.status)
    assert np.abs(move.apply(one.point) - two.point).max() < 1e-9 * R
    turned = move.rotation @ one.covariance @ move.rotation.T
    assert np.abs(turned - two.covariance).max() < 1e-6 * np.abs(one.covariance).max()


def test_a_mesh_converges_to_its_equation_at_second_order() -> None:
    """Soft finger on triangles of a quarter of the area errs by a quarter, but for the stretched ones at the poles."""
    assert np.abs(orders(1000)[0] - 2.0).max() < 0.25


def test_beyond_an_end_the_nearest_point_is_given_and_said_to_be_off() -> None:
    surface = EllipticCylinder(1.4 * R, 0.5 * R, 1.6 * R, upper=True, pose=POSE)
    beyond = np.array([0.3 * R, 1.9 * R, 0.0])
    beyond[2] = 0.5 * R * np.sqrt(1 - (beyond[0] / (1.4 * R)) ** 2)
    normal = np.array([beyond[0] / 1.4**2, 0.0, beyond[2] / 0.5**2])
    normal /= np.linalg.norm(normal)
    wrench = contact_wrenches(POSE.apply(beyond), POSE.rotate(normal), -3.0 * POSE.rotate(normal), np.array(0.0))
    answer = Locator(surface, noise=NOISE).run(wrench[None])
    assert answer.status[0] == Status.OFF_SURFACE
    own = POSE.inverse().apply(answer.point[0])
    assert np.allclose(own, [beyond[0], 1.6 * R, beyond[2]], rtol=0, atol=1e-7 * R)
    assert answer.residual[0] > 3.0


def test_off_a_closed_body_the_nearest_point_to_the_axis_is_given() -> None:
    """Against scipy's constrained minimum of the distance between a line and an ellipsoid."""
    body, rng = Ellipsoid((R, 0.7 * R, 0.5 * R)), np.random.default_rng(12)
    locator = Locator(body, noise=NOISE)
    for _ in range(20):
        force, through = rng.normal(size=3), rng.normal(size=3) * 3 * R
        force /= np.linalg.norm(force)
        answer = locator.run(np.r_[force, np.cross(through, force)][None])
        if answer.status[0] != Status.OFF_SURFACE:
            continue
        best = minimize(
            lambda q, f=force, a=through: np.linalg.norm(np.cross(q * body.axes - a, f)) / R,
            answer.point[0] / body.axes + 0.1 * rng.normal(size=3),
            constraints={"type": "eq", "fun": lambda q: q @ q - 1.0},
            options={"ftol": 1e-14, "maxiter": 500},
        )
        found = np.linalg.norm(np.cross(answer.point[0] - through, force)) / R
        assert abs(found - best.fun) < 1e-6


def test_rows_hold_what_rows_of_a_mesh_hold() -> None:
    row = EQUATIONS["ellipsoid"]
    _, _, wrenches = touches(row, 0.0, 5, 13)
    locator, out = Locator(row.surface, noise=NOISE), Locator.empty()
    answer = locator.run(wrenches, sequential=False)
    for i, wrench in enumerate(wrenches):
        locator.reset()
        locator(wrench, out)
        assert np.array_equal(out[ROW.point], answer.point[i])
        assert np.array_equal(out[ROW.covariance].reshape(3, 3), answer.covariance[i])
