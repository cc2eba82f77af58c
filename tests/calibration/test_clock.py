"""The offset of the poses' clock comes back from simulated motion, through noise, touches and slow poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from claims.evidence.moving import Swing, moving_wrenches
from palpate.calibration.clock import ClockOffset, _sums, identify_offset
from palpate.errors import InputError, NotIdentifiable
from palpate.signals import Payload
from palpate.spatial.pose import rotation_from_quaternion
from palpate.spatial.pose_track import PoseTrack
from palpate_lab.simulation.session import GRAVITY, Load

LOAD = Load(0.5, np.array([0.002, -0.001, 0.045]), np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, -0.3]))
LIGHT = Load(0.5, np.zeros(3), LOAD.force_bias, LOAD.torque_bias)  # its centre does not swing: weight and nothing else
NOTHING = Load(0.0, np.zeros(3), LOAD.force_bias, LOAD.torque_bias)
PAYLOAD = Payload(LOAD.mass * GRAVITY, LOAD.force_bias, LOAD.center_of_mass, LOAD.torque_bias)
NOISE = np.array([0.02] * 3 + [0.001] * 3)
SWING = Swing()  # three axes, 0.4 to 0.5 rad at 0.17 to 0.23 Hz

Log = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def a_log(
    offset: float,
    seed: int = 0,
    *,
    swing: Swing = SWING,
    load: Load = LOAD,
    lasting: float = 10.0,
    rate: float = 100.0,
    pose_rate: float = 100.0,
) -> Log:
    """Times and wrenches; stamps, `offset` behind, and quaternions with 0.01 degrees of noise."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(lasting * rate)) / rate
    wrenches = moving_wrenches(load, swing.at(time)) + rng.normal(size=(len(time), 6)) * NOISE
    posed = np.arange(-1.0, lasting + 1.0, 1.0 / pose_rate) + rng.uniform(0.0, 1.0 / pose_rate)
    error = Rotation.from_rotvec(rng.normal(0.0, np.radians(0.01), (len(posed), 3)))
    turned = Rotation.from_quat(swing.at(posed).quaternion) * error
    return time, wrenches, posed - offset, turned.as_quat()


def z(found: ClockOffset, offset: float) -> float:
    return (found.offset - offset) / found.deviation


def test_poses_at_ten_hertz_and_forty_milliseconds_behind() -> None:
    """The case that this is for: within 2 ms, and then compensation leaves no more than 1.2 times the noise."""
    time, wrenches, stamps, quaternions = a_log(0.040, lasting=20.0, rate=1000.0, pose_rate=10.0)
    found = identify_offset(time, wrenches, stamps, quaternions)
    assert abs(found.offset - 0.040) < 2e-3
    assert found.deviation < 1e-3

    def left(offset: float) -> float:
        track = PoseTrack(offset=offset)
        track.add(stamps, quaternions)
        contact, _ = PAYLOAD.compensate(wrenches, rotation_from_quaternion(track.at(time)[0]))
        return float(np.sqrt(np.mean(contact[:, :3] ** 2))) / NOISE[0]

    assert left(found.offset) < 1.2
    assert left(0.0) > 2.0  # the test can fail


def test_its_deviation_is_honest() -> None:
    """Twelve logs whose model is exact: the rms of 12 normal numbers lies within 1 +- 2.5 / sqrt 24."""
    rng = np.random.default_rng(0)
    scores = []
    for seed in range(12):
        offset = float(rng.uniform(-0.1, 0.1))
        swing = Swing(swing=tuple(rng.uniform(0.3, 0.6, 3)), swing_rate=tuple(rng.uniform(0.1, 0.35, 3)))
        log = a_log(offset, seed, swing=swing, load=LIGHT)
        scores.append(z(identify_offset(*log, search=(-0.12, 0.12)), offset))
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.5
    assert np.abs(scores).max() < 4.0


@pytest.mark.parametrize("offset", [-0.31, 0.0, 0.2])
def test_of_either_sign_and_with_a_payload(offset: float) -> None:
    found = identify_offset(*a_log(offset, load=LIGHT), payload=PAYLOAD)
    assert abs(z(found, offset)) < 4.0
    assert found.deviation < 1e-3


def test_far_off_clocks_are_found_where_they_are_looked_for() -> None:
    time, wrenches, stamps, quaternions = a_log(0.04, load=LIGHT)
    found = identify_offset(time, wrenches, stamps - 1.7e9, quaternions, search=(1.7e9 - 0.2, 1.7e9 + 0.2))
    assert abs(found.offset - 1.7e9 - 0.04) < 2e-3


def pressed(wrenches: np.ndarray, share: float) -> np.ndarray:
    """Touches of 2 to 8 N, half a second each, that fill this share of the log."""
    touched = wrenches.copy()
    rng, every = np.random.default_rng(9), 100
    for start in range(0, len(wrenches), every):
        touched[start : start + round(share * every), :3] += rng.normal(size=3) * 4.0
    return touched


@pytest.mark.parametrize(("share", "payload"), [(0.25, None), (0.6, PAYLOAD)])
def test_touches_hardly_move_it(share: float, payload: Payload | None) -> None:
    time, wrenches, *poses = a_log(0.04, load=LIGHT, lasting=20.0)
    found = identify_offset(time, pressed(wrenches, share), *poses, payload=payload)
    assert abs(found.offset - 0.04) < 2e-3
    assert any("something touched, or the arm accelerated" in note for note in found.notes)


def test_a_turn_about_one_axis_is_enough() -> None:
    """The weight along it cannot be told from the bias, and that does not matter."""
    swing = Swing(swing=(0.0, 0.0, 0.6))
    found = identify_offset(*a_log(0.04, swing=swing, load=LIGHT))
    assert abs(z(found, 0.04)) < 4.0


def test_missing_readings_and_gaps_are_left_out() -> None:
    time, wrenches, stamps, quaternions = a_log(0.04, load=LIGHT)
    wrenches[::47] = np.nan
    time[600:] += 30.0  # nothing in between
    away = stamps > 5.96
    stamps = np.where(away, stamps + 30.0, stamps)
    found = identify_offset(time, wrenches, stamps, quaternions)
    assert abs(z(found, 0.04)) < 4.0


@pytest.mark.parametrize(
    ("load", "swing", "walk"), [(LOAD, Swing(start=1e9), 0.0), (NOTHING, SWING, 0.0), (NOTHING, SWING, 0.01)]
)
@pytest.mark.parametrize("seed", range(2))
def test_an_arm_that_rests_and_a_sensor_that_carries_nothing_tell_nothing(
    load: Load, swing: Swing, walk: float, seed: int
) -> None:
    """Nor does its zero, should it walk by half of the noise with every reading."""
    time, wrenches, *poses = a_log(0.04, seed, load=load, swing=swing, pose_rate=10.0)
    walked = walk * np.cumsum(np.random.default_rng(100 + seed).normal(size=(len(time), 3)), axis=0)
    with pytest.raises(NotIdentifiable, match="do not show when the arm turns"):
        identify_offset(time, wrenches + np.pad(walked, [(0, 0), (0, 3)]), *poses)


def test_a_turn_that_is_too_slow_is_no_answer_however_sure_the_search_is() -> None:
    """1 N that turns at 0.09 rad/s under 0.1 N of noise, 400 times: 0.1 / (0.09 sqrt 400) = 56 ms, above 30 ms.

    From -5 to 5 s of search the true offset stands out clearly all the same.
    """
    time, posed, weight = np.arange(400) / 20.0, np.arange(-6.0, 26.0, 0.1), np.array([0.0, 0.0, -1.0])
    turn, poses = (Rotation.from_rotvec(0.09 * at[:, None] * [1.0, 0.0, 0.0]) for at in (time, posed))
    wrenches = np.zeros((400, 6))
    wrenches[:, :3] = turn.inv().apply(weight) + 0.1 * np.random.default_rng(0).normal(size=(400, 3))
    payload = Payload(weight, np.zeros(3), np.zeros(3), np.zeros(3))
    with pytest.raises(NotIdentifiable, match=r"would be known only to 0\.0[4-7]"):
        identify_offset(
            time, wrenches, posed, poses.as_quat(), payload=payload, search=(-5.0, 5.0), noise=np.full(6, 0.1)
        )


def test_a_residual_that_is_said_five_times_tells_no_more_than_once() -> None:
    """All within one stretch, as where poses are interpolated: the deviation stays, it does not shrink by sqrt 5."""
    rng, time = np.random.default_rng(1), np.arange(60.0)
    across, residual = rng.normal(size=(2, 60, 3))
    _, information, variance = _sums(time, across, residual, 1.0)
    _, more, larger = _sums(*(np.repeat(each, 5, axis=0) for each in (time, across, residual)), 1.0)
    assert larger**0.5 / more == pytest.approx(variance**0.5 / information, rel=1e-12)


def test_an_arm_that_rests_for_half_of_the_log_is_no_contradiction() -> None:
    """The parts at rest say nothing of the offset, and are not asked for one of their own."""
    for seed in range(4):
        found = identify_offset(*a_log(0.04, seed, swing=Swing(start=5.0), load=LIGHT))
        assert found.validation.ratio < 6.0  # four numbers: one of 7,000 by chance
        assert abs(z(found, 0.04)) < 4.0


def test_a_search_is_made_wider_while_the_best_offset_is_at_its_edge(monkeypatch: pytest.MonkeyPatch) -> None:
    found = identify_offset(*a_log(0.3), search=(-0.1, 0.1))
    assert found.offset == pytest.approx(identify_offset(*a_log(0.3)).offset, abs=1e-6)
    monkeypatch.setattr("palpate.calibration.clock.WIDEST", 0.0)
    with pytest.raises(InputError, match=r"edge of the search.*Search"):
        identify_offset(*a_log(0.3), search=(-0.1, 0.1))


def test_logs_apart_and_impossible_searches_are_refused() -> None:
    time, wrenches, stamps, quaternions = a_log(0.0)
    with pytest.raises(InputError, match="overlap"):
        identify_offset(time, wrenches, stamps + 1000.0, quaternions)
    with pytest.raises(InputError, match="search must go"):
        identify_offset(time, wrenches, stamps, quaternions, search=(0.1, 0.1))
    with pytest.raises(InputError, match=r"never increase.*Correct"):
        identify_offset(np.zeros_like(time), wrenches, stamps, quaternions)
