"""Steering by the heading, and the velocity of a robot from its poses."""

import math

import numpy as np
import pytest

from palpate.control.drive import DifferentialDrive
from palpate.control.navigation import heading_error
from palpate_lab.papers.steering import Speedometer, Steering

RATE = 30.0
NOISE = 0.5e-3  # m, of the tracker


def driven(error: float, bias: float = 0.0, seconds: float = 30.0, speed: float = 0.05) -> np.ndarray:
    """(n, 3) pose of an ideal drive that is to go along x; `bias` [m/s] of the right track."""
    drive = DifferentialDrive()
    steering, pose, poses = Steering(drive), np.array([0.0, 0.0, -error]), list[np.ndarray]()
    for k in range(int(seconds * RATE)):
        left, right = steering.wheels(k / RATE, heading_error(0.0, float(pose[2])), speed)
        forward, turn = drive.twist(left, right + bias)
        pose = pose + np.array([forward * math.cos(pose[2]), forward * math.sin(pose[2]), turn]) / RATE
        poses.append(pose)
    return np.array(poses)


@pytest.mark.parametrize("error", [0.0, 0.3, -1.0, 2.0, 3.1])
def test_steering_finds_the_heading_and_goes_there(error: float) -> None:
    poses = driven(error)
    assert abs(poses[-1, 2]) < 1e-3
    assert abs(poses[:, 2]).max() <= abs(error) + 1e-12  # no overshoot beyond the start
    assert np.diff(poses[-30:, 0]).mean() * RATE == pytest.approx(0.05, rel=1e-3)


def test_it_turns_on_the_spot_where_it_looks_away() -> None:
    left, right = Steering(DifferentialDrive()).wheels(0.0, 2.0, 0.05)
    assert left == -right < 0.0


def test_the_integral_takes_out_a_track_that_is_wrong() -> None:
    """5 mm/s at one track turn by 0.06 rad/s, which k_p alone would answer with 0.06/3 rad."""
    assert abs(driven(0.0, bias=0.005, speed=0.03)[-1, 2]) < 2e-4


def test_reset_forgets_the_integral() -> None:
    steering = Steering(DifferentialDrive())
    first = [steering.wheels(k / RATE, 0.1, 0.02) for k in range(30)]
    assert first[-1] != first[0]
    steering.reset()
    assert [steering.wheels(k / RATE, 0.1, 0.02) for k in range(30)] == first


def test_the_speed_is_that_of_the_window() -> None:
    meter = Speedometer(0.5)
    found = [meter.velocity(k / RATE, 0.04 * min(k / RATE, 1.0), -0.03 * min(k / RATE, 1.0)) for k in range(60)]
    assert all(math.isnan(x) for x, _ in found[:7])  # under half of the window
    for x, y in found[8:31]:
        assert (x, y) == pytest.approx((0.04, -0.03))
    assert found[45] == pytest.approx((0.0, 0.0), abs=1e-12)  # 0.5 s after it stopped
    meter.reset()
    assert math.isnan(meter.velocity(2.0, 0.0, 0.0)[0])


def test_its_noise_is_as_stated() -> None:
    rng, meter = np.random.default_rng(3), Speedometer(0.5)
    poses = NOISE * rng.standard_normal((4000, 2))
    found = np.array([meter.velocity(k / RATE, *pose) for k, pose in enumerate(poses.tolist())])[20:]
    n = 16
    stated = NOISE * RATE * math.sqrt(12.0 / (n**3 - n))
    assert found.std() == pytest.approx(stated, rel=0.1)  # windows overlap: some 500 are independent
    assert stated == pytest.approx(0.81e-3, rel=0.01)


def test_repeated_times_and_lost_poses_add_nothing() -> None:
    meter, twice = Speedometer(0.5), Speedometer(0.5)
    for k in range(20):
        wanted = meter.velocity(k / RATE, 0.001 * k, 0.0)
        twice.velocity(k / RATE, 0.001 * k, 0.0)
        twice.velocity(k / RATE, math.nan, 0.0)
        assert twice.velocity(k / RATE, 7.0, 7.0) == pytest.approx(wanted, nan_ok=True)
