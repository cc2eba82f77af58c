"""The pose of a surface from touches: right within its own covariance, and honest about what it cannot see."""

from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.calibration._touch_evidence import KnownPoints, _scale, fit, moved, offset
from palpate.calibration.mounting import Mounting, Spreads, identify_mounting
from palpate.calibration.presses import find_presses
from palpate.calibration.touch_error import spread_in_time, touch_error
from palpate.errors import InputError, NotIdentifiable
from palpate.spatial.pose import Pose
from palpate.surfaces import Mesh
from palpate_lab.simulation.contacts import contact_wrenches, directed_forces, touch_wrenches
from palpate_lab.simulation.shapes import Body, EllipsoidBody

BODY = EllipsoidBody((0.03, 0.0125, 0.02))
NOMINAL = Pose(np.eye(3), np.array([0.0, 0.0, 0.085]))
TRUE = Pose.from_rotation_vector(np.array([0.02, -0.01, 0.03]), np.array([0.001, -0.0005, 0.0862]))
NOISE = np.array([0.002] * 3 + [1e-4] * 3)  # N, N m: 0.02 N and 1 mN m averaged over half a second at 200 Hz
AXES = {f"{kind} {axis} of the surface" for kind in ("rotation about", "translation along") for axis in "xyz"}


identify = partial(identify_mounting, initial=NOMINAL)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return Mesh.from_arrays(*BODY.mesh(2000))


def sensed(wrenches: np.ndarray, rng: np.random.Generator | None = None, pose: Pose = TRUE) -> np.ndarray:
    """Wrenches of the surface's frame as the sensor reads them."""
    noise = 0.0 if rng is None else rng.normal(size=wrenches.shape) * NOISE
    return wrenches @ pose.wrench_matrix().T + noise


def pressed(points: np.ndarray, rng: np.random.Generator, body: Body = BODY) -> np.ndarray:
    return touch_wrenches(points, body.normals(points), rng, force=(2.0, 8.0), tan_theta=0.4, pitch=1e-3)


def error(mounting: Mounting, true: Pose = TRUE) -> np.ndarray:
    """The xi of true = exp(xi) estimate, to first order in its rotation."""
    turn = true.rotation @ mounting.pose.rotation.T
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), true.translation - turn @ mounting.pose.translation])


def test_exact_touches_give_the_exact_pose(mesh: Mesh) -> None:
    rng = np.random.default_rng(0)
    points = BODY.sample(12, rng)
    # without torsion nothing is left over
    wrenches = contact_wrenches(points, BODY.normals(points), pressed(points, rng)[:, :3], np.zeros(12))
    found = identify(sensed(wrenches), mesh, points=points, spreads=Spreads(placement=1e-6))
    # the prior draws by (posterior / prior)^2, about (1e-5 m / 1e-2 m)^2 of a millimetre
    assert np.abs(error(found)).max() < 1e-7
    assert set(found.observable) == AXES
    assert found.unobservable == ()


def test_errors_are_as_large_as_the_covariance_says(mesh: Mesh) -> None:
    squares, trials = [], 40
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        points = BODY.sample(10, rng)
        marks = points + rng.normal(0.0, 0.4e-3, points.shape)
        normal = BODY.normals(points)
        wrenches = pressed(points, rng)
        wrenches[:, 3:] -= np.cross(points, wrenches[:, :3])  # its torsion, replaced by one from the stated prior
        torsion = rng.normal(0.0, 2e-3, 10) * np.linalg.norm(wrenches[:, :3], axis=1)
        wrenches = contact_wrenches(points, normal, wrenches[:, :3], torsion)
        found = identify(sensed(wrenches, rng), mesh, points=marks, noise=NOISE, spreads=Spreads(placement=0.4e-3))
        squares.append(error(found) @ np.linalg.solve(found.covariance, error(found)))
    # chi-square with 6 degrees of freedom: a mean of 6, known to sqrt(12 / 40) = 0.55; three of these
    assert np.mean(squares) == pytest.approx(6.0, abs=1.6)


def test_jacobian_is_the_slope_of_the_residual() -> None:
    rng = np.random.default_rng(1)
    points = BODY.sample(5, rng)
    wrenches, spreads = sensed(pressed(points, rng)), Spreads(placement=1e-3)
    evidence = KnownPoints(wrenches, np.zeros((5, 6, 6)), spreads, points, BODY.normals(points))
    pose, step = moved(TRUE, np.full(6, 0.01)), 1e-6
    slopes = [
        (evidence.residual(moved(pose, e)) - evidence.residual(moved(pose, -e))) / (2 * step) for e in np.eye(6) * step
    ]
    # N m over rad or m, about 8; step^2 of the sine and rounding 1e-16 * 1 / 1e-6 are both below 1e-9
    assert np.allclose(np.stack(slopes, axis=2), evidence.jacobian(pose), rtol=0, atol=1e-8)


def test_turning_the_sensor_turns_the_answer(mesh: Mesh) -> None:
    rng = np.random.default_rng(2)
    points = BODY.sample(8, rng)
    wrenches = sensed(pressed(points, rng), rng)
    turn = Pose.from_rotation_vector(np.array([0.5, -1.1, 0.4]), np.array([0.1, -0.05, 0.2]))
    isotropic = np.diag([1e-6] * 6)
    there = turn.wrench_matrix() @ isotropic @ turn.wrench_matrix().T
    first = identify(wrenches, mesh, points=points, noise=isotropic)
    second = identify(
        sensed(wrenches, pose=turn), mesh, initial=turn @ NOMINAL, points=points, noise=(there + there.T) / 2
    )
    # both fits stop within 1e-5 standard deviations (about 1e-4 rad, 1e-4 m) of the optimum
    assert np.abs(offset(turn @ first.pose, second.pose)).max() < 1e-8
    assert first.unobservable == second.unobservable


@pytest.mark.parametrize("crossed", [[], [4], [1, 4]])
def test_crossed_marks_are_named_and_left_out(mesh: Mesh, crossed: list[int]) -> None:
    rng = np.random.default_rng(3)
    points = BODY.sample(12, rng)
    marks = points.copy()
    marks[crossed] = BODY.on_ray(-points[crossed])
    wrenches = sensed(pressed(points, rng), rng)
    wrenches[7] = np.nan
    found = identify(wrenches, mesh, points=marks, noise=NOISE, labels=list("abcdefghijkl"))
    assert found.touches.tolist() == [k for k in range(12) if k not in (*crossed, 7)]
    left = {note[0] for note in found.notes if "is left out" in note}
    assert left == {"h", *("abcdefghijkl"[k] for k in crossed)}
    assert np.abs(error(found)[3:]).max() < 2e-3


def test_marks_off_the_surface_are_said(mesh: Mesh) -> None:
    rng = np.random.default_rng(4)
    points = BODY.sample(6, rng)
    found = identify(sensed(pressed(points, rng)), mesh, points=points * 1.3)
    assert any("off the surface" in note for note in found.notes)


def test_parallel_forces_do_not_see_along_themselves(mesh: Mesh) -> None:
    rng = np.random.default_rng(5)
    points = BODY.on_ray(np.abs(rng.normal(size=(10, 3))))
    force = np.tile([0.0, 0.0, -5.0], (10, 1))
    wrenches = contact_wrenches(points, BODY.normals(points), force, np.zeros(10))
    found = identify(sensed(wrenches, rng), mesh, points=points, noise=NOISE)
    assert found.unobservable == ("translation along z of the surface",)
    along = TRUE.rotation[:, 2]  # there the initial pose and its prior of 10 mm stand
    assert abs(along @ (found.pose.translation - NOMINAL.translation)) < 1e-3
    spread = along @ found.position_covariance @ along
    assert np.sqrt(spread) == pytest.approx(0.01, rel=0.1)


def test_marks_on_one_line_do_not_see_the_turn_about_it() -> None:
    rng = np.random.default_rng(6)
    plate = Mesh.from_arrays(
        np.array([[-0.05, -0.05, 0], [0.05, -0.05, 0], [0.05, 0.05, 0], [-0.05, 0.05, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    points = np.stack([np.linspace(-0.03, 0.03, 8), np.zeros(8), np.zeros(8)], axis=1)
    wrenches = touch_wrenches(points, np.tile([0.0, 0.0, 1.0], (8, 1)), rng, force=(2.0, 8.0))
    found = identify(sensed(wrenches, rng), plate, points=points, noise=NOISE)
    assert found.unobservable == ("rotation about x of the surface",)


def test_nothing_seen_is_refused_with_what_is_missing(mesh: Mesh) -> None:
    with pytest.raises(NotIdentifiable, match="at least three marks") as refusal:
        identify(np.full((4, 6), np.nan), mesh, points=np.zeros((4, 3)))
    assert set(refusal.value.missing) == AXES
    with pytest.raises(NotIdentifiable):  # a touch so light that the noise drowns it
        identify(np.full((1, 6), 1e-4), mesh, points=np.zeros((1, 3)), noise=NOISE)


def _free(body: Body, count: int, friction: float, rng: np.random.Generator) -> np.ndarray:
    """Touches anywhere, their tangential force scattered as the prior expects."""
    points = body.sample(count, rng)
    normals = body.normals(points)
    drag = rng.normal(0.0, friction, (2, count))
    forces = directed_forces(normals, rng.uniform(2.0, 8.0, count), np.hypot(*drag), np.arctan2(*drag))
    return contact_wrenches(points, normals, forces, rng.normal(0.0, 1e-3, count) * np.linalg.norm(forces, axis=1))


def test_touches_anywhere_place_the_surface_within_the_covariance(mesh: Mesh) -> None:
    squares, trials = [], 12
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        wrenches = sensed(_free(BODY, 12, 0.05, rng), rng)
        found = identify(wrenches, mesh, noise=NOISE, spreads=Spreads(friction=0.05, torsion=1e-3))
        assert found.unobservable == ()
        squares.append(error(found) @ np.linalg.solve(found.covariance, error(found)))
    # a mean of 6, known to sqrt(12 / 12) = 1; three of these
    assert np.mean(squares) == pytest.approx(6.0, abs=3.0)


@pytest.mark.parametrize(
    ("axes", "blind"),
    [
        ((0.0125, 0.0125, 0.03), ("rotation about z of the surface",)),
        ((0.02, 0.02, 0.02), tuple(f"rotation about {axis} of the surface" for axis in "xyz")),
    ],
)
def test_a_turn_that_changes_nothing_is_named_and_stays(
    axes: tuple[float, float, float], blind: tuple[str, ...]
) -> None:
    rng = np.random.default_rng(7)
    body = EllipsoidBody(axes)
    wrenches = sensed(_free(body, 30, 0.1, rng), rng)
    found = identify(wrenches, Mesh.from_arrays(*body.mesh(2000)), noise=NOISE, spreads=Spreads(friction=0.1))
    assert found.unobservable == blind


def test_the_offset_between_two_poses_is_the_step_that_was_taken() -> None:
    turn, shift = np.array([0.2, -0.1, 0.3]), np.array([0.01, 0.02, -0.03])
    start = Pose.from_rotation_vector((0.4, 0.5, -0.6), (0.1, 0.0, 0.2))
    turned = Pose.from_rotation_vector(tuple(turn), (0.0, 0.0, 0.0)).rotation @ start.rotation
    there = Pose(turned, start.translation + shift)
    np.testing.assert_allclose(offset(start, there), [*turn, *shift], atol=1e-12)


def test_the_scale_of_distances_is_their_deviation_where_it_is_more_than_one() -> None:
    steps = np.random.default_rng(6).normal(size=(20_000, 3))
    assert _scale(np.linalg.norm(2.0 * steps, axis=1)) == pytest.approx(2.0, rel=0.02)
    assert _scale(np.linalg.norm(0.5 * steps, axis=1)) == 1.0


def test_a_far_touch_pulls_no_harder_the_further_it_is() -> None:
    """Huber: three deviations' worth at 20 of them as at 40; its direction turns with the pose, by a few percent."""
    rng = np.random.default_rng(14)
    points = BODY.sample(12, rng)
    normals = BODY.normals(points)
    wrenches = sensed(contact_wrenches(points, normals, pressed(points, rng)[:, :3], np.zeros(12)))

    def pulled(far: float) -> np.ndarray:
        marks = points.copy()
        marks[4] += far * np.array([1.0, 0.0, 0.0])
        evidence = KnownPoints(wrenches, np.zeros((12, 6, 6)), Spreads(placement=1e-3), marks, normals)
        return offset(TRUE, fit(evidence, NOMINAL)[0])

    near, far = pulled(0.02), pulled(0.04)
    assert np.linalg.norm(near[3:]) > 1e-5  # it does pull
    assert np.linalg.norm(far - near) < 0.1 * np.linalg.norm(near)


def drifting(rng: np.random.Generator, count: int, lasting: float) -> np.ndarray:
    """Shifts (count, 3) of variance 1 and correlation exp(-|k - l| / lasting)."""
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    return np.linalg.cholesky(np.exp(-apart / lasting)) @ rng.normal(size=(count, 3))


@pytest.mark.parametrize(("count", "drift"), [(40, 0.0), (40, 1e-3), (400, 1e-3)])
def test_jitter_and_drift_of_touches_are_found_as_drawn(count: int, drift: float) -> None:
    """Of residuals from a fit of an offset, jitter and drift as drawn: both, or no drift."""
    rng, found = np.random.default_rng(12), list[tuple[float, float]]()
    slopes = np.concatenate([1e-2 * rng.normal(size=(count, 2, 3)), np.tile(np.eye(3)[:2], (count, 1, 1))], axis=2)
    for _ in range(20):
        errors = 0.5e-3 * rng.normal(size=(count, 2)) + drift * drifting(rng, count, count / 8.0)[:, :2]
        error = touch_error(errors - errors.mean(axis=0), slopes, np.full(count, 0.3e-3**2))
        found.append((error.jitter, error.drift))
    jitter, drifts = np.sqrt(np.mean(np.square(found), axis=0))
    assert jitter == pytest.approx(0.4e-3, rel=0.3)  # 0.5 mm less the noise of 0.3 mm; a brief drift is like jitter
    assert drifts < 0.1e-3 if drift == 0.0 else 0.7 * drift < drifts < 2.0 * drift  # 8 times its length tell it roughly


@pytest.mark.parametrize("jitter", [0.3e-3, 2.6e-3])
def test_three_touches_believe_no_errors_smaller_than_a_finger_makes(mesh: Mesh, jitter: float) -> None:
    """Of 100 poses, 95 +- 7 lie in the 95 % ellipsoid if touches err by 2.6 mm; more if they err less."""
    inside = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        points = BODY.sample(3, rng)
        wrenches = pressed(points + jitter * rng.normal(size=points.shape), rng)
        found = identify(sensed(wrenches, rng), mesh, points=points, noise=NOISE)
        inside += float(error(found) @ np.linalg.solve(found.covariance, error(found))) < 12.59
        assert "fewer than 4 touches" in found.notes[0]
    assert inside >= 88


def test_a_drift_between_halves_is_in_the_covariance(mesh: Mesh) -> None:
    """A random walk of the marks: the mean shift of the second half lies where the first half says."""
    squares, trials = list[float](), 30
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        points, walk = BODY.sample(30, rng), np.cumsum(rng.normal(0.0, 0.2e-3, (60, 3)), axis=0)  # 1 mm in 30 touches
        marks = points - walk[:30] + rng.normal(0.0, 0.2e-3, points.shape)
        found = identify(sensed(pressed(points, rng), rng), mesh, points=marks, noise=NOISE)
        away = error(found, TRUE @ Pose(np.eye(3), walk[30:].mean(axis=0)))
        covariance = found.covariance + found.error.drift**2 * np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
        squares.append(float(away @ np.linalg.solve(covariance, away)))
    assert 0.5 * 6.0 < np.mean(squares) < 2.0 * 6.0


def test_errors_of_neighbours_count_once() -> None:
    alone = np.random.default_rng(13).normal(size=(200, 2))
    assert spread_in_time(alone) == 1.0
    assert spread_in_time(np.repeat(alone, 8, axis=0)) == pytest.approx(8.0, rel=0.4)  # of 200: to 20 %, the larger


def test_touches_that_no_pose_explains_are_refused(mesh: Mesh) -> None:
    rng = np.random.default_rng(3)
    points = BODY.sample(12, rng)
    wrenches = sensed(pressed(points, rng), rng) * [1, 1, 1, -1, -1, -1]
    with pytest.raises(InputError, match=r"fit no pose.*Check"):
        identify(wrenches, mesh, points=points, noise=NOISE)


def test_touches_left_out_lie_where_the_others_predict(mesh: Mesh) -> None:
    rng = np.random.default_rng(4)
    points = BODY.sample(24, rng)
    marks = points + rng.normal(0.0, 0.5e-3, points.shape)
    found = identify(sensed(pressed(points, rng), rng), mesh, points=marks, noise=NOISE)
    assert found.validation.parts == 4
    assert 0.2 < found.validation.ratio < 2.0


def test_presses_are_found_without_their_ramps() -> None:
    """From 0.7 of the force on: of 2 N with a gap of a reading, and of 10 N; one is too light and one too short."""
    time = 100.0 + 0.01 * np.arange(800)
    knots = [0, 0.5, 0.71, 1.5, 1.71, 2, 2.2, 2.5, 2.7, 3, 3.01, 3.05, 3.06, 4, 5.05, 7, 8.05]
    force = np.interp(time - 100.0, knots, [0, 0, 2, 2, 0, 0, 0.9, 0.9, 0, 0, 9, 9, 0, 0, 10, 10, 0])
    wrenches = np.zeros((800, 6))
    wrenches[:, 2] = -force
    wrenches[100, 5] = np.nan
    start, end = find_presses(time, wrenches, on=1.0, off=0.3)
    np.testing.assert_allclose(start, [100.65, 101.01, 104.74], atol=1e-9)
    np.testing.assert_allclose(end, [100.99, 101.56, 107.31], atol=1e-9)
    assert [each.shape for each in find_presses(time, 0.0 * wrenches, on=1.0, off=0.3)] == [(0,), (0,)]
