"""Wrenches in other frames."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.spatial.pose import Pose
from palpate.spatial.wrench import Wrench
from tests.support.dice import agree, mixed, rolled


def some(count: int = 40) -> tuple[Wrench, Pose, np.random.Generator]:
    rng = np.random.default_rng(0)
    wrench = Wrench(rng.normal(size=(count, 3)), rng.normal(size=(count, 3)))
    return wrench, Pose.from_rotation_vector(rng.normal(size=3), rng.normal(size=3)), rng


def test_the_power_on_a_moving_body_does_not_depend_on_the_frame() -> None:
    """F . v + M . w, v the velocity of the body's point at the frame's origin: in the target v' = R v - w' x t."""
    wrench, pose, rng = some()
    velocity, turning = rng.normal(size=(2, 40, 3))
    power = np.sum(wrench.force * velocity + wrench.torque * turning, axis=1)
    there = wrench.transformed(pose)
    turning_there = turning @ pose.rotation.T
    velocity_there = velocity @ pose.rotation.T - np.cross(turning_there, pose.translation)
    power_there = np.sum(there.force * velocity_there + there.torque * turning_there, axis=1)
    assert np.allclose(power, power_there, rtol=0, atol=1e-13)


def test_a_shift_adds_its_moment_and_a_turn_turns() -> None:
    shift = Wrench(np.array([0.0, 0, 10]), np.array([1.0, 0, 0])).transformed(Pose(np.eye(3), (0.1, 0, 0)))
    assert np.allclose(shift.force, [0, 0, 10], rtol=0, atol=1e-15)
    assert np.allclose(shift.torque, [1, -1, 0], rtol=0, atol=1e-15)  # (0.1, 0, 0) x (0, 0, 10) = (0, -1, 0)
    turn = Wrench(np.array([1.0, 0, 0]), np.array([0, 2.0, 0])).transformed(
        Pose.from_rotation_vector((0, 0, np.pi / 2), np.zeros(3))
    )
    assert np.allclose(turn.vector(), [0, 1, 0, -2, 0, 0], rtol=0, atol=1e-15)


def test_covariance_goes_with_the_wrench() -> None:
    """Of each of a batch, and of one for all."""
    wrench, pose, _ = some()
    vectors = wrench.vector().reshape(-1, 6)[:3]
    each = np.stack([mixed(np.repeat([1.0, 0.05], 3), k) for k in range(3)])
    for own in (each, each[:1]):
        there = Wrench.from_vector(vectors, own if len(own) > 1 else own[0]).transformed(pose).covariance
        assert there is not None
        for stated, known in zip(there.reshape(-1, 6, 6), own, strict=True):
            agree(stated, rolled(lambda off: Wrench.from_vector(off).transformed(pose).vector(), known))


def test_shapes_are_checked_and_values_frozen() -> None:
    wrench = Wrench.from_vector(np.arange(12.0).reshape(2, 6), np.eye(6))
    assert np.array_equal(wrench.vector(), np.arange(12.0).reshape(2, 6))
    assert wrench.covariance is not None
    for array in (wrench.force, wrench.torque, wrench.covariance):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0
    with pytest.raises((InputError, TypeError), match=r"shape|torque"):
        Wrench(np.zeros((2, 3)), np.zeros(3))
