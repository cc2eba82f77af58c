"""Covariances of what signals carry: a payload's load with or without an IMU, an IMU's forces, a mounting."""

import numpy as np
import pytest

from palpate import Pose
from palpate.signals.wrench_sensor import Placement
from tests.support.dice import agree, mixed, rolled
from tests.support.payloads import (
    EXACT,
    FELT,
    MOUNT,
    MOUNTED,
    OWN,
    READING,
    SWING,
    TURNS,
    WITH_IMU,
    accelerometer,
    felt,
    in_surface,
    known_payload,
    load,
    load_by_imu,
    payload_with_imu,
)


@pytest.mark.parametrize("moving", [False, True])
def test_a_payload_is_as_sure_as_its_parameters(moving: bool) -> None:
    readings = np.tile(READING, (3, 1))
    wrench, covariance = known_payload().compensate(readings, TURNS.as_matrix(), SWING if moving else None)
    for k in range(3):
        rest = 0.0 if moving else -SWING[k]
        np.testing.assert_allclose(wrench[k], READING - load(EXACT, k, rest), atol=1e-12)
        agree(covariance[k], rolled(lambda off, k=k, rest=rest: load(off, k, rest), OWN))


def test_a_payload_with_an_imu_is_as_sure_as_all_parameters_together() -> None:
    payload = payload_with_imu()
    wrench, covariance = payload.compensate(np.tile(READING, (3, 1)), None, FELT)
    for k, reading in enumerate(FELT):
        np.testing.assert_allclose(wrench[k], READING - load_by_imu(np.zeros(18), reading), atol=1e-12)
        agree(covariance[k], rolled(lambda off, reading=reading: load_by_imu(off, reading), WITH_IMU))
    np.testing.assert_array_equal(payload.joint_covariance, WITH_IMU)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_forces_of_an_imu_are_as_sure_as_its_turn_bias_and_noise(noise: float) -> None:
    own = np.zeros((6, 18))
    own[:, 12:] = mixed(np.repeat([0.02, 0.1], 3), 3)
    imu = accelerometer(own, noise)
    forces = imu.forces(FELT)
    for k, reading in enumerate(FELT):
        np.testing.assert_allclose(forces[k], felt(np.zeros(6), reading), atol=1e-12)
        found = rolled(lambda off, reading=reading: felt(off, reading), own[:, 12:])
        expected = np.sqrt(np.trace(found) / 3.0 + noise**2)
        assert imu.deviations(forces)[k, 0] == pytest.approx(expected, rel=1e-5)


def test_a_surface_is_as_sure_in_its_sensor_as_its_mounting() -> None:
    """The inverse of a pose that is perturbed on the left."""
    placement = Placement(MOUNT, MOUNTED)

    def inverse(off: np.ndarray) -> np.ndarray:
        there = (Pose.from_rotation_vector(off[:3], off[3:]) @ MOUNT).inverse() @ MOUNT
        return np.concatenate([there.rotation_vector(), there.translation])

    agree(placement.factor.T @ placement.factor, rolled(inverse, MOUNTED))
    np.testing.assert_allclose(placement.matrix @ READING, in_surface(READING), atol=1e-14)
    assert Placement(MOUNT).factor.shape == (0, 6)
