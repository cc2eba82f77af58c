"""Calibrate a plate on load cells of one axis by known weights, at known or unknown places.

A weight W at (x, y) is carried by the cells, at (x_i, y_i): with readings u_i less their zero

    sum g_i u_i = W,    sum g_i u_i (x_i, y_i) = W (x, y)

which are linear in the gains g and hold however the plate bends. At unknown places only the first is known. As a stiff
plate's readings have three directions, such weights show three combinations of the gains: all of three cells. Of more
cells, the others are taken as equal to `TOLERANCE`.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from palpate.calibration.validation import Validation, cross_validate
from palpate.calls import called_as
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.load_cells._log import BenchLog, UnloadedStretch, rest_noise, rests, zeros
from palpate.sensors.load_cells.model import AXES, LoadCells, require_layout, with_changes
from palpate.sensors.load_cells.plate import TOLERANCE, plate_cells, uneven, with_gains
from palpate.spatial.arguments import takes_arrays

PLACED = 5e-4  # m: standard deviation of a weight's place
SETTLES, ENDS = 0.3, 0.1  # of the time that a weight stands, at its beginning and end, which are omitted
FEWEST = 5  # samples of a weight
ELSEWHERE = 2.0  # times the misfit of the weights: touches load the plate where no weight stood
WORST = 0.2  # of a reading: cells that err by more do not carry these weights
CHANCE = 1e-3  # probability that Gaussian errors alone name a weight of a log
OFF_WEIGHT = 0.02  # share by which a named weight must be off, or
OFF_PLACE = 5e-3  # m by which its place must be: errors of cells are not Gaussian
NAMED = 0.01  # of the plates with cells equal to `TOLERANCE`, in which one is named
ROUNDS = 4
ERRORS = np.concatenate([[0.0], np.geomspace(1e-5, WORST, 100)])


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights that stood on a plate in turn, n on k cells.

    Attributes:
        readings: (n, k) [V] means less the zero.
        weight: (n,) [N].
        place: (n, 2) [m] along the plate; NaN where not known.
        spread: (n, k, k) [V^2] covariance of `readings`.
        arms: (3, k) 1 and the place [m] along the plate of each cell.
    """

    readings: Float[np.ndarray, "n k"]
    weight: Float[np.ndarray, " n"]
    place: Float[np.ndarray, "n 2"]
    spread: Float[np.ndarray, "n k k"]
    arms: Float[np.ndarray, "3 k"]

    @cached_property
    def known(self) -> Bool[np.ndarray, " e"]:
        """Mask (3 n,) of the equations of known quantities: W, W x and W y of each weight."""
        return np.isfinite(self.values)

    @cached_property
    def values(self) -> Float[np.ndarray, " e"]:
        """Right sides (3 n,) of the equations [N, N m]."""
        return (self.weight[:, None] * np.column_stack([np.ones(len(self.weight)), self.place])).ravel()

    @cached_property
    def slopes(self) -> Float[np.ndarray, "e k"]:
        """Left sides (3 n, k) of the equations, of the gains."""
        return (self.arms * self.readings[:, None]).reshape(-1, len(self.arms.T))

    def whitened(
        self, gains: Float[np.ndarray, " k"], error: float
    ) -> tuple[Float[np.ndarray, "e k"], Float[np.ndarray, " e"]]:
        """Return left and right sides of unit variance, if each cell errs by a share of its load; 0 where not known."""
        arms = self.arms * gains
        loads = self.spread + error**2 * self.readings[:, :, None] ** 2 * np.eye(len(gains))
        placed = (PLACED * self.weight)[:, None, None] ** 2 * np.diag([0.0, 1.0, 1.0])
        known = self.known.reshape(-1, 3)
        both = known[:, :, None] & known[:, None]
        root = np.linalg.cholesky(np.where(both, arms @ loads @ arms.T + placed, np.eye(3)))
        left = np.where(self.known[:, None], self.slopes, 0.0).reshape(-1, 3, len(gains))
        right = np.where(self.known, self.values, 0.0).reshape(-1, 3, 1)
        return np.linalg.solve(root, left).reshape(-1, len(gains)), np.linalg.solve(root, right).ravel()


@dataclass(frozen=True, eq=False)
class Gains:
    """Gains of the cells: `gains` (k,) and `covariance` [N/V], `error`, a cell's share of its load, and `shown` < k."""

    gains: Float[np.ndarray, " k"]
    covariance: Float[np.ndarray, "k k"]
    error: float
    shown: int


@dataclass(frozen=True, eq=False)
class PlateCalibration:
    """A calibrated plate, and how well it explains its log.

    Attributes:
        cells: the model, with notes.
        weights: that were used.
        found: `Gains` by them.
        validation: errors of weights that a fit had not seen, over those expected.
        odd: cells, from 0, -> how much more each reads than the others, of those whose gain contradicts theirs.
    """

    cells: LoadCells
    weights: Weights
    found: Gains
    validation: Validation
    odd: Mapping[int, float]

    @property
    def rms(self) -> tuple[float, float]:
        """Root mean squares of the errors of weight, over it, and of place [m], NaN where none was known."""
        weights = self.weights
        sums = (weights.slopes @ self.found.gains).reshape(-1, 3)
        square: np.ndarray = np.sum((sums[:, 1:] / sums[:, :1] - weights.place) ** 2, axis=1)
        known = np.isfinite(square)
        place = float(np.sqrt(np.mean(square[known]))) if known.any() else np.nan
        return float(np.sqrt(np.mean((sums[:, 0] / weights.weight - 1.0) ** 2))), place


@called_as("palpate.sensors.load_cells.calibrate_plate.identify_plate(time, voltages, weights, places, positions)")
@takes_arrays
def identify_plate(
    time: Float[np.ndarray, " n"],
    voltages: Float[np.ndarray, "n k"],
    weights: Float[np.ndarray, " n"],
    places: Float[np.ndarray, "n 2"],
    positions: Float[np.ndarray, "k 3"],
    *,
    axis: str = "z",
    limits: ArrayLike | None = None,
    provenance: Mapping[str, str] | None = None,
) -> PlateCalibration:
    """Identify the gains of a plate's cells, their covariance and the noise from weights that stand on it in turn.

    The zero is taken before, between and after the weights.

    Args:
        time: (n,) [s].
        voltages: (n, k) [V].
        weights: (n,) [N] of what stands on the plate; 0: nothing.
        places: (n, 2) [m] along the two axes that follow `axis` of x, y, z, x, y; NaN: not known.
        positions: (k, 3) [m] of the cells in the surface's frame.
        axis: of the surface's frame that the cells measure; weights press against it.
        limits: (k, 2) [V] range of each cell; None: not known.
        provenance: kept in the model.

    Raises:
        InputError: a shape is wrong, the log does not begin unloaded, has no weights, or the cells do not carry them.
        NotIdentifiable: too few weights, or all in one place or one line; or all cells are in one line.
    """
    along = AXES.index(axis)
    across = [(along + 1) % 3, (along + 2) % 3]
    require_layout(positions, (axis,))
    log, loaded = _bench(time, voltages, weights, places)
    found = rests(log)
    noise, correlation, _ = rest_noise(log, found)
    stood = _weights(log, found, loaded, noise * correlation, positions[:, across])
    stray = _stray(stood)
    try:
        gains = fit_gains(stood)
    except InputError as unexplained:
        raise (InputError(stray, where="reference") if stray else unexplained) from None
    left = _validated(stood, gains)
    own = 2.0 * np.diag((gains.error * gains.gains) ** 2)  # in a touch, and in all weights alike, as of a curve
    covariance = left.widening * gains.covariance + own
    cells = _divided(plate_cells(positions, gains.gains, noise, axis, limits), stood, gains)
    odd = _odd(gains)
    bias = np.mean([rest.voltage for rest in found], axis=0)
    notes = (*([stray] if stray else []), *_said(gains, odd, len(positions)), *left.notes)
    known = {"bias": bias, "drift": _drift(found, noise), "correlation": correlation, "samples": len(log.time)}
    changed = with_changes(with_gains(cells, covariance), provenance=provenance, notes=notes, **known)
    return PlateCalibration(changed, stood, gains, left, odd)


def _bench(
    time: np.ndarray, voltages: np.ndarray, weights: np.ndarray, places: np.ndarray
) -> tuple[BenchLog, Float[np.ndarray, "n 3"]]:
    """Return the complete rows as a `BenchLog`, and weight and place (n, 3) of each."""
    complete = np.isfinite(np.column_stack([time, voltages, weights])).all(axis=1)
    loaded, voltages = np.column_stack([weights, places])[complete], voltages[complete]
    if not np.any(loaded[:, 0] > 0):
        hint = "Write each weight in N, unloaded 0."
        raise InputError("no weight stands on the plate.", where="reference", hint=hint)
    if np.any(loaded[:, 0] < 0):
        hint = "Write what presses on the plate as positive."
        raise InputError("a weight is negative.", where="reference", hint=hint)
    still = np.ptp(voltages, axis=0) == 0
    if still.any():
        raise InputError(f"cell {int(np.argmax(still)) + 1} never changes: it is dead, or not connected.")
    forces = np.outer(loaded[:, 0], [0.0, 0.0, -1.0])
    return BenchLog(time[complete], voltages, forces, np.zeros_like(forces), np.zeros(len(forces))), loaded


def _weights(
    log: BenchLog,
    found: Sequence[UnloadedStretch],
    loaded: Float[np.ndarray, "n 3"],
    noise: Float[np.ndarray, "k k"],
    cells: Float[np.ndarray, "k 2"],
) -> Weights:
    """Return the means of the stretches in which one weight stands in one place, each without beginning and end."""
    stated = np.where(np.isnan(loaded), np.inf, loaded)
    edges = np.flatnonzero(np.append(True, np.any(stated[1:] != stated[:-1], axis=1)))
    length = np.diff(edges, append=len(loaded))
    begin = edges + np.rint(SETTLES * length).astype(int)
    count = edges + length - np.rint(ENDS * length).astype(int) - begin
    stands = (loaded[edges, 0] > 0) & (count >= FEWEST)
    begin, count, what = begin[stands], count[stands], loaded[edges[stands]]
    if len(what) < 3:
        few = f"only {len(what)} weights stand still on the plate, and 3 are needed: put one near each cell in turn."
        raise NotIdentifiable(few, rank=len(what), missing=("gains",))
    free = log.voltages - zeros(log, list(found))[:, :-3]
    rested = 1.0 / np.mean([rest.rows.stop - rest.rows.start for rest in found])
    readings = np.array([free[a : a + n].mean(axis=0) for a, n in zip(begin.tolist(), count.tolist(), strict=True)])
    spread = noise * (1.0 / count + rested)[:, None, None]
    arms = np.column_stack([np.ones(len(cells)), cells]).T
    return Weights(readings, what[:, 0], what[:, 1:], spread, arms)


def fit_gains(weights: Weights) -> Gains:
    """Return the `Gains` by least squares, with the cells' error that the weights show.

    Combinations of gains that the weights do not show are those of equal cells, with 1 % of deviation each.

    Raises:
        InputError: no gains explain the weights.
    """
    total = weights.readings.sum(axis=1)
    usual = float(total @ weights.weight / (total @ total))
    gains, error = np.full(weights.readings.shape[1], usual), 1e-3
    covariance, shown = np.zeros((len(gains), len(gains))), 0
    for _ in range(ROUNDS):
        left, right = weights.whitened(gains, error)
        _, values, ways = np.linalg.svd(left * usual, full_matrices=False)
        seen = values * TOLERANCE > 1.0
        shown = int(np.count_nonzero(seen))
        free = ways[~seen]
        information = (left * usual).T @ (left * usual) + free.T @ free / TOLERANCE**2
        covariance = np.linalg.inv(information)
        gains = usual * (1.0 + covariance @ ((left * usual).T @ (right - left @ np.full(len(gains), usual))))
        error = _error(weights, gains, int(np.count_nonzero(weights.known)) - shown)
    if error >= WORST:
        what = f"no gains explain more than {100 * (1 - WORST):.0f} % of their readings."
        hint = "Check the order of columns and positions, weights in N and places in m."
        raise InputError(f"the cells do not carry these weights: {what}", where="reference", hint=hint)
    return Gains(gains, usual**2 * covariance, error, shown)


def _error(weights: Weights, gains: np.ndarray, freedom: int) -> float:
    """Return the least share of its load by which each cell errs, so that the weights are explained."""
    if freedom <= 0:
        return TOLERANCE / 10.0

    def explained(error: float) -> bool:
        left, right = weights.whitened(gains, error)
        return bool(np.sum((right - left @ gains) ** 2) <= freedom)

    return [*ERRORS.tolist(), WORST][bisect_left(ERRORS.tolist(), True, key=explained)]  # the more, the better


def _validated(weights: Weights, found: Gains) -> Validation:
    """Return the `Validation` of weights that are predicted by gains from the others."""
    count = len(weights.weight)

    def predict(omitted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rest, part = (_picked(weights, rows) for rows in (~omitted, omitted))
        gains = fit_gains(rest)
        left, right = (side[part.known] for side in part.whitened(found.gains, found.error))
        return right - left @ gains.gains, np.eye(len(left)) + left @ gains.covariance @ left.T

    return cross_validate(count, predict, parts=min(8, count))


def _picked(weights: Weights, rows: np.ndarray) -> Weights:
    names = "readings", "weight", "place", "spread"
    return replace(weights, **{name: getattr(weights, name)[rows] for name in names})


def _stray(weights: Weights) -> str:
    """Return a sentence on the weight that contradicts the others most, by an F test; "" if none does."""
    from scipy.special import fdtrc  # here: scipy is slow to import

    count, found = len(weights.weight), list[tuple[float, int, Float[np.ndarray, "3"]]]()
    for i, out in enumerate(np.eye(count, dtype=bool)):
        rest, one = _picked(weights, ~out), _picked(weights, out)
        try:
            fit = fit_gains(rest)
        except InputError:
            continue
        left, right = (side[one.known] for side in one.whitened(fit.gains, fit.error))
        off = right - left @ fit.gains
        square = off @ np.linalg.solve(np.eye(len(off)) + left @ fit.covariance @ left.T, off)
        freedom = int(np.count_nonzero(rest.known)) - fit.shown
        if freedom > 0:
            found.append((float(fdtrc(len(off), freedom, square / len(off))), i, one.slopes @ fit.gains))
    chance, i, sums = min(found, default=(1.0, 0, np.ones(3)), key=lambda each: each[0])
    weight, place, seen = weights.weight[i], weights.place[i], sums[1:] / sums[0]
    if chance * count > CHANCE or not (
        abs(sums[0] / weight - 1.0) > OFF_WEIGHT or np.hypot(*(seen - place)) > OFF_PLACE
    ):
        return ""
    at = [f" at ({x:.3f}, {y:.3f}) m" if np.isfinite(place).all() else "" for x, y in (place, seen)]
    return (
        f"Weight {i + 1} of {count}, stated as {weight:.4g} N{at[0]}, is {sums[0]:.4g} N{at[1]} by the others: correct "
        "its rows, or leave them out."
    )


def _divided(cells: LoadCells, weights: Weights, found: Gains) -> LoadCells:
    """Return the cells with the division of loads that the weights show, where there are enough, and the misfit."""
    inverse, _, rest = cells.inverse()
    if not len(rest):
        return with_changes(cells, misfit=ELSEWHERE * found.error)
    loads = weights.readings @ inverse.T @ cells.measured
    across, enough = weights.readings @ rest.T, len(loads) >= 6
    slope: np.ndarray = np.linalg.lstsq(loads, across)[0] if enough else np.zeros((3, len(rest)))
    freedom = max(1, len(loads) - 3) / len(loads) if enough else 1.0
    made = uneven(cells, slope.T) if enough else cells
    white = np.asarray(np.linalg.solve(np.linalg.cholesky(made.noise), (loads @ made.measured.T @ made.matrix.T).T))
    size: np.ndarray = np.sum(white**2, axis=0) / len(rest)
    off = float(np.mean((across - loads @ slope) ** 2)) / freedom / float(np.mean(size))
    return with_changes(made, misfit=ELSEWHERE * float(np.sqrt(off)))


def _drift(found: Sequence[UnloadedStretch], noise: Float[np.ndarray, "k k"]) -> float:
    """Return the standard deviation of the zero's change from one unloaded stretch to the next, over the noise."""
    if len(found) < 2:
        return 0.0
    steps = np.diff([rest.voltage for rest in found], axis=0) ** 2
    return float(np.sqrt(np.mean(steps / np.diag(noise))))


def _odd(found: Gains) -> dict[int, float]:
    """Return the cell whose gain contradicts those of the others most, and by what share; {}: none does.

    Gains differ by `TOLERANCE` [1 standard deviation] and by the errors of the estimate.
    """
    count = len(found.gains)
    ways = (np.full((count, count), 1.0) - count * np.eye(count)) / (count - 1)  # mean of the others less the own
    usual = ways @ found.gains + found.gains
    spread = TOLERANCE**2 * np.sum(ways**2, axis=1) + np.diag(ways @ found.covariance @ ways.T) / usual**2
    off = (usual / found.gains - 1.0) / np.sqrt(spread)
    cell = int(np.argmax(np.abs(off)))
    return {cell: float(usual[cell] / found.gains[cell] - 1.0)} if abs(off[cell]) > named_beyond(count) else {}


def named_beyond(count: int) -> float:
    """Return the bound of the largest of `count` differences [Bonferroni]: `NAMED` of sound plates exceed it."""
    return -NormalDist().inv_cdf(0.5 * NAMED / count)


def _said(found: Gains, odd: Mapping[int, float], count: int) -> list[str]:
    said = [
        f"Cell {cell + 1} reads {100 * abs(more):.1f} % {'more' if more > 0 else 'less'} than the others for the same "
        "load. The model corrects it; check its mounting, and that nothing else carries its corner."
        for cell, more in odd.items()
    ]
    if found.shown < count:
        said.append(
            f"The weights show {found.shown} combinations of the {count} gains; where they do not, the cells are taken "
            f"as equal to {100 * TOLERANCE:g} %, which the covariance includes. To know, put weights at known places."
        )
    return said
