"""The cells one by one: sensitivities S_i and places l_i, as far as calibration and prior knowledge determine them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.load_cells import LoadCells, named_axis, single_wrench_map
from palpate.spatial._arrays import frozen
from palpate.spatial.pose import skew

__all__ = ["SingleCells", "single_cells"]

STEPS, SETTLED = 50, 1e-12
FLOOR = 1e-6  # relative error of the matrix that is always assumed
KNOWN = 0.05  # of a cell's sensitivity, for the standard deviation of one that counts as determined
NEAR = 0.5e-3  # m: the same, for a place
UNIT = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])  # N, N m: wrenches that weigh alike


@dataclass(frozen=True, eq=False)
class SingleCells:
    """The paper's parameters: f_i = S_i (u_i - b_i) at l_i, with w = sum (f_i, l_i x f_i).

    Attributes:
        sensitivity: (k, 3, 3) S_i [N/V]; position: (k, 3) l_i [m].
        covariance: (12 k, 12 k) of all S_i row by row, then all l_i.
        determined: (12 k,) share of the prior's variance of each that is gone.
    """

    sensitivity: Float[np.ndarray, "k 3 3"]
    position: Float[np.ndarray, "k 3"]
    covariance: Float[np.ndarray, "p p"]
    determined: Float[np.ndarray, " p"]

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            object.__setattr__(self, name, frozen(value))


def single_cells(
    cells: LoadCells,
    sensitivity: Float[np.ndarray, "k 3 3"],
    *,
    spread: float = 0.2,
    place_spread: float = 2e-3,
    known: float = KNOWN,
    near: float = NEAR,
) -> SingleCells:
    """S_i and l_i from a calibration and a prior of both, by least squares on what they must satisfy.

    Under a rigid frame the voltages span six dimensions, and any S_i and l_i with

        sum (S_i; [l_i]x S_i) C_i = 1,    C_i the three rows of cell i,

    read every wrench alike: 36 equations of rank 24 to 30 for 12 k unknowns. The others are as the prior says, and the
    wrench does not need them.

    Args:
        cells: calibrated; its positions are the prior of l_i.
        sensitivity: (k, 3, 3) [N/V] prior of S_i, such as a data sheet's.
        spread: standard deviation of that prior, as a share of the cell's largest sensitivity.
        place_spread: of the positions [m].
        known: share of that sensitivity to which each S must be determined; inf asks nothing.
        near: [m] to which each place must be; inf asks nothing.

    Raises:
        InputError: a position is not known at all, or shapes.
        NotIdentifiable: some are not determined as well as asked; names the directions.
    """
    count = cells.cells
    prior_s = np.asarray(sensitivity, dtype=np.float64)
    if prior_s.shape != (count, 3, 3) or not np.isfinite(prior_s).all():
        raise InputError(f"sensitivities must be ({count}, 3, 3) finite numbers, not {prior_s.shape}")
    if not np.isfinite(cells.positions).all():
        raise InputError("the places of all cells must be known roughly.", mend="State positions in [load_cells].")
    largest = np.repeat(np.abs(prior_s).max(axis=(1, 2)), 9)
    size = np.concatenate([spread * largest, np.full(3 * count, place_spread)])
    prior = np.concatenate([prior_s.reshape(-1), cells.positions.reshape(-1)])
    found, hessian = _fitted(cells, prior, size)
    covariance = np.linalg.inv(hessian) * np.outer(size, size)
    allowed = np.concatenate([known * largest, np.full(3 * count, near)])
    _require(covariance, allowed, count)
    return SingleCells(
        found[: 9 * count].reshape(-1, 3, 3),
        found[9 * count :].reshape(-1, 3),
        covariance,
        1.0 - np.diag(covariance) / size**2,
    )


def _fitted(cells: LoadCells, prior: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gauss and Newton on equations and prior, in units of the prior's deviations; and the last normal matrix."""
    scale = np.outer(1.0 / UNIT, UNIT).reshape(-1)
    doubt = cells.covariance * np.outer(scale, scale) + FLOOR**2 * np.eye(36)
    white = np.linalg.inv(np.linalg.cholesky(doubt)) * scale
    found, hessian = prior.copy(), np.eye(len(prior))
    for _ in range(STEPS):
        left, slopes = _equations(cells, found)
        steep = white @ slopes * size
        hessian = steep.T @ steep + np.eye(len(prior))
        step = np.linalg.solve(hessian, steep.T @ (white @ left) + (found - prior) / size)
        found = found - step * size
        if np.abs(step).max() < SETTLED:
            break
    return found, hessian


def _equations(cells: LoadCells, found: np.ndarray) -> tuple[Float[np.ndarray, "36"], Float[np.ndarray, "36 p"]]:
    """Left sides of sum (S_i; [l_i]x S_i) C_i - 1 = 0, row by row, and their derivatives by all S_i and l_i."""
    count = cells.cells
    singles, places = found[: 9 * count].reshape(-1, 3, 3), found[9 * count :].reshape(-1, 3)
    left, slopes = -np.eye(6), np.zeros((36, len(found)))
    for i in range(count):
        rows, apart = cells.matrix[3 * i : 3 * i + 3], single_wrench_map(places[i])
        share = singles[i] @ rows
        left = left + apart @ share
        slopes[:, 9 * i : 9 * i + 9] = np.einsum("wa,bc->wcab", apart, rows).reshape(36, 9)
        turned = np.zeros((6, 6, 3))
        for k in range(3):
            turned[3:, :, k] = skew(np.eye(3)[k]) @ share
        slopes[:, 9 * count + 3 * i : 9 * count + 3 * i + 3] = turned.reshape(36, 3)
    return left.reshape(-1), slopes


def _require(covariance: np.ndarray, allowed: np.ndarray, count: int) -> None:
    """Raise where combinations of the unknowns are not determined, naming what each is mostly of."""
    values, vectors = np.linalg.eigh(covariance / np.outer(allowed, allowed))
    loose = values > 1.0
    if not loose.any():
        return
    names = tuple(dict.fromkeys(_combination(vector, count) for vector in vectors[:, loose].T[::-1]))
    raise NotIdentifiable(
        f"{int(loose.sum())} of {len(allowed)} combinations of the cells' own sensitivities and places are not "
        f"determined: {'; '.join(names[:4])}{'; ...' if len(names) > 4 else ''}. Under a rigid frame the voltages span "
        "six dimensions, so the wrench does not need them; calibrate the cells before the frame is glued on, or state "
        "them more closely.",
        rank=int(np.count_nonzero(~loose)),
        missing=names,
    )


def _combination(vector: np.ndarray, count: int) -> str:
    """The parts of a direction that are more than half its largest."""
    singles, places = vector[: 9 * count].reshape(-1, 3, 3), vector[9 * count :].reshape(-1, 3)
    least = 0.5 * np.abs(vector).max()
    parts = [
        f"force along {'xyz'[row]} of cell {cell + 1} by its channel {'xyz'[column]}"
        for cell, row, column in np.argwhere(np.abs(singles) >= least)
    ]
    parts += [
        f"place of cell {cell + 1} along {named_axis(place)}"
        for cell, place in enumerate(places)
        if np.abs(place).max() >= least
    ]
    return " with ".join(parts[:3]) + (" and others" if len(parts) > 3 else "")
