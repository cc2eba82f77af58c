"""Coverage of a calibration of load cells: places and force directions that it knows well, and those it lacks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.sensors.load_cells._fit import ReferenceBlocks
from palpate.sensors.load_cells.model import LoadCells
from palpate.spatial.pose import skew

PARTS = 3  # parts along x and along y into which the touched surface is divided
FORCE, FRICTION = 1.0, 0.5  # N, and its sideways share, for which errors are predicted
WANTED = 50e-6  # m: largest acceptable error from the calibration
QUIET = 0.1  # of the normal force: less friction does not show the moment along the force


@dataclass(frozen=True, eq=False)
class CalibratedRegion:
    """The nine parts of a surface that a calibration may touch.

    Attributes:
        visits: (9,) number of blocks in each part.
        error: (9, 5) [m] predicted from the calibration alone, for normal forces and with friction along +-x, +-y.
        notes: missing places and directions, one sentence each.
    """

    visits: Float[np.ndarray, " p"]
    error: Float[np.ndarray, "p 5"]
    notes: tuple[str, ...]


def coverage(data: ReferenceBlocks, cells: LoadCells) -> CalibratedRegion:
    """Return the `CalibratedRegion` of blocks, with errors by the cells' calibration covariance."""
    at = data.contact[:, :2]
    low, high = at.min(axis=0), at.max(axis=0)
    cell = np.minimum((PARTS * (at - low) / np.maximum(high - low, 1e-9)).astype(int), PARTS - 1)
    visits = np.bincount(PARTS * cell[:, 0] + cell[:, 1], minlength=PARTS**2)
    middle = low + (high - low) * (np.stack(np.divmod(np.arange(PARTS**2), PARTS), axis=1) + 0.5) / PARTS
    nearest = np.array([np.argmin(np.sum((at - spot) ** 2, axis=1)) for spot in middle])
    error = np.array([_foretold(data, cells, int(k)) for k in nearest])
    pressing = np.einsum("nk,nk->n", data.force, data.normal)
    sideways = np.einsum("nak,nk->na", data.tangents, data.force) / pressing[:, None]
    friction = np.sqrt(np.mean(sideways**2, axis=0))
    return CalibratedRegion(visits.astype(float), error, _notes(middle, visits, error, friction))


def _foretold(data: ReferenceBlocks, cells: LoadCells, k: int) -> Float[np.ndarray, "5"]:
    normal, tangents, at = data.normal[k], data.tangents[k], data.contact[k]
    pushes = [-normal, *(-normal + sign * FRICTION * t for t in tangents for sign in (1, -1))]
    out = list[float]()
    for push in pushes:
        force = FORCE * push
        wrench = np.concatenate([force, np.cross(at, force)])
        turned = tangents @ skew(normal) / (FORCE * (push @ normal))
        slopes = np.concatenate([-turned @ skew(at), turned], axis=1)  # of a touch without torque, by the wrench
        out.append(float(np.sqrt(np.trace(slopes @ cells.calibration_covariance(wrench) @ slopes.T))))
    return np.array(out)


def _notes(middle: np.ndarray, visits: np.ndarray, error: np.ndarray, friction: np.ndarray) -> tuple[str, ...]:
    said = list[str]()
    places = [f"x = {1e3 * x:.0f}, y = {1e3 * y:.0f} mm" for x, y in middle]
    if empty := [place for place, count in zip(places, visits, strict=True) if count == 0]:
        said.append(f"Nothing was touched around {', '.join(empty)}: add a path there.")
    worst = zip(places, error.max(axis=1), strict=True)
    if unsure := [f"{place} ({1e6 * part:.0f} um)" for place, part in worst if part > WANTED]:
        said.append(
            f"The calibration's own error at 1 N is above {1e6 * WANTED:.0f} um around {', '.join(unsure)}: add a path "
            "there."
        )
    along = zip(("around", "along y"), friction, strict=True)
    if weak := [f"{part:.0%} of the normal force {axis}" for axis, part in along if part < QUIET]:
        said.append(
            f"Friction was small ({', '.join(weak)}): the moment along the force, and with it the torque about the "
            "normal, is poorly known. Slide along and across."
        )
    return tuple(said)
