"""A payload that is heavy, off the axes and known with errors that all belong together, by Newton: the truth of tests.

Gravity is not along z, the sensor turns and swings, and no two axes are alike. Errors (12,) are those of weight, force
bias, centre and torque bias, as in `Payload.covariance`.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from palpate import Pose
from palpate.signals import Imu, Payload
from palpate.spatial.pose import quaternion_from_rotation
from tests.support.dice import mixed

G = 9.7  # m/s^2
WEIGHT, CENTER = np.array([1.5, -2.0, -11.0]), np.array([0.03, -0.05, 0.08])  # N, m
BIAS, READING = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.3]), np.array([4.0, -6.0, -3.0, 0.2, 0.5, -0.3])
TURNS = Rotation.from_euler("xyz", [[45, 20, -30], [-100, 45, 70], [0, 0, 45]], degrees=True)  # sensor in base
SWING = np.array([[2.0, -3.0, 1.0], [-1.5, 0.5, 4.0], [3.0, 2.0, -2.0]])  # m/s^2 in the sensor's frame
FELT = SWING + np.array([1.0, 2.0, 9.0])  # m/s^2, by an accelerometer
OWN = mixed(np.repeat([0.1, 0.2, 3e-3, 0.01], 3), 1)
MOUNT = Pose.from_rotation_vector((np.pi / 4, -0.7, 1.2), (0.02, -0.03, 0.1))  # of a surface in the sensor
MOUNTED = mixed(np.repeat([0.02, 1e-3], 3), 3)  # rad, m
EXACT = np.zeros(12)
WITH_IMU = mixed(np.repeat([0.1, 0.2, 3e-3, 0.01, 0.02, 0.1], 3), 2)  # and of the turn and bias of an accelerometer
WITH_IMU[:2] = WITH_IMU[:, :2] = 0.0  # its weight is along z, of a base that the accelerometer states
_TURN, _BIAS = Rotation.from_rotvec([0.5, -1.0, 0.7]), np.array([0.2, -0.1, 0.3])  # of the accelerometer


def known_payload(residual: np.ndarray | None = None, samples: int = 0) -> Payload:
    """The payload, whose errors have the covariance OWN."""
    return Payload(WEIGHT, BIAS[:3], CENTER, BIAS[3:], OWN, magnitude=G, residual=residual, samples=samples)


def payload_with_imu(noise: float = 0.0) -> Payload:
    """The same, of 11 N, with an accelerometer and errors WITH_IMU."""
    imu = accelerometer(WITH_IMU[12:], noise)
    return Payload([0, 0, -11.0], BIAS[:3], CENTER, BIAS[3:], WITH_IMU[:12, :12], G, imu=imu)


def accelerometer(covariance: np.ndarray, noise: float = 0.0) -> Imu:
    return Imu(quaternion_from_rotation(_TURN.as_matrix()), _BIAS, noise, covariance)


def load(off: np.ndarray, k: int, swing: np.ndarray | float = 0.0) -> np.ndarray:
    """What the payload with errors puts on the sensor in pose k, biases and all; it swings by so much more."""
    weight = WEIGHT + off[:3]
    return _hung(off, TURNS[k].inv().apply(weight) - np.linalg.norm(weight) / G * (SWING[k] + swing))


def load_by_imu(off: np.ndarray, reading: np.ndarray) -> np.ndarray:
    """The same by an accelerometer's reading (3,), with errors (18,)."""
    return _hung(off, -(11.0 - off[2]) / G * felt(off[12:], reading))


def felt(off: np.ndarray, reading: np.ndarray) -> np.ndarray:
    """The specific force in the sensor's axes, if the accelerometer is turned by (3,) and biased by (3,) more."""
    return (_TURN * Rotation.from_rotvec(off[:3])).inv().apply(reading - _BIAS - off[3:])


def in_surface(wrench: np.ndarray, off: np.ndarray | None = None) -> np.ndarray:
    """A wrench of the sensor in a surface whose mounting is off by a turn and a shift (6,) in the sensor's frame."""
    off = np.zeros(6) if off is None else off
    turn = Rotation.from_rotvec(off[:3]).as_matrix()
    into, at = (turn @ MOUNT.rotation).T, turn @ MOUNT.translation + off[3:]
    return np.concatenate([into @ wrench[:3], into @ (wrench[3:] - np.cross(at, wrench[:3]))])


def _hung(off: np.ndarray, force: np.ndarray) -> np.ndarray:
    return np.concatenate([force, np.cross(CENTER + off[6:9], force)]) + BIAS + off[[3, 4, 5, 9, 10, 11]]
