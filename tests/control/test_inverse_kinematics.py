"""The damped step against the printed form; limits that nothing passes."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.control import _arm
from palpate.control.arm import Arm
from palpate.files.arm import load_arm
from palpate.spatial.pose import Pose
from tests.support.arms import write_arm

N = 3
ANY = st.floats(allow_nan=True, allow_infinity=True)
ROW = st.lists(ANY | st.floats(-3.0, 3.0), min_size=N, max_size=N).map(np.array)


def made(acceleration: float = np.inf) -> Arm:
    """Three joints with ranges of 2, 3 and no end."""
    places = Pose(np.tile(np.eye(3), (N + 1, 1, 1)), np.full((N + 1, 3), 0.1))
    turns = np.array([True, True, True])
    lower, upper = np.array([-1.0, -2.0, -np.inf]), np.array([1.0, 1.0, np.inf])
    return Arm(
        ("a", "b", "c"), places, np.eye(3), turns, lower, upper, np.array([1.0, 2.0, 0.5]), np.full(N, acceleration)
    )


@pytest.mark.parametrize("n", [4, 6, 7])
def test_the_step_is_that_of_the_printed_form(n: int) -> None:
    """(J'J + l^2)^-1 J' e by NumPy; its condition is 1/l^2 = 400 at most, so 1e-12 of it are lost."""
    rng = np.random.default_rng(n)
    for _ in range(20):
        jacobian, e, damping = rng.normal(size=(6, n)), rng.normal(size=6), rng.uniform(0.05, 0.5)
        out = np.empty(n)
        missed = _arm.damped_step(jacobian, e, damping, out)
        printed = np.linalg.solve(jacobian.T @ jacobian + damping**2 * np.eye(n), jacobian.T @ e)
        assert np.abs(out - printed).max() < 1e-10
        assert missed == pytest.approx(np.linalg.norm(e - jacobian @ out) / np.linalg.norm(e), abs=1e-10)


def test_the_step_reaches_what_was_wanted(tmp_path: Path) -> None:
    """Away from singular poses the point moves by e, but for the damping and the curvature, |e|^2/0.3 m."""
    arm = load_arm(write_arm(tmp_path), "base", "ft")
    q, point, out = np.array([0.3, 0.8, -1.2, 0.4, 1.0, -0.5]), np.array([0.0, 0.0, 0.15]), np.empty(6)
    e = np.array([1e-4, -2e-4, 1e-4, 2e-4, 1e-4, -1e-4])
    missed = _arm.damped_step(arm.jacobian(q, point), e, 1e-4, out)
    before, after = arm.pose(q), arm.pose(q + out)
    assert missed < 1e-4
    assert np.abs(after.apply(point) - before.apply(point) - e[:3]).max() < 1e-6
    assert np.abs(Pose(after.rotation @ before.rotation.T, np.zeros(3)).rotation_vector() - e[3:]).max() < 1e-6


def test_a_singular_pose_holds_or_says_what_is_missed() -> None:
    jacobian, out = np.zeros((6, 6)), np.full(6, 9.0)
    assert np.isnan(_arm.damped_step(jacobian, np.ones(6), 0.0, out))
    assert not out.any()
    jacobian[0, 0] = 1.0
    assert _arm.damped_step(jacobian, np.eye(6)[1], 0.05, out) == pytest.approx(1.0)
    assert not out.any()
    assert _arm.damped_step(jacobian, np.eye(6)[0], 0.05, out) == pytest.approx(0.05**2 / (1 + 0.05**2))
    assert _arm.damped_step(jacobian, np.zeros(6), 0.05, out) == 0.0
    for bad in (np.nan, np.inf):
        assert np.isnan(_arm.damped_step(jacobian, np.full(6, bad), 0.05, out))
        assert np.isnan(_arm.damped_step(np.full((6, 6), bad), np.ones(6), 0.05, out))
        assert not out.any()


@settings(max_examples=300, deadline=None)
@given(q=ROW, step=ROW, last=ROW, dt=ANY | st.floats(1e-3, 0.1), acceleration=st.sampled_from([np.inf, 5.0]))
def test_limits_are_never_passed(
    q: np.ndarray, step: np.ndarray, last: np.ndarray, dt: float, acceleration: float
) -> None:
    """The range exactly, and speed but for the rounding of q + step; without a clock nothing moves."""
    arm, out = made(acceleration), np.full(N, 0.25)
    share = _arm.limit(arm.limits, q, step, last, dt, out)
    if not np.isfinite(q).all():
        assert np.isnan(share)
        assert (out == 0.25).all()
        return
    assert (out >= np.minimum(arm.lower, q)).all()
    assert (out <= np.maximum(arm.upper, q)).all()
    period = dt if 0 < dt < np.inf else 0.0
    assert (np.abs(out - q) <= arm.speed * period * (1 + 1e-12) + 4e-16 * np.abs(q)).all()
    if not np.isfinite(step).all() or period == 0.0:
        assert np.isnan(share)


@settings(max_examples=60, deadline=None)
@given(wanted=st.lists(ROW, min_size=1, max_size=40), start=st.floats(-1.0, 1.0), dt=st.sampled_from([0.02, 0.005]))
def test_what_keeps_its_acceleration_can_always_be_braked(wanted: list[np.ndarray], start: float, dt: float) -> None:
    """From standing, whatever is wanted: no step differs from the one before by more than a dt^2 (1e-9 of rounding)."""
    arm = made(5.0)
    q, last = np.full(N, start), np.zeros(N)
    for step in (*wanted, *([np.full(N, np.nan)] * 100)):
        out = np.empty(N)
        _arm.limit(arm.limits, q, step, last, dt, out)
        assert (np.abs(out - q - last) <= 5.0 * dt**2 * (1 + 1e-9) + 1e-15).all()
        assert (out >= arm.lower).all()
        assert (out <= arm.upper).all()
        last, q = out - q, out
    assert np.abs(last).max() < 1e-12  # 100 cycles suffice: speed / (a dt) = 80 at most


def test_a_joint_brakes_before_the_end_of_its_range() -> None:
    """Pushed on for 5 s: it arrives at the end, and keeps its acceleration all the way (1e-9 of rounding)."""
    arm, dt = made(5.0), 0.02
    for push, end in ((1.0, arm.upper[:2]), (-1.0, arm.lower[:2])):
        q, last = np.zeros(N), np.zeros(N)
        for _ in range(250):
            out = np.empty(N)
            _arm.limit(arm.limits, q, np.full(N, push), last, dt, out)
            assert (np.abs(out - q - last) <= 5.0 * dt**2 * (1 + 1e-9) + 1e-15).all()
            last, q = out - q, out
        assert q[:2] == pytest.approx(end, abs=1e-12)


def test_a_fast_step_keeps_its_direction() -> None:
    arm, out, step = made(), np.empty(N), np.array([0.2, -0.1, 0.004])
    share = _arm.limit(arm.limits, np.zeros(N), step, np.zeros(N), 0.02, out)
    assert share == pytest.approx(0.1)  # of the first joint: 0.02 of 0.2
    assert out == pytest.approx(0.1 * step)
    q = np.array([1.5, 0.0, 0.0])  # outside its range: back only, and not faster
    _arm.limit(arm.limits, q, np.array([0.01, 0.0, 0.0]), np.zeros(N), 0.02, out)
    assert out[0] == 1.5
    _arm.limit(arm.limits, q, np.array([-0.01, 0.0, 0.0]), np.zeros(N), 0.02, out)
    assert out[0] == pytest.approx(1.49)


def test_a_period_of_the_loop_is_pose_jacobian_step_and_limits(tmp_path: Path) -> None:
    """The compiled cycle against its parts, each of which is tested by itself: equal but for rounding."""
    arm, rng = load_arm(write_arm(tmp_path), "base", "ft"), np.random.default_rng(3)
    axes, point = np.linalg.qr(rng.normal(size=(3, 3)))[0], np.array([0.01, -0.02, 0.15])
    command, last, bounds = np.array([0.3, 0.8, -1.2, 0.4, 1.0, -0.5]), np.zeros(6), np.array([0.01, 0.25, 1.0])
    turned, at = np.empty((3, 3)), np.empty(3)
    for size in (1e-4, 1e-2, 1.0, np.nan):  # free, free, bounded, none
        offset, e = 0.01 * rng.normal(size=6), size * rng.normal(size=6)
        _arm.stance(arm.chain, command, offset, axes, point, turned, at)
        pose = arm.pose(command + offset)
        assert turned == pytest.approx(pose.rotation @ axes, abs=1e-12)
        assert at == pytest.approx(pose.apply(point), abs=1e-12)
        wanted = np.zeros(6) if np.isnan(size) else e.copy()
        for part, most in ((wanted[:3], 0.25 * 0.02), (wanted[3:], 1.0 * 0.02)):
            part *= min(1.0, most / max(1e-9, float(np.linalg.norm(part))))
        step, following = np.empty(6), np.empty(6)
        _arm.damped_step(arm.jacobian(command + offset, point), wanted, 0.01, step)
        _arm.limit(arm.limits, command, step, last, 0.02, following)
        before = command.copy()
        _arm.stepped(arm.chain, arm.limits, offset, point, e, bounds, 0.02, command, last)
        assert command == pytest.approx(following, abs=1e-12)
        assert last == pytest.approx(following - before, abs=1e-12)
