"""Gravity from an IMU in place of poses: what comes back, with which covariance, and which mistakes are named."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import palpate
from claims.row import Row
from palpate.surfaces import Sphere

__all__ = ["BALL", "MASS", "NOISE", "PLACE", "Rests", "mistakes", "rows", "squared_distance", "touches"]

G = 9.80665
NOISE = np.repeat([0.05, 0.002, 0.02], 3)  # N, N m, m/s^2
MASS, CENTRE = 1.2, np.array([0.004, -0.01, 0.05])
BIAS = np.array([-3.0, 4.0, -9.0, 0.1, -0.2, 0.3])
BALL, PLACE = 0.02, np.array([0.0, 0.0, 0.1])  # m: a ball on the tool, touched by 8 N


@dataclass(frozen=True)
class Rests:
    """Readings of a tool at rest, by statics, and how the IMU is mounted.

    Attributes:
        rotations: (n, 3, 3) sensor in base, z up.
        readings: (n, 9) force [N], torque [N m], specific force [m/s^2].
        turn: (3, 3) from the sensor's axes to the IMU's.
        bias: (3,) [m/s^2].
    """

    rotations: np.ndarray
    readings: np.ndarray
    turn: np.ndarray
    bias: np.ndarray

    @classmethod
    def of(cls, seed: int, rotations: np.ndarray | None = None, noise: float = 1.0) -> Rests:
        """Return 12 to 24 random orientations, an IMU turned by any rotation, with a bias of 0.1 m/s^2."""
        rng = np.random.default_rng(seed)
        if rotations is None:
            rotations = Rotation.random(int(rng.integers(12, 25)), random_state=rng).as_matrix()
        turn, bias = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
        bias *= 0.1 / np.linalg.norm(bias)
        rows = []
        for rotation in rotations:
            weight = rotation.T @ [0.0, 0.0, -MASS * G]
            felt = turn @ rotation.T @ [0.0, 0.0, G] + bias
            rows.append(np.concatenate([weight + BIAS[:3], np.cross(CENTRE, weight) + BIAS[3:], felt]))
        readings = np.array(rows)
        return cls(rotations, readings + noise * NOISE * rng.normal(size=readings.shape), turn, bias)

    def identified(self) -> palpate.Payload:
        """Return the payload from forces, torques and accelerations."""
        return palpate.identify_payload_with_imu(self.readings[:, :6], self.readings[:, 6:])

    def error(self, found: palpate.Payload) -> np.ndarray:
        """Return the truth less what was found, (16,), in the order of `joint_covariance` from the weight's z on."""
        imu = found.imu
        assert imu is not None
        turned = Rotation.from_matrix(imu.rotation.T @ self.turn).as_rotvec()
        weight = -MASS * G - found.weight[2]
        biases = BIAS - np.concatenate([found.force_bias, found.torque_bias])
        centre = CENTRE - found.center_of_mass
        return np.concatenate([[weight], biases[:3], centre, biases[3:], turned, self.bias - imu.bias])


def squared_distance(rests: Rests, found: palpate.Payload) -> float:
    """Return the squared Mahalanobis distance of the truth, over its 16 degrees of freedom."""
    error = rests.error(found)
    return float(error @ np.linalg.solve(found.joint_covariance[2:, 2:], error)) / 16


def mistakes() -> dict[str, tuple[np.ndarray, str]]:
    """Return name -> readings (n, 9), and words that the refusal must hold."""
    rests, turns = Rests.of(1), np.linspace(0.0, 6.0, 12)[:, None]
    level, upright = (Rests.of(1, Rotation.from_euler(axis, turns).as_matrix()).readings for axis in "xz")
    good, rng = rests.readings, np.random.default_rng(2)
    moved = good.copy()
    moved[:, 6:] += rng.normal(size=(len(good), 3)) * 1.5
    moved[:, :3] -= MASS * (moved[:, 6:] - good[:, 6:]) @ rests.turn
    return {
        "three rests": (good[:3], "needs 4 samples or more"),
        "turns about the vertical": (upright, "differ too little"),
        "turns about one level axis": (level, "stays level"),
        "accelerations in g": (good / np.repeat([1.0, G], [6, 3]), 'unit = "g"'),
        "a gyroscope": (np.hstack([good[:, :6], rng.normal(size=(len(good), 3)) * 0.01]), "rates of a gyroscope"),
        "gravity's sign reversed": (good * np.repeat([1.0, -1.0], [6, 3]), "mirror images"),
        "a sensor that moves": (moved, "the sensor moved"),
        "no payload": (np.hstack([good[:, :6] * 0 + BIAS + NOISE[:6] * rng.normal(size=(len(good), 6)), good[:, 6:]]),
                       "cannot be told from the force bias"),
    }  # fmt: skip


def touches(seed: int, noise: float = 1.0) -> tuple[Rests, np.ndarray]:
    """Return rests in each of which a ball on the tool is pressed by 8 N, and the places (n, 3) on it [m]."""
    rests, rng = Rests.of(seed, noise=noise), np.random.default_rng(seed)
    out = rng.normal(size=(len(rests.readings), 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    force, point = -8.0 * out, PLACE + BALL * out
    pushed = np.concatenate([force, np.cross(point, force), np.zeros_like(force)], axis=1)
    return Rests(rests.rotations, rests.readings + pushed, rests.turn, rests.bias), BALL * out


def rows(small: bool) -> Iterator[Row]:
    """Return what comes back from rests, mistakes, and touches by IMU and by poses."""
    seeds = 20 if small else 200
    made = [(rests := Rests.of(seed), rests.identified()) for seed in range(seeds)]
    within = [
        abs(e[0]) < 0.01 * MASS * G and np.linalg.norm(e[4:7]) < 1e-3 and np.linalg.norm(e[10:13]) < np.pi / 180
        for e in (rests.error(found) for rests, found in made)
    ]
    what = "an IMU in place of poses, 12 to 24 rests"
    target = ">= 95 % within 1 %, 1 mm, 1 deg"
    yield Row(f"{what}: mass, centre, rotation of the IMU", target, f"{np.mean(within):.1%} of {seeds}",
              np.mean(within) >= 0.95)  # fmt: skip
    mean = float(np.mean([squared_distance(*pair) for pair in made]))
    yield Row(f"{what}: squared error over its covariance, per number", "0.8 to 1.25", f"{mean:.2f}",
              0.8 <= mean <= 1.25)  # fmt: skip
    missed = [name for name, (readings, words) in mistakes().items() if words not in _refusal(readings)]
    got = f"{len(mistakes()) - len(missed)} of {len(mistakes())}{': not ' if missed else ''}{', '.join(missed)}"
    yield Row("mistakes in a log with an IMU", "all named", got, not missed)
    yield _touched(3 if small else 40)


def _refusal(readings: np.ndarray) -> str:
    try:
        palpate.identify_payload_with_imu(readings[:, :6], readings[:, 6:])
    except palpate.PalpateError as refused:
        return str(refused)
    return ""


def _touched(seeds: int) -> Row:
    """Return the row of touches of a ball, compensated by an IMU and by poses."""
    found: dict[str, list[np.ndarray]] = {"IMU": [], "poses": []}
    sensor, mount = palpate.ForceTorque(noise=(NOISE[0], NOISE[3])), palpate.Pose.from_quaternion([0, 0, 0, 1], PLACE)
    for seed in range(seeds):
        free, (pressed, places) = Rests.of(1000 + seed), touches(1000 + seed)
        by_poses = palpate.identify_payload(free.readings[:, :6], free.rotations)
        quaternions = Rotation.from_matrix(pressed.rotations).as_quat()
        for name, payload in (("IMU", free.identified()), ("poses", by_poses)):
            channels = {"force": pressed.readings[:, :3], "torque": pressed.readings[:, 3:6]}
            channels |= {"acceleration": pressed.readings[:, 6:]} if name == "IMU" else {"orientation": quaternions}
            estimator = palpate.WrenchEstimator(Sphere(BALL), palpate.Compensation(sensor, payload), mount=mount)
            contacts = estimator.run(palpate.Recording(np.arange(len(places)) * 1.0, channels))
            found[name].append(contacts.point - places)
    off = {name: 1e3 * float(np.sqrt(np.mean(np.concatenate(each) ** 2) * 3)) for name, each in found.items()}
    got = f"{off['IMU']:.2f} mm by the IMU, {off['poses']:.2f} mm by poses, rms"
    return Row("touches of 8 N on a ball of 20 mm", "IMU <= 1.2 times poses", got,
               off["IMU"] <= 1.2 * off["poses"])  # fmt: skip
