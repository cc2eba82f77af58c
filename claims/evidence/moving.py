"""A loaded sensor on a moving arm: pose and acceleration in closed form, and what the load makes it read."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation.session import GRAVITY, Load


@dataclass(frozen=True)
class Course:
    """Where the sensor is and how it moves, sample by sample; all vectors are written in the base.

    Args:
        quaternion: x, y, z, w of the sensor in the base.
        position: [m] of the sensor's origin.
        acceleration: [m/s^2] of the sensor's origin.
        angular_velocity: [rad/s].
        angular_acceleration: [rad/s^2].
    """

    quaternion: Float[np.ndarray, "n 4"]
    position: Float[np.ndarray, "n 3"]
    acceleration: Float[np.ndarray, "n 3"]
    angular_velocity: Float[np.ndarray, "n 3"]
    angular_acceleration: Float[np.ndarray, "n 3"]

    def point_acceleration(self, point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
        """Of a point r [m] fixed in the sensor: a + alpha x r + omega x (omega x r) [m/s^2], in the base."""
        arm = rotation_from_quaternion(self.quaternion) @ point
        swing = np.cross(self.angular_velocity, np.cross(self.angular_velocity, arm))
        return self.acceleration + np.cross(self.angular_acceleration, arm) + swing

    def in_sensor(self, vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        return np.einsum("nji,nj->ni", rotation_from_quaternion(self.quaternion), vectors)


@dataclass(frozen=True)
class Swing:
    """Positions and angles that swing as -cos: at rest until `start`, when they set off without a jolt of velocity.

    The orientation is Rz(a) Ry(b) Rx(c), with c swinging about half a turn, which points the sensor's z down.

    Args:
        swing: (3,) amplitudes [rad] of a, b, c.
        swing_rate: (3,) [Hz].
        sway: (3,) amplitudes [m] along x, y, z.
        sway_rate: (3,) [Hz].
        start: [s].
    """

    swing: tuple[float, float, float] = (0.5, 0.4, 0.5)
    swing_rate: tuple[float, float, float] = (0.17, 0.23, 0.2)
    sway: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sway_rate: tuple[float, float, float] = (0.5, 0.4, 0.6)
    start: float = -np.inf

    def at(self, time: Float[np.ndarray, " n"]) -> Course:
        """The course at these times [s]."""
        since = time if np.isinf(self.start) else np.maximum(time - self.start, 0.0)
        moving = (time > self.start)[:, None]
        angles, rates, changes = _swings(since, np.array(self.swing), np.array(self.swing_rate), moving)
        position, _, acceleration = _swings(since, np.array(self.sway), np.array(self.sway_rate), moving)
        turns = [_half_turn(angles[:, k] + (np.pi if k == 2 else 0.0), axis) for k, axis in enumerate((2, 1, 0))]
        yaw = turns[0]
        pitch = _product(yaw, turns[1])
        first = np.broadcast_to([0.0, 0.0, 1.0], position.shape)  # the axes about which a, b, c turn, in the base
        second = rotation_from_quaternion(yaw)[:, :, 1]
        third = rotation_from_quaternion(pitch)[:, :, 0]
        slow = rates[:, :1] * first
        middle = slow + rates[:, 1:2] * second
        return Course(
            _product(pitch, turns[2]),
            position + np.array([0.4, 0.0, 0.6]),
            acceleration,
            middle + rates[:, 2:] * third,
            changes[:, :1] * first
            + changes[:, 1:2] * second
            + rates[:, 1:2] * np.cross(slow, second)
            + changes[:, 2:] * third
            + rates[:, 2:] * np.cross(middle, third),
        )


def moving_wrenches(
    load: Load, course: Course, inertia: Float[np.ndarray, "3 3"] | None = None
) -> Float[np.ndarray, "n 6"]:
    """Readings [N, N m] of the free sensor on this course, by Newton and Euler for the load, in the sensor's frame.

    The sensor holds the load by -F and -M, so F = m (g - a_c) and M = c x F - (I alpha + omega x I omega).

    Args:
        load: what hangs on the sensor, and its zero.
        course: of the sensor.
        inertia: I [kg m^2] about the centre of mass, in the sensor's frame; None for a point.
    """
    force = load.mass * course.in_sensor(GRAVITY - course.point_acceleration(load.center_of_mass))
    torque = np.cross(load.center_of_mass, force)
    if inertia is not None:
        omega, alpha = course.in_sensor(course.angular_velocity), course.in_sensor(course.angular_acceleration)
        torque = torque - alpha @ inertia.T - np.cross(omega, omega @ inertia.T)
    return np.concatenate([force + load.force_bias, torque + load.torque_bias], axis=1)


def _swings(time: np.ndarray, size: np.ndarray, rate: np.ndarray, moving: np.ndarray) -> tuple[np.ndarray, ...]:
    """Value, first and second derivative of -size cos(2 pi rate t), (n, 3) each."""
    omega = 2 * np.pi * rate
    phase = time[:, None] * omega
    return -size * np.cos(phase), moving * size * omega * np.sin(phase), moving * size * omega**2 * np.cos(phase)


def _half_turn(angle: Float[np.ndarray, " n"], axis: int) -> Float[np.ndarray, "n 4"]:
    quaternion = np.zeros((len(angle), 4))
    quaternion[:, axis], quaternion[:, 3] = np.sin(angle / 2), np.cos(angle / 2)
    return quaternion


def _product(left: Float[np.ndarray, "n 4"], right: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Hamilton's product: the rotation `right`, then `left`."""
    v, w, u, s = left[:, :3], left[:, 3:], right[:, :3], right[:, 3:]
    return np.concatenate([w * u + s * v + np.cross(v, u), w * s - np.sum(v * u, axis=1, keepdims=True)], axis=1)
