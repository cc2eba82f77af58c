"""What navigators share: touches of any sensor, headings, steering, measured speed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.contact import ContactEstimate, Contacts, Status
from palpate.contact.estimate import ROW
from palpate.control.drive import DifferentialDrive
from palpate.control.navigation import Speedometer, Steering, heading_error, planar_touches, require_goal
from palpate.errors import InputError

RATE = 30.0
NOISE = 0.5e-3  # m, of the tracker


def contacts(*rows: tuple[float, float, float, Status], lift: float = 0.0, features: int = 0) -> Contacts:
    """One frame's rows on a cylinder: angle, force inwards and along rising angles, status; `lift` of the normal."""
    made = np.full((len(rows), ROW.length), np.nan)
    made[:, ROW.candidates] = 0.0
    for row, (angle, force, shear, status) in zip(made, rows, strict=True):
        row[ROW.status] = status
        if math.isfinite(force):
            out = np.array([math.cos(angle) * math.cos(lift), math.sin(angle) * math.cos(lift), math.sin(lift)])
            along = np.array([-math.sin(angle), math.cos(angle), 0.0])
            row[ROW.point], row[ROW.normal] = 0.055 * out, out
            row[ROW.force] = -force * out + shear * along
    estimate = ContactEstimate.from_rows(made)
    count = len(rows)
    extra = {f"feature {k}": np.full(count, np.nan) for k in range(features)}
    nought = np.zeros(count, dtype=np.int64)
    return Contacts(nought, np.zeros(count), nought, estimate, extra)


def touches(*rows: tuple[float, float, float, Status], lift: float = 0.0) -> np.ndarray:
    found = planar_touches(contacts(*rows, lift=lift))
    assert found is not None
    return found


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.0, math.pi])
@pytest.mark.parametrize("shear", [0.0, 0.9])
def test_a_touch_is_where_it_presses_whatever_friction_does(angle: float, shear: float) -> None:
    (found,) = touches((angle, 2.0, shear, Status.CONTACT))
    assert math.cos(found[0] - angle) == pytest.approx(1.0)
    assert found[1] == pytest.approx(2.0)


def test_several_at_once_and_those_that_are_doubted() -> None:
    rows = [(0.1 * k, 1.0 + k, 0.0, status) for k, status in enumerate((Status.OFF_SURFACE, Status.IMPLAUSIBLE))]
    np.testing.assert_allclose(touches(*rows, (2.0, 3.0, 0.0, Status.AMBIGUOUS)), [[0.0, 1.0], [0.1, 2.0], [2.0, 3.0]])


def test_a_force_on_a_slope_counts_by_its_planar_part() -> None:
    np.testing.assert_allclose(touches((0.5, 2.0, 0.0, Status.CONTACT), lift=1.0), [[0.5, 2.0 * math.cos(1.0)]])
    assert touches((0.5, 2.0, 0.0, Status.CONTACT), lift=math.pi / 2.0)[:, 1].sum() == pytest.approx(0.0, abs=1e-15)


def test_without_a_normal_the_force_itself_counts() -> None:
    made = contacts((0.5, 2.0, 0.0, Status.CONTACT))
    rows = made.rows()
    rows[:, ROW.normal] = np.nan
    found = planar_touches(made.with_estimate(ContactEstimate.from_rows(rows[:, : ROW.length])))
    assert found is not None
    np.testing.assert_allclose(found, [[0.5, 2.0]])


@pytest.mark.parametrize(
    "row",
    [
        (0.0, math.nan, 0.0, Status.NO_CONTACT),
        (0.0, math.nan, 0.0, Status.TOO_LIGHT),
        (0.0, -1.0, 0.0, Status.CONTACT),  # it pulls
        (0.0, 0.0, 0.0, Status.CONTACT),
    ],
)
def test_rows_without_a_touch(row: tuple[float, float, float, Status]) -> None:
    assert touches(row).shape == (0, 2)
    assert touches().shape == (0, 2)
    assert touches(row, (1.0, 1.0, 0.0, Status.CONTACT)).shape == (1, 2)


@pytest.mark.parametrize("status", [Status.INVALID, Status.SATURATED, Status.NO_POSE])
def test_a_sensor_that_says_nothing(status: Status) -> None:
    assert planar_touches(contacts((0.0, math.nan, 0.0, status), features=8)) is None


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_an_error_of_heading_leads_there_by_the_short_way(wanted: float, heading: float) -> None:
    error = heading_error(wanted, heading)
    assert abs(error) <= math.pi
    assert math.cos(heading + error - wanted) == pytest.approx(1.0)


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


@pytest.mark.parametrize("goal", [(1.0,), (1.0, 2.0, 3.0), (math.nan, 0.0)])
def test_a_goal_that_is_none(goal: tuple[float, ...]) -> None:
    assert require_goal([1, 2]) == (1.0, 2.0)
    with pytest.raises(InputError, match="two finite numbers"):
        require_goal(goal)
