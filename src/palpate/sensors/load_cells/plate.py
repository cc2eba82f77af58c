"""A plate on cells of one axis: the forward model from the gain and the place of each cell.

The cells' forces -g_i u_i a at l_i, along the axis a, balance what presses on the plate whatever it is made of, so that

    w = A u,    A = -(a; l_i x a) g_i

needs neither a stiff plate nor equal cells. In `LoadCells` that A is the least squares' if C = R A' (A R A')^-1 +
R Q' H, with Q the combinations of unit variance that A' does not make, and H how an uneven plate loads these.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.sensors.load_cells.model import AXES, LoadCells, measured, require_layout, unmeasured, with_changes
from palpate.spatial.arguments import takes_arrays

TOLERANCE = 0.01  # of a gain that no calibration determines: one standard deviation
UNEVEN = 0.3  # share of a reading that an uncalibrated plate may divide otherwise than a stiff one on equal cells


@takes_arrays
def plate_cells(
    positions: Float[np.ndarray, "k 3"],
    gains: Float[np.ndarray, " k"],
    noise: Float[np.ndarray, "k k"],
    axis: str = "z",
    limits: ArrayLike | None = None,
) -> LoadCells:
    """Return the `LoadCells` of a plate whose gains are known to 1 %, and which may bend.

    Args:
        positions: (k, 3) [m] of at least three cells.
        gains: (k,) [N/V] of the cells, positive if a reading grows where something presses against the axis.
        noise: (k, k) covariance [V^2] of one reading.
        axis: of the surface's frame that the cells measure.
        limits: (k, 2) [V] lowest and highest reading; None: not known.

    Raises:
        InputError: arrays of other shapes.
        NotIdentifiable: all cells lie on one line.
    """
    axes = (axis,)
    require_layout(positions, axes)
    balance = measured(axes).T @ (_units(axes, positions) * gains)
    spread = noise @ balance.T
    matrix = spread @ np.linalg.inv(balance @ spread) @ _seen(axes, positions)
    cells = LoadCells(matrix, noise, positions=positions, axes=axes, limits=limits, misfit=UNEVEN)
    return with_gains(cells, np.diag((TOLERANCE * gains) ** 2))


def with_gains(cells: LoadCells, covariance: Float[np.ndarray, "k k"]) -> LoadCells:
    """Return the cells with E by the covariance (k, k) of their gains [N/V]."""
    slopes = np.einsum("ik,kj->kij", _units(cells.axes, cells.positions), cells.matrix).reshape(cells.cells, 36)
    return with_changes(cells, covariance=slopes.T @ covariance @ slopes)


def uneven(cells: LoadCells, loads: Float[np.ndarray, "r 3"]) -> LoadCells:
    """Return the cells of a plate that loads the combinations Q of `inverse` by H (r, 3) for each wrench measured.

    The noise is taken to be independent in A u and in the new Q u, which keeps A: their correlation is that of H.
    """
    inverse, _, rest = cells.inverse()
    balance, back = cells.measured.T @ inverse, cells.noise @ rest.T
    matrix = cells.matrix + back @ loads @ _seen(cells.axes, cells.positions)
    root = np.linalg.cholesky(balance @ cells.noise @ balance.T)
    factor = np.concatenate([matrix @ cells.measured @ root, back], axis=1)
    return with_changes(cells, matrix=matrix, noise=factor @ factor.T)


def _units(axes: tuple[str, ...], positions: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "6 k"]:
    """Return the wrench on the plate (6, k) if each cell carries 1 N: what presses is against the axis."""
    axis = np.eye(3)[AXES.index(axes[0])]
    return -np.concatenate([np.tile(axis, (len(positions), 1)), np.cross(positions, axis)], axis=1).T


def _seen(axes: tuple[str, ...], positions: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "3 6"]:
    """Return the map from any wrench to those measured, without the wrenches that are not."""
    return np.linalg.inv(np.concatenate([measured(axes), unmeasured(axes, positions)], axis=1))[:3]
