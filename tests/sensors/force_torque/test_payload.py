"""Payload identification: truth comes back with an honest covariance, and what cannot come back is refused by name."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.errors import InputError, NotIdentifiable
from palpate.files.models import write_model
from palpate.sensors.force_torque._payload_fit import Errors, gain_of, model, residual_covariance, two_stage
from palpate.sensors.force_torque.calibrate import identify_payload
from palpate.signals import Payload
from palpate.spatial.pose import rotation_from_quaternion
from tests.cli.test_calibrate_drift import RIG, TIME, WALK, a_zero, columns, drift, found_in

WEIGHT = np.array([0.3, -0.2, -12.0])
CENTER = np.array([0.004, -0.01, 0.05])
FORCE_BIAS, TORQUE_BIAS = np.array([-3.0, 4.0, -9.0]), np.array([0.1, -0.2, 0.3])
NOISE = np.array([0.1, 0.1, 0.2, 0.004, 0.004, 0.002])
TRUTH = np.concatenate([WEIGHT, FORCE_BIAS, CENTER, TORQUE_BIAS])
SWAP = [0, 2, 1, 3, 5, 4]


def poses(count: int, seed: int = 0) -> np.ndarray:
    return Rotation.random(count, random_state=seed).as_matrix()


def readings(rotations: np.ndarray, weight: np.ndarray = WEIGHT, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Statics, pose by pose, in the base and back: gravity at the centre, its torque about the sensor's origin."""
    rows = []
    for rotation in rotations:
        torque = np.cross(rotation @ CENTER, weight)
        rows.append(np.concatenate([rotation.T @ weight + FORCE_BIAS, rotation.T @ torque + TORQUE_BIAS]))
    return np.array(rows) + np.random.default_rng(seed).normal(size=(len(rotations), 6)) * NOISE * noise


def parameters(payload: Payload) -> np.ndarray:
    return np.concatenate([payload.weight, payload.force_bias, payload.center_of_mass, payload.torque_bias])


def real(shared: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wrenches as logged (in the base) and rotations."""
    folder = shared / "data" / "payload"
    pose = np.loadtxt(folder / f"recorded_messages_pose{name}.txt", delimiter=",")
    return (
        np.loadtxt(folder / f"recorded_messages_wrench{name}.txt", delimiter=","),
        rotation_from_quaternion(pose[:, 3:]),
    )


# --- what comes back


@pytest.mark.parametrize("robust", [True, False])
@pytest.mark.parametrize("noise", [None, NOISE])
def test_exact_wrenches_give_the_truth(robust: bool, noise: np.ndarray | None) -> None:
    rotations = poses(8)
    payload = identify_payload(readings(rotations), rotations, robust=robust, noise=noise)
    np.testing.assert_allclose(parameters(payload), TRUTH, atol=1e-11)  # rounding of 12 N through a well posed fit
    assert payload.samples == 8
    assert payload.notes == ()


def test_gravity_of_any_length_is_only_a_direction() -> None:
    rotations = poses(5)
    for length in (3.0, 1e-300, 1e300):
        payload = identify_payload(readings(rotations), rotations, gravity=length * WEIGHT, magnitude=9.81)
        np.testing.assert_allclose(parameters(payload), TRUTH, atol=1e-11)
        assert payload.mass == pytest.approx(np.linalg.norm(WEIGHT) / 9.81, rel=1e-12)
        assert np.linalg.matrix_rank(payload.covariance[:3, :3]) <= 1


CASES = {
    "two stages, free": ({}, 12),
    "two stages, gravity given": ({"gravity": WEIGHT}, 10),
    "joint, free": ({"noise": NOISE}, 12),
    "joint, gravity given": ({"noise": NOISE, "gravity": WEIGHT}, 10),
}


@pytest.mark.parametrize("case", CASES)
def test_covariance_holds(case: str) -> None:
    """The mean of 40 squared distances of 12 (10) degrees of freedom scatters by sqrt(2 k / 40): 6.5 % (7.1 %) of k.

    Estimated from 40 poses' residuals, the covariance's own error adds about (k + 1) / (3 x 40) = 11 %; with the noise
    known it adds nothing. Both within two deviations, of dice that are always the same.
    """
    settings, unknowns = CASES[case]
    squared = []
    for seed in range(40):
        rotations = poses(40, seed)
        payload = identify_payload(readings(rotations, noise=1.0, seed=1000 + seed), rotations, **settings)
        error = parameters(payload) - TRUTH
        squared.append(error @ np.linalg.pinv(payload.covariance, rcond=1e-12, hermitian=True) @ error)
    mean, excess = np.mean(squared) / unknowns, 0.0 if "noise" in settings else 0.11
    assert 1.0 - 0.14 < mean < 1.0 + excess + 0.14


def test_known_noise_sharpens_the_weight_through_the_torque() -> None:
    rotations = poses(40)
    wrenches = readings(rotations, noise=1.0)
    apart, joint = (identify_payload(wrenches, rotations, noise=noise) for noise in (None, NOISE))
    assert np.trace(joint.covariance[:3, :3]) < np.trace(apart.covariance[:3, :3])


def test_noise_that_does_not_explain_the_residuals_is_not_believed() -> None:
    rotations = poses(40)
    wrenches = readings(rotations, noise=1.0)
    payload = identify_payload(wrenches, rotations, noise=NOISE / 4)
    assert "times the stated noise" in payload.notes[0]
    np.testing.assert_allclose(payload.covariance, identify_payload(wrenches, rotations).covariance, rtol=1e-9)


# --- laws


def test_noise_that_hardly_explains_the_residuals_is_widened_until_it_does() -> None:
    """Half as much variance again as was stated: chance makes 4 % of it, a fit of 200 poses sees it.

    The covariance must be that of the noise there is, within chance; and not below the stated one where there is less.
    """
    rotations = poses(200)
    wrenches = readings(rotations, noise=np.sqrt(1.5))
    stated, true = (identify_payload(wrenches, rotations, noise=k * NOISE) for k in (1.0, np.sqrt(1.5)))
    ratio = np.diag(stated.covariance) / np.diag(true.covariance)
    assert np.allclose(ratio, 1.0, rtol=0, atol=0.15)
    quiet = readings(rotations, noise=0.5)
    believed = identify_payload(quiet, rotations, noise=NOISE)
    assert np.allclose(np.diag(believed.covariance), np.diag(true.covariance) / 1.5, rtol=0.1, atol=0)


def test_turning_the_base_turns_the_weight_only_and_turning_the_sensor_all_in_it() -> None:
    rotations, turn = poses(30), poses(1, seed=9)[0]
    wrenches = readings(rotations, noise=1.0)
    before, after = identify_payload(wrenches, rotations), identify_payload(wrenches, turn @ rotations)
    np.testing.assert_allclose(after.weight, turn @ before.weight, atol=1e-10)
    np.testing.assert_allclose(parameters(after)[3:], parameters(before)[3:], atol=1e-10)
    whole = np.eye(12)
    whole[:3, :3] = turn
    np.testing.assert_allclose(after.covariance, whole @ before.covariance @ whole.T, atol=1e-12)
    turned = np.einsum("ji,nkj->nki", turn, wrenches.reshape(-1, 2, 3)).reshape(-1, 6)
    after = identify_payload(turned, rotations @ turn)
    np.testing.assert_allclose(after.weight, before.weight, atol=1e-10)
    expected = (parameters(before)[3:].reshape(3, 3) @ turn).ravel()
    np.testing.assert_allclose(parameters(after)[3:], expected, atol=1e-10)


def test_the_centre_is_not_pulled_by_the_noise_of_the_force() -> None:
    """With the measured force as the regressor its noise shrinks the centre by 1 / (1 + 3 s^2/|w|^2), 4 % here.

    In one fit of many poses: that mistake does not average out, and chance is below half a percent.
    """
    deviations, rotations = np.array([1.5, 1.5, 1.5, 0.01, 0.01, 0.01]), poses(1200)
    wrenches = readings(rotations) + np.random.default_rng(3).normal(size=(1200, 6)) * deviations
    assert two_stage(wrenches, rotations, None)[8] == pytest.approx(CENTER[2], rel=0.01)


# --- bad samples


def test_samples_that_something_touched_are_set_aside_and_listed() -> None:
    rotations = poses(60)
    wrenches = readings(rotations, noise=1.0)
    clean = identify_payload(
        np.delete(wrenches, [3, 17, 40, 41, 42], axis=0), np.delete(rotations, [3, 17, 40, 41, 42], 0)
    )
    wrenches[[3, 17, 40, 41, 42]] += [5.0, -3.0, 8.0, 0.2, 0.1, 0.0]
    payload = identify_payload(wrenches, rotations)
    np.testing.assert_allclose(parameters(payload), parameters(clean), atol=1e-9)
    assert payload.samples == 55
    assert "rows 3, 17, 40, 41, 42" in payload.notes[0]
    pulled = identify_payload(wrenches, rotations, robust=False)
    assert np.abs(pulled.force_bias - FORCE_BIAS).max() > 0.3  # 5 of 60 samples by 8 N


def test_good_samples_are_rarely_set_aside() -> None:
    away = 0
    for seed in range(100):
        rotations = poses(7 + seed % 20, seed)
        wrenches = readings(rotations, noise=1.0, seed=seed)
        away += len(wrenches) - identify_payload(wrenches, rotations, robust=True).samples
    assert away <= 4  # of 1,650; a few come from the deviations of seven poses


@pytest.mark.parametrize("lost", [np.nan, 1e200], ids=["none", "beyond any sensor"])
def test_rows_without_numbers_are_ignored_and_said_by_their_own_number(lost: float) -> None:
    rotations = poses(30)
    wrenches = readings(rotations, noise=1.0)
    good = identify_payload(np.delete(wrenches, [2, 9], axis=0), np.delete(rotations, [2, 9], axis=0))
    wrenches[2, 4], rotations[9, 0, 0] = lost, np.inf
    payload = identify_payload(wrenches, rotations)
    np.testing.assert_array_equal(parameters(payload), parameters(good))
    assert "2 of 30 rows hold NaN or infinity" in payload.notes[0]
    assert "rows 2, 9" in payload.notes[0]
    wrenches[20, :3] += 30.0
    assert any("rows 20)" in note for note in identify_payload(wrenches, rotations).notes)
    averaged = identify_payload(wrenches, rotations, of="poses").notes
    assert any("of 28 poses are far from the fit and were set aside (poses 20)" in note for note in averaged)


def test_wrong_input_is_named() -> None:
    rotations = poses(6)
    wrenches = readings(rotations)
    with pytest.raises(InputError, match=r"\(n, 6\).*Write"):
        identify_payload(wrenches[:, :3], rotations)
    with pytest.raises(InputError, match=r"rotations must have shape \(6, 3, 3\).*Write"):
        identify_payload(wrenches, rotations[:5])
    with pytest.raises(InputError, match=r"row 4: the rotation is not orthonormal.*Check"):
        identify_payload(wrenches, np.where(np.arange(6)[:, None, None] == 4, 1.1 * rotations, rotations))
    with pytest.raises(InputError, match=r"row 2: the rotation is a reflection.*Check"):
        identify_payload(wrenches, np.where(np.arange(6)[:, None, None] == 2, -rotations, rotations))
    with pytest.raises(InputError, match=r"none of the 6 rows.*Find"):
        identify_payload(np.full((6, 6), np.nan), rotations)
    with pytest.raises(InputError, match=r"gravity.*Leave"):
        identify_payload(wrenches, rotations, gravity=[0, 0, 0])
    with pytest.raises(InputError, match=r"hypothesis 'upside down' is not known.*Use"):
        identify_payload(wrenches, rotations, hypothesis="upside down")


# --- what poses cannot separate


def about(axis: np.ndarray, count: int = 12) -> np.ndarray:
    return Rotation.from_rotvec(np.linspace(-2.0, 2.0, count)[:, None] * axis).as_matrix()


def test_poses_about_one_axis_are_refused_naming_it_and_the_turn_it_takes() -> None:
    mounted = Rotation.from_euler("x", 90, degrees=True).as_matrix()  # the sensor's y lies along the base's z
    rotations = about(np.array([0.0, 0.0, 1.0])) @ mounted
    wrenches = readings(rotations, noise=0.1)
    with pytest.raises(
        NotIdentifiable,
        match=r"one axis, z of the base, which is y of the sensor.*30 degrees or more about x and about z",
    ) as caught:
        identify_payload(wrenches, rotations)
    assert caught.value.rank == 5
    assert caught.value.missing == ("weight along z (base)", "force_bias along y (sensor)")
    turns = Rotation.from_rotvec(np.radians([[30.0, 0.0, 0.0], [0.0, 0.0, 30.0]])).as_matrix()
    mended = np.concatenate([rotations, rotations[:1] @ turns])
    payload = identify_payload(readings(mended, noise=0.1), mended)
    np.testing.assert_allclose(payload.weight, WEIGHT, atol=1.0)


@pytest.mark.parametrize("given", [np.array([0.0, 0.0, -12.0]), np.array([1.0, 2.0, -11.0])])
def test_with_gravity_given_one_axis_that_is_not_gravity_suffices(given: np.ndarray) -> None:
    rotations = about(np.array([1.0, 0.0, 0.0]))
    payload = identify_payload(readings(rotations, weight=given), rotations, gravity=given)
    np.testing.assert_allclose(payload.weight, given, atol=1e-10)
    np.testing.assert_allclose(parameters(payload)[3:], TRUTH[3:], atol=1e-10)


def test_with_gravity_given_turning_about_it_is_refused() -> None:
    weight = np.array([0.0, 0.0, -12.0])
    rotations = about(np.array([0.0, 0.0, 1.0]))
    with pytest.raises(NotIdentifiable, match="gravity along -z of the sensor") as caught:
        identify_payload(readings(rotations, weight=weight), rotations, gravity=weight)
    assert caught.value.missing == ("mass", "force_bias along -z (sensor)")


@pytest.mark.parametrize("count", [1, 5])
def test_one_orientation_is_refused(count: int) -> None:
    rotations = np.repeat(poses(1), count, axis=0)
    with pytest.raises(NotIdentifiable, match="same orientation") as caught:
        identify_payload(readings(rotations, noise=1.0), rotations)
    assert caught.value.rank == 3


def test_two_poses_share_an_axis_and_with_gravity_leave_the_centre_open() -> None:
    rotations = poses(2)
    axis = Rotation.from_matrix(rotations[1] @ rotations[0].T).as_rotvec()
    axis /= np.linalg.norm(axis)
    with pytest.raises(NotIdentifiable, match="one axis") as caught:
        identify_payload(readings(rotations), rotations)
    named = np.array([float(part) for part in caught.value.missing[0].split("[")[1].split("]")[0].split(",")])
    assert abs(named @ axis) == pytest.approx(1.0, abs=0.01)  # printed to two decimals
    with pytest.raises(NotIdentifiable, match="center_of_mass along"):
        identify_payload(readings(rotations), rotations, gravity=WEIGHT)


def test_a_wobble_of_half_a_degree_is_not_a_second_axis() -> None:
    rng = np.random.default_rng(4)
    rotations = about(np.array([0.0, 0.0, 1.0])) @ Rotation.from_rotvec(rng.normal(size=(12, 3)) * 0.009).as_matrix()
    with pytest.raises(NotIdentifiable, match="one axis, z"):
        identify_payload(readings(rotations, noise=0.1), rotations)


def test_nothing_on_the_sensor_is_refused_as_lost_in_noise() -> None:
    rotations = poses(30)
    with pytest.raises(NotIdentifiable, match="tare"):
        identify_payload(readings(rotations, weight=np.zeros(3), noise=1.0), rotations)


# --- named mistakes

MISTAKES = {  # of two parts; of one part, with outliers: test_payload_mistakes.py
    "base frame + y and z swapped": lambda w, r: (
        np.einsum("nij,nkj->nki", r, w[:, SWAP].reshape(-1, 2, 3)).reshape(-1, 6),
        r,
    ),
    "inverse rotations + base frame": lambda w, r: (
        np.einsum("nij,nkj->nki", r, w.reshape(-1, 2, 3)).reshape(-1, 6),
        r.swapaxes(1, 2),
    ),
}


@pytest.mark.parametrize("gravity", [None, WEIGHT])
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_of_two_parts_is_named_and_undone(name: str, gravity: np.ndarray | None) -> None:
    rotations = poses(40)
    mistaken = MISTAKES[name](readings(rotations, noise=1.0), rotations)
    with pytest.raises(InputError) as caught:
        identify_payload(*mistaken, gravity=gravity)
    assert f"hypothesis={name!r}" in caught.value.hint
    payload = identify_payload(*mistaken, gravity=gravity, hypothesis=name)
    assert payload.notes == ()
    np.testing.assert_allclose(payload.weight, WEIGHT, atol=0.2)  # 0.2 N / sqrt 40 five times over


@pytest.mark.parametrize("gravity", [None, WEIGHT])
def test_a_reversed_sign_shows_only_as_a_weight_that_points_up(gravity: np.ndarray | None) -> None:
    rotations = poses(40)
    wrenches = readings(rotations, noise=1.0)
    payload = identify_payload(-wrenches, rotations, gravity=gravity)
    assert "hypothesis='sign reversed'" in payload.notes[-1]
    np.testing.assert_allclose(
        payload.residual, identify_payload(wrenches, rotations, gravity=gravity).residual, rtol=1e-9
    )


def test_a_bad_log_that_no_mistake_explains_is_called_bad() -> None:
    rotations = poses(40)
    payload = identify_payload(readings(rotations, noise=10.0), rotations, gravity=WEIGHT)
    assert "no known mistake explains them" in payload.notes[-1]


# --- real


def test_seven_real_poses_give_the_authors_force_part(shared: Path) -> None:
    wrenches, rotations = real(shared, "")
    for robust in (True, False):
        payload = identify_payload(wrenches, rotations, gravity=[0, 0, -1], hypothesis="base frame", robust=robust)
        got = [payload.weight[2], *payload.force_bias]
        np.testing.assert_allclose(got, [-10.80391, -2.13583, -2.76399, -13.07675], atol=0.5e-5 + 1e-7)
        # theirs begins with the height and was fitted on the measured force: [0.05197, -0.15658, -0.07939, 0.12979]
        np.testing.assert_allclose(payload.torque_bias, [-0.15658, -0.07939, 0.12979], atol=2e-3)


def test_a_hundred_real_poses(shared: Path) -> None:
    wrenches, rotations = real(shared, "_100")
    with pytest.raises(InputError, match="hypothesis='base frame'"):
        identify_payload(wrenches, rotations)
    payload = identify_payload(wrenches, rotations, hypothesis="base frame")
    assert [note[:15] for note in payload.notes] == ["The bias drifts"]
    assert payload.mass == pytest.approx(1.2396, abs=0.0005)
    np.testing.assert_allclose(payload.force_bias, [-3.468, -4.577, -16.719], atol=0.01)
    np.testing.assert_allclose(payload.center_of_mass, [-0.0010, -0.0001, 0.0451], atol=0.0005)
    assert payload.residual[0] == pytest.approx(0.281, abs=0.0005)


def test_a_centre_of_mass_beyond_reach_is_said() -> None:
    rotations = poses(30)
    wrenches = readings(rotations)
    assert "centre of mass is" not in " ".join(identify_payload(wrenches, rotations).notes)
    wrenches[:, 3:] *= 1e3  # N mm taken for N m
    with pytest.raises(InputError, match=r"centre of mass .* is implausible; it is nearer if the torque is in N mm"):
        identify_payload(wrenches, rotations)


def test_the_noise_that_a_fit_leaves_is_corrected_for_its_unknowns() -> None:
    """Residuals of normal numbers of deviation 1 after a fit of 4 unknowns to 12 forces, and of 6 to 12 torques."""
    rng, found = np.random.default_rng(5), np.zeros((6, 6))
    for _ in range(3000):
        force, torque = (_left_of_a_fit(rng, unknowns) for unknowns in (4, 6))
        found += residual_covariance(np.concatenate([force, torque], axis=1), 4) / 3000
    np.testing.assert_allclose([np.trace(found[:3, :3]) / 3, np.trace(found[3:, 3:]) / 3], 1.0, atol=0.02)


def _left_of_a_fit(rng: np.random.Generator, unknowns: int) -> np.ndarray:
    columns, values = rng.normal(size=(12, unknowns)), rng.normal(size=12)
    return (values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]).reshape(4, 3)


def test_the_covariance_of_two_stages_is_noise_through_their_slopes() -> None:
    """By central differences of every reading; their step, 1e-4 of about 10 N, errs by its square, 1e-10."""
    rotations, step = poses(6), 1e-4
    exact = readings(rotations).ravel()
    slopes = np.empty((12, exact.size))
    for k, change in enumerate(step * np.eye(exact.size)):
        up, down = (two_stage((exact + way * change).reshape(-1, 6), rotations, None) for way in (1.0, -1.0))
        slopes[:, k] = (up - down) / (2 * step)
    root = np.random.default_rng(8).normal(size=(6, 6)) * NOISE
    noise = root.T @ root  # forces and torques correlate
    gain = gain_of(model(TRUTH, rotations)[1], None)[0]
    found = Errors(noise, np.zeros((2, 6)), np.arange(6)).spread(gain)
    np.testing.assert_allclose(gain.reshape(12, -1), slopes, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found, slopes @ np.kron(np.eye(6), noise) @ slopes.T, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("course", ["none", "walk", "trend"])
def test_the_covariance_holds_for_a_bias_that_drifts_while_poses_are_recorded(course: str) -> None:
    """Monte Carlo: Mahalanobis^2 of the twelve against the load and the bias at an end of the log.

    Without the trend in the covariance that of the steady drift is 1.7.
    """
    rng, step = np.random.default_rng(12), np.array([0.1, 0.1, 0.1, 0.004, 0.004, 0.004])
    rotations, distances = poses(40), list[float]()
    for _ in range(15):
        steps = {"none": 0.0, "walk": rng.normal(size=(40, 6)), "trend": 0.3 * rng.choice([-1.0, 1.0], 6)}[course]
        drift = np.cumsum(step * (steps + np.zeros((40, 6))), axis=0)
        wrenches = readings(rotations) + NOISE * rng.normal(size=(40, 6)) + drift
        found = identify_payload(wrenches, rotations, robust=False)
        bias = drift[rng.choice([0, 39])]
        off = parameters(found) - TRUTH - np.concatenate([np.zeros(3), bias[:3], np.zeros(3), bias[3:]])
        distances.append(float(off @ np.linalg.solve(found.covariance, off)) / 12)
    assert 0.5 < np.mean(distances) < {"none": 1.5, "walk": 2.5, "trend": 1.5}[course]


def test_poses_left_out_lie_where_the_others_predict_and_widen_the_covariance_where_they_do_not() -> None:
    rotations, rng = poses(40), np.random.default_rng(3)
    clean = readings(rotations) + NOISE * rng.normal(size=(40, 6))
    turned = clean.copy()
    turned[20:] = readings(rotations[20:] @ Rotation.from_rotvec([0.1, 0.0, 0.0]).as_matrix())
    good, bad = identify_payload(clean, rotations), identify_payload(turned, rotations, robust=False)
    assert "Parts of the log" not in " ".join(good.notes)
    assert np.trace(bad.covariance) > 10 * np.trace(good.covariance)
    assert "4 parts" in good.provenance["left_out"]


def test_halves_of_a_real_log_agree_within_their_covariances(shared: Path) -> None:
    """Fifty poses whose fz drifts by 1.8 N, a pause, fifty more; with independent errors it is 52 times the twelve."""
    wrenches, rotations = real(shared, "_100")
    first, second = (
        identify_payload(wrenches[rows], rotations[rows], hypothesis="base frame")
        for rows in (slice(50), slice(50, 100))
    )
    off, covariance = parameters(first) - parameters(second), first.covariance + second.covariance
    load = [0, 1, 2, 6, 7, 8]  # of the biases, which jump in the pause, less is known
    assert 0.5 < off[load] @ np.linalg.solve(covariance[np.ix_(load, load)], off[load]) / 6 < 2.0
    assert off @ np.linalg.solve(covariance, off) / 12 < 2.5
    assert "drifts by about 1.9 N" in first.notes[0]


def test_with_a_payload_the_arm_may_move(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without it, that it moves is said."""
    payload = Payload(*np.array([[0.0, 0.0, -10.0], [1.0, 2.0, 3.0], [0.0, 0.0, 0.05], [0.1, 0.2, 0.3]]))
    turned = Rotation.from_rotvec(np.column_stack([0.5 * np.sin(TIME / 5.0), 0.3 * np.cos(TIME / 7.0), 0.0 * TIME]))
    weight = turned.inv().apply([0.0, 0.0, -10.0])
    hanging = np.column_stack([weight, np.cross([0.0, 0.0, 0.05], weight)]) + np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    columns(tmp_path / "free.csv", "fx,fy,fz,tx,ty,tz,qx,qy,qz,qw", a_zero() + hanging, turned.as_quat())
    write_model(tmp_path / "payload.toml", payload)
    code, out = drift(
        tmp_path, "free.csv", RIG + 'payload = "payload.toml"\n[drift]\nwalk={force=1,torque=1}\nweight=0.05'
    )
    assert code == 0
    np.testing.assert_allclose(found_in(out).walk, WALK, rtol=0.35)
    assert found_in(out).weight == 0.05  # as stated
    assert drift(tmp_path, "free.csv")[0] == 1
    assert "turns by" in capsys.readouterr().err


def test_inertia_of_an_arm_that_moves_is_no_walk(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """0.1 m to either side in 2.5 s at 10 N of weight: 0.65 N; with positions it is taken off, without them said."""
    mass, gravity, rate = 10.0 / 9.81, np.array([0.0, 0.0, -10.0]), 2.0 * np.pi / 2.5
    swing = 0.1 * np.outer(np.sin(rate * TIME), [1.0, 0.0, 0.0])
    turned = Rotation.from_rotvec(np.column_stack([0.3 * np.sin(TIME / 5.0), 0.2 * np.cos(TIME / 7.0), 0.0 * TIME]))
    path = swing + turned.apply([0.0, 0.0, 0.05])
    pulled = turned.inv().apply(gravity - mass * np.gradient(np.gradient(path, TIME, axis=0), TIME, axis=0))
    hanging = np.column_stack([pulled, np.cross([0.0, 0.0, 0.05], pulled)])
    payload = Payload(gravity, np.zeros(3), np.array([0.0, 0.0, 0.05]), np.zeros(3))
    write_model(tmp_path / "payload.toml", payload)
    poses = turned.as_quat() + 1e-5 * np.random.default_rng(0).standard_normal((len(TIME), 4))
    rig, walks = RIG + 'payload = "payload.toml"\n', list[np.ndarray]()
    for names, places in (("x,y,z,qx,qy,qz,qw", swing), ("qx,qy,qz,qw", swing[:, :0])):
        columns(tmp_path / "free.csv", f"fx,fy,fz,tx,ty,tz,{names}", a_zero() + hanging, places, poses)
        code, out = drift(tmp_path, "free.csv", rig)
        walks.append(found_in(out).walk if code == 0 else np.full(6, np.inf))
        said = capsys.readouterr()
        assert code or ("accelerations were taken" if places.size else "counts as walk") in said.out
    np.testing.assert_allclose(walks[0], WALK, rtol=0.35)
    assert walks[1][0] > 2.0 * WALK[0]
