"""What the study assumes: a probe 150 mm from a force/torque sensor, and what touches it, by plain geometry."""

from dataclasses import dataclass

import numpy as np

from palpate.signals.drift import Drift
from palpate_lab.simulation.shapes import Superquadric

RATE = 200.0  # Hz
NOISE = np.array([0.04] * 3 + [1.5e-3] * 3)  # N, N m
BODY = Superquadric((0.030, 0.022, 0.040), (0.7, 0.7))  # m, half-lengths of a probe's head
PLACE = np.array([0.0, 0.0, 0.150])  # m, of its middle in the sensor's frame
LEVER = 0.0375  # m: walk and warm-up of the torques are those of the forces, times it, as the noise is
FRICTION, TORSION = 0.6, 2e-3  # of touches; the estimator allows 1.0 and 5 mm


@dataclass(frozen=True)
class Touch:
    """From `begin` to `end` [s]: it rises in `onset` to `force` [N], stays, and goes as it came, or in `release`."""

    begin: float
    end: float
    force: float
    onset: float = 0.1
    release: float | None = None

    def size(self, time: np.ndarray) -> np.ndarray:
        """(n,) [N], as half a cosine."""
        rise = _rise((time - self.begin) / max(self.onset, 1e-9))
        fall = _rise((self.end - time) / max(self.onset if self.release is None else self.release, 1e-9))
        return self.force * np.minimum(rise, fall)


def _rise(share: np.ndarray) -> np.ndarray:
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(share, 0.0, 1.0))


def drift_of(walk: float, warm_up: float = 0.0, weight: float = 0.0) -> Drift:
    """By walk [N/sqrt(s)] and warm-up [N/s] of each force; torques a lever less."""
    each = np.repeat([1.0, LEVER], 3)
    return Drift(walk * each, warm_up * each, 600.0 if warm_up else np.inf, weight)


def wrenches(time: np.ndarray, touches: list[Touch], rng: np.random.Generator) -> np.ndarray:
    """(n, 6) in the sensor's frame: a force within a cone about the normal at a point of the body, and a torsion."""
    total = np.zeros((len(time), 6))
    for touch in touches:
        point, normal = _place(rng)
        tilt, turn = np.arctan(FRICTION * np.sqrt(rng.random())), rng.uniform(0, 2 * np.pi)
        across = np.cross(normal, rng.standard_normal(3))
        across /= np.linalg.norm(across)
        direction = -np.cos(tilt) * normal + np.sin(tilt) * (
            np.cos(turn) * across + np.sin(turn) * np.cross(normal, across)
        )
        torque = np.cross(point, direction) + rng.uniform(-TORSION, TORSION) * np.cos(tilt) * normal
        total += touch.size(time)[:, None] * np.concatenate([direction, torque])
    return total


def _place(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Of the lower part of the body, as it is pressed on tissue or met by a hand: not where the sensor is."""
    while True:
        point = BODY.sample(1, rng)
        if point[0, 2] > -0.02:
            return point[0] + PLACE, BODY.normals(point)[0]


def readings(time: np.ndarray, zero: np.ndarray, touches: list[Touch], rng: np.random.Generator) -> np.ndarray:
    """(n, 6) as the sensor reads them."""
    return zero + wrenches(time, touches, rng) + NOISE * rng.standard_normal((len(time), 6))
