"""Average the wrenches of a log in which the arm rests in each pose for a while: one mean per pose."""

from __future__ import annotations

from math import radians

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.spatial.arguments import takes_arrays

STILL = radians(0.3)
ENOUGH = 4  # poses


@takes_arrays
def average_poses(
    wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"], *, shortest: int = 10
) -> tuple[Float[np.ndarray, "k 6"], Float[np.ndarray, "k 3 3"], Int[np.ndarray, " k"]]:
    """Return mean wrenches, rotations and sample counts of the stretches whose orientation stays within 0.3 degrees.

    A fit to single samples would be overconfident: those of one pose share its model error. A log with fewer than four
    stretches is returned unchanged, with counts of one.

    Args:
        wrenches: (n, 6) [N, N m]; rows that are not finite are in no stretch.
        rotations: (n, 3, 3), likewise.
        shortest: least number of samples in a stretch.

    Returns:
        Means (k, 6) [N, N m], rotations (k, 3, 3) and counts (k,) of k stretches.

    Raises:
        InputError: arrays of other shapes.
    """
    both = np.concatenate([wrenches, rotations.reshape(-1, 9)], axis=1)
    finite = np.asarray(np.isfinite(both).all(axis=1), dtype=bool)
    stretches = [rows for rows in _stretches(rotations, finite) if len(rows) >= shortest]
    if len(stretches) < ENOUGH:
        return wrenches, rotations, np.ones(len(wrenches), dtype=np.int64)
    means = np.stack([wrenches[rows].mean(axis=0) for rows in stretches])
    turns = np.stack([_nearest_rotation(rotations[rows].mean(axis=0)) for rows in stretches])
    return means, turns, np.array([len(rows) for rows in stretches])


def _stretches(rotations: Float[np.ndarray, "n 3 3"], finite: Bool[np.ndarray, " n"]) -> list[Int[np.ndarray, " k"]]:
    """Return runs of consecutive rows whose rotation lies within `STILL` of that of the run's first row."""
    found: list[Int[np.ndarray, " k"]] = []
    start = 0
    while start < len(rotations):
        stop = _first_turned(rotations, finite, start) if finite[start] else start + 1
        if finite[start]:
            found.append(np.arange(start, stop))
        start = stop
    return found


def _first_turned(rotations: Float[np.ndarray, "n 3 3"], finite: Bool[np.ndarray, " n"], start: int) -> int:
    """Return the first row after `start` that is turned from it by more than `STILL`, searched in growing chunks."""
    chunk, begin, cosine = 64, start + 1, 1.0 + 2.0 * np.cos(STILL)  # the trace of a rotation by that angle
    while begin < len(rotations):
        rows = slice(begin, begin + chunk)
        turned = ~finite[rows] | (np.einsum("nij,ij->n", rotations[rows], rotations[start]) < cosine)
        if turned.any():
            return begin + int(np.argmax(turned))
        begin, chunk = begin + chunk, 2 * chunk
    return len(rotations)


def _nearest_rotation(matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    left, _, right = np.linalg.svd(matrix)
    return left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
