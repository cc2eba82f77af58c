"""The closed forms of a moving, loaded sensor against finite differences, and its load against energy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from claims.evidence.moving import Swing, moving_wrenches
from palpate_lab.simulation.session import GRAVITY, Load

MOTION = Swing(swing_rate=(0.5, 0.7, 0.9), sway=(0.2, 0.1, 0.15))
LOAD = Load(0.5, np.array([0.01, -0.02, 0.05]), np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, -0.3]))
INERTIA = np.diag([2e-3, 3e-3, 1e-3])
TIMES = np.random.default_rng(1).uniform(0.0, 10.0, 50)
STEP = 1e-4


def test_velocities_and_accelerations_are_the_derivatives_of_the_pose() -> None:
    """Central differences; their error is of the order of the step squared, and of rounding over it."""
    before, here, after = (MOTION.at(TIMES + shift) for shift in (-STEP, 0.0, STEP))
    point = np.array([0.1, -0.2, 0.3])

    def path(course: object) -> np.ndarray:
        return course.position + Rotation.from_quat(course.quaternion).apply(point)

    second = (path(after) - 2 * path(here) + path(before)) / STEP**2
    np.testing.assert_allclose(here.point_acceleration(point), second, atol=1e-5)
    turned = Rotation.from_quat(after.quaternion) * Rotation.from_quat(before.quaternion).inv()
    np.testing.assert_allclose(here.angular_velocity, turned.as_rotvec() / (2 * STEP), atol=1e-6)
    change = (after.angular_velocity - before.angular_velocity) / (2 * STEP)
    np.testing.assert_allclose(here.angular_acceleration, change, atol=1e-5)


def test_the_load_takes_the_power_that_its_energy_gains() -> None:
    """Kinetic and potential energy of the load, differentiated, are the power of what holds it: -F.v - M.omega."""

    def energy(time: np.ndarray) -> np.ndarray:
        ahead, here, behind = (MOTION.at(time + shift) for shift in (STEP, 0.0, -STEP))
        places = [c.position + Rotation.from_quat(c.quaternion).apply(LOAD.center_of_mass) for c in (ahead, behind)]
        velocity = (places[0] - places[1]) / (2 * STEP)
        omega = here.in_sensor(here.angular_velocity)
        centre = (places[0] + places[1]) / 2
        spin = np.einsum("ni,ij,nj->n", omega, INERTIA, omega)
        return 0.5 * LOAD.mass * np.sum(velocity**2, axis=1) + 0.5 * spin - LOAD.mass * centre @ GRAVITY

    here = MOTION.at(TIMES)
    reading = moving_wrenches(LOAD, here, INERTIA) - np.concatenate([LOAD.force_bias, LOAD.torque_bias])
    velocity = here.in_sensor((MOTION.at(TIMES + STEP).position - MOTION.at(TIMES - STEP).position) / (2 * STEP))
    power = -np.sum(reading * np.concatenate([velocity, here.in_sensor(here.angular_velocity)], axis=1), axis=1)
    gained = (energy(TIMES + 1e-3) - energy(TIMES - 1e-3)) / 2e-3
    np.testing.assert_allclose(power, gained, atol=1e-4)


@pytest.mark.parametrize("time", [0.0, 1.0])
def test_before_its_start_it_rests_under_its_weight(time: float) -> None:
    course = Swing(sway=(0.2, 0.1, 0.15), start=1.0).at(np.array([time]))
    assert not course.acceleration.any()
    assert not course.angular_velocity.any()
    np.testing.assert_allclose(moving_wrenches(LOAD, course), LOAD.wrenches(course.quaternion), atol=1e-12)
