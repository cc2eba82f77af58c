"""Find the contacts of a sample of a taxel skin, without a model of how pressure spreads."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays

LEAST = 0.15  # N a cell: below it is noise of the counts
REACH = 1.6  # of the usual distance between neighbours: cells of one patch

Frames = Callable[[np.ndarray, np.ndarray], np.ndarray]  # forces of cells (k,) [N], wrench (6,), to rows (c, 6)


@takes_arrays
class CellPlaces:
    """Positions of a skin's cells: centres (k, 3) [m] and outward normals (k, 3)."""

    def __init__(self, centres: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "k 3"]) -> None:
        self.centres, self.normals = centres, normals
        apart = np.linalg.norm(centres[:, None] - centres, axis=2)
        pitch = np.median(np.sort(apart, axis=1)[:, 1])
        self.near = apart < REACH * pitch


def all_taxels(sheet: CellPlaces) -> Frames:
    """Return a peer that finds one contact: the centre of all loaded cells, weighted by force.

    The peer is a function from forces of the cells (k,) [N] and a wrench (6,) to (1, 6): point [m] and force [N].
    Without loaded cells it is (0, 6).
    """

    def answer(forces: np.ndarray, wrench: np.ndarray) -> np.ndarray:
        del wrench
        felt = np.flatnonzero(forces > LEAST)
        return _contact(sheet, forces, felt)[None] if len(felt) else np.empty((0, 6))

    return answer


def patches(sheet: CellPlaces) -> Frames:
    """Return a peer that finds one contact per patch of loaded neighbours: its centre and its sum along the normals.

    The peer is a function as in `all_taxels`; it returns a row per patch, (c, 6).
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    def answer(forces: np.ndarray, wrench: np.ndarray) -> np.ndarray:
        del wrench
        felt = np.flatnonzero(forces > LEAST)
        if not len(felt):
            return np.empty((0, 6))
        count, label = connected_components(csr_array(sheet.near[np.ix_(felt, felt)]), directed=False)
        return np.stack([_contact(sheet, forces, felt[label == k]) for k in range(count)])

    return answer


def patches_and_wrench(sheet: CellPlaces) -> Frames:
    """Return a peer that finds the points of `patches`, and the shortest forces there that make the sensor's wrench.

    The peer is a function from forces of the cells (k,) [N] and a wrench (6,) [N, N m] to a row per patch, (c, 6):
    point [m] and force [N].
    """
    skin = patches(sheet)

    def answer(forces: np.ndarray, wrench: np.ndarray) -> np.ndarray:
        rows = skin(forces, wrench)
        if len(rows):
            rows[:, 3:] = minimum_norm(rows[:, :3], wrench)
        return rows

    return answer


@takes_arrays
def minimum_norm(points: Float[np.ndarray, "n 3"], wrench: Float[np.ndarray, "6"]) -> Float[np.ndarray, "n 3"]:
    """Return the shortest forces (n, 3) [N] at points (n, 3) [m] that make a wrench (6,) [N, N m] about the origin.

    Raises:
        InputError: arrays of other shapes.
    """
    columns = [np.concatenate([np.eye(3), np.cross(point, np.eye(3)).T]) for point in points]
    return (np.linalg.pinv(np.concatenate(columns, axis=1)) @ wrench).reshape(-1, 3)


def _contact(sheet: CellPlaces, forces: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Return point and force (6,) of the contact on some cells."""
    share = forces[which]
    return np.r_[share @ sheet.centres[which] / share.sum(), -(share @ sheet.normals[which])]
