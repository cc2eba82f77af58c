"""Locate pokes among the taxels that answered, by a model of their response, learned from the pokes themselves.

A centroid of the answers shrinks towards the middle of the touched area, which looks like a gain of the sensor. The
model does not, and takes a silent taxel to be farther than those that answered.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.sensors.taxels.poking.rigid_groups import Units, frame_about
from palpate.spatial.arguments import frozen_value

__all__ = ["LocalTaxels", "PokePlaces", "Response", "centred", "charted", "learned", "seen_among"]

NEAR = 14  # taxels about the strongest one that are looked at
WIDE = 1.6  # half the width of what is searched for the poke, in spacings
GRID = 17  # points along each side of the grid, and of the finer second one: two peaks are 2 mm apart
INSIDE = 2.0  # deviations about the mean that must lie within what is searched
LEFT = 2.5  # deviations about the mean that are searched again
UNEVEN = 0.25  # deviation of the log of a poke's level: force and tool are not always alike
ROUGH = 0.3  # deviation of the log of a response that is as large as the threshold, from rounding and noise
CENTRED = 2e-3  # m: how far a poke is from the centroid of its answers
QUIET = 0.05  # weight of a silent taxel in a poke's place, relative to one that answered
_ENOUGH, _MANY = 30, 1000  # pokes of which the model is learned, at least and about
_ROUNDS = 4
_LEAST = 0.05  # of the scatter
_BOUNDS = np.log([5e-4, 1.0]), np.log([3e-2, 50.0])  # reach [m] and power, least and most


@frozen_value(eq=True)
class Response:
    """A taxel's response t to a force F at a distance r: log(t / F) = level - power log(1 + r^2 / (2 power reach^2)).

    Attributes:
        level: log of the response to 1 N at no distance.
        reach: [m].
        power: large for a bell; 2.5 under a compliant layer.
        scatter: standard deviation of the log of a response.
    """

    level: float
    reach: float
    power: float = 2.5
    scatter: float = 0.2

    def log(self, square: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Return the natural log of the response to 1 N at squared distances [m^2], of their shape.

        Raises:
            InputError: square has another shape.
        """
        return self.level - self.power * np.log1p(square / (2.0 * self.power * self.reach**2))


@frozen_value
class PokePlaces:
    """Places of n pokes among the w taxels about each.

    Attributes:
        taxels: (n, w) about the poke, -1: none; shares: (n, w) weights of their places in the poke's, with a sum of 1.
        origin: (n,) the taxel that answered most.
        second: (n, 2) [m] the poke's offset from shares times places, in the tangent plane of `origin`.
        covariance: (n, 2, 2) [m^2] of the poke's place in that plane.
        found: (n,) true if there was an answer.
    """

    taxels: Int[np.ndarray, "n w"]
    shares: Float[np.ndarray, "n w"]
    origin: Int[np.ndarray, " n"]
    second: Float[np.ndarray, "n 2"]
    covariance: Float[np.ndarray, "n 2 2"]
    found: Bool[np.ndarray, " n"]

    def points(self, units: Units) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 2"]]:
        """Return the pokes' places (n, 3) [m], and two unit axes (n, 3, 2) of the tangent plane at each one's origin.

        Args:
            units: modules or single taxels, as placed now.
        """
        places, normals = units.places
        axes = tangents(units, normals, self.origin)
        there = np.nan_to_num(places)[np.maximum(self.taxels, 0)]
        points = np.einsum("nw,nwc->nc", self.shares, there) + np.einsum("nca,na->nc", axes, self.second)
        if units.surface is not None:  # between taxels the chord lies below it, and a lever is too short by that
            points = np.where(self.found[:, None], units.surface.project(points)[0], points)
        return points, axes


def tangents(
    units: Units, normals: Float[np.ndarray, "k 3"], taxel: Int[np.ndarray, " n"]
) -> Float[np.ndarray, "n 3 2"]:
    """Return unit axes (n, 3, 2) of the tangent plane at taxels (n,), which turn with a module; normals are (k, 3)."""
    unit = np.maximum(units.layout.module[taxel], 0)
    along = np.broadcast_to([1.0, 0.0, 0.0], (len(taxel), 3)) if units.alone else units.frame[unit, :, 0]
    known = np.asarray(np.isfinite(normals[taxel]).all(axis=1), dtype=bool)
    return frame_about(np.where(known[:, None], normals[taxel], [0.0, 0.0, 1.0]), along)[:, :, :2]


@frozen_value
class LocalTaxels:
    """Taxels about each poke, in the tangent plane at the strongest answer.

    Attributes:
        taxels: (n, w), -1: none; flat: (n, w, 2) [m] their places.
        origin: (n,) the taxel that answered most.
        log: (n, w) of the answers over the force, NaN: silent; quiet: (n,) the same of the threshold.
        found: (n,) true if there was an answer.
        spacing: [m] between taxels.
    """

    taxels: Int[np.ndarray, "n w"]
    flat: Float[np.ndarray, "n w 2"]
    origin: Int[np.ndarray, " n"]
    log: Float[np.ndarray, "n w"]
    quiet: Float[np.ndarray, " n"]
    found: Bool[np.ndarray, " n"]
    spacing: float

    def variance(self, response: Response) -> Float[np.ndarray, "n w"]:
        """Return the variances (n, w) of the answers' logs, larger near the threshold by rounding and noise."""
        over = np.nan_to_num(self.log - self.quiet[:, None])
        return response.scatter**2 + (ROUGH * np.exp(-over)) ** 2


def seen_among(chart: LocalTaxels, response: Response) -> PokePlaces:
    """Return the `PokePlaces`: mean and covariance of each poke's place under a uniform prior."""
    mean, covariance = _posterior(chart, response)
    shares, beside = _shares(chart, mean)
    return PokePlaces(
        chart.taxels, shares, chart.origin, beside, covariance, chart.found & _inside(chart, mean, covariance)
    )


def centred(pokes: Pokes, units: Units) -> PokePlaces:
    """Return `PokePlaces` at the centroids of the answers, with a standard deviation of 2 mm along each axis."""
    order = np.lexsort((-pokes.response, pokes.poke))
    rank = np.arange(len(order)) - pokes.starts[pokes.poke[order]]
    kept, at = order[rank < NEAR], rank[rank < NEAR]
    placed = np.isin(pokes.taxel[kept], units.taxels)
    taxels, shares = np.full((len(pokes), NEAR), -1), np.zeros((len(pokes), NEAR))
    taxels[pokes.poke[kept], at] = np.where(placed, pokes.taxel[kept], -1)
    shares[pokes.poke[kept], at] = np.where(placed, pokes.response[kept], 0.0)
    total = shares.sum(axis=1, keepdims=True)
    found = (total[:, 0] > 0) & np.isfinite(pokes.wrench).all(axis=1) & (pokes.wrench[:, :3] != 0).any(axis=1)
    shares = shares / np.where(total > 0, total, 1.0)
    origin = np.maximum(np.take_along_axis(taxels, shares.argmax(axis=1)[:, None], axis=1)[:, 0], 0)
    covariance = np.tile(CENTRED**2 * np.eye(2), (len(pokes), 1, 1))
    return PokePlaces(taxels, shares, origin, np.zeros((len(pokes), 2)), covariance, found)


def learned(chart: LocalTaxels) -> Response:
    """Fit the `Response` of these taxels, in turns with the places of the pokes.

    With fewer than 30 pokes of three answers or more, return a guess from the strongest answers.
    """
    from scipy.optimize import least_squares  # here: scipy is slow to import

    told, known = np.isfinite(chart.log).sum(axis=1) >= 3, _guess(chart)
    if told.sum() < _ENOUGH:
        return known
    told &= np.cumsum(told) % max(int(told.sum()) // _MANY, 1) == 0
    same = ("taxels", "flat", "origin", "log", "quiet", "found")
    chart = replace(chart, **{name: getattr(chart, name)[told] for name in same})
    rows = np.isfinite(chart.log)
    poke = np.nonzero(rows)[0]
    for _ in range(_ROUNDS):
        mean, covariance = _posterior(chart, known)
        square = ((chart.flat - mean[:, None]) ** 2).sum(axis=2) + np.trace(covariance, axis1=1, axis2=2)[:, None]
        share = (known.scatter**2 / chart.variance(known) * _inside(chart, mean, covariance)[:, None])[rows]

        def gaps(free: np.ndarray, square: np.ndarray = square, share: np.ndarray = share) -> np.ndarray:
            shape = Response(0.0, float(np.exp(free[0])), float(np.exp(free[1])))
            gap = chart.log[rows] - shape.log(square[rows])
            level = np.bincount(poke, share * gap) / np.maximum(
                np.bincount(poke, share), 1e-12
            )  # each poke has its own
            return (gap - level[poke]) * np.sqrt(share)

        start = np.clip(np.log([known.reach, known.power]), *_BOUNDS)
        found = least_squares(gaps, start, bounds=_BOUNDS, loss="soft_l1", f_scale=0.3)
        reach, power = np.exp(found.x).tolist()
        level = float(np.median(chart.log[rows] - Response(0.0, reach, power).log(square[rows])))
        free = int(rows.sum()) - 3 * len(chart.log)  # level and place of each poke are taken from its answers
        scatter = known.scatter  # as was thought, while hardly an answer is left to tell it: then it grew without end
        if free >= _ENOUGH:
            spread = 1.4826 * float(np.median(np.abs(gaps(found.x)))) * np.sqrt(rows.sum() / free)
            scatter = float(np.clip(spread, _LEAST, 1.0))
        known = Response(level, reach, power, scatter)
    return known


def _guess(chart: LocalTaxels) -> Response:
    strongest = np.nanmax(np.where(chart.found[:, None], chart.log, -np.inf), axis=1, initial=-np.inf)[chart.found]
    if not len(strongest):
        return Response(0.0, chart.spacing)
    answering = np.isfinite(chart.log).sum(axis=1)[chart.found]
    radius = chart.spacing * np.sqrt(0.93 * max(float(answering.mean()), 1.0) / np.pi)
    fall = max(float(np.median(strongest - chart.quiet[chart.found])), 0.7)
    reach = radius / np.sqrt(5.0 * np.expm1(fall / 2.5))
    return Response(float(np.median(strongest)), float(reach))


def charted(pokes: Pokes, units: Units) -> LocalTaxels:
    """Return `LocalTaxels`, the nearest ones about the strongest answer of each poke that face the same way.

    On modules only those on the same one: others would fix modules to each other at their expected places.
    """
    from scipy.spatial import cKDTree

    places, normals = units.places
    known = np.flatnonzero(np.isfinite(places).all(axis=1) & np.isfinite(normals).all(axis=1))
    width, strongest = min(NEAR, len(known)), np.full(len(pokes), -1)
    order = np.lexsort((pokes.response, pokes.poke))
    order = order[np.isin(pokes.taxel[order], known) & (pokes.response[order] > 0)]
    strongest[pokes.poke[order]] = pokes.taxel[order]  # the last of each poke is its strongest
    force = np.linalg.norm(pokes.wrench[:, :3], axis=1)
    found = (strongest >= 0) & (force > 0) & np.isfinite(pokes.wrench).all(axis=1)
    near = cKDTree(places[known]).query(places[known], k=width)
    far, which = np.asarray(near[0]).reshape(len(known), -1), known[np.asarray(near[1]).reshape(len(known), -1)]
    spacing = float(np.median(far[:, 1:3])) if width > 2 else 5e-3
    about = np.where(found[:, None], which[np.searchsorted(known, strongest)], -1)
    origin = np.maximum(strongest, 0)
    axes = tangents(units, normals, origin)
    away = np.where((about >= 0)[..., None], places[np.maximum(about, 0)] - places[origin][:, None], 0.0)
    away = np.nan_to_num(away)
    flat = np.einsum("nwc,nca->nwa", away, axes)
    length, long = np.linalg.norm(flat, axis=2), np.linalg.norm(away, axis=2)
    flat = flat * np.where(length > 0, long / np.maximum(length, 1e-12), 1.0)[..., None]
    facing = np.einsum("nwc,nc->nw", normals[np.maximum(about, 0)], np.nan_to_num(normals[origin])) > 0
    module = units.layout.module
    same = units.alone | (module[np.maximum(about, 0)] == module[origin][:, None])
    about = np.where((about >= 0) & facing & same, about, -1)
    least = float(np.quantile(pokes.response, 0.02)) if len(pokes.response) else 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        log, quiet = np.log(_answers(pokes, about) / force[:, None]), np.log(max(pokes.threshold, least) / force)
    return LocalTaxels(about, flat, origin, log, np.nan_to_num(quiet), found, spacing)


def _answers(pokes: Pokes, about: Int[np.ndarray, "n w"]) -> Float[np.ndarray, "n w"]:
    key = pokes.poke * pokes.taxels + pokes.taxel
    order = np.argsort(key)
    wanted = np.arange(len(about))[:, None] * pokes.taxels + about
    at = np.minimum(np.searchsorted(key[order], wanted), max(len(key) - 1, 0))
    if not len(key):
        return np.full(about.shape, np.nan)
    there = (key[order][at] == wanted) & (about >= 0)
    return np.where(there, pokes.response[order][at], np.nan)


def _posterior(chart: LocalTaxels, response: Response) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 2"]]:
    """Return mean and covariance of each poke's place about the strongest answer, with a uniform prior."""
    from palpate.sensors.taxels.poking._response import posterior  # compiled: loaded when first needed

    mean, covariance = np.zeros((len(chart.log), 2)), np.zeros((len(chart.log), 2, 2))
    model = response.level, response.reach, response.power, response.scatter, ROUGH, UNEVEN
    search = GRID, WIDE * chart.spacing, LEFT
    posterior(chart.taxels, chart.flat, chart.log, chart.quiet, model, search, mean, covariance)
    return mean, covariance


def _inside(
    chart: LocalTaxels, mean: Float[np.ndarray, "n 2"], covariance: Float[np.ndarray, "n 2 2"]
) -> Bool[np.ndarray, " n"]:
    """Return whether each poke's place ends within what is searched for it.

    A poke farther away appears at the edge of the search, too near: the skin would grow.
    """
    ends = np.abs(mean) + INSIDE * np.sqrt(np.einsum("naa->na", covariance))
    return np.asarray((ends < WIDE * chart.spacing).all(axis=1), dtype=bool)


def _shares(
    chart: LocalTaxels, mean: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n w"], Float[np.ndarray, "n 2"]]:
    """Return the shares of taxels whose places give the mean, and the offset that remains."""
    answered = np.isfinite(chart.log)
    say = np.where(answered, 1.0, QUIET) * (chart.taxels >= 0)
    solid = np.concatenate([np.ones((*say.shape, 1)), chart.flat / chart.spacing], axis=2)
    wanted = np.concatenate([np.ones((len(mean), 1)), mean / chart.spacing], axis=1)
    square: Float[np.ndarray, "n 3 3"] = np.einsum("nw,nwi,nwj->nij", say, solid, solid) + 1e-9 * np.eye(3)
    told = np.linalg.solve(square, wanted[..., None])[..., 0]
    shares = say * np.einsum("nwi,ni->nw", solid, told)
    total = shares.sum(axis=1, keepdims=True)
    shares = np.where(chart.found[:, None], shares / np.where(np.abs(total) > 1e-6, total, 1.0), 0.0)
    return shares, np.where(chart.found[:, None], mean - np.einsum("nw,nwa->na", shares, chart.flat), 0.0)
