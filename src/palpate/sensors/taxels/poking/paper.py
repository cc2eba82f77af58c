"""Find taxels by the paper's methods: the point nearest to all lines of force, free or on the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.sensors.taxels.poking.closest_point import nearest_in_metric
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.spatial._arrays import Value
from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.surface import Surface

__all__ = ["NormalEquations", "averaged", "free", "in_link", "normal_equations", "on_surface"]

FLAT = 1e-9  # of the eigenvalues of a taxel's matrix: below it its lines of force are parallel

Places = Float[np.ndarray, "k 3"]


@takes_arrays
@dataclass(frozen=True, eq=False)
class NormalEquations(Value):
    """Normal equations A p = b of each taxel.

    Attributes:
        matrix: (k, 3, 3), the sum of the weights times I - u u', u the direction of a force.
        vector: (k, 3) [m].
        pressing: (k, 3) sum of the weights times u.
        weight: (k,) the sum of the weights; 0: it never answered.
    """

    matrix: Float[np.ndarray, "k 3 3"]
    vector: Float[np.ndarray, "k 3"]
    pressing: Float[np.ndarray, "k 3"]
    weight: Float[np.ndarray, " k"]


def in_link(pokes: Pokes) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Return the pokes' forces [N] and their torques [N m] about the link's origin, each (n, 3), in the link's frame.

    This is equation (6) of the `taxel poking` paper.
    """
    force, torque = pokes.wrench[:, :3], pokes.wrench[:, 3:]
    moved = torque - np.cross(pokes.origin, force)
    turn = pokes.rotation
    return np.einsum("nij,ni->nj", turn, force), np.einsum("nij,ni->nj", turn, moved)


def normal_equations(pokes: Pokes, *, weighted: bool = False) -> NormalEquations:
    """Return the `NormalEquations` [taxel poking, (5)] of all pokes in the link's frame.

    Args:
        pokes: of one configuration or of several.
        weighted: by the square of each response over the strongest one of its poke; else all answers have the same
            weight. Doubtful pokes count less in both.
    """
    from palpate.sensors.taxels.poking._accumulate import accumulate  # compiled: loaded when first needed

    force, torque = in_link(pokes)
    weights = pokes.weight[pokes.poke]
    if weighted:
        weights = weights * (pokes.response / _strongest(pokes)[pokes.poke]) ** 2
    sound = np.asarray(np.isfinite(pokes.wrench).all(axis=1), dtype=bool)
    weights = np.where(sound[pokes.poke], weights, 0.0)
    sums = np.zeros((pokes.taxels, 12))
    accumulate(np.nan_to_num(force), np.nan_to_num(torque), pokes.starts, pokes.taxel, weights, sums)
    matrix = sums[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    weight = np.bincount(pokes.taxel, weights, pokes.taxels)
    return NormalEquations(matrix, sums[:, 6:9].copy(), sums[:, 9:].copy(), weight)


def _strongest(pokes: Pokes) -> Float[np.ndarray, " n"]:
    """Return the strongest response of each poke; 1 where there is none."""
    found = np.ones(len(pokes))
    some = np.diff(pokes.starts) > 0
    if some.any():
        found[some] = np.maximum.reduceat(pokes.response, pokes.starts[:-1][some])
    return found


def free(equations: NormalEquations) -> Places:
    """Return the point nearest to each taxel's lines of force, (k, 3) [m]; NaN if parallel or it never answered."""
    values = np.linalg.eigvalsh(equations.matrix)
    sound = values[:, 0] > FLAT * np.maximum(values[:, 2], 1e-300)
    found = np.full(equations.vector.shape, np.nan)
    found[sound] = np.linalg.solve(equations.matrix[sound], equations.vector[sound][..., None])[..., 0]
    return found


def on_surface(equations: NormalEquations, surface: Surface) -> Places:
    """Return the surface's points of least residual [taxel poking, II-B], (k, 3) [m]; NaN if a taxel never answered.

    The residual is (p - p*)' A (p - p*), so that it is the closest point to p* in the metric of A: one query for the
    complete surface, not a constrained problem for each triangle. Facets at which forces would pull are excluded: the
    lines of force meet the far side of a link, too, which the paper does not mention.
    """
    found = np.full(equations.vector.shape, np.nan)
    answered = np.flatnonzero(equations.weight > 0)
    if len(answered):
        found[answered] = nearest_in_metric(
            equations.matrix[answered], equations.vector[answered], equations.pressing[answered], surface
        )
    return found


def averaged(pokes: Pokes, surface: Surface | None = None, *, weighted: bool = True) -> tuple[Places, list[Places]]:
    """Return the mean (k, 3) [m] over configurations, and a list of each one's places (k, 3) [taxel poking, IV-B].

    Args:
        pokes: of several configurations.
        surface: places are constrained to it; None: they are free.
        weighted: as in `normal_equations`.
    """
    singles = list[Places]()
    for number in range(pokes.configurations):
        own = normal_equations(pokes.picked(_of(pokes.configuration, number)), weighted=weighted)
        singles.append(free(own) if surface is None else on_surface(own, surface))
    stacked = np.stack(singles)
    there = np.asarray(np.isfinite(stacked).all(axis=2), dtype=bool)
    count = there.sum(axis=0)
    total = np.where(there[..., None], stacked, 0.0).sum(axis=0)
    return np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan), singles


def _of(configuration: Int[np.ndarray, " n"], number: int) -> Bool[np.ndarray, " n"]:
    return np.asarray(configuration == number, dtype=bool)
