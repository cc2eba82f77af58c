"""Two flat skins of three-axis taxels, by mechanics that no estimator uses: magnets in rubber, and elastic pillars.

Magnets move as points of an elastic half-space do under a load on its face (Johnson, Contact Mechanics, 3.2 and 3.6),
less the motion at the depth of the rigid board, and Hall sensors on the board measure the fields of all dipoles. Each
pillar bears the tip that presses it, and slides under it where friction does not suffice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.spatial.pose import skew
from palpate_lab.simulation.skin_touches import hertz_discs
from palpate_lab.simulation.three_axis_touches import RATE, Loads

POISSON, MODULUS = 0.45, 4e5  # of the rubber: Poisson's ratio, shear modulus [Pa]
MAGNET, BOARD = 2e-3, 6e-3  # m: depths of a magnet and of the board with the Hall sensors
MOMENT = 5e-10  # T m^3: of a magnet, times mu0 / 4 pi
EARTH, TURN = (20e-6, 45e-6), 0.02  # T: along x and across it; rad/s by which the skin turns about x
STIFFNESS, TWICE, BENDING = 2.5e3, 3e-3, 1e3  # of a pillar: N/m, of which there is twice at a compression [m]; N/m
FRICTION = 1.2  # between a tip and a pillar
COUNTS_PER_TESLA, COUNTS_PER_NEWTON, NOISE = 1e6, 1e3, 4.0  # about 1e4 counts by 10 N; noise in counts
FADES, CREEPS = 1.2e-3, 10.0  # by a kelvin: share of what a sensor measures (neodymium magnets); counts at rest
_LATE, _SETTLE = 0.025, 0.5  # share of a reading that follows late, and the time [s] that it takes
_SPREAD, _TILT, _CROSSTALK = 0.05, 0.035, 0.015  # of gains, of axes [rad]; share of a neighbour in a reading
_OFFSET = 1e-4  # m: of a magnet from its place
_RINGS, _AT_ONCE = 3, 64  # of points in a disc; contacts whose motion is computed together
_HALVINGS, _SWEEPS, _DEEP = 40, 60, 8e-3  # to find the depth [m] of a tip, and its motion along the face
_Mechanics = Callable[[np.ndarray, Loads], tuple[np.ndarray, Loads]]


@dataclass(frozen=True)
class ThreeAxisSkin:
    """A flat skin of k three-axis taxels.

    Attributes:
        positions, normals: (k, 3) [m] on its face at z = 0, and +z.
        pitch: [m].
        gains: (k, 3, 3) [counts] by one unit of what a sensor measures, along its axes.
        mixing: (k, k) share of each taxel's value in a reading.
        mechanics: from positions and loads to values (n, k, 3), force [N] or field [T], and to the loads in truth.
    """

    positions: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    pitch: float
    gains: Float[np.ndarray, "k 3 3"]
    mixing: Float[np.ndarray, "k k"]
    mechanics: _Mechanics

    def readings(self, loads: Loads, seed: int, warmer: ArrayLike = 0.0) -> tuple[Float[np.ndarray, "n k 3"], Loads]:
        """Return whole counts (n, k, 3), and the loads with the resultant and centre that act in truth.

        The skin is `warmer` [K] than usual, a number or one for each frame.
        """
        values, truth = self.mechanics(self.positions, loads)
        felt: np.ndarray = np.einsum("iab,nib->nia", self.gains, self.mixing @ _late(values))
        warmth = np.broadcast_to(np.asarray(warmer, dtype=np.float64), len(felt))[:, None, None]
        felt = (1.0 - FADES * warmth) * felt + CREEPS * warmth
        return np.rint(felt + NOISE * np.random.default_rng(seed).standard_normal(felt.shape)), truth


def magnetic_skin(rows: int, columns: int, seed: int) -> ThreeAxisSkin:
    """Draw a skin of magnets in rubber whose magnets, sensors and cross-talk differ from taxel to taxel."""
    rng = np.random.default_rng(seed)
    offset, skewed = rng.standard_normal((2, rows * columns, 3))
    mechanics = partial(_magnets, offset=_OFFSET * offset, skewed=_SPREAD * MOMENT * skewed)
    return _skin(rows, columns, 4.7e-3, COUNTS_PER_TESLA, rng, mechanics)


def pillar_array(rows: int, columns: int, seed: int) -> ThreeAxisSkin:
    """Draw an array of pillars whose sensors and cross-talk differ from taxel to taxel."""
    return _skin(rows, columns, 4e-3, COUNTS_PER_NEWTON, np.random.default_rng(seed), _pillars)


def half_space(
    away: Float[np.ndarray, "*#batch 2"], depth: float, force: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*#batch 3"]:
    """Return the motion [m] of points of a half-space z < 0 by forces on its face (Johnson, (3.18), (3.75)).

    Args:
        away: (*batch, 2) [m] from the force to the points, along the face.
        depth: of the points [m].
        force: (*batch, 3) [N], pressing where z is negative.
    """
    far = np.sqrt(np.sum(away**2, axis=-1) + depth**2)
    near, part, cube = far + depth, (1 - 2 * POISSON) / far, far**-3
    press, along = -force[..., 2], np.sum(away * force[..., :2], axis=-1)
    radial = press * (depth * cube - part / near) + along * (cube - part / near**2)
    flat = force[..., :2] * (1 / far + part * far / near)[..., None] + away * radial[..., None]
    down = press * (depth**2 * cube + 2 * (1 - POISSON) / far) + along * (depth * cube + part / near)
    return np.concatenate([flat, -down[..., None]], axis=-1) / (4 * np.pi * MODULUS)


def _skin(
    rows: int, columns: int, pitch: float, gain: float, rng: np.random.Generator, mechanics: _Mechanics
) -> ThreeAxisSkin:
    row, column = np.indices((rows, columns)).reshape(2, -1)
    places = pitch * np.column_stack([column - (columns - 1) / 2, row - (rows - 1) / 2, 0 * row])
    turned = np.eye(3) + skew(_TILT * rng.standard_normal((len(row), 3)))
    gains = gain * rng.uniform(1 - _SPREAD, 1 + _SPREAD, (len(row), 3, 1)) * turned
    far: np.ndarray = np.linalg.norm(places[:, None] - places, axis=2)
    mixing = np.eye(len(row)) + _CROSSTALK * rng.uniform(0.5, 1.5, far.shape) * ((far > 0) & (far < 1.1 * pitch))
    return ThreeAxisSkin(places, np.tile([0.0, 0.0, 1.0], (len(row), 1)), pitch, gains, mixing, mechanics)


def _late(values: np.ndarray) -> np.ndarray:
    slow, late = values[0].copy(), np.empty_like(values)
    for now, value in enumerate(values):
        slow += (value - slow) / (RATE * _SETTLE)
        late[now] = value + _LATE * (slow - value)
    return late


def _magnets(places: np.ndarray, loads: Loads, offset: np.ndarray, skewed: np.ndarray) -> tuple[np.ndarray, Loads]:
    moved = np.zeros((loads.count, *places.shape))
    for first in range(0, len(loads.frame), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        np.add.at(moved, loads.frame[some], _motion(places + offset, loads, some))
    magnets, moments = places + offset + [0.0, 0.0, BOARD - MAGNET] + moved, skewed + np.array([0.0, 0.0, MOMENT])
    field = np.stack([_dipoles(hall - magnets, moments) for hall in places], axis=1)
    angle = TURN / RATE * np.arange(loads.count)
    earth = np.stack([0 * angle + EARTH[0], EARTH[1] * np.sin(angle), EARTH[1] * np.cos(angle)], axis=1)
    return field + earth[:, None], loads


def _motion(magnets: np.ndarray, loads: Loads, some: slice) -> np.ndarray:
    """Return the motion (m, k, 3) of the magnets against the board, by Hertz's pressure on a disc."""
    force, tip = loads.force[some, None], loads.tip[some]
    radius = np.cbrt(-0.75 * tip[:, 0] * force[:, 0, 2] * (1 - POISSON) / (2 * MODULUS))
    x, y, share = hertz_discs(np.minimum(radius, tip[:, 1]), np.ones(len(tip)), _RINGS)
    twist = loads.torque[some, None] * share / np.sum(share * (x**2 + y**2), axis=1, keepdims=True)
    load = share[..., None] * force + np.stack([-twist * y, twist * x, 0 * x], axis=-1)
    away = magnets[:, None, :2] - (loads.place[some, None, :2] + np.stack([x, y], axis=-1))[:, None]
    return np.sum(half_space(away, MAGNET, load[:, None]) - half_space(away, BOARD, load[:, None]), axis=2)


def _dipoles(away: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Return the field (n, 3) [T] of k dipoles at the end of vectors (n, k, 3) from them (Jackson, (5.56))."""
    far = np.linalg.norm(away, axis=2, keepdims=True)
    along = np.sum(away * moment, axis=2, keepdims=True)
    return np.sum(3 * along * away / far**5 - moment / far**3, axis=1)


def _pillars(places: np.ndarray, loads: Loads) -> tuple[np.ndarray, Loads]:
    away = places[:, :2] - loads.place[:, None, :2]
    pressed = _pressed(np.sum(away**2, axis=2), loads.tip, -loads.force[:, 2:])
    centre = np.einsum("mk,mka->ma", pressed, away) / pressed.sum(axis=1, keepdims=True)
    motions, pushed = _motions(away - centre[:, None]), pressed[..., None] * away / loads.tip[:, None, :1]
    along = _sideways(motions, pressed, pushed, np.column_stack([loads.force[:, :2], loads.torque]))
    forces = np.concatenate([along, -pressed[..., None]], axis=2)
    torque = np.einsum("mka,mka->m", motions[..., 2], along)
    values = np.zeros((loads.count, *places.shape))
    np.add.at(values, loads.frame, forces)
    place = loads.place + np.pad(centre, ((0, 0), (0, 1)))
    return values, replace(loads, place=place, force=forces.sum(axis=1), torque=torque)


def _pressed(square: np.ndarray, tip: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return the normal force (m, k) on each pillar at a squared distance from tips that press with a force in all."""
    gap = np.where(square <= tip[:, 1:] ** 2, square / (2 * tip[:, :1]), np.inf)
    depth, bears = np.zeros(force.shape), np.zeros(gap.shape)
    for halving in range(_HALVINGS):
        depth += np.where(bears.sum(axis=1, keepdims=True) < force, 1, -1) * _DEEP / 2 ** (halving + 1)
        squeeze = np.maximum(depth - gap, 0.0)
        bears = STIFFNESS * squeeze * (1 + squeeze / TWICE)
    return bears


def _sideways(motions: np.ndarray, pressed: np.ndarray, pushed: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the force (m, k, 2) on each pillar along the face: a round tip pushes it aside, and friction as it can.

    The tip moves and turns until force and torque (m, 3) are those wanted, if friction suffices.
    """
    bound = BENDING * (pressed > 0)
    stiff = np.einsum("mkab,mk->mb", motions**2, bound) + 1e-9
    motion, forces = np.zeros(wanted.shape), pushed
    for _ in range(_SWEEPS):
        motion += (wanted - np.einsum("mkab,mka->mb", motions, forces)) / stiff
        bent = np.einsum("mkab,mb,mk->mka", motions, motion, bound)
        limit = FRICTION * pressed / np.maximum(np.linalg.norm(bent, axis=2), 1e-12)
        forces = pushed + bent * np.minimum(1.0, limit)[..., None]
    return forces


def _motions(away: np.ndarray) -> np.ndarray:
    """Return how places (m, k, 2) move, (m, k, 2, 3), as a tip moves along x and y and turns about z."""
    along = np.broadcast_to(np.eye(2), (*away.shape, 2))
    return np.concatenate([along, np.stack([-away[..., 1], away[..., 0]], axis=2)[..., None]], axis=3)
