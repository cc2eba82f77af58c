"""Move forces into their cones of friction."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays

_WITHOUT = (
    "forces outside their cones of friction are not corrected: clarabel is not installed "
    "(pip install 'palpate[fusion]')"
)
_NONE = "no forces within the cones of friction were found: the forces of the closed form are given"


@takes_arrays
def within_cones(
    force: Float[np.ndarray, "m 3"],
    normals: Float[np.ndarray, "m 3"],
    counts: Int[np.ndarray, " n"],
    covariances: Sequence[Float[np.ndarray, "_ _"]],
    friction: float,
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " n"], tuple[str, ...]]:
    """Return the forces f within the cones with the least (f - force)^T covariance^-1 (f - force), frame by frame.

    clarabel solves it as a problem of second-order cones.

    Args:
        force: (m, 3) [N] the best forces without cones.
        normals: (m, 3) outward, unit.
        counts: (n,) number of contacts in each frame.
        covariances: (3 count, 3 count) [N^2] of each frame's forces; may be singular.
        friction: bound of the tangential over the normal force.

    Returns:
        Forces (m, 3) [N], the least square (n,) of each frame, and notes where forces are unchanged: clarabel is not
        installed, or found none.

    Raises:
        InputError: arrays of other shapes.
    """
    found, further, notes = force.copy(), np.zeros(len(counts)), tuple[str, ...]()
    try:
        clarabel: Any = import_module("clarabel")
    except ImportError:
        return found, further, (_WITHOUT,)
    turns, end = _cones(normals, friction), 0
    for k, (count, covariance) in enumerate(zip(counts.tolist(), covariances, strict=True)):
        one, end, root = slice(end, end + count), end + count, _root(covariance)
        matrix = (turns[one] @ root.reshape(count, 3, -1)).reshape(3 * count, -1)
        least = _shortest(clarabel, matrix, (turns[one] @ force[one, :, None]).reshape(-1))
        if least is None:
            notes = (_NONE,)
        else:
            found[one] += (root @ least).reshape(-1, 3)
            further[k] = least @ least
    return found, further, notes


def _shortest(
    clarabel: Any, matrix: Float[np.ndarray, "m s"], given: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " s"] | None:
    """Return the shortest x for which `given` + `matrix` x lies in its cones; None if none is found."""
    count, size = len(given) // 3, matrix.shape[1]
    if not size:
        return None
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.SecondOrderConeT(3)] * count
    problem = (_identity(size), [0.0] * size, _columns(-matrix), given.tolist(), cones, settings)
    solved = clarabel.DefaultSolver(*problem).solve()
    return np.asarray(solved.x) if str(solved.status) in ("Solved", "AlmostSolved") else None


class _Sparse(NamedTuple):
    """The fields of SciPy's sparse matrices that clarabel reads; importing SciPy takes longer than many frames."""

    data: list[float]
    indices: list[int]
    indptr: list[int]
    shape: tuple[int, int]
    has_canonical_format: bool = True


def _columns(matrix: Float[np.ndarray, "r c"]) -> _Sparse:
    """Return a full matrix as a sparse one of lists, which clarabel reads in half the time."""
    height, width = matrix.shape
    ends = range(0, height * width + 1, height)
    return _Sparse(matrix.T.ravel().tolist(), [*range(height)] * width, [*ends], (height, width))


@cache
def _identity(size: int) -> _Sparse:
    return _Sparse([1.0] * size, [*range(size)], [*range(size + 1)], (size, size))


def _root(covariance: Float[np.ndarray, "m m"]) -> Float[np.ndarray, "m r"]:
    """Return S (m, r) with covariance = S S^T, without columns that are zero."""
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariance)
        kept = values > 1e-14 * max(values[-1], 0.0)
        return vectors[:, kept] * np.sqrt(values[kept])


def _cones(normals: Float[np.ndarray, "n 3"], friction: float) -> Float[np.ndarray, "n 3 3"]:
    """Return matrices (n, 3, 3) from a force to (friction times its normal part, its two tangential parts)."""
    x, y, z = normals.T
    sign = np.where(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    rows = np.empty((len(normals), 3, 3))
    rows[:, 0] = -friction * normals
    rows[:, 1, 0], rows[:, 1, 1], rows[:, 1, 2] = 1.0 + sign * x * x * a, sign * x * y * a, -sign * x
    rows[:, 2, 0], rows[:, 2, 1], rows[:, 2, 2] = x * y * a, sign + y * y * a, -y
    return rows
