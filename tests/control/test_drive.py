"""Two tracks: what they make of a motion, within their top speed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.control.drive import DifferentialDrive
from palpate.errors import InputError

DRIVE = DifferentialDrive(track=0.085, top=0.05)
FORWARD, TURN = st.floats(-1.0, 1.0), st.floats(-20.0, 20.0)


def test_straight_and_on_the_spot() -> None:
    assert DRIVE.wheels(0.03, 0.0) == (0.03, 0.03)
    left, right = DRIVE.wheels(0.0, 1.0)  # counter-clockwise: the right track goes ahead
    assert (left, right) == pytest.approx((-0.0425, 0.0425))


def test_a_circle_closes_after_its_time() -> None:
    """Radius 0.1 m at 0.02 m/s, by Euler's steps of the twist: the robot is back after 2 pi 0.1/0.02 s."""
    forward, turn = DRIVE.twist(*DRIVE.wheels(0.02, 0.2))
    steps = 20_000
    heading = turn * np.linspace(0.0, 2.0 * np.pi * 0.1 / 0.02, steps, endpoint=False)
    assert forward * np.cos(heading).mean() == pytest.approx(0.0, abs=1e-12)
    assert forward * np.sin(heading).mean() == pytest.approx(0.0, abs=1e-12)
    assert forward / turn == pytest.approx(0.1)


@given(FORWARD, TURN)
def test_twist_is_the_inverse_of_wheels_with_the_curvature_kept(forward: float, turn: float) -> None:
    left, right = DRIVE.wheels(forward, turn)
    assert max(abs(left), abs(right)) <= DRIVE.top * (1.0 + 1e-12)
    got = DRIVE.twist(left, right)
    assert got[0] * turn == pytest.approx(got[1] * forward, abs=1e-12)  # the same curve, slower
    assert got[0] * forward >= 0.0
    assert got[1] * turn >= 0.0
    if abs(forward) + 0.5 * DRIVE.track * abs(turn) <= DRIVE.top:
        assert got == pytest.approx((forward, turn), abs=1e-12)
    elif forward or turn:
        assert max(abs(left), abs(right)) == pytest.approx(DRIVE.top)


def test_what_is_not_finite_stops_it() -> None:
    assert DRIVE.wheels(math.nan, 0.0) == DRIVE.wheels(0.01, math.inf) == DRIVE.wheels(math.inf, math.inf) == (0.0, 0.0)


@pytest.mark.parametrize("wrong", [{"track": 0.0}, {"top": -0.05}, {"track": math.nan}, {"top": math.inf}])
def test_a_drive_that_cannot_be(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=r"drive: .*must be positive"):
        DifferentialDrive(**wrong)
