"""Simulate a session with a convex probe in a second: free motion, then touches at marks, and the truth of both.

The arm moves slowly, so inertia is neglected; noise is white; everything follows from one seed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate.signals.recording import FORCE, ORIENTATION, TORQUE, Recording
from palpate.spatial.pose import Pose, rotation_from_quaternion
from palpate_lab.simulation.contacts import contact_wrenches, directed_forces
from palpate_lab.simulation.shapes import Superquadric

RATE = 200.0  # Hz
NOISE = np.array([0.02] * 3 + [0.001] * 3)  # N, N m: one standard deviation of one reading
GRAVITY = np.array([0.0, 0.0, -9.80665])  # m/s^2, base frame
NOMINAL = Pose.from_quaternion([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.085])  # of the surface in the sensor, by drawing
ASSEMBLY = (np.radians(1.5), 1.2e-3)  # rad, m: the size of the error of assembly, each in a random direction
PLACEMENT = 0.4e-3  # m: how well the operator hits a mark, one standard deviation along each tangent
HOLD, MOVE, FREE, RAMP, PRESS = 1.0, 0.6, 0.7, 0.3, 0.9  # s


@dataclass(frozen=True)
class Load:
    """The sensor's true payload and biases, in the sensor frame: mass [kg], centre [m], biases [N, N m]."""

    mass: float
    center_of_mass: Float[np.ndarray, "3"]
    force_bias: Float[np.ndarray, "3"]
    torque_bias: Float[np.ndarray, "3"]

    def wrenches(self, quaternions: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 6"]:
        """Return readings (n, 6) [N, N m] of the free sensor at orientations x, y, z, w (sensor in base)."""
        weight = np.einsum("nji,j->ni", rotation_from_quaternion(quaternions), self.mass * GRAVITY)
        return np.concatenate(
            [weight + self.force_bias, np.cross(self.center_of_mass, weight) + self.torque_bias], axis=1
        )


@dataclass(frozen=True)
class SessionTouches:
    """Touches, a row each, in the surface's frame: steady from `start` to `end` [s], with their aims and landings."""

    start: Float[np.ndarray, " n"]
    end: Float[np.ndarray, " n"]
    mark: Float[np.ndarray, "n 3"]
    point: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "n 3"]
    label: tuple[str, ...]


@dataclass(frozen=True)
class Session:
    """Two logs, the probe that they were made with, and the truth.

    Attributes:
        vertices, faces: the probe's mesh [m].
        nominal, true: pose of the surface in the sensor's frame, as drawn and as assembled.
        load: the sensor's true payload and biases.
        free_motion, touches: the logs.
        truth: the touches.
        contact: (n, 6) [N, N m] exact wrench of the touches on the probe at the times of `touches`, in the sensor's
            frame.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    nominal: Pose
    true: Pose
    load: Load
    free_motion: Recording
    touches: Recording
    truth: SessionTouches
    contact: Float[np.ndarray, "n 6"]


def simulate_session(seed: int = 0, *, touches: int = 20, facets: int = 8000) -> Session:
    """Simulate a `Session` with a probe of 60 x 25 x 40 mm whose assembly is 1.2 mm and 1.5 degrees off its drawing."""
    rng = np.random.default_rng(seed)
    probe = Superquadric((0.030, 0.0125, 0.020), (0.8, 0.6))
    vertices, faces = probe.mesh(facets)
    turn, slide = (unit / np.linalg.norm(unit) for unit in rng.normal(size=(2, 3)))
    error = Pose.from_rotation_vector(ASSEMBLY[0] * turn, ASSEMBLY[1] * slide)
    true = Pose(error.rotation @ NOMINAL.rotation, NOMINAL.translation + error.translation)
    load = Load(
        mass=0.45 + rng.uniform(-0.05, 0.05),
        center_of_mass=np.array([0.002, -0.001, 0.045]) + rng.normal(0.0, 0.001, 3),
        force_bias=rng.normal(0.0, 4.0, 3),
        torque_bias=rng.normal(0.0, 0.1, 3),
    )
    free = _move(_orientations(14, 1.2, rng), HOLD, MOVE)
    truth, arm, contact = _touching(probe, true, touches, rng)
    logs = _recorded(free, load, None, rng), _recorded(arm, load, contact, rng)
    return Session(vertices, faces, NOMINAL, true, load, *logs, truth, contact)


def _orientations(count: int, spread: float, rng: np.random.Generator) -> Float[np.ndarray, "n 4"]:
    """Draw quaternions about "probe down", turned by rotation vectors of standard deviation `spread` [rad] an axis."""
    from scipy.spatial.transform import Rotation

    down = Rotation.from_euler("x", np.pi)
    return (down * Rotation.from_rotvec(rng.normal(0.0, spread, (count, 3)))).as_quat()


def _move(stops: Float[np.ndarray, "k 4"], hold: float, move: float) -> Float[np.ndarray, "n 4"]:
    """Keep each orientation for a time, then turn to the next one with a smooth start and stop."""
    from scipy.spatial.transform import Rotation, Slerp

    held, moved = round(hold * RATE), round(move * RATE)
    ease = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, moved + 1) / (moved + 1))
    course = np.concatenate([np.r_[np.full(held, float(k)), k + ease] for k in range(len(stops))])
    return Slerp(np.arange(len(stops)), Rotation.from_quat(stops))(np.minimum(course, len(stops) - 1)).as_quat()


def _touching(
    probe: Superquadric, true: Pose, count: int, rng: np.random.Generator
) -> tuple[SessionTouches, Float[np.ndarray, "n 4"], Float[np.ndarray, "n 6"]]:
    """Return marks spread over the head, touches there with random friction and torsion, and the arm's orientation."""
    mark = probe.on_ray(_spread(count, lowest=-0.2))
    aside = rng.normal(0.0, PLACEMENT, (count, 3))
    point = probe.on_ray(mark + aside)
    normal = probe.normals(point)
    direction = directed_forces(
        normal, np.ones(count), rng.uniform(0.0, 0.4, count), rng.uniform(0.0, 2 * np.pi, count)
    )
    torsion = rng.uniform(-2e-3, 2e-3, count)  # N m of spin for each newton
    unit = contact_wrenches(point, normal, direction, torsion) @ true.wrench_matrix().T
    size = np.tile(_press_profile(), count) * np.repeat(rng.uniform(1.5, 10.0, count), len(_press_profile()))
    wrenches = size[:, None] * np.repeat(unit, len(_press_profile()), axis=0)
    start = np.arange(count) * len(_press_profile()) / RATE + FREE / 2 + RAMP
    truth = SessionTouches(start, start + PRESS, mark, point, normal, tuple(f"mark {k + 1}" for k in range(count)))
    arm = _move(_orientations(count, 0.35, rng), FREE / 2 + 2 * RAMP + PRESS, FREE / 2)
    return truth, arm, wrenches


def _press_profile() -> Float[np.ndarray, " k"]:
    """Return shares of the full force: free, up, steady with a tremor of 3 %, down, free (the arm turns)."""
    free, ramp, press = (round(seconds * RATE) for seconds in (FREE / 2, RAMP, PRESS))
    up = np.arange(1, ramp + 1) / (ramp + 1)
    tremor = 1.0 + 0.03 * np.sin(2 * np.pi * 3.0 * np.arange(press) / RATE)
    return np.concatenate([np.zeros(free), up, tremor, up[::-1], np.zeros(free)])


def _spread(count: int, lowest: float) -> Float[np.ndarray, "n 3"]:
    """Return unit directions spread evenly over the sphere above z = lowest (a Fibonacci lattice)."""
    z = 1.0 - (1.0 - lowest) * (np.arange(count) + 0.5) / count
    turn = np.pi * (3.0 - 5**0.5) * np.arange(count)
    return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)


def _recorded(
    quaternions: Float[np.ndarray, "n 4"], load: Load, contact: np.ndarray | None, rng: np.random.Generator
) -> Recording:
    clean = load.wrenches(quaternions) + (0.0 if contact is None else contact)
    noisy = clean + rng.normal(size=clean.shape) * NOISE
    channels = {FORCE: noisy[:, :3], TORQUE: noisy[:, 3:], ORIENTATION: quaternions}
    return Recording(np.arange(len(noisy)) / RATE, channels, source="simulation")
