"""Average the wrenches of a log in which the arm rests in each pose for a while: one mean per pose."""

from __future__ import annotations

from math import radians

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays

STILL = radians(0.3)
ENOUGH = 4  # poses
FAR = radians(2.0)  # between the rows of a table with one row for each orientation, at least
BRIEF = 0.25  # of the usual length: a shorter stretch is none of its own
NOISE = 4.2  # median steps from a reading to the next: by noise, a rest seems to turn further 4 times in a million


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
    cosine = 1.0 + 2.0 * np.cos(STILL)  # the trace of a rotation by that angle
    stretches = [rows for rows in _stretches(rotations, finite, cosine) if len(rows) >= shortest]
    if len(stretches) < ENOUGH:
        return wrenches, rotations, np.ones(len(wrenches), dtype=np.int64)
    means = np.stack([wrenches[rows].mean(axis=0) for rows in stretches])
    turns = np.stack([_nearest_rotation(rotations[rows].mean(axis=0)) for rows in stretches])
    return means, turns, np.array([len(rows) for rows in stretches])


@takes_arrays
def average_rests(
    wrenches: Float[np.ndarray, "n 6"], accelerations: Float[np.ndarray, "n 3"], *, shortest: int = 10
) -> tuple[Float[np.ndarray, "k 6"], Float[np.ndarray, "k 3"], Int[np.ndarray, " k"], float | None]:
    """Return mean wrenches, accelerations and sample counts of the stretches in which gravity keeps its direction.

    It may turn by 0.3 degrees, or by as much as the accelerometer's noise can make it seem. A table with a row for each
    orientation is returned unchanged, with counts of one.

    Args:
        wrenches: (n, 6) [N, N m]; rows that are not finite are in no stretch.
        accelerations: (n, 3) [m/s^2] of an accelerometer on the sensor, likewise.
        shortest: least number of samples in a stretch.

    Returns:
        Means (k, 6) [N, N m] and (k, 3) [m/s^2], counts (k,), and the standard deviation [m/s^2] of one reading of the
            accelerometer along an axis, None where each row stands alone.

    Raises:
        InputError: arrays of other shapes, or fewer than four stretches in a log that moves for most of the time.
    """
    both = np.concatenate([wrenches, accelerations], axis=1)
    lengths = np.linalg.norm(accelerations, axis=1)
    finite = np.asarray(np.isfinite(both).all(axis=1) & (lengths > 0.0), dtype=bool)
    up = np.where(finite, accelerations.T, np.nan).T / np.where(finite, lengths, 1.0)[:, None]
    steps = np.linalg.norm(np.diff(up[finite], axis=0), axis=1)
    if not len(steps) or np.median(steps) > FAR:
        return wrenches, accelerations, np.ones(len(wrenches), dtype=np.int64), None
    noise = NOISE * float(np.median(steps))
    found = _stretches(up[:, None], finite, np.cos(max(STILL, noise)))
    stretches = [rows for rows in found if len(rows) >= shortest and _rests(up[rows], max(STILL, noise))]
    usual = BRIEF * float(np.median([len(rows) for rows in stretches])) if stretches else 0.0
    stretches = [rows for rows in stretches if len(rows) >= usual]  # not the slow begin of a turn
    if len(stretches) < ENOUGH and sum(map(len, stretches)) < 0.5 * np.count_nonzero(finite):
        raise InputError(
            f"the sensor moves: gravity keeps its direction in {len(stretches)} stretches of {shortest} samples or "
            "more, and elsewhere the accelerations of the motion hide it.",
            hint="Hold it still for a second or longer in each of some twelve orientations.",
        )
    means = np.stack([both[rows].mean(axis=0) for rows in stretches])
    scatter = np.concatenate([accelerations[rows] - accelerations[rows].mean(axis=0) for rows in stretches])
    counts = np.array([len(rows) for rows in stretches])
    deviation = np.sqrt((scatter**2).sum() / (3 * (counts.sum() - len(counts))))
    return means[:, :6], means[:, 6:], counts, float(deviation)


def _rests(up: Float[np.ndarray, "n 3"], noise: float) -> bool:
    """Return whether directions keep their mean from one half to the other, as they do not in a slow turn."""
    first, second = np.array_split(up, 2)
    apart = float(np.linalg.norm(first.mean(axis=0) - second.mean(axis=0)))
    return apart <= max(STILL / 4, noise / len(first) ** 0.5)


def _stretches(
    rotations: Float[np.ndarray, "n p q"], finite: Bool[np.ndarray, " n"], cosine: float
) -> list[Int[np.ndarray, " k"]]:
    """Return runs of consecutive rows whose product with the run's first row is not below `cosine`."""
    found: list[Int[np.ndarray, " k"]] = []
    start = 0
    while start < len(rotations):
        stop = _first_turned(rotations, finite, start, cosine) if finite[start] else start + 1
        if finite[start]:
            found.append(np.arange(start, stop))
        start = stop
    return found


def _first_turned(
    rotations: Float[np.ndarray, "n p q"], finite: Bool[np.ndarray, " n"], start: int, cosine: float
) -> int:
    """Return the first row after `start` whose product with it is below `cosine`, searched in growing chunks."""
    chunk, begin = 64, start + 1
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
