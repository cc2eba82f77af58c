"""Forces that friction allows: the best ones within their cones, where the closed form leaves them."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays

__all__ = ["within_cones"]

_WITHOUT = (
    "contacts outside their cones of friction are left there: clarabel is not installed (pip install 'palpate[fusion]')"
)
_NONE = "no forces within the cones of friction were found: those of the closed form are given"


@takes_arrays
def within_cones(
    force: Float[np.ndarray, "n 3"],
    covariance: Float[np.ndarray, "m m"],
    normals: Float[np.ndarray, "n 3"],
    friction: float,
) -> tuple[Float[np.ndarray, "n 3"], float, tuple[str, ...]]:
    """The forces f with the least (f - force)^T covariance^-1 (f - force) of those within the cones.

    With covariance = S S^T and f = force + S x it is the shortest x whose f lies in second-order cones
    |t_i| <= friction n_i: a problem of n cones, solved by clarabel.

    Args:
        force: (n, 3) [N] the best without cones.
        covariance: (3n, 3n) of it; it may be singular.
        normals: (n, 3) outward unit normals.
        friction: tangential over normal force.

    Returns:
        Forces, how far off they are: that least square, and what could not be done.
    """
    try:
        clarabel: Any = import_module("clarabel")
    except ImportError:
        return force, 0.0, (_WITHOUT,)
    count, root = len(force), _root(covariance)
    turn = _cones(normals, friction)
    matrix = (turn @ root.reshape(count, 3, -1)).reshape(3 * count, -1)
    given = (turn @ force[:, :, None]).reshape(-1)
    size = matrix.shape[1]
    if not size:
        return force, 0.0, (_NONE,)
    rows: Int[np.ndarray, " m"] = np.arange(3 * count * size) % (3 * count)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    problem = clarabel.DefaultSolver(
        _identity(size),
        np.zeros(size),
        _columns(-matrix, rows, 3 * count, 3 * count),
        given,
        [clarabel.SecondOrderConeT(3)] * count,
        settings,
    )
    found = problem.solve()
    if str(found.status) not in ("Solved", "AlmostSolved"):
        return force, 0.0, (_NONE,)
    least = np.asarray(found.x)
    return force + (root @ least).reshape(-1, 3), float(least @ least), ()


def _columns(values: Float[np.ndarray, "r c"], rows: Int[np.ndarray, " m"], each: int, height: int) -> Any:
    """A matrix as clarabel takes it, `each` numbers a column: handed over as it is, which is quicker than found out."""
    sparse: Any = import_module("scipy.sparse")
    width = values.shape[1]
    return sparse.csc_array((values.T.ravel(), rows, each * np.arange(width + 1)), shape=(height, width))


@cache
def _identity(size: int) -> Any:
    """Made once for each number of contacts: it takes a third of the solver's time."""
    return _columns(np.ones((1, size)), np.arange(size), 1, size)


def _root(covariance: Float[np.ndarray, "m m"]) -> Float[np.ndarray, "m r"]:
    """S with covariance = S S^T; without the columns of directions in which it is zero."""
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariance)
        kept = values > 1e-14 * max(values[-1], 0.0)
        return vectors[:, kept] * np.sqrt(values[kept])


def _cones(normals: Float[np.ndarray, "n 3"], friction: float) -> Float[np.ndarray, "n 3 3"]:
    """Rows that take a force to (friction times its normal part, its tangential parts)."""
    x, y, z = normals.T
    sign = np.where(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    rows = np.empty((len(normals), 3, 3))
    rows[:, 0] = -friction * normals
    rows[:, 1, 0], rows[:, 1, 1], rows[:, 1, 2] = 1.0 + sign * x * x * a, sign * x * y * a, -sign * x
    rows[:, 2, 0], rows[:, 2, 1], rows[:, 2, 2] = x * y * a, sign + y * y * a, -y
    return rows
