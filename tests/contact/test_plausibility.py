"""A wrong unit puts the line of action where the body is not; the noise of a log is told from its steps."""

import numpy as np
import pytest

from palpate.calibration.presses import find_presses
from palpate.contact.estimate import Status
from palpate.contact.plausibility import lines_of_action, never_at_rest, unexplained
from palpate.sensors.force_torque.poses import average_poses
from palpate.signals.noise import estimate_noise
from palpate.spatial.pose import Pose

CENTRE, SIZE = np.array([0.0, 0.01, 0.08]), 0.05


def _touches(seed: int) -> np.ndarray:
    """400 wrenches whose lines of action pass within half the body's size of its middle."""
    rng = np.random.default_rng(seed)
    force, aside = rng.normal(size=(400, 3)), rng.normal(size=(400, 3))
    point = CENTRE + 0.5 * SIZE * aside / np.linalg.norm(aside, axis=1, keepdims=True)
    return np.concatenate([force, np.cross(point, force)], axis=1)


@pytest.mark.parametrize(
    ("torque", "length", "word"),
    [
        (1.0, 1.0, ""),
        (1e3, 1.0, "further from the middle of the body"),  # N mm declared as N m
        (1.0, 1e3, "through the sensor's origin"),  # mesh in mm declared as m
        (1.0, 1e-3, "further from the middle of the body"),  # mesh in m declared as mm
        (1e-3, 1.0, "through the sensor's origin"),  # N m declared as N mm
    ],
)
def test_wrong_units_are_doubted_and_right_ones_are_not(torque: float, length: float, word: str) -> None:
    wrenches = _touches(0) * np.repeat([1.0, torque], 3)
    doubt = lines_of_action(wrenches, CENTRE * length, SIZE * length)
    assert word in doubt
    assert bool(doubt) == bool(word)


def test_nothing_pressed_is_not_doubted() -> None:
    assert lines_of_action(np.zeros((5, 6)), CENTRE, SIZE) == ""
    assert lines_of_action(np.full((5, 6), np.nan), CENTRE, SIZE) == ""
    assert never_at_rest(np.full((5, 6), np.nan), np.ones(1)) == ""


def test_a_force_that_never_rests_is_said() -> None:
    wrenches = np.tile([3.0, 0, 4.0, 0, 0, 0], (100, 1))
    assert "never below 5 N" in never_at_rest(wrenches, np.ones(1))
    wrenches[:10] = 0.0
    time = np.arange(100) / 2
    assert never_at_rest(wrenches, np.ones(1), time) == ""  # one long touch
    wrenches[10:, 0] += np.arange(90) % 15 // 10 * 12.0
    assert "from 5.0 s on the force is 5 N between touches" in never_at_rest(wrenches, np.ones(1), time)
    assert "until 44.5 s the force is 5 N between touches" in never_at_rest(wrenches[::-1], np.ones(1), time)


def test_noise_is_told_from_steps_whatever_touches_come_and_go() -> None:
    """The median of 20,000 steps has a standard deviation of 0.8 %; the touches move it by under 3 %."""
    rng = np.random.default_rng(3)
    sigma = np.array([0.02, 0.03, 0.04, 1e-3, 2e-3, 3e-3])
    press = 10 * np.maximum(0, np.sin(np.arange(20_000) / 300))[:, None] * np.array([0, 0, 1, 0.01, 0, 0])
    noise = estimate_noise(press + sigma * rng.normal(size=(20_000, 6)))
    assert noise.deviation == pytest.approx(sigma, rel=0.06)


def test_repeated_readings_and_coarse_steps_do_not_silence_the_noise() -> None:
    rng = np.random.default_rng(4)
    wrenches = rng.normal(size=(5000, 6))
    doubled = estimate_noise(np.repeat(wrenches, 3, axis=0))
    assert doubled.deviation == pytest.approx(np.ones(6), rel=0.06)
    coarse = estimate_noise(np.round(0.3 * wrenches))  # most steps are 0
    assert np.all(coarse.deviation > 0.1)
    assert estimate_noise(wrenches[:8]) is None
    assert estimate_noise(np.full((50, 6), np.nan)) is None


def test_poses_at_rest_are_averaged_and_motion_is_left_out() -> None:
    rng = np.random.default_rng(6)
    stops = [Pose.from_rotation_vector(rng.normal(size=3), np.zeros(3)).rotation for _ in range(5)]
    moving = [Pose.from_rotation_vector([0.05 * k, 0, 0], np.zeros(3)).rotation for k in range(20)]
    rotations = np.stack([turn for stop in stops for turn in [stop] * 30 + moving])
    clean = np.repeat(np.arange(5.0), 50)[:, None] * np.ones(6)
    wrenches = clean + 0.01 * rng.normal(size=(250, 6))
    rotations[7, 0, 0] = np.nan  # in the first pose: it falls into two stretches, 7 samples and 22
    means, turns, counts = average_poses(wrenches, rotations)
    assert counts.tolist() == [22, 30, 30, 30, 30]
    assert means[1:] == pytest.approx(np.arange(1.0, 5.0)[:, None] * np.ones(6), abs=0.01)  # 0.01/sqrt(30), 5 times
    assert turns == pytest.approx(np.stack(stops), abs=1e-12)


def test_a_log_of_single_poses_comes_back_as_it_is() -> None:
    wrenches, rotations = np.ones((3, 6)), np.broadcast_to(np.eye(3), (3, 3, 3))
    means, _, counts = average_poses(wrenches, rotations)
    assert means is wrenches
    assert counts.tolist() == [1, 1, 1]


def test_presses_are_found_without_their_ramps() -> None:
    time = np.arange(400) * 0.01
    strength = np.zeros(400)
    strength[100:200] = np.r_[np.linspace(0, 5, 20), np.full(60, 5.0), np.linspace(5, 0, 20)]
    strength[300:350] = 0.4  # never exceeds `on`
    wrenches = np.zeros((400, 6))
    wrenches[:, 2] = -strength
    start, end = find_presses(time, wrenches, on=0.5, off=0.3)
    assert len(start) == 1
    assert 1.10 <= start[0] <= 1.20  # the ramp passes 0.7 of the force at 1.14 s
    assert 1.79 <= end[0] <= 1.90
    assert len(find_presses(time, np.zeros((400, 6)), on=0.5, off=0.3)[0]) == 0


def _counts(statuses: list[Status]) -> np.ndarray:
    return np.bincount(statuses, minlength=len(Status))


def test_most_of_the_loaded_samples_decide_what_is_unexplained() -> None:
    free = [Status.NO_CONTACT, Status.TOO_LIGHT, Status.INVALID, Status.NO_POSE] * 5
    found = [Status.CONTACT, Status.AMBIGUOUS]
    assert unexplained(_counts(free)) == []
    assert unexplained(_counts([*free, *found * 10, Status.OFF_SURFACE, Status.IMPLAUSIBLE])) == []
    [some] = unexplained(_counts([*free, *found, Status.OFF_SURFACE, Status.IMPLAUSIBLE]))
    assert "check the units" not in some
    [said] = unexplained(_counts([*free, *found, Status.OFF_SURFACE, *[Status.IMPLAUSIBLE] * 2]))
    assert "40% are implausible" in said
    assert "20% are off the surface" in said
    assert "check the units" in said
