"""Coverage of a calibration of load cells: places and force directions that it knows well, and those it lacks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.sensors.load_cells._fit import ReferenceBlocks
from palpate.sensors.load_cells.model import LoadCells
from palpate.spatial.pose import skew

__all__ = ["CalibratedRegion", "coverage"]

PARTS = 3  # parts along x and along y into which the touched surface is divided
FORCE, FRICTION = 1.0, 0.5  # N, and its sideways share, for which errors are predicted
WANTED = 50e-6  # m: largest acceptable error from the calibration
QUIET = 0.1  # of the normal force: less friction does not show the moment along the force


@dataclass(frozen=True, eq=False)
class CalibratedRegion:
    """The parts of a surface that a calibration touched, and the predicted error in each.

    Attributes:
        place: (9, 3) [m] touched points nearest to the middles of the parts of the surface.
        visits: (9,) number of blocks in each part.
        error: (9, 5) [m] predicted from the calibration alone, for normal forces and with friction along +-x, +-y.
        friction: (2,) rms of the sideways share of the force along the two tangents.
        notes: missing places and directions, one sentence each.
    """

    place: Float[np.ndarray, "p 3"]
    visits: Float[np.ndarray, " p"]
    error: Float[np.ndarray, "p 5"]
    friction: Float[np.ndarray, "2"]
    notes: tuple[str, ...]


def coverage(data: ReferenceBlocks, cells: LoadCells) -> CalibratedRegion:
    """Return the region that the blocks cover, with errors predicted from the cells' calibration covariance."""
    low, high = data.contact[:, :2].min(axis=0), data.contact[:, :2].max(axis=0)
    cell = np.minimum((PARTS * (data.contact[:, :2] - low) / np.maximum(high - low, 1e-9)).astype(int), PARTS - 1)
    part = PARTS * cell[:, 0] + cell[:, 1]
    visits = np.bincount(part, minlength=PARTS**2)
    middle = low + (high - low) * (np.stack(np.divmod(np.arange(PARTS**2), PARTS), axis=1) + 0.5) / PARTS
    nearest = np.array([np.argmin(np.sum((data.contact[:, :2] - spot) ** 2, axis=1)) for spot in middle])
    error = np.array([_foretold(data, cells, int(k)) for k in nearest])
    pressing = np.einsum("nk,nk->n", data.force, data.normal)
    sideways = np.einsum("nak,nk->na", data.tangents, data.force) / pressing[:, None]
    friction = np.sqrt(np.mean(sideways**2, axis=0))
    notes = _notes(middle, visits, error, friction)
    return CalibratedRegion(data.contact[nearest], visits.astype(float), error, friction, notes)


def _foretold(data: ReferenceBlocks, cells: LoadCells, k: int) -> Float[np.ndarray, "5"]:
    """Return the rms position errors (5,) [m] of touches at block k, from the calibration's covariance."""
    normal, tangents, at = data.normal[k], data.tangents[k], data.contact[k]
    pushes = [-normal, *(-normal + sign * FRICTION * t for t in tangents for sign in (1, -1))]
    out = list[float]()
    for push in pushes:
        force = FORCE * push
        wrench = np.concatenate([force, np.cross(at, force)])
        slopes = np.zeros((2, 6))  # of the point by the wrench, for a touch without torque
        turned = tangents @ skew(normal) / (FORCE * (push @ normal))
        slopes[:, :3], slopes[:, 3:] = -turned @ skew(at), turned
        out.append(float(np.sqrt(np.trace(slopes @ cells.calibration_covariance(wrench) @ slopes.T))))
    return np.array(out)


def _notes(middle: np.ndarray, visits: np.ndarray, error: np.ndarray, friction: np.ndarray) -> tuple[str, ...]:
    said = list[str]()
    worst = error.max(axis=1)
    empty = [_place(spot) for spot, count in zip(middle, visits, strict=True) if count == 0]
    if empty:
        said.append(f"Nothing was touched around {', '.join(empty)}: add a path there.")
    unsure = [
        f"{_place(spot)} ({1e6 * part:.0f} um)" for spot, part in zip(middle, worst, strict=True) if part > WANTED
    ]
    if unsure:
        said.append(
            f"The calibration's own error at 1 N is above {1e6 * WANTED:.0f} um around {', '.join(unsure)}: add a path "
            "there."
        )
    weak = [
        f"{part:.0%} of the normal force {axis}"
        for axis, part in zip(("around", "along y"), friction, strict=True)
        if part < QUIET
    ]
    if weak:
        said.append(
            f"Friction was small ({', '.join(weak)}): the moment along the force, and with it the torque about the "
            "normal, is poorly known. Slide along and across."
        )
    return tuple(said)


def _place(spot: np.ndarray) -> str:
    return f"x = {1e3 * spot[0]:.0f}, y = {1e3 * spot[1]:.0f} mm"
