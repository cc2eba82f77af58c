"""Solve for taxels, or the modules that carry them, and the errors of sensor and robot, from all pokes in one fit.

Gauss-Newton steps find the most likely values under the priors; pokes that fit badly count less.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.calibration.validation import Validation
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.sensors.taxels.poking.priors import Priors, tied
from palpate.sensors.taxels.poking.response import PokePlaces, Response, centred, charted, learned, seen_among, tangents
from palpate.sensors.taxels.poking.rigid_groups import Units
from palpate.sensors.taxels.poking.spacing import by_scale
from palpate.sensors.taxels.poking.systematic_errors import Nuisances, predicted
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import skew

__all__ = ["PlacesSolution", "solve", "validated"]

TAIL = 5.0  # degrees of freedom of the residuals: pokes that fit badly count less
_STEPS = 40
_FRESH = 5  # steps after which the derivatives of the taxels' places are taken anew
_STILL = 1e-5  # m: the steps that end it
_LONGEST = 1e-2, 0.4  # m, rad: of one step of a unit
DENSER = 2.0  # standard deviation of the log of the density of pokes, from one taxel to the next: it is never even
NEARER = 0.015  # standard deviation of the scale of pokes' offsets from modules, as a response is learned roughly
LEAST = 1.0  # 1/m^2, 1/rad^2: the weak prior of every unit, within a metre
HALVES = 20  # blocks of consecutive pokes, assigned in turn to both halves, so that each has all configurations
_WELL, _MOST_WELL = 2.366, 4.642  # median and 80 % quantile of chi-square with three degrees of freedom


@frozen_value
class PlacesSolution:
    """The best fit of units and errors to all pokes.

    Attributes:
        units: their places; nuisances: the errors; response: of the taxels, None for single ones.
        covariance: (p, p) of all unknowns: units, then `Nuisances.vector`; 0 for those not estimated.
        weight: (n,) of each poke, 0: not used.
        noise: ratio of the torques' residuals to their covariance.
        scale: factor by which the layout would fit best, and its standard deviation; NaN for single taxels.
    """

    units: Units
    nuisances: Nuisances
    response: Response | None
    covariance: Float[np.ndarray, "p p"]
    weight: Float[np.ndarray, " n"]
    noise: float
    scale: tuple[float, float] = (np.nan, np.nan)


@dataclass(frozen=True, eq=False)
class _Linear:
    """Residuals of pokes and their derivatives."""

    residual: Float[np.ndarray, "n 3"]
    spread: Float[np.ndarray, "n 3 3"]
    unit: Int[np.ndarray, "n w"]  # of each taxel about the poke; -1: none
    by_unit: Float[np.ndarray, "n w 3 f"]
    by_nuisance: Float[np.ndarray, "n 3 54"]
    by_point: Float[np.ndarray, "n 3 3"]


@takes_arrays
def solve(
    pokes: Pokes,
    units: Units,
    priors: Priors,
    *,
    start: Units | None = None,
    deviations: Float[np.ndarray, " f"] | None = None,
) -> PlacesSolution:
    """Fit units and nuisances to pokes; return a `PlacesSolution`.

    Args:
        pokes: of all configurations.
        units: initial values.
        priors: of the nuisances.
        start: prior places of the units; None: nothing is known.
        deviations: (f,) [m, rad] prior standard deviations of a unit's unknowns; None: nothing is known.

    Raises:
        InputError: deviations has another shape.
    """
    count = max(pokes.configurations, 1)
    nuisances, before = Nuisances.none(count), Before(units, start, deviations, Nuisances.deviations(priors, count))
    chart = None if units.alone else charted(pokes, units)
    response = None if chart is None else learned(chart)
    seen = centred(pokes, units) if chart is None or response is None else seen_among(chart, response)
    size, by_place = len(units) * units.freedom, units.jacobian
    for turn in range(_STEPS):
        if turn % _FRESH == 0:
            by_place = units.jacobian
        linear = _linear(pokes, units, by_place, seen, nuisances)
        weight, noise = _weights(pokes, seen, linear)
        step = before.step(*_equations(linear, weight / noise**2, units, pokes, priors), units, nuisances)
        by = step[:size].reshape(len(units), -1)
        share = 1.0 / max(float(np.abs(by / units.each(*_LONGEST)).max(initial=1.0)), 1.0)
        units, nuisances = units.moved(share * by), nuisances.moved(share * step[size:])
        if share == 1.0 and np.abs(by[:, :2]).max(initial=0.0) < _STILL:
            break
    linear = _linear(pokes, units, units.jacobian, seen, nuisances)
    weight, noise = _weights(pokes, seen, linear)
    told = _worth(weight, pokes.weight) * weight / noise**2
    covariance = before.covariance(_equations(linear, told, units, pokes, priors)[0])
    scale = np.nan, np.nan
    if chart is not None:
        far, worth, along = _scale(linear, told, pokes, units, seen, covariance)
        if worth > 0:
            scale = 1.0 + far / worth, float(np.sqrt(1.0 / worth + NEARER**2))
        shared = _shared(linear, told, pokes, units, seen, covariance, DENSER / chart.spacing)
        worth += NEARER**-2  # with the prior of the offsets' scale
        step = -far / worth * along
        units, nuisances = units.moved(step[:size].reshape(len(units), -1)), nuisances.moved(step[size:])
        covariance = covariance + shared + np.outer(along, along) / worth
    return PlacesSolution(units, nuisances, response, covariance, weight, noise, scale)


@takes_arrays
def validated(
    pokes: Pokes,
    solution: PlacesSolution,
    priors: Priors,
    *,
    start: Units | None = None,
    deviations: Float[np.ndarray, " f"] | None = None,
) -> Validation:
    """Return the `Validation`: torques of each half of the pokes against the prediction from the other half.

    It compares 80 % quantiles of squared residuals, and is empty if no half can be used.

    Args:
        pokes: of all configurations.
        solution: of all pokes.
        priors: as for `solve`.
        start: as for `solve`.
        deviations: as for `solve`.

    Raises:
        InputError: deviations has another shape.
    """
    half = np.arange(len(pokes)) * HALVES // max(len(pokes), 1) % 2 == 0
    squares, count = list[float](), 0
    for left in (half, ~half):
        rest = replace(pokes, weight=np.where(left, 0.0, pokes.weight))
        found = solve(rest, solution.units, priors, start=start, deviations=deviations)
        response = found.response
        seen = centred(pokes, found.units) if response is None else seen_among(charted(pokes, found.units), response)
        linear = _linear(pokes, found.units, found.units.jacobian, seen, found.nuisances)
        used = np.asarray(left & (pokes.weight > 0) & seen.found & np.isfinite(linear.residual).all(axis=1), dtype=bool)
        rows, root = _roots(linear, used / found.noise**2)
        if not len(rows):
            continue
        lines, columns = _lines(linear, rows, root, found.units, pokes)
        lines = np.where(columns[:, None] >= 0, lines, 0.0)
        known = found.covariance[columns[:, :, None], columns[:, None]]
        spread = np.eye(3) + lines @ known @ np.swapaxes(lines, 1, 2)
        distances = _square(np.einsum("nij,nj->ni", root, linear.residual[rows]), spread)
        squares.append(float(np.quantile(distances, 0.8)) / _MOST_WELL)
        count += len(rows)
    return Validation(float(np.mean(squares)), len(squares), count) if squares else Validation()


def _weights(pokes: Pokes, seen: PokePlaces, linear: _Linear) -> tuple[Float[np.ndarray, " n"], float]:
    """Return the weight of each poke, 0: not used, and the ratio of residuals to their covariance."""
    distance = _square(linear.residual, linear.spread)
    used = seen.found & (pokes.weight > 0) & np.isfinite(distance)
    noise = max(1.0, float(np.sqrt(np.median(distance[used]) / _WELL))) if used.any() else 1.0
    return np.where(used, pokes.weight * (TAIL + 3.0) / (TAIL + np.nan_to_num(distance) / noise**2), 0.0), noise


def _worth(weight: Float[np.ndarray, " n"], believed: Float[np.ndarray, " n"]) -> float:
    """Return the factor from J' W J to the information of pokes that count less where they fit badly.

    For p = 3 numbers with the square d, w = (T + p) / (T + d), b = E[w^2 d] / p and a = E[w] - 2 b / (T + p), it is a^2
    / (b E[w]) (Huber and Ronchetti, Robust Statistics, 2009, 6.3).

    Args:
        weight: of each poke, w times
        believed: its weight before the fit.
    """
    used = weight > 0
    if not used.any():
        return 1.0
    share = weight[used] / believed[used]
    varied = share * (TAIL + 3.0 - TAIL * share) / 3.0  # w^2 d / p
    mean, varied = (float(np.average(each, weights=believed[used])) for each in (share, varied))
    return min((mean - 2.0 * varied / (TAIL + 3.0)) ** 2 / (varied * mean), 1.0) if varied > 0 else 1.0


@takes_arrays
class Before:
    """The priors of a fit: precisions of all unknowns, and prior places of the units."""

    def __init__(
        self,
        units: Units,
        start: Units | None,
        deviations: Float[np.ndarray, " f"] | None,
        nuisances: Float[np.ndarray, " q"],
    ) -> None:
        size = np.zeros(units.freedom) if deviations is None else _precision(deviations)
        size = np.maximum(size, LEAST)
        self.start = start
        self.units = np.tile(size, len(units))
        self.free = np.concatenate([np.ones(len(self.units), dtype=bool), nuisances > 0])
        self.nuisances = _precision(nuisances)

    def step(
        self, square: np.ndarray, right: np.ndarray, units: Units, nuisances: Nuisances
    ) -> Float[np.ndarray, " p"]:
        """Return the step (p,) to the most likely values of units, then nuisances, from J' W J and J' W r.

        Raises:
            InputError: a singular matrix, or arrays of other shapes.
        """
        away = np.zeros_like(self.units) if self.start is None else units.away(self.start).ravel()
        gap = np.concatenate([self.units * away, self.nuisances * nuisances.vector()])
        matrix, wanted = self._raised(square), (right - gap)[self.free]
        found = np.zeros(len(right))
        if units.alone:  # a poke depends on several
            found[self.free] = np.linalg.solve(matrix, wanted)
        else:
            found[self.free] = eliminated(matrix, wanted, len(units), units.freedom)
        return found

    def covariance(self, square: np.ndarray) -> Float[np.ndarray, "p p"]:
        """Return the covariance (p, p) of all unknowns for J' W J (p, p); 0 for those not estimated.

        Raises:
            InputError: a singular matrix, or arrays of other shapes.
        """
        found = np.zeros_like(square)
        found[np.ix_(self.free, self.free)] = np.linalg.inv(self._raised(square))
        return found

    def _raised(self, square: np.ndarray) -> np.ndarray:
        matrix = square + np.diag(np.concatenate([self.units, self.nuisances]))
        matrix = matrix[np.ix_(self.free, self.free)]
        return matrix + np.diag(1e-12 * np.diag(matrix))


@takes_arrays
def eliminated(
    matrix: Float[np.ndarray, "p p"], right: Float[np.ndarray, " p"], units: int, size: int
) -> Float[np.ndarray, " p"]:
    """Return the solution x (p,) of matrix x = right, whose units are coupled only by shared unknowns.

    Args:
        matrix: (p, p) positive definite, units first.
        right: (p,).
        units: number of units.
        size: number of unknowns of each.

    Raises:
        InputError: a singular matrix; or arrays of other shapes.
    """
    rows, each = slice(None, units * size), np.arange(units)
    own = matrix[rows, rows].reshape(units, size, units, size)[each, :, each]
    cross, rest = matrix[rows, units * size :], slice(units * size, None)
    told = np.concatenate([cross, right[rows, None]], axis=1).reshape(units, size, -1)
    told = np.linalg.solve(own, told).reshape(units * size, -1)
    common = np.linalg.solve(matrix[rest, rest] - cross.T @ told[:, :-1], right[rest] - cross.T @ told[:, -1])
    return np.concatenate([told[:, -1] - told[:, :-1] @ common, common])


def _precision(deviations: Float[np.ndarray, " q"]) -> Float[np.ndarray, " q"]:
    with np.errstate(divide="ignore"):
        return np.where(np.isfinite(deviations) & (deviations > 0), 1.0 / deviations**2, 0.0)


def _linear(
    pokes: Pokes,
    units: Units,
    by_place: Float[np.ndarray, "k 3 f"],
    seen: PokePlaces,
    nuisances: Nuisances,
) -> _Linear:
    """Return residuals, and their derivatives at the most likely force and the mean contact.

    At the measured force they would contain the noise of the residuals (errors in variables). About the mean contact
    the true one scatters, so that derivatives there do not contain its error (Berkson, Two regressions, 1950).
    """
    points, axes = seen.points(units)
    said = predicted(pokes, points, nuisances)
    residual = pokes.wrench[:, 3:] - said.torque
    read = np.eye(6)[3:] - said.by_wrench  # from the noise of a wrench to the residual
    beside = said.by_point @ axes
    force = pokes.wrench[:, :3]
    spread = read @ pokes.noise @ np.swapaxes(read, 1, 2) + beside @ seen.covariance @ np.swapaxes(beside, 1, 2)
    twist = _twist(force, residual, spread, seen.found & (pokes.weight > 0))
    spread = spread + twist**2 * np.einsum("ni,nj->nij", force, force)
    sound = np.asarray(np.isfinite(residual).all(axis=1), dtype=bool)
    spread = np.where(sound[:, None, None], spread, np.eye(3))
    told = np.linalg.solve(spread, residual[..., None])
    noise = (pokes.noise @ np.swapaxes(read, 1, 2) @ told)[..., 0]
    likely = predicted(replace(pokes, wrench=pokes.wrench - noise), points, nuisances)
    unit, by_unit = _by_unit(units, by_place, seen, axes, likely.by_point)
    return _Linear(residual, spread, unit, by_unit, likely.by_nuisance, likely.by_point)


def _by_unit(
    units: Units,
    by_place: Float[np.ndarray, "k 3 f"],
    seen: PokePlaces,
    axes: Float[np.ndarray, "n 3 2"],
    by_point: Float[np.ndarray, "n 3 3"],
) -> tuple[Int[np.ndarray, "n w"], Float[np.ndarray, "n w 3 f"]]:
    """Return the units on which a contact depends, and the torque's derivative by their unknowns.

    A contact's offset from the taxels' places turns with a module.
    """
    about = np.maximum(seen.taxels, 0)
    unit = np.where(seen.shares != 0, units.layout.module[about], -1)
    if units.alone:
        return unit, np.einsum("nij,nw,nwjf->nwif", by_point, seen.shares, by_place[about])
    moved = np.einsum("nw,nwjf->njf", seen.shares, by_place[about])  # all on one module
    turned = -skew(np.einsum("nca,na->nc", axes, seen.second))
    if units.surface is not None:
        turned = turned @ np.cross(axes[:, :, 0], axes[:, :, 1])[..., None]
    moved[..., -turned.shape[2] :] += turned
    return unit.max(axis=1, keepdims=True), (by_point @ moved)[:, None]


def _square(residual: Float[np.ndarray, "n 3"], spread: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, " n"]:
    """Return squared residuals in units of their covariance; NaN where there is none."""
    found = np.full(len(residual), np.nan)
    sound = np.isfinite(residual).all(axis=1) & np.isfinite(spread).all(axis=(1, 2))
    half = np.linalg.solve(spread[sound], residual[sound][..., None])[..., 0]
    found[sound] = np.einsum("ni,ni->n", residual[sound], half)
    return found


def _equations(
    linear: _Linear, weight: Float[np.ndarray, " n"], units: Units, pokes: Pokes, priors: Priors
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, " p"]]:
    """Return J' W J and J' W r of the pokes that count, and of the priors between single taxels."""
    from palpate.sensors.taxels.poking._normal_equations import add_squares  # compiled: loaded when first needed

    rows, root = _roots(linear, weight)
    values, columns = _lines(linear, rows, root, units, pokes)
    right = np.zeros(len(units) * units.freedom + 12 * max(pokes.configurations, 1) + 42)
    square = np.zeros((len(right), len(right)))
    add_squares(values, np.einsum("nij,nj->ni", root, linear.residual[rows]), columns, square, right)
    square = np.triu(square) + np.triu(square, 1).T
    more, along = tied(units, priors)
    square[: len(more), : len(more)] += more
    right[: len(along)] += along
    return square, right


def _roots(
    linear: _Linear, weight: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " r"], Float[np.ndarray, "r 3 3"]]:
    """Return the rows that count, and the matrices that whiten their residuals."""
    rows = np.flatnonzero(weight > 0)
    root = np.linalg.cholesky(np.linalg.inv(linear.spread[rows])) * np.sqrt(weight[rows])[:, None, None]
    return rows, np.swapaxes(root, 1, 2)


def _lines(
    linear: _Linear,
    rows: Int[np.ndarray, " r"],
    root: Float[np.ndarray, "r 3 3"],
    units: Units,
    pokes: Pokes,
) -> tuple[Float[np.ndarray, "r 3 l"], Int[np.ndarray, "r l"]]:
    """Return the whitened lines of J, and the columns of their entries, -1: none."""
    by_unit = np.einsum("nij,nwjf->niwf", root, linear.by_unit[rows]).reshape(len(rows), 3, -1)
    values = np.concatenate([by_unit, root @ linear.by_nuisance[rows]], axis=2)
    unit = linear.unit[rows][..., None]
    own = np.where(unit >= 0, unit * units.freedom + np.arange(units.freedom), -1).reshape(len(rows), -1)
    shared = Nuisances.columns(pokes.configuration[rows], max(pokes.configurations, 1))
    return values, np.concatenate([own, len(units) * units.freedom + shared], axis=1)


def _scale(
    linear: _Linear,
    weight: Float[np.ndarray, " n"],
    pokes: Pokes,
    units: Units,
    seen: PokePlaces,
    covariance: Float[np.ndarray, "p p"],
) -> tuple[float, float, Float[np.ndarray, " p"]]:
    """Return J' W r and J' W J for a scale of the layout at a best fit, and k (p,), by which unknowns depend on it.

    A poke's place among its taxels scales with them. Where x fit best for a scale of 1, x - s k (p,) do for 1 + s.
    """
    rows, root = _roots(linear, weight)
    values, columns = _lines(linear, rows, root, units, pokes)
    moved = np.einsum("nw,nwc->nc", seen.shares, by_scale(units)[np.maximum(seen.taxels, 0)])
    moved = moved + np.einsum("nca,na->nc", seen.points(units)[1], seen.second)
    line = (root @ linear.by_point[rows] @ moved[rows][..., None])[..., 0]
    both = np.where(columns >= 0, np.einsum("ril,ri->rl", values, line), 0.0)
    cross = np.bincount(np.maximum(columns, 0).ravel(), both.ravel(), len(covariance))
    along = covariance @ cross
    residual = np.einsum("rij,rj->ri", root, linear.residual[rows])
    worth = max(float((line**2).sum() - cross @ along), 0.0)
    return float((line * residual).sum()), worth, along


def _shared(
    linear: _Linear,
    weight: Float[np.ndarray, " n"],
    pokes: Pokes,
    units: Units,
    seen: PokePlaces,
    covariance: Float[np.ndarray, "p p"],
    denser: float,
) -> Float[np.ndarray, "p p"]:
    """Return what the covariance lacks, as contacts about one taxel have equal errors.

    If pokes get denser to one side as exp(g . x), all about a taxel are off by S g to first order, S the covariance of
    each. g has the standard deviation `denser` [1/m] along each axis, independent at each taxel.
    """
    rows, root = _roots(linear, weight)
    values, columns = _lines(linear, rows, root, units, pokes)
    axes = tangents(units, units.places[1], seen.origin[rows])
    beside = root @ linear.by_point[rows] @ axes @ seen.covariance[rows]  # (r, 3, 2)
    along = np.einsum("ril,ria->rla", values, beside)
    used, taxel = np.unique(seen.origin[rows], return_inverse=True)
    first, freedom, size = len(units) * units.freedom, units.freedom, len(covariance)
    wide = freedom + size - first  # a taxel's lines touch its own unit, and what all share
    local, sound = np.where(columns < first, columns % freedom, columns - first + freedom), columns >= 0
    own = units.layout.module[used][:, None] * freedom + np.arange(freedom)
    told = np.zeros((size, size))
    for way in range(2):
        where = (taxel[:, None] * wide + local)[sound]
        lines = np.bincount(where, along[sound, way], wide * len(used)).reshape(-1, wide)
        mine, rest = lines[:, :freedom], lines[:, freedom:]
        np.add.at(told, (own[:, :, None], own[:, None]), mine[:, :, None] * mine[:, None])
        np.add.at(told[:, first:], own, mine[:, :, None] * rest[:, None])
        told[first:, first:] += rest.T @ rest
    told[first:, :first] = told[:first, first:].T
    return denser**2 * covariance @ told @ covariance


def _twist(
    force: Float[np.ndarray, "n 3"],
    residual: Float[np.ndarray, "n 3"],
    spread: Float[np.ndarray, "n 3 3"],
    used: Bool[np.ndarray, " n"],
) -> float:
    """Return the torque along the force over the force [m] that noise does not explain: friction under a turning tip.

    F . M is the same in any frame, and 0 for a pure force [taxel poking, (3)], once bias and cross-talk are removed.
    """
    rows = used & np.isfinite(residual).all(axis=1) & (force != 0).any(axis=1)
    if not rows.any():
        return 0.0
    along = force[rows] / (force[rows] ** 2).sum(axis=1, keepdims=True)
    found = 1.4826 * np.median(np.abs(np.einsum("ni,ni->n", along, residual[rows])))
    noise = np.median(np.einsum("ni,nij,nj->n", along, spread[rows], along))
    return float(np.sqrt(max(found**2 - noise, 0.0)))
