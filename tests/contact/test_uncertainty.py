"""The covariance of the point: against finite differences of the located point, and against dice."""

import functools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from claims.evidence.covariance import CHI2_95, squared_distance
from palpate.contact import Locator
from palpate.spatial.pose import Pose
from palpate.surfaces import Mesh
from palpate.surfaces.analytic import Analytic
from palpate_lab.simulation.contacts import touch_wrenches
from palpate_lab.simulation.shapes import EllipsoidBody
from tests.support.bodies import PLACE, R, box, on_mesh
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
