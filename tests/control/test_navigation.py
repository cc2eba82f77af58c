"""What navigators share: touches of any sensor, headings, goals."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.contact import ContactEstimate, Contacts, Status
from palpate.contact.estimate import ROW
from palpate.control.navigation import heading_error, planar_touches, require_goal
from palpate.errors import InputError


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
    ("force", "status"),  # below 0 it pulls
    [(math.nan, Status.NO_CONTACT), (math.nan, Status.TOO_LIGHT), (-1.0, Status.CONTACT), (0.0, Status.CONTACT)],
)
def test_rows_without_a_touch(force: float, status: Status) -> None:
    row = (0.0, force, 0.0, status)
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


@pytest.mark.parametrize("goal", [(1.0,), (1.0, 2.0, 3.0), (math.nan, 0.0)])
def test_a_goal_that_is_none(goal: tuple[float, ...]) -> None:
    assert require_goal([1, 2]) == (1.0, 2.0)
    with pytest.raises(InputError, match=r"goal: .*two finite numbers"):
        require_goal(goal)
