"""The covariance of the point against finite differences and dice, and the residual of a wrench, in deviations."""

import functools

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from claims.evidence.covariance import CHI2_95, squared_distance
from palpate.contact import Locator, Status
from palpate.spatial.pose import Pose
from palpate.surfaces import Mesh, plane
from palpate.surfaces.analytic import Analytic
from palpate_lab.simulation.contacts import touch_wrenches
from palpate_lab.simulation.shapes import EllipsoidBody
from tests.support.bodies import BODIES, PLACE, R, box, on_mesh
from tests.support.dice import mixed, rolled
from tests.support.equations import EQUATIONS

BODY = EllipsoidBody((R, 0.7 * R, 0.5 * R))
UNITS = np.array([np.outer(e, e) for e in np.eye(6)])
STEPS = np.array([1e-5] * 3 + [1e-7] * 3)  # N, N m: they move the point by 1e-7 m or less


@functools.cache
def ellipsoid(facets: int) -> Mesh:
    vertices, faces = BODY.mesh(facets)
    return Mesh.from_arrays(vertices + PLACE, faces)


@functools.cache
def flat() -> Mesh:
    vertices, faces = box()
    return Mesh.from_arrays(vertices + PLACE, faces)


def slopes(locator: Locator, wrench: np.ndarray) -> np.ndarray:
    """(6, 3): central differences of the located point by each component of the wrench."""
    both = [locator.run(wrench + sign * np.diag(STEPS), sequential=False).point for sign in (1, -1)]
    return (both[0] - both[1]) / (2 * STEPS[:, None])


def covariances(locator: Locator, wrench: np.ndarray) -> np.ndarray:
    """(6, 3, 3): the covariance of the point for a unit variance of each component alone."""
    return locator.run(np.tile(wrench, (6, 1)), 1e-12 * UNITS, sequential=False).covariance * 1e12  # no edge is near


@functools.cache
def surface(name: str) -> Mesh | Analytic:
    """A surface with an equation, or a box whose facets lie at 45 degrees to all axes."""
    turned = Pose.from_rotation_vector(Rotation.from_euler("zx", [45, 45], degrees=True).as_rotvec(), PLACE)
    return flat().transformed(turned) if name == "box" else EQUATIONS[name].surface


@pytest.mark.parametrize("method", ["soft_finger", "wrench_axis"])
@pytest.mark.parametrize("name", ["box", "ellipsoid", "fingertip", "paraboloid"])
def test_a_place_is_as_sure_as_a_wrench_whose_noises_belong_together(name: str, method: str) -> None:
    """The answer itself, for wrenches that are off a little: its derivative is under test, not the place."""
    body, rng = surface(name), np.random.default_rng(4)
    if isinstance(body, Mesh):
        points, normals, _ = on_mesh(body, 12, rng)
    else:
        points, normals = EQUATIONS[name].points(12, 4)
    wrenches = touch_wrenches(points, normals, rng, force=(2.0, 8.0), tan_theta=0.4, pitch=0.05 * R)
    locator, own = Locator(body, method=method, friction=2.0, torsion=1.0), mixed(np.repeat([2e-3, 5e-5], 3), 5)
    answer = locator.run(wrenches, 1e-6 * own, sequential=False)  # so small that no edge is near
    assert answer.answered.all()

    def place(off: np.ndarray, near: np.ndarray, wrench: np.ndarray) -> np.ndarray:
        return locator.run((wrench + off)[None], sequential=False, previous=near).point[0]

    for wrench, near, stated in zip(wrenches, answer.point, answer.covariance, strict=True):
        found = rolled(lambda off, near=near, wrench=wrench: place(off, near, wrench), own)
        assert np.abs(1e6 * stated - found).max() < 1e-4 * np.abs(found).max()


@pytest.mark.parametrize("method", ["soft_finger", "wrench_axis"])
def test_on_a_smooth_mesh_too_within_the_turn_of_its_normals(method: str) -> None:
    """The covariance lies across the interpolated normal, the located point moves in the facet.

    They differ by the angle between, e/R: less and less, mesh by finer mesh.
    """
    rng = np.random.default_rng(1)
    worst = []
    points = BODY.sample(40, rng)
    wrenches = touch_wrenches(points + PLACE, BODY.normals(points), rng, force=(2.0, 8.0), tan_theta=0.4, pitch=0.2 * R)
    for facets in (500, 8000):
        locator = Locator(ellipsoid(facets), method=method, friction=3.0, torsion=0.1)
        errors = []
        for wrench in wrenches:
            steps, found = slopes(locator, wrench), covariances(locator, wrench)
            expected = np.einsum("ni,nj->nij", steps, steps)
            scale = np.trace(expected, axis1=1, axis2=2).max()
            errors.append(np.abs(found - expected).max() / scale)
        worst.append(np.median(errors))  # a step may cross to another facet, a kink for the wrench axis
    assert worst[0] < 2 * ellipsoid(500).edge / R  # both factors of dp dp^T turn
    assert worst[1] < 0.4 * worst[0]  # a quarter, for edges of a quarter


@pytest.mark.parametrize("method", ["soft_finger", "wrench_axis"])
def test_it_is_of_rank_two_symmetric_and_across_the_normal(method: str) -> None:
    rng = np.random.default_rng(2)
    points = BODY.sample(200, rng)
    wrenches = touch_wrenches(points + PLACE, BODY.normals(points), rng, force=(2.0, 8.0), tan_theta=0.5, pitch=0.2 * R)
    root = rng.normal(size=(6, 6)) * np.array([0.02] * 3 + [5e-4] * 3)
    locator = Locator(ellipsoid(2000), method=method, friction=2.0, torsion=0.1, noise=root.T @ root)
    answer = locator.run(wrenches, sequential=False)
    assert answer.answered.all()
    scale = np.trace(answer.covariance, axis1=1, axis2=2)[:, None, None]
    assert np.abs((answer.covariance - np.swapaxes(answer.covariance, 1, 2)) / scale).max() < 1e-14
    across = np.einsum("nij,nj->ni", answer.covariance, answer.normal) / scale[:, 0]
    assert np.abs(across).max() < 1e-14
    values = np.linalg.eigvalsh(answer.covariance / scale)
    assert np.abs(values[:, 0]).max() < 1e-14
    assert values[:, 1].min() > 1e-8


@pytest.mark.parametrize("pitch", [0.0, 0.2 * R])
def test_coverage_of_the_95_percent_ellipse_and_the_mean_squared_distance(pitch: float) -> None:
    """2000 draws: a share of 0.95 to 0.005 and a mean of 2 to 0.045 (one deviation of each); three are allowed.

    The truth is the analytic point of each draw's own touch, and the mesh adds what it is coarse (e^2/R = 9 um of 100).
    """
    rng = np.random.default_rng(3)
    points = BODY.sample(2000, rng)
    normals = BODY.normals(points)
    wrenches = touch_wrenches(points + PLACE, normals, rng, force=(4.0, 10.0), tan_theta=0.4, pitch=pitch)
    noise = np.array([0.01] * 3 + [2e-4] * 3)
    noisy = wrenches + rng.normal(size=wrenches.shape) * noise
    answer = Locator(ellipsoid(8000), friction=3.0, torsion=0.1, noise=noise).run(noisy, sequential=False)
    assert answer.answered.all()
    squared = squared_distance(answer, points + PLACE)
    assert abs(np.mean(squared < CHI2_95) - 0.95) < 0.015
    assert abs(np.minimum(squared, 20).mean() - 2) < 0.14


NOISE = np.array([0.02] * 3 + [5e-4] * 3)
FRICTION, TORSION = 0.5, 1e-3


def made(x: np.ndarray) -> np.ndarray:
    """Any wrench within the bounds, from eight free numbers: direction, log of the grip, slip in the cone, torsion."""
    point = BODY.on_ray(x[:3])
    normal = BODY.normals(point)
    grip = np.exp(x[3])
    side = x[4:7] - normal * (x[4:7] @ normal)
    length = np.linalg.norm(side)
    force = -grip * normal + FRICTION * grip * np.tanh(length) / max(length, 1e-12) * side
    return np.concatenate([force, np.cross(point, force) + TORSION * grip * np.tanh(x[7]) * normal])


def nearest_by_minimisation(wrench: np.ndarray, start: np.ndarray, rng: np.random.Generator) -> float:
    def square(x: np.ndarray) -> float:
        return float(np.sum(((made(x) - wrench) / NOISE) ** 2))

    grip = np.log(np.linalg.norm(wrench[:3]))
    starts = [np.concatenate([start / R + 0.3 * rng.normal(size=3), [grip], rng.normal(size=3), [0]]) for _ in range(3)]
    return min(float(np.sqrt(minimize(square, x0, method="BFGS").fun)) for x0 in starts)


def test_outside_the_bounds_it_is_the_distance_to_the_nearest_wrench_within() -> None:
    """Against a direct minimisation over the analytic body.

    5 %: where both bounds are met the scheme stops up to 4 % above the least. 0.2 deviations: the mesh lies up to
    e^2/8R = 9 um inside the body, and one deviation of the torque, 0.5 mN m over 10 N, moves the point by 50 um.
    """
    rng = np.random.default_rng(0)
    points = BODY.sample(60, rng)
    wrenches = touch_wrenches(points, BODY.normals(points), rng, force=(2.0, 10.0), tan_theta=1.5, pitch=0.3 * R)
    mesh = Mesh.from_arrays(*BODY.mesh(5000))
    answer = Locator(mesh, noise=NOISE, friction=FRICTION, torsion=TORSION).run(wrenches, sequential=False)
    outside = np.flatnonzero(answer.status == Status.IMPLAUSIBLE)
    assert len(outside) > 20
    truth = [nearest_by_minimisation(wrenches[i], points[i], rng) for i in outside[:5]]
    assert np.allclose(answer.residual[outside[:5]], truth, rtol=0.05, atol=0.2)


def test_inside_the_bounds_it_is_zero_and_outside_positive() -> None:
    rng = np.random.default_rng(1)
    points = BODY.sample(300, rng)
    normals = BODY.normals(points)
    mesh = Mesh.from_arrays(*BODY.mesh(1280))
    locator = Locator(mesh, noise=NOISE, friction=FRICTION, torsion=TORSION)
    inside = touch_wrenches(points, normals, rng, force=(2.0, 10.0), tan_theta=0.3, pitch=0.5 * TORSION)
    answer = locator.run(inside, sequential=False)
    assert answer.answered.all()
    assert np.all(answer.residual == 0)
    outside = touch_wrenches(points, normals, rng, force=(2.0, 10.0), tan_theta=1.5, pitch=0.3 * R)
    answer = locator.run(outside, sequential=False)
    implausible = answer.status == Status.IMPLAUSIBLE
    assert np.all(answer.residual[implausible] > 3.0)  # beyond what noise explains
    assert np.all(answer.residual[answer.answered] <= 3.0)


def test_it_scales_with_the_noise() -> None:
    rng = np.random.default_rng(2)
    points = BODY.sample(50, rng)
    wrenches = touch_wrenches(points, BODY.normals(points), rng, force=(2.0, 10.0), tan_theta=1.5, pitch=0.3 * R)
    mesh = Mesh.from_arrays(*BODY.mesh(1280))
    one, two = (
        Locator(mesh, noise=scale * NOISE, friction=FRICTION, torsion=TORSION, on=0.1).run(wrenches, sequential=False)
        for scale in (1.0, 0.5)
    )
    assert np.allclose(2 * one.residual, two.residual, rtol=1e-6, atol=0, equal_nan=True)


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_pressing_harder_carries_more_torsion(turn: float) -> None:
    """On a plane |tau| <= c p bounds by a line; x beyond it are x / sqrt(var tau + c^2 var p), two equal parts here."""
    excess, pressed, bound, deviation = 5e-3, 5.0, 5e-3, 1e-3
    noise = np.array([deviation / bound] * 3 + [deviation] * 3)
    wrench = np.array([0.0, 0.0, -pressed, 0.0, 0.0, turn * (bound * pressed + excess)])
    answer = Locator(plane((0, 0, 0), (0, 0, 1), R), noise=noise, torsion=bound).run(wrench, sequential=False)
    assert answer.residual == pytest.approx(excess / (np.sqrt(2.0) * deviation), rel=1e-6)


def off_surface(mesh: Mesh, rng: np.random.Generator, count: int) -> np.ndarray:
    """Wrenches that press the surface from above and pass beside it."""
    force = np.array([0, 0, -5.0]) + rng.normal(size=(count, 3))
    turn = rng.uniform(0, 2 * np.pi, count)
    beside = mesh.centre + 2.5 * R * np.c_[np.cos(turn), np.sin(turn), np.zeros(count)]
    return np.concatenate([force, np.cross(beside, force)], axis=1)


def nearest_to_axis_by_brute_force(mesh: Mesh, wrench: np.ndarray) -> float:
    """Least distance between the line of action and the sides of the facets that face the force; it misses them all."""
    force, moment = wrench[:3], wrench[3:]
    f, axis = force / np.linalg.norm(force), np.cross(force, moment) / (force @ force)
    corners = mesh.vertices[mesh.faces[mesh.normals @ f < 0]]
    across = np.eye(3) - np.outer(f, f)
    start, end = (corners - axis) @ across, (np.roll(corners, -1, axis=1) - axis) @ across
    side = end - start
    along = np.clip(-np.sum(start * side, axis=2) / np.maximum(np.sum(side * side, axis=2), 1e-30), 0, 1)
    return float(np.linalg.norm(start + along[..., None] * side, axis=2).min())


@pytest.mark.parametrize("name", ["open patch", "plane"])
def test_off_the_surface_the_point_nearest_to_the_axis_is_given(name: str) -> None:
    mesh, rng = BODIES[name].mesh, np.random.default_rng(3)
    wrenches = off_surface(mesh, rng, 60)
    answer = Locator(mesh, noise=NOISE).run(wrenches, sequential=False)
    assert np.all(answer.status == Status.OFF_SURFACE)
    assert np.abs(mesh.project(answer.point)[0] - answer.point).max() < 1e-12
    for point, wrench in zip(answer.point, wrenches, strict=True):
        force = wrench[:3]
        distance = np.linalg.norm(np.cross(force, wrench[3:] - np.cross(point, force))) / (force @ force)
        assert distance == pytest.approx(nearest_to_axis_by_brute_force(mesh, wrench), rel=1e-9)


def test_off_the_surface_the_residual_is_the_least_change_of_the_wrench_that_puts_it_there() -> None:
    """Linear least squares over force and torsion at the given point: W' = (F, p x F + tau n), weighed by the noise."""
    mesh, rng = plane(PLACE, (0.1, -0.2, 1.0), 0.8 * R), np.random.default_rng(4)
    wrenches = off_surface(mesh, rng, 40)
    answer = Locator(mesh, noise=NOISE).run(wrenches, sequential=False)
    for i in range(40):
        basis = np.zeros((6, 4))
        basis[:3, :3] = np.eye(3)
        basis[3:, :3] = np.cross(answer.point[i], np.eye(3)).T
        basis[3:, 3] = answer.normal[i]
        left = np.linalg.lstsq(basis / NOISE[:, None], wrenches[i] / NOISE, rcond=None)[1]
        assert answer.residual[i] == pytest.approx(float(np.sqrt(left[0])), rel=1e-6)


def test_a_force_that_only_pulls_on_a_plane_has_no_point() -> None:
    square = plane((0, 0, 0), (0, 0, 1), R)
    answer = Locator(square, noise=NOISE).run(np.array([[0, 0, 5.0, 0, 0, 0], [5.0, 0, 0, 0, 0, 0]]))
    assert answer.status.tolist() == [Status.OFF_SURFACE] * 2
    assert np.isnan(answer.point).all()
    assert np.array_equal(answer.force[0], [0, 0, 5.0])
