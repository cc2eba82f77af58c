"""What an accelerated payload adds to a reading is taken off, or widens the covariance by as much; at rest neither.

Truth is `claims.evidence.moving`: positions and angles in closed form, forces by Newton and Euler.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from claims.evidence.moving import Course, Swing, moving_wrenches
from palpate.errors import InputError
from palpate.signals import Payload, motion
from palpate.signals._curvature import WindowSettings, part_of, pose_period
from palpate.signals.motion import Motion
from palpate.signals.recording import ACCELERATION, FORCE, ORIENTATION, POSITION, TORQUE, UNSTEADY, Recording
from palpate.spatial.pose import rotation_from_quaternion
from palpate.spatial.pose_track import PoseTrack
from palpate_lab.simulation.session import GRAVITY, Load
from tests.support.streams import pieces

LOAD = Load(0.5, np.array([0.002, -0.001, 0.045]), np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, -0.3]))
PAYLOAD = Payload(LOAD.mass * GRAVITY, LOAD.force_bias, LOAD.center_of_mass, LOAD.torque_bias)
NOISE = 0.02  # N
PLACE, TURN = 1e-4, np.radians(0.01)  # m, rad: noise of the poses
RESTING = Swing(start=1e9)
SWAYING = Swing(sway=(0.3, 0.3, 0.3), sway_rate=(0.4, 0.41, 0.39))  # 2.3 m/s^2 rms
QUICK = Swing(sway=(0.05, 0.05, 0.05), sway_rate=(1.0, 1.03, 0.97))  # 2.4 m/s^2 rms
SETTING_OFF = Swing(sway=(0.3, 0.3, 0.3), sway_rate=(0.4, 0.41, 0.39), start=4.0)


def a_recording(
    swing: Swing, *, lasting: float = 8.0, rate: float = 500.0, pose_rate: float = 100.0, seed: int = 0
) -> tuple[Recording, Course]:
    """Wrenches, an accelerometer, and poses of their own rate between which rows run straight."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(lasting * rate)) / rate
    course = swing.at(time)
    wrenches = moving_wrenches(LOAD, course) + rng.normal(size=(len(time), 6)) * np.repeat([NOISE, 1e-3], 3)
    posed = np.arange(-0.2, lasting + 0.2, 1.0 / pose_rate)
    there = swing.at(posed)
    error = Rotation.from_rotvec(rng.normal(0.0, TURN, (len(posed), 3)))
    track = PoseTrack()
    track.add(
        posed,
        (Rotation.from_quat(there.quaternion) * error).as_quat(),
        there.position + rng.normal(0.0, PLACE, (len(posed), 3)),
    )
    quaternion, position = track.at(time)
    felt = course.in_sensor(course.acceleration - GRAVITY) + rng.normal(0.0, 0.01, (len(time), 3))
    channels = {FORCE: wrenches[:, :3], TORQUE: wrenches[:, 3:], ORIENTATION: quaternion, POSITION: position}
    return Recording(time, {**channels, ACCELERATION: felt}, source="arm.csv"), course


def without(recording: Recording, *names: str) -> Recording:
    return replace(recording, channels={k: v for k, v in recording.channels.items() if k not in names})


def moved(recording: Recording, source: str, **options: object) -> Recording:
    options = {"lever": LOAD.center_of_mass, "gravity": PAYLOAD.gravity} | options
    (answer,) = Motion(source, **options).stream(iter([recording]))
    return answer


def left(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Force (n, 3) that compensation leaves of a free sensor, and its variance along each axis (n, 1)."""
    rotations = rotation_from_quaternion(recording.channels[ORIENTATION])
    contact, _ = PAYLOAD.compensate(recording.wrenches(), rotations, recording.channels.get(ACCELERATION))
    return contact[:, :3], NOISE**2 + (PAYLOAD.mass * recording.channels[UNSTEADY]) ** 2


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def chi2(recording: Recording) -> float:
    force, variance = left(recording)
    return float(np.mean(force**2 / variance))


@pytest.mark.parametrize("pose_rate", [100.0, 500.0])
def test_accelerations_from_poses_leave_the_noise(pose_rate: float) -> None:
    """2.3 m/s^2 of half a kilogram are 50 times the noise; 0.1 mm and 0.01 degrees of noise of the poses."""
    recording, _ = a_recording(SWAYING, pose_rate=pose_rate)
    answer = moved(recording, "poses")
    whole = slice(200, -200)  # at the very ends the nearest acceleration is held, and said to be unsure
    assert rms(left(answer)[0][whole]) < 1.2 * NOISE
    assert chi2(answer) < 1.2


def test_an_accelerometer_leaves_the_noise() -> None:
    """The accelerometer sits at the sensor's origin, and the payload's centre swings about that."""
    for swing in (SWAYING, QUICK):
        recording, _ = a_recording(swing)
        answer = moved(recording, "imu")
        assert rms(left(answer)[0]) < 1.2 * NOISE
        assert chi2(answer) < 1.2


def test_recorded_motion_is_passed_on_and_moved_to_the_lever() -> None:
    recording, course = a_recording(QUICK)
    exact = {**recording.channels, ACCELERATION: course.in_sensor(course.acceleration)}
    recording = replace(recording, channels=exact)
    at_origin = moved(recording, "motion", lever=None)
    np.testing.assert_array_equal(at_origin.channels[ACCELERATION], exact[ACCELERATION])
    assert not at_origin.channels[UNSTEADY].any()
    at_lever = moved(recording, "motion").channels[ACCELERATION]
    true = course.in_sensor(course.point_acceleration(LOAD.center_of_mass))
    assert rms(at_lever - true) < 0.01  # m/s^2, a quarter of the noise of the force


def test_nothing_is_asked_of_poses_that_are_not_there() -> None:
    recording, _ = a_recording(QUICK, lasting=1.0)
    answer = moved(without(recording, ORIENTATION, POSITION), "motion")
    np.testing.assert_array_equal(answer.channels[ACCELERATION], recording.channels[ACCELERATION])
    assert not answer.channels[UNSTEADY].any()


@pytest.mark.parametrize("swing", [SWAYING, QUICK, SETTING_OFF, Swing()])
@pytest.mark.parametrize("pose_rate", [100.0, 500.0])
def test_what_is_left_out_widens_the_covariance_as_much(swing: Swing, pose_rate: float) -> None:
    recording, _ = a_recording(swing, pose_rate=pose_rate)
    answer = moved(recording, "none")
    assert ACCELERATION not in answer.channels  # weight only
    assert 0.8 < chi2(answer) < 1.2


@pytest.mark.parametrize("pose_rate", [10.0, 100.0, 500.0])
def test_at_rest_nothing_is_widened(pose_rate: float) -> None:
    for seed in range(3):
        recording, _ = a_recording(RESTING, pose_rate=pose_rate, seed=seed, lasting=20.0)
        arm = Motion("none", lever=LOAD.center_of_mass)
        (answer,) = arm.stream(iter([recording]))
        assert not answer.channels[UNSTEADY].any()
        assert arm.notes() == ()
        (answer,) = Motion("none").stream(iter([without(recording, POSITION)]))
        assert not answer.channels[UNSTEADY].any()


def test_rest_and_motion_in_one_log_are_told_apart() -> None:
    recording, _ = a_recording(SETTING_OFF)
    arm = Motion("none", lever=LOAD.center_of_mass)
    (answer,) = arm.stream(iter([recording]))
    moving = answer.channels[UNSTEADY][:, 0] > 0
    assert not moving[recording.time < 3.6].any()
    assert moving[recording.time > 4.2].all()
    (note,) = arm.notes(PAYLOAD.mass)
    assert "no acceleration is known: covariances were widened by up to 0." in note or "up to 1" in note
    assert " N" in note
    assert "m/s^2" in arm.notes()[0]


def test_without_positions_an_arm_of_half_a_metre_is_assumed() -> None:
    """A sensor that turns about a pivot 0.5 m away, in any direction of the sensor: on average it fits."""
    turning = Swing(swing=(0.5, 0.5, 0.5), swing_rate=(0.5, 0.6, 0.55))
    time = np.arange(4000) / 500.0
    course = turning.at(time)
    poses = {ORIENTATION: course.quaternion, FORCE: np.zeros((4000, 3)), TORQUE: np.zeros((4000, 3))}
    arm = Motion("none")
    (answer,) = arm.stream(iter([Recording(time, poses)]))
    directions = np.random.default_rng(0).normal(size=(300, 3))
    arms = 0.5 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    still = replace(course, acceleration=np.zeros((4000, 3)))
    true = np.sqrt(np.mean([still.point_acceleration(each) ** 2 for each in arms], axis=(0, 2)))
    middle = slice(100, -100)
    ratio = answer.channels[UNSTEADY][middle, 0] / true[middle]
    assert 0.9 < ratio.min() < ratio.max() < 1.1
    assert "arm of 0.5 m" in arm.notes()[0]


def test_a_parabola_has_its_curvature() -> None:
    """Closed form, at any rate and window: 1e-7 is rounding of metres over a window's square."""
    a, time = np.array([1.0, -2.0, 0.5]), np.arange(2000) / 1000.0
    turn = np.tile(Rotation.from_rotvec([0.3, -1.0, 2.0]).as_quat(), (2000, 1))
    place = 3.0 + 0.2 * time[:, None] + time[:, None] ** 2 * a / 2
    channels = {FORCE: place, TORQUE: place, ORIENTATION: turn, POSITION: place}
    answer = moved(Recording(time, channels), "poses", lever=None)
    expected = np.tile(rotation_from_quaternion(turn[0]).T @ a, (2000, 1))
    np.testing.assert_allclose(answer.channels[ACCELERATION], expected, atol=1e-7)


@pytest.mark.parametrize("pose_rate", [100.0, 500.0])
def test_the_noise_of_derivatives_is_known(pose_rate: float) -> None:
    """At rest they are nothing but noise. A window of 0.2 s makes it alike for as long: 20 s hold 100 of them."""
    recording, _ = a_recording(RESTING, pose_rate=pose_rate, lasting=20.0)
    answer = moved(recording, "poses")
    middle = slice(200, -200)
    found = answer.channels[ACCELERATION][middle]
    said = np.sqrt(np.mean(answer.channels[UNSTEADY][middle] ** 2))
    assert 0.75 < rms(found) / said < 1.25


@pytest.mark.parametrize("rows", [1, 2, 3, 10, 33.3, 100])
def test_the_period_of_slower_poses_is_seen(rows: float) -> None:
    """Two periods make a part; noise from the poses, which rows run straight between. Rest before does not hide it."""
    recording, _ = a_recording(QUICK, lasting=10.0, rate=1000.0, pose_rate=1000.0 / rows)
    resting = np.tile([0.0, 0.0, 0.0, 0.0, 1.0, 0.4, 0.0, 0.6], (10000, 1))
    resting[:, 0] = np.arange(10000) / 1000.0 - 10.0
    poses = np.column_stack([recording.time, recording.channels[ORIENTATION], recording.channels[POSITION]])
    for log in (poses, np.concatenate([resting, poses])):
        settings = WindowSettings(1e-3, 1, 901)
        part, factor = part_of(pose_period(log, settings), settings)
        assert 2 * rows - 2 <= part <= 2 * rows + 2
        assert factor == pytest.approx(1.0, abs=0.2)
    assert pose_period(resting, settings) == 0.0


def test_poses_too_slow_for_the_window_are_said() -> None:
    recording, _ = a_recording(SWAYING, pose_rate=10.0)
    arm = Motion("none", lever=LOAD.center_of_mass)
    list(arm.stream(iter([recording])))
    assert "poses have a low rate" in arm.notes()[-1]


def test_near_a_gap_the_nearest_is_held_and_beyond_that_nothing_is_known() -> None:
    recording, course = a_recording(SWAYING)
    lost = (recording.time > 3.0) & (recording.time < 3.5)
    short = (recording.time > 3.5) & (recording.time < 3.55)  # alone between gaps: less than a window
    lost |= (recording.time >= 3.55) & (recording.time < 4.2)
    channels = dict(recording.channels)
    for name in (ORIENTATION, POSITION):
        channels[name] = np.where(lost[:, None], np.nan, channels[name])
    arm = Motion("poses", lever=LOAD.center_of_mass)
    (answer,) = arm.stream(iter([replace(recording, channels=channels)]))
    acceleration, unsteady = answer.channels[ACCELERATION], answer.channels[UNSTEADY][:, 0]
    assert np.isfinite(acceleration).all()
    assert np.isfinite(unsteady).all()
    assert not acceleration[short].any()
    assert (unsteady[short] == motion.UNKNOWN).all()
    held = (recording.time > 2.95) & (recording.time <= 3.0)
    assert (unsteady[held] > 0.3).all()
    off = acceleration - course.in_sensor(course.point_acceleration(LOAD.center_of_mass))
    assert rms(off[held] / unsteady[held, None]) < 1.0
    assert "have no acceleration" in arm.notes()[-1]


SMALL, CUT = a_recording(SETTING_OFF, lasting=6.0)[0], 500


def test_it_looks_ahead_no_further_than_it_must(monkeypatch: pytest.MonkeyPatch) -> None:
    """A log without end is answered as it comes."""
    monkeypatch.setattr(motion, "CHUNK", CUT)
    taken = 0

    def endless() -> Iterator[Recording]:
        nonlocal taken
        for piece in pieces(SMALL, 10):
            taken += len(piece)
            yield piece

    given_back = 0
    for answer in Motion("none").stream(endless()):
        given_back += len(answer)
        assert taken - given_back <= 3 * CUT
    assert given_back == len(SMALL)


@pytest.mark.parametrize("source", ["none", "poses", "motion", "imu"])
@pytest.mark.parametrize("rows", [0, 1, 2, 7])
def test_short_logs_come_back(source: str, rows: int) -> None:
    answer = moved(SMALL.picked(slice(rows)), source)
    assert len(answer) == rows
    assert np.isfinite(answer.channels[UNSTEADY]).all()
    assert list(Motion(source, gravity=PAYLOAD.gravity).stream(iter([]))) == []


def test_times_that_repeat_jump_or_are_missing_do_no_harm() -> None:
    time = SMALL.time.copy()
    time[100:110] = time[100]
    time[500] = np.nan
    time[1000:] -= 1.0
    time[2000:] += 1e6
    for source in ("none", "poses"):
        answer = moved(replace(SMALL, time=time), source)
        assert np.isfinite(answer.channels[UNSTEADY]).all()
    assert np.isfinite(answer.channels[ACCELERATION]).all()


def test_what_is_missing_is_named() -> None:
    with pytest.raises(InputError, match="Use one of none, poses, motion, imu"):
        Motion("guess")
    with pytest.raises(InputError, match=r"gravity.*Use"):
        Motion("imu")
    with pytest.raises(InputError, match=r"no acceleration.*Name"):
        moved(without(SMALL, ACCELERATION), "imu")
    with pytest.raises(InputError, match=r"positions and orientations.*Add"):
        moved(without(SMALL, POSITION), "poses")
    with pytest.raises(InputError, match=r"csv: .*no orientation"):
        moved(without(SMALL, ORIENTATION), "imu")
