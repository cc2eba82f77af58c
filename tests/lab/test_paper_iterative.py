"""The iterative baseline: it finds the truth where it converges, and says where it must not be believed."""

import numpy as np
import pytest

import palpate
from palpate_lab.papers.iterative import fit_paraboloid, locate_iteratively
from palpate_lab.simulation import EllipsoidBody, contact_wrenches, touch_wrenches

R = 0.010
AXES = (R, 0.7 * R, 0.5 * R)


class Equation(EllipsoidBody):
    """With what the iteration wants besides."""

    size, centre = 2.5 * R, np.zeros(3)

    def hessian(self, points: np.ndarray) -> np.ndarray:
        """Constant, as of every quadric."""
        return np.broadcast_to(np.diag(2.0 / np.asarray(self.axes) ** 2), (len(points), 3, 3))


BODY = Equation(AXES)


def _touches(count: int, pitch: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    points = BODY.sample(count, rng)
    return points, touch_wrenches(points, BODY.normals(points), rng, pitch=pitch)


def test_a_start_in_the_middle_of_a_fitted_region_moves() -> None:
    """At x = 0 MINPACK bounds its first step by nothing: the unknowns must not be counted from there."""
    fitted = fit_paraboloid(palpate.Mesh.from_arrays(*BODY.mesh(5_000)), (0.0, 0.0, AXES[2]), 2e-3)
    point = BODY.on_ray(np.array([0.1, 0.1, 1.0]))
    wrench = contact_wrenches(point, BODY.normals(point), np.array([0.5, 0.0, -5.0]), np.array(1e-4))
    found = locate_iteratively(wrench, fitted, start=fitted.origin)
    assert found.status == palpate.Status.CONTACT
    assert np.linalg.norm(found.point - point) < 3e-5  # chords of the mesh, and quartic terms over 2 mm


@pytest.mark.parametrize("jacobian", ["analytic", "numeric"])
def test_a_wrench_made_at_a_point_is_found_there(jacobian: str) -> None:
    points, wrenches = _touches(40, 0.1 * R)
    found = [locate_iteratively(wrench, BODY, jacobian=jacobian, torsion=1.0) for wrench in wrenches]
    assert all(result.status == palpate.Status.CONTACT and result.converged for result in found)
    # 1e-14 asked of the solver, differences good to 1e-8 of a Newton step: 1e-9 m is far above both
    assert np.max(np.linalg.norm([result.point for result in found] - points, axis=1)) < 1e-9
    torques = [result.torque for result in found]
    expected = np.einsum("nk,nk->n", wrenches[:, 3:] - np.cross(points, wrenches[:, :3]), BODY.normals(points))
    np.testing.assert_allclose(torques, expected, atol=1e-9)  # 1e-9 m times 10 N, and its share of |F|


def test_it_answers_as_the_soft_finger_does() -> None:
    _, wrenches = _touches(20, 0.1 * R)
    mesh = palpate.Mesh.from_arrays(*BODY.mesh(20_000))
    ours = palpate.Locator(mesh, torsion=1.0).run(wrenches, sequential=False)
    theirs = [locate_iteratively(wrench, BODY, torsion=1.0) for wrench in wrenches]
    np.testing.assert_array_equal([int(e.status) for e in theirs], ours.status)
    # the mesh's chord error in angle is e/R = 0.03 and the torsion at most 0.1 R: a tenth of a millimetre is generous
    assert np.max(np.linalg.norm([e.point for e in theirs] - ours.point, axis=1)) < 1e-4


def test_a_mesh_is_touched_on_the_paraboloid_that_fits_it() -> None:
    points, wrenches = _touches(30, 0.05 * R)
    mesh = palpate.Mesh.from_arrays(*BODY.mesh(5_000))
    blunt = points[:, 2] ** 2 > (0.4 * R) ** 2  # where the curvature radius is several times the region
    for point, wrench in zip(points[blunt], wrenches[blunt], strict=True):
        found = locate_iteratively(wrench, fit_paraboloid(mesh, point, 1e-3), start=point, torsion=1.0)
        assert found.status == palpate.Status.CONTACT
        # quartic terms of the ellipsoid over 1 mm, r^4/(8 R^3), and the mesh's own chords: micrometres
        assert np.linalg.norm(found.point - point) < 3e-5


def test_a_corner_is_no_paraboloid() -> None:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * R
    from scipy.spatial import ConvexHull

    hull = ConvexHull(signs)
    box = palpate.Mesh.from_arrays(signs, hull.simplices)
    with pytest.raises(palpate.GeometryError, match="no paraboloid"):
        fit_paraboloid(box, (R, 0.9 * R, 0.9 * R), 0.5 * R)
    assert fit_paraboloid(box, (R, 0.0, 0.0), 0.3 * R).misfit < 1e-12
    with pytest.raises(palpate.GeometryError, match="must be positive"):
        fit_paraboloid(box, (R, 0.0, 0.0), 0.0)


def test_the_derivatives_of_the_fitted_paraboloid_are_differences_of_it() -> None:
    mesh = palpate.Mesh.from_arrays(*BODY.mesh(2_000))
    fitted = fit_paraboloid(mesh, (0.2 * R, 0.1 * R, 0.5 * R), 1.5e-3)
    at = np.array([[0.1 * R, 0.2 * R, 0.55 * R]])
    step = 1e-6
    moved = [at + sign * step * axis for axis in np.eye(3) for sign in (1, -1)]
    slope = np.array([fitted.value(a)[0] - fitted.value(b)[0] for a, b in zip(moved[::2], moved[1::2], strict=True)])
    np.testing.assert_allclose(fitted.gradient(at)[0], slope / (2 * step), atol=1e-8)  # exact up to rounding / step
    turn = [fitted.gradient(a)[0] - fitted.gradient(b)[0] for a, b in zip(moved[::2], moved[1::2], strict=True)]
    np.testing.assert_allclose(fitted.hessian(at)[0], np.array(turn) / (2 * step), rtol=1e-6, atol=1e-6)


def test_what_cannot_be_believed_is_said() -> None:
    top = np.array([0.0, 0.0, AXES[2]])
    press = contact_wrenches(top, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -5.0]), np.array(0.0))
    assert locate_iteratively(press, BODY).status == palpate.Status.CONTACT
    assert locate_iteratively(press, BODY, start=-top).status == palpate.Status.OFF_SURFACE  # it pulls there
    assert locate_iteratively(np.zeros(6), BODY).status == palpate.Status.NO_CONTACT
    assert locate_iteratively(np.full(6, np.nan), BODY).status == palpate.Status.INVALID
    twisted = press + np.array([0, 0, 0, 0, 0, 0.1])
    assert locate_iteratively(twisted, BODY).status == palpate.Status.IMPLAUSIBLE
    with pytest.raises(palpate.InputError, match="Jacobian"):
        locate_iteratively(press, BODY, jacobian="guessed")
