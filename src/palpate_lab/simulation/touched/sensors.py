"""Simulate the forearm's two sensors from the engine's contacts: readings with bias, drift and noise, and counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.signals.drift import Drift
from palpate.signals.recording import CELLS, FORCE, ORIENTATION, TORQUE, Recording
from palpate_lab.simulation.drift import simulate_drift
from palpate_lab.simulation.skin_bench import PaperSheet, Rolled, read_out
from palpate_lab.simulation.touched.body import Physics
from palpate_lab.simulation.touched.settings import GRAVITY, STEP_RATE, ForearmSettings

_RINGS = 16  # of points in a pressed disc, twice as many in each: a cell's share errs by 2 %
_CHUNK = 4096  # contacts at once
_AMPLITUDE, _PERIODS = 0.35, (9.0, 25.0)  # rad of each of three sines an axis at most, s


def motion(
    settings: ForearmSettings, steps: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 4"]]:
    """Return the sensor's orientation in the base at every step: at rest until `quiet`, then slow sines on all axes.

    It is given as rotation matrices (n, 3, 3), and as quaternions x, y, z, w (n, 4).
    """
    from scipy.spatial.transform import Rotation

    time = np.arange(steps) / STEP_RATE
    passed = np.maximum(time - settings.quiet, 0.0)
    size, turns = rng.uniform(0.4, 1.0, (3, 3)) * _AMPLITUDE, 2 * np.pi / rng.uniform(*_PERIODS, (3, 3))
    waves = (size * np.sin(passed[:, None, None] * turns)).sum(axis=-1)
    waves *= (1.0 - np.exp(-(passed**2) / 4.0))[:, None] * (1.0 if settings.moving else 0.0)
    stretched = Rotation.from_euler("y", np.pi / 2)  # the forearm lies along the base's x
    turned = stretched * Rotation.from_rotvec(waves)
    return turned.as_matrix(), turned.as_quat()


def inertia(settings: ForearmSettings, rotations: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 6"]:
    """Return the part of the reading from the link's inertia, (n, 6) [N, N m], about the sensor's fixed origin.

    With the rate w and its derivative a in the sensor's frame: -m (a x c + w x (w x c)), and the moment of the same
    about the origin with -(I a + w x I w).
    """
    from scipy.spatial.transform import Rotation

    steps = (Rotation.from_matrix(rotations[:-1]).inv() * Rotation.from_matrix(rotations[1:])).as_rotvec()
    between = STEP_RATE * np.concatenate([steps[:1], steps, steps[-1:]])  # rates half a step before and after each
    rate, change = 0.5 * (between[1:] + between[:-1]), STEP_RATE * np.diff(between, axis=0)
    turn, centre = settings.mount.rotation, settings.mount.apply(np.array(settings.centre))
    radius, half = settings.sheet.radius, settings.half_length
    across = radius**2 / 4 + half**2 / 3
    tensor = settings.mass * turn @ np.diag([across, across, radius**2 / 2]) @ turn.T
    force = -settings.mass * (np.cross(change, centre) + np.cross(rate, np.cross(rate, centre)))
    torque = np.cross(centre, force) - change @ tensor - np.cross(rate, rate @ tensor)
    return np.concatenate([force, torque], axis=1)


def true_mass(settings: ForearmSettings, rng: np.random.Generator) -> ForearmSettings:
    """Return the `ForearmSettings` with the link's true mass, off from the payload model by the drift's `weight`."""
    deviation = 0.0 if settings.drift is None else settings.drift.weight
    return replace(settings, mass=settings.mass + deviation * float(rng.standard_normal()) / GRAVITY)


def wrench_log(
    settings: ForearmSettings,
    exact: Float[np.ndarray, "n 6"],
    quaternions: Float[np.ndarray, "n 4"],
    rng: np.random.Generator,
) -> tuple[Recording, Float[np.ndarray, "k 6"]]:
    """Return the force/torque sensor's log with orientations, a `Recording`, and its true bias (k, 6) [N, N m].

    There is a row of the bias for each reading.

    Args:
        settings: rate, noise, bias and drift.
        exact: (n, 6) [N, N m] on the sensor at each step.
        quaternions: (n, 4) of the sensor in the base.
        rng: random numbers of noise and drift.
    """
    every = slice(None, None, STEP_RATE // settings.wrench_rate)
    exact, quaternions = exact[every], quaternions[every]
    time = np.arange(len(exact)) / settings.wrench_rate
    drift = settings.drift or Drift(np.zeros(6))
    zero = np.array(settings.bias) + simulate_drift(time, drift, rng)
    noise = np.repeat([settings.force_noise, settings.torque_noise], 3) * rng.standard_normal(exact.shape)
    read = exact + zero + noise
    channels = {FORCE: read[:, :3], TORQUE: read[:, 3:], ORIENTATION: quaternions}
    return Recording(time, channels, source="touched forearm"), zero


def loads(
    sheet: Rolled, physics: Physics, frames: int, *, modulus: float, radius: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, "frames rows columns"], Float[np.ndarray, " m"]]:
    """Compute the force [N] on each cell in each sample, and the share of each contact's normal force that is on cells.

    The normal force is Hertz's pressure on a disc, a^3 = 3 F R / (4 E) (Johnson, Contact Mechanics, 4.2), with the
    equal radius 1/R = 1/r + 1/(2 R_link) of a sphere on a cylinder; the disc is laid on the unrolled sheet, and its
    part next to the sheet presses no cell. The shapes are (frames, rows, columns) and (m,).

    Args:
        sheet: sheet of cells.
        physics: results of the engine, with contacts.
        frames: number of samples.
        modulus: E [Pa].
        radius: (m,) r [m] of each contact's indenter.
    """
    newtons = -np.einsum("ij,ij->i", physics.force, physics.normal)
    disc = np.cbrt(0.75 * newtons / modulus / (1.0 / radius + 0.5 / sheet.radius)) / sheet.pitch
    column = np.arctan2(physics.point[:, 1], physics.point[:, 0]) * sheet.radius / sheet.pitch
    row = physics.point[:, 2] / sheet.pitch + (sheet.rows - 1) / 2
    ring = np.repeat(np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS), 2 * _RINGS)
    angle = np.pi * (np.tile(np.arange(2 * _RINGS), _RINGS) + 0.5) / _RINGS
    angle += 2.399963 * np.repeat(np.arange(_RINGS), 2 * _RINGS)
    weight = np.sqrt(1.0 - ring**2)
    weight /= weight.sum()
    cells, size = np.zeros(frames * sheet.rows * sheet.columns), sheet.rows * sheet.columns
    share = np.zeros(len(newtons))
    for first in range(0, len(newtons), _CHUNK):
        now = slice(first, first + _CHUNK)
        r = np.rint(row[now, None] + disc[now, None] * ring * np.cos(angle)).astype(np.int64)
        c = np.mod(column[now, None] + disc[now, None] * ring * np.sin(angle) + 0.5, sheet.period)  # cells [c, c + 1)
        c = np.floor(c).astype(np.int64)
        on = (r >= 0) & (r < sheet.rows) & (c < sheet.columns)
        number = physics.frame[now, None] * size + r * sheet.columns + c
        load = newtons[now, None] * weight
        cells += np.bincount(number[on], load[on], cells.size)
        share[now] = (weight * on).sum(axis=1)
    return cells.reshape(frames, sheet.rows, sheet.columns), share


def skin_frames(
    settings: ForearmSettings,
    model: PaperSheet,
    pressed: Float[np.ndarray, "n rows columns"],
    rng: np.random.Generator,
) -> Recording:
    """Return the skin's log, a `Recording` of counts (n, rows, columns) as channel CELLS, on its own clock."""
    made = read_out(model, pressed, rng, rate=float(settings.skin_rate), start=settings.clock_offset)
    return Recording(made.time, {CELLS: made.channels[CELLS]}, source="touched forearm")
