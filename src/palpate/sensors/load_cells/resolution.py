"""Predict the resolution of force cells at points of a surface, before anything is measured, or built."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.sensors.load_cells.model import AXES, LoadCells, with_changes
from palpate.sensors.load_cells.plate import plate_cells
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import skew

WANTED = 2e-3  # m: the accuracy that the paper requires
AZIMUTHS = 12  # directions of a force with friction, the worst of which counts


@frozen_value(eq=True)
class Resolution:
    """Root mean square errors of touches at n points, of position and force in three dimensions.

    The position error under a force F is e, e^2 = (noise/F)^2 + calibration^2.

    Attributes:
        noise: (n,) [m N] position error from the noise of readings and bias, times the force.
        calibration: (n,) [m] position error from the calibration.
        force: (n,) [N] error of the force from the noise.
        scale: (n,) error of the force from the calibration, over the force.
        torque: (n,) [N m] error of the torque about the normal from the noise; NaN if there is none or it is not
            measured.
        largest: (n,) [N] force at which the first cell leaves its range; inf where none is known.
    """

    noise: Float[np.ndarray, " n"]
    calibration: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    scale: Float[np.ndarray, " n"]
    torque: Float[np.ndarray, " n"]
    largest: Float[np.ndarray, " n"]

    def __post_init__(self) -> None:
        for value in vars(self).values():
            value.flags.writeable = False

    def position(self, force: float) -> Float[np.ndarray, " n"]:
        """Return the position error (n,) [m] under a force [N]."""
        return np.hypot(self.noise / force, self.calibration)

    def smallest(self, accuracy: float) -> Float[np.ndarray, " n"]:
        """Return the least force (n,) [N] with a position error below `accuracy` [m]; inf where no force is enough."""
        left = accuracy**2 - self.calibration**2
        with np.errstate(divide="ignore"):
            return np.where(left <= 0, np.inf, self.noise / np.sqrt(np.maximum(left, 0.0)))


@takes_arrays
def resolution(
    cells: LoadCells,
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    *,
    friction: float = 0.0,
    tare: float = np.inf,
    soft: bool = True,
    sound: Bool[np.ndarray, " k"] | None = None,
) -> Resolution:
    """Return the `Resolution` over a surface, to first order in the errors.

    Args:
        cells: calibrated, or `nominal_cells`; their drift since the bias was taken counts too.
        points: (n, 3) [m] of the surface.
        normals: (n, 3) outward unit normals.
        friction: tangent of the angle between force and normal; the worst direction counts.
        tare: number of independent readings that the bias was taken from.
        soft: whether a contact may have a torque about the normal; else F . M = 0.
        sound: mask (k,) of the cells that answer; None: all. The others still carry load.

    Raises:
        InputError: `tare` is not positive, or `friction` is negative; or arrays of other shapes.
        NotIdentifiable: the sound cells do not determine a wrench.
    """
    if not (tare > 0 and friction >= 0):  # NaN too
        raise InputError("tare must be positive, and friction not negative.")
    spread = (1.0 + 1.0 / tare + cells.drift**2) * cells.inverse(sound)[1]
    pushes = _directions(normals, friction)
    units = [push / np.linalg.norm(push, axis=1, keepdims=True) for push in pushes]
    *errors, readings = zip(*(_at(cells, points, normals, unit, spread, soft) for unit in units), strict=True)
    largest = _largest(cells, np.array(readings), cells.channels(sound))
    return Resolution(*(np.max(error, axis=0) for error in errors), largest=largest)


@takes_arrays
def position_slope(
    point: Float[np.ndarray, "*batch 3"],
    normal: Float[np.ndarray, "*batch 3"],
    force: Float[np.ndarray, "*batch 3"],
) -> Float[np.ndarray, "*batch 4 6"]:
    """Return the derivative of a soft finger's contact point and torque by the wrench, at zero torque.

    M = p x F + tau n gives with m = dM - p x dF, the change of the moment about the point,

        dtau = m . F/(n . F),    dp = Q F x (m - dtau n)/|F|^2,    Q = 1 - F n'/(F . n)

    as dp lies in the tangent plane.

    Args:
        point: (*batch, 3) [m] p.
        normal: (*batch, 3) n, the outward unit normal there.
        force: (*batch, 3) [N] F.

    Returns:
        (*batch, 4, 6) d(p, tau)/d(F, M) [m/N, 1/N; m, 1].

    Raises:
        InputError: arrays of other shapes.
    """
    moment = np.concatenate([-skew(point), np.broadcast_to(np.eye(3), (*point.shape[:-1], 3, 3))], axis=-1)
    pressing = np.sum(force * normal, axis=-1)[..., None]
    twist = np.einsum("...i,...ij->...j", force, moment) / pressing
    across = moment - normal[..., :, None] * twist[..., None, :]
    shift = skew(force) @ across / np.sum(force**2, axis=-1)[..., None, None]
    out = np.einsum("...i,...ij->...j", normal, shift) / pressing
    return np.concatenate([shift - force[..., :, None] * out[..., None, :], twist[..., None, :]], axis=-2)


@takes_arrays
def nominal_cells(
    positions: ArrayLike,
    sensitivity: float,
    noise: float,
    limit: float = np.inf,
    *,
    drift: float = 0.0,
    axes: Sequence[str] = AXES,
) -> LoadCells:
    """Return the `LoadCells` of a layout: springs of equal stiffness, without cross-coupling.

    The frame's balance gives f_i = B_i' (sum B_j B_j')^-1 w with B_i = (1; [l_i]x). A cell of one axis reads more, the
    harder something presses against that axis, and its sensitivity is known to 1 %.

    Args:
        positions: (k, 3) [m] of at least three cells.
        sensitivity: [N/V] of every axis.
        noise: [V] standard deviation of a reading.
        limit: [V] range of a reading, to either side.
        drift: [V] standard deviation of the bias's drift after it was taken.
        axes: that each cell measures, see `LoadCells`.

    Raises:
        InputError: sensitivity or noise is 0, or there are fewer than three positions; or arrays of other shapes.
        NotIdentifiable: the positions do not determine a wrench.
    """
    places = shaped(positions, (None, 3), "positions")
    if len(axes) == 1:
        ends = np.tile([-limit, limit], (len(places), 1))
        gains, spread = np.full(len(places), sensitivity), noise**2 * np.eye(len(places))
        return with_changes(plate_cells(places, gains, spread, axes[0], ends), drift=drift / noise)
    maps = np.hstack([np.zeros((6, 0)), *(np.vstack([np.eye(3), skew(place)]) for place in places)])
    balance = maps @ maps.T
    if np.linalg.cond(balance / np.outer(_ARMS, _ARMS)) > _FLAT:
        shares = np.zeros((maps.shape[1], 6))  # LoadCells names the missing direction
    else:
        shares = np.linalg.solve(balance, maps).T
    limits, spread = np.tile([-limit, limit], (len(shares), 1)), np.full(len(shares), noise)
    return LoadCells(shares / sensitivity, spread, limits=limits, positions=places, drift=drift / noise)


_ARMS = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])  # m: lengths of a fingertip
_FLAT = 1e12


def _at(
    cells: LoadCells, points: np.ndarray, normals: np.ndarray, force: np.ndarray, spread: np.ndarray, soft: bool
) -> tuple[np.ndarray, ...]:
    """Return the first five fields of `Resolution` for 1 N at each point, and its readings (n, 3 k)."""
    slope = position_slope(points, normals, force)
    place = slope[:, :3]
    wrench = np.concatenate([force, np.cross(points, force)], axis=1)
    unsure = cells.calibration_covariance(wrench)
    if not soft:  # the wrench nearest to the measured one without moment along the force
        torsion = np.concatenate([wrench[:, 3:], wrench[:, :3]], axis=1)  # slope of F . M
        moved = torsion @ spread / np.einsum("ni,ij,nj->n", torsion, spread, torsion)[:, None]
        place = place - (place @ moved[..., None]) * torsion[:, None]
    return (
        _rms(place @ spread @ np.swapaxes(place, 1, 2)),
        _rms(place @ unsure @ np.swapaxes(place, 1, 2)),
        np.full(len(points), np.sqrt(np.trace(spread[:3, :3]))),
        _rms(unsure[:, :3, :3]),
        np.sqrt(np.einsum("ni,ij,nj->n", slope[:, 3], spread, slope[:, 3]))
        if soft and len(cells.axes) > 1
        else np.full(len(points), np.nan),
        wrench @ cells.matrix.T,
    )


def _directions(normals: np.ndarray, friction: float) -> list[np.ndarray]:
    """Return unit forces (n, 3) that press with a friction, in `AZIMUTHS` directions."""
    if friction == 0.0:
        return [-normals]
    first = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    turns = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    return [
        (friction * (np.cos(turn) * first + np.sin(turn) * second) - normals) / np.hypot(1.0, friction)
        for turn in turns
    ]


def _largest(
    cells: LoadCells, readings: Float[np.ndarray, "d n m"], kept: Bool[np.ndarray, " m"]
) -> Float[np.ndarray, " n"]:
    """Return the force (n,) [N] at which the first sound channel leaves its range, from readings of 1 N [V]."""
    room = np.where(readings < 0, cells.bias - cells.limits[:, 0], cells.limits[:, 1] - cells.bias)
    return np.min((room / np.maximum(np.abs(readings), 1e-300))[..., kept], axis=(0, 2))


def _rms(covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.trace(covariance, axis1=-2, axis2=-1), 0.0))
