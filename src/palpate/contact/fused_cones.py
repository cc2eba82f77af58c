"""Forces that friction allows: the best ones within their cones, where the closed form leaves them."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float, Int

__all__ = ["within_cones"]

_WITHOUT = (
    "contacts outside their cones of friction are left there: clarabel is not installed (pip install 'palpate[fusion]')"
)
_NONE = "no forces within the cones of friction were found: those of the closed form are given"


def within_cones(
    force: Float[np.ndarray, "n 3"],
    covariance: Float[np.ndarray, "m m"],
    normals: Float[np.ndarray, "n 3"],
    friction: float,
) -> tuple[Float[np.ndarray, "n 3"], tuple[str, ...]]:
    """The forces f with the least (f - force)^T covariance^-1 (f - force) of those within the cones.

    With covariance = S S^T and f = force + S x it is the shortest x whose f lies in second-order cones
    |t_i| <= friction n_i: a problem of n cones, solved by clarabel.

    Args:
        force: (n, 3) [N] the best without cones.
        covariance: (3n, 3n) of it; it may be singular.
        normals: (n, 3) outward unit normals.
        friction: tangential over normal force.

    Returns:
        Forces, and what could not be done.
    """
    try:
        clarabel: Any = import_module("clarabel")
    except ImportError:
        return force, (_WITHOUT,)
    count = len(force)
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-14 * max(values[-1], 0.0)
    root = vectors[:, kept] * np.sqrt(values[kept])
    turn = np.stack([_cone(normal, friction) for normal in normals])
    matrix = np.einsum("nij,njk->nik", turn, root.reshape(count, 3, -1)).reshape(3 * count, -1)
    given = np.einsum("nij,nj->ni", turn, force).reshape(-1)
    size = matrix.shape[1]
    if not size:
        return force, (_NONE,)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    problem = clarabel.DefaultSolver(
        _columns(np.ones((1, size)), np.arange(size), 1, size),
        np.zeros(size),
        _columns(-matrix, np.tile(np.arange(3 * count), size), 3 * count, 3 * count),
        given,
        [clarabel.SecondOrderConeT(3)] * count,
        settings,
    )
    found = problem.solve()
    if str(found.status) not in ("Solved", "AlmostSolved"):
        return force, (_NONE,)
    return force + (root @ np.asarray(found.x)).reshape(-1, 3), ()


def _columns(values: Float[np.ndarray, "r c"], rows: Int[np.ndarray, " m"], each: int, height: int) -> Any:
    """A matrix as clarabel takes it, `each` numbers a column: handed over as it is, which is quicker than found out."""
    sparse: Any = import_module("scipy.sparse")
    width = values.shape[1]
    return sparse.csc_array((values.T.ravel(), rows, each * np.arange(width + 1)), shape=(height, width))


def _cone(normal: Float[np.ndarray, "3"], friction: float) -> Float[np.ndarray, "3 3"]:
    """Rows that take a force to (friction times its normal part, its tangential parts)."""
    sign = 1.0 if normal[2] >= 0 else -1.0
    a = -1.0 / (sign + normal[2])
    b = normal[0] * normal[1] * a
    first = [1.0 + sign * normal[0] ** 2 * a, sign * b, -sign * normal[0]]
    return np.array([-friction * normal, first, [b, sign + normal[1] ** 2 * a, -normal[1]]])
