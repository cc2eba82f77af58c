"""The estimator as a stream: the same answers however it is fed, filters as they say, honest ellipses, tare."""

import copy
from dataclasses import fields
from threading import active_count

import numpy as np
import pytest

from palpate.contact import ContactEstimate, Locator, Status, WrenchEstimator
from palpate.errors import InputError
from palpate.sensors.force_torque import ForceTorque
from palpate.sensors.force_torque.compensation import Compensation
from palpate.signals import Butterworth, Kalman, Payload, Recording
from palpate.signals.filters import Filter
from palpate.signals.recording import ACCELERATION, FORCE, ORIENTATION, TORQUE, UNSTEADY
from palpate.spatial.pose import Pose, rotation_from_quaternion, skew
from palpate.surfaces import plane
from tests.conformance.live import each_reading
from tests.support.bodies import BODIES
from tests.support.state import remembered
from tests.support.streams import pieces

RATE = 200.0
NOISE = np.array([0.02] * 3 + [5e-4] * 3)
MOUNT = Pose.from_rotation_vector((0.3, -0.5, 1.1), (0.01, 0.02, 0.08))
_RNG = np.random.default_rng(5)
_ROOT = _RNG.normal(size=(12, 12)) * np.repeat([3e-3, 3e-3, 1e-4, 3e-4], 3)[:, None]
PAYLOAD = Payload(
    np.array([0.3, -0.4, -12.0]),
    np.array([-3.0, 4.0, -16.0]),
    np.array([-0.001, 0.002, 0.045]),
    np.array([0.1, -0.2, 0.05]),
    _ROOT @ _ROOT.T,
)
CALIBRATED = np.diag([1e-3, 2e-3, 1e-3, 1e-4, 1e-4, 2e-4]) ** 2
FILTERS = [None, Kalman(1e-3, 2e-3), Butterworth(20.0), Butterworth(20.0, zero_phase=True)]
FLAT = plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def estimator(
    made: Filter | None = None, sensor: ForceTorque | None = None, payload: Payload | None = PAYLOAD
) -> WrenchEstimator:
    """On a body with more than one candidate, so that the last contact counts."""
    sensor = ForceTorque(NOISE, limits=[60.0] * 3 + [5.0] * 3) if sensor is None else sensor
    locator = Locator(BODIES["ellipsoid"].mesh, noise=NOISE, friction=2.0, torsion=0.05, on=1.0, off=0.5)
    return WrenchEstimator(locator, Compensation(sensor, payload), MOUNT, CALIBRATED, made, RATE)


def hard_log(count: int = 500, base: bool = False) -> Recording:
    """Touches that come and go while the arm turns and is shaken, with everything that can be wrong with a sample."""
    rng, step = np.random.default_rng(0), np.arange(count)
    press = 3.0 * np.maximum(0.0, np.sin(step / 15.0))[:, None]
    away = np.array([0.2, -0.1, -1.0]) + 0.2 * np.sin(step[:, None] / np.array([40.0, 50.0, 60.0]))
    force = press * away @ MOUNT.rotation.T
    readings = np.concatenate([force, np.cross(MOUNT.translation, force)], axis=1)
    quaternions = np.array([30.0, 0.0, 0.0, 5.0]) + np.cumsum(rng.normal(size=(count, 4)), axis=0)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    acceleration = 0.1 * rng.normal(size=(count, 3))
    turn = rotation_from_quaternion(quaternions)
    readings = readings - PAYLOAD.compensate(np.zeros((count, 6)), turn, acceleration)[0]
    readings = readings + NOISE * rng.normal(size=(count, 6))
    if base:
        readings = np.einsum("nij,nkj->nki", turn, readings.reshape(-1, 2, 3)).reshape(-1, 6)
    time = step / RATE
    time[250:] += 1.0
    time[400:] -= 2.0
    quaternions[[3, 100, 101]], acceleration[[7, 200]] = np.nan, np.nan
    readings[[5, 150], 2], readings[[11, 260], 1] = np.nan, 100.0
    channels = {
        FORCE: readings[:, :3],
        TORQUE: readings[:, 3:],
        ORIENTATION: quaternions,
        ACCELERATION: acceleration,
        UNSTEADY: np.full((count, 1), 0.05),
    }
    return Recording(time, channels, frame="base" if base else "sensor")


def assert_same(parts: list[ContactEstimate], whole: ContactEstimate) -> None:
    """To the last bit, NaN included."""
    for field in fields(whole):
        expected = getattr(whole, field.name)
        joined = np.concatenate([np.atleast_1d(getattr(part, field.name)) for part in parts])
        assert np.array_equal(joined.reshape(expected.shape), expected, equal_nan=True)


def streamed(made: Filter | None, recording: Recording, size: int, beside: bool) -> list[ContactEstimate]:
    chain, parts = estimator(made, ForceTorque(NOISE, frame="base")), list(pieces(recording, size))
    chain.beside = beside
    answers = list(chain.pairs(parts))
    assert [id(block) for block, _ in answers] == [id(block) for block in parts]  # in order, row for row
    assert [len(answer.status) for _, answer in answers] == [len(block) for block in parts]
    return [answer.estimate for _, answer in answers]


@pytest.mark.parametrize("made", FILTERS[2:], ids=["butterworth", "zero phase"])
def test_large_blocks_and_a_thread_make_no_difference_in_the_base_frame(made: Filter | None) -> None:
    """Larger than the pieces in which the work is done inside; the thread locates while the next ones are measured."""
    recording = hard_log(9000, base=True)
    (whole,) = streamed(made, recording, 10**6, False)
    assert {Status.CONTACT, Status.NO_CONTACT, Status.INVALID, Status.NO_POSE} <= set(whole.status.tolist())
    for size, beside in ((4096, False), (701, True), (10**6, True)):
        assert_same(streamed(made, recording, size, beside), whole)


def test_what_goes_wrong_beside_is_raised_in_its_turn_and_the_thread_ends() -> None:
    chain, before = estimator(), active_count()
    chain.threads = 2
    parts = list(pieces(hard_log(), 100))
    parts[3] = Recording(parts[3].time, {FORCE: parts[3].channels[FORCE]})
    answers = chain.stream(parts)
    with pytest.raises(InputError, match="torque"):
        list(answers)
    assert active_count() == before
    early = chain.stream(list(pieces(hard_log(), 100)))
    next(early)
    early.close()  # whoever needs no more
    assert active_count() == before


@pytest.mark.parametrize("made", FILTERS[:3], ids=["none", "kalman", "butterworth"])
def test_samples_and_arrays_with_accelerations_are_the_block_to_the_last_bit(made: Filter | None) -> None:
    """Without any, as in tests/laws/test_split_laws.py, a sample could ignore it."""
    log = hard_log()
    log = Recording(log.time, {name: values for name, values in log.channels.items() if name != UNSTEADY})
    beside = {name: log.channels[name] for name in (ORIENTATION, ACCELERATION)}
    chain = estimator(made)
    whole = chain.run(log).estimate
    chain.reset()
    assert_same([chain.update(*sample).estimate for sample in each_reading(chain, log)], whole)
    fed = copy.deepcopy(chain)
    chain.reset()
    rows = chain.empty(len(log))
    chain.run_into(log.time, log.wrenches(), rows, np.zeros(len(log), np.int64), beside)
    assert_same([ContactEstimate.from_rows(rows)], whole)
    assert not remembered(fed, chain)


def test_update_takes_what_a_caller_has() -> None:
    """Lists, frozen values, columns of something larger, and no rotation where nothing turns."""
    chain, reading = estimator(payload=None), np.array([0.5, 0.2, -3.0, 0.0, 0.1, 0.0])
    first = chain.update(0.0, reading).estimate
    table = np.repeat(reading[:, None], 3, axis=1)
    frozen = reading.copy()
    frozen.flags.writeable = False
    for form in (reading.tolist(), frozen, table[:, 1]):
        chain.reset()
        assert_same([chain.update(1.0, form, np.asfortranarray(np.eye(3))).estimate], first)
    with pytest.raises(InputError, match="orientation of the sensor: the payload's weight"):
        estimator().update(0.0, reading)
    assert estimator().update(0.0, reading, np.full((3, 3), np.nan)).status[0] == Status.NO_POSE


def test_the_chain_is_the_payloads_own_formula() -> None:
    """`Payload.compensate` in NumPy, its covariance, the mounting's to first order: 1e-12 of 20 N is rounding."""
    recording = hard_log()
    chain = estimator(sensor=ForceTorque(NOISE))
    wrenches, covariances, statuses = chain.contact_wrenches(recording)
    assert covariances is not None
    good = statuses < 0
    turn = rotation_from_quaternion(recording.channels[ORIENTATION][good])
    acceleration = recording.channels[ACCELERATION][good]
    wrench, spread = PAYLOAD.compensate(recording.wrenches()[good], turn, acceleration)
    lever = np.concatenate([np.eye(3), skew(PAYLOAD.center_of_mass)])
    spread = spread + np.diag(NOISE**2) + (PAYLOAD.mass * 0.05) ** 2 * lever @ lever.T
    matrix = MOUNT.inverse().wrench_matrix()
    expected, spread = wrench @ matrix.T, matrix @ spread @ matrix.T
    assert np.abs(wrenches[good] - expected).max() < 1e-12
    # T_surface_sensor = (exp(xi) T)^-1 = T^-1 exp(-xi): in the sensor's frame, -xi turns and shifts the wrench
    for sample, moved in zip(np.flatnonzero(good), wrench, strict=True):
        jacobian = np.block([[skew(moved[:3]), np.zeros((3, 3))], [skew(moved[3:]), skew(moved[:3])]])
        whole = spread[np.count_nonzero(good[:sample])] + matrix @ jacobian @ CALIBRATED @ jacobian.T @ matrix.T
        assert np.abs(covariances[sample] - whole).max() < 1e-10 * np.abs(whole).max()


@pytest.mark.parametrize("made", FILTERS[1:3], ids=["kalman", "butterworth"])
@pytest.mark.parametrize("frequency", [0.5, 3.0, 10.0])
def test_measured_gain_and_delay_of_a_sine_are_the_formulas(made: Filter, frequency: float) -> None:
    """Two per cent, of the issue; the sine runs until the start is forgotten, then over whole periods.

    The delay of a narrow band is the slope of the phase: two sines 2 % apart.
    """
    count, phases, gains = int(20 * RATE), [], []
    time = np.arange(2 * count) / RATE
    for wave in (0.99 * frequency, 1.01 * frequency):
        sine = np.sin(2 * np.pi * wave * time)[:, None] * np.array([0.0, 0.0, 1.0])
        chain = WrenchEstimator(Locator(FLAT), ForceTorque(), filter=made, rate=RATE)
        force = chain.run(Recording(time, {FORCE: sine, TORQUE: np.zeros_like(sine)})).force[count:, 2]
        basis = np.exp(-2j * np.pi * wave * time[count:])
        design = np.stack([basis.real, -basis.imag], axis=1)  # cos and sin, by least squares
        cosine, sinus = np.linalg.lstsq(design, force, rcond=None)[0]
        phases.append(np.arctan2(cosine, sinus))
        gains.append(np.hypot(cosine, sinus))
    delay = -np.diff(np.unwrap(phases))[0] / (2 * np.pi * 0.02 * frequency)
    assert np.mean(gains) == pytest.approx(float(made.gain(frequency, RATE)), rel=0.02)
    assert delay == pytest.approx(float(made.delay(frequency, RATE)), rel=0.02, abs=0.02 / RATE)


def test_zero_phase_keeps_a_sine_in_step() -> None:
    made, time = Butterworth(8.0, zero_phase=True), np.arange(3000) / RATE
    sine = np.sin(2 * np.pi * 6.0 * time)[:, None] * np.array([0.0, 0.0, 1.0])
    chain = WrenchEstimator(Locator(FLAT), ForceTorque(), filter=made, rate=RATE)
    recording = Recording(time, {FORCE: sine, TORQUE: np.zeros_like(sine)})
    force = np.concatenate([answer.force for answer in chain.stream(pieces(recording, 100))])
    inner = slice(500, 2500)
    assert np.abs(force[inner, 2] - float(made.gain(6.0, RATE)) * sine[inner, 2]).max() < 1e-6


@pytest.mark.parametrize("made", [None, Kalman(4e-6, 4e-4), Butterworth(20.0), Butterworth(20.0, zero_phase=True)])
def test_ellipses_hold_95_per_cent_after_the_filter(made: Filter | None) -> None:
    """Steady touches, and for the Kalman filter ones that walk as it believes, on a plane: 400 runs of 60 samples.

    Samples of a run hang together, so the 24,000 are worth about 400 x 60 / 20: 0.6 % of deviation, and three of that.
    """
    rng, runs, count = np.random.default_rng(3), 400, 60
    truth = np.array([0.01, 0.02, -5.0, -0.05, 0.1, 0.0]) * np.ones((runs, count, 6))
    if isinstance(made, Kalman):
        walk = np.cumsum(rng.normal(size=(runs, count, 6)) * NOISE * (made.q / made.r) ** 0.5, axis=1)
        truth = truth + walk - walk[:, :1]
    readings = (truth + NOISE * rng.normal(size=truth.shape)).reshape(-1, 6)
    truth = truth.reshape(-1, 6)
    time = np.arange(runs * count) / RATE + np.repeat(np.arange(runs), count)  # a second apart: afresh each time
    chain = WrenchEstimator(Locator(FLAT, noise=NOISE, on=0.1), ForceTorque(NOISE), filter=made, rate=RATE)
    recording = Recording(time, {FORCE: readings[:, :3], TORQUE: readings[:, 3:]})
    (answer,) = chain.stream([recording])
    point = np.stack([-truth[:, 4], truth[:, 3]], axis=1) / truth[:, 2:3]  # where M = p x F on z = 0
    off, spread = answer.point[:, :2] - point, answer.covariance[:, :2, :2]
    held = np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off) < 5.991464547107979
    late = np.tile(np.arange(count) >= 15, runs)
    assert 0.93 < held.mean() < 0.97
    assert 0.93 < held[late].mean() < 0.97


def at_rest(mean: np.ndarray, count: int = 400, seed: int = 0, still: bool = True) -> Recording:
    rng = np.random.default_rng(seed)
    quaternions = np.tile([0.1, -0.2, 0.3, 0.9], (count, 1)) + (0.0 if still else 0.02) * rng.normal(size=(count, 4))
    turn = rotation_from_quaternion(quaternions)
    readings = mean - PAYLOAD.compensate(np.zeros((count, 6)), turn)[0] + NOISE * rng.normal(size=(count, 6))
    channels = {FORCE: readings[:, :3], TORQUE: readings[:, 3:], ORIENTATION: quaternions}
    return Recording(np.arange(count) / RATE, channels, source="a.csv")


DRIFT = np.array([0.3, -0.2, 0.4, 0.01, 0.02, -0.01])


def test_a_tare_takes_off_what_the_sensor_read_at_rest() -> None:
    """The mean of 400 samples is good to 0.05 of the noise: five of that."""
    chain = estimator()
    said = chain.tare(at_rest(DRIFT)).note
    assert "400 samples" in said
    assert "0.53" in said  # N, the length of the drift
    wrenches, _, _ = chain.contact_wrenches(at_rest(DRIFT, seed=1))
    mean = MOUNT.wrench_matrix() @ wrenches.mean(axis=0)
    assert np.abs(mean / NOISE).max() < 5 * (2 / 400) ** 0.5
    chain.tare(at_rest(0.0 * DRIFT))  # in its place, not on top
    wrenches, _, _ = chain.contact_wrenches(at_rest(0.0 * DRIFT, seed=1))
    assert np.abs(MOUNT.wrench_matrix() @ wrenches.mean(axis=0) / NOISE).max() < 5 * (2 / 400) ** 0.5


def test_a_tare_forgets_the_filter_and_reset_keeps_the_tare() -> None:
    chain = estimator(Kalman(1e-6, 1.0))
    chain.run(at_rest(10 * DRIFT))
    chain.tare(at_rest(DRIFT))
    for _ in range(2):
        assert np.linalg.norm(chain.run(at_rest(DRIFT, seed=2)).force, axis=1).max() < 0.2
        chain.reset()


def pressed(recording: Recording, force: np.ndarray) -> Recording:
    """With what a contact adds to the force."""
    return Recording(recording.time, {**recording.channels, FORCE: recording.channels[FORCE] + force}, source="a.csv")


def test_a_tare_is_refused_where_something_moves_or_touches() -> None:
    rest = at_rest(DRIFT)
    slow = np.linspace(0.0, 0.1, 400)[:, None] * np.ones(3)
    knock = np.where(np.arange(400) % 50 < 10, 1.0, 0.0)[:, None] * np.ones(3)
    for made, what in (
        (pressed(rest, slow), "changes between the two halves by 0.08"),
        (pressed(rest, knock), "scatters by 0.6"),
    ):
        with pytest.raises(InputError, match=rf"a.csv: the sensor was not at rest.*{what}.*noise is 0.0346 N.*Keep"):
            estimator().tare(made)
    with pytest.raises(InputError, match=r"at least 10 usable samples, and has 9.*Let"):
        estimator().tare(rest.picked(slice(0, 9)))
    with pytest.raises(InputError, match=r"not at rest.*Keep"):  # the noise taken from the steps
        estimator(sensor=ForceTorque()).tare(pressed(rest, knock))


def test_a_tare_that_could_be_a_touch_says_so() -> None:
    """A press of 3 N through the middle of the body is one that the surface explains; a twist of 1 N m is not."""
    force = MOUNT.rotation @ np.array([0.0, 0.0, -3.0])
    touch = np.concatenate([force, np.cross(MOUNT.translation, force)])
    assert "also be a steady touch of 3 N at" in estimator().tare(at_rest(touch)).warning
    assert not estimator().tare(at_rest(DRIFT + np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]))).warning


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match=r"rate.*State"):
        WrenchEstimator(Locator(FLAT), ForceTorque(), filter=Kalman())
    with pytest.raises(InputError, match=r"half the rate of the samples.*Choose"):
        estimator(Butterworth(100.0))
    chain = estimator(FILTERS[3])
    for call in (lambda: chain.run(hard_log()), lambda: chain.update(0.0, np.zeros(6), np.eye(3))):
        with pytest.raises(InputError, match=r"needs later samples.*Give"):
            call()


@pytest.mark.parametrize("shape", [(5,), (7,), (2, 6), (1, 6)])
def test_a_reading_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"reading must have shape \(6,\).*Write"):
        estimator(payload=None).update(0.0, np.zeros(shape))
