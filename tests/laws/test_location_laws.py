"""Laws of location, over every surface: what is made at a point is found there, and nothing else about it matters."""

from collections.abc import Callable

import numpy as np
import pytest

from claims.evidence.laws import moved, shuffled, unchanged
from palpate.contact import Locator
from palpate.surfaces import Mesh
from palpate_lab.simulation.contacts import touch_wrenches
from tests.support.bodies import BODIES, R, Surfaced, on_mesh

NOISE = np.array([0.02] * 3 + [5e-4] * 3)
Change = Callable[..., tuple]


@pytest.fixture(params=BODIES.values(), ids=BODIES.keys())
def row(request: pytest.FixtureRequest) -> Surfaced:
    return request.param


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
