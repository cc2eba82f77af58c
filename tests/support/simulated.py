"""Logs for tests, made forwards from known touches: presses on a body, a base that moves, tables on disk."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from claims.evidence.moving import Swing
from palpate_lab.simulation.contacts import contact_wrenches, directed_forces

POSE = ("qx", "qy", "qz", "qw", "x", "y", "z")  # of the sensor in the base, as columns of a log
SLOW = Swing((0.3, 0.2, 0.3), (0.05, 0.07, 0.06), (0.02, 0.03, 0.02), (0.05, 0.04, 0.06))  # inertia stays below noise
RATE, REST, RAMP, HOLD, PAUSE = 100.0, 1.0, 0.1, 0.5, 0.4  # Hz, s


@dataclass(frozen=True, eq=False)
class Truth:
    """Touches, one a row: steady from `start` to `end` [s], at `point` (k, 3) [m], with `force` (k, 3) [N].

    All in the surface's frame; the force is the one on the body.
    """

    start: np.ndarray
    end: np.ndarray
    point: np.ndarray
    force: np.ndarray

    def __len__(self) -> int:
        return len(self.start)

    def write(self, path: Path) -> None:
        """As `palpate evaluate` reads it."""
        point = dict(zip(("px", "py", "pz"), self.point.T, strict=True))
        write_table(path, {"start": self.start, "end": self.end} | point)


def pressed(
    points: np.ndarray, normals: np.ndarray, rng: np.random.Generator, *, tan_theta: float = 0.3
) -> tuple[np.ndarray, np.ndarray, Truth]:
    """Each point pressed in turn: up, held, down, free.

    Args:
        points: (k, 3) [m] in the surface's frame.
        normals: (k, 3) outward.
        rng: the dice.
        tan_theta: of the largest angle between force and normal.

    Returns:
        Times (n,) [s], wrenches on the body (n, 6) [N, N m] about the surface's origin, and the touches.
    """
    count = len(points)
    slopes, turns = rng.uniform(0.0, tan_theta, count), rng.uniform(0.0, 2 * np.pi, count)
    forces = directed_forces(normals, rng.uniform(2.0, 6.0, count), slopes, turns)
    start = REST + (2 * RAMP + HOLD + PAUSE) * np.arange(count) + RAMP
    time = np.arange(round((start[-1] + HOLD + RAMP + PAUSE) * RATE)) / RATE
    share = np.clip(1.0 - np.maximum(start - time[:, None], time[:, None] - start - HOLD) / RAMP, 0.0, 1.0)
    wrenches = share @ contact_wrenches(points, normals, forces, np.zeros(count))
    return time, wrenches, Truth(start, start + HOLD, points, forces)


def base_poses(time: np.ndarray) -> dict[str, np.ndarray]:
    """The seven columns of a base that turns and sways slowly."""
    course = SLOW.at(time)
    return dict(zip(POSE, np.concatenate([course.quaternion, course.position], axis=1).T, strict=True))


def write_table(path: Path, columns: dict[str, np.ndarray]) -> None:
    """CSV with every digit."""
    pl.DataFrame(columns).write_csv(path)
