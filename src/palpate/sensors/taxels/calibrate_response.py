"""Fit what taxels with three axes read under known forces: the gains of each, and how a force spreads to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from math import sqrt
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import CHI2_95
from palpate.contact.ground_truth import TrueSamples
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels._loads import LEAST_PATCH
from palpate.sensors.taxels.estimator import SIX, SQUARE, TaxelEstimator
from palpate.sensors.taxels.health import Health
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.presses import EACH, EVERY, FEWEST, PRESSED, WARMS, Presses, axes_at, known_presses
from palpate.sensors.taxels.response import AXES, TaxelResponse, coupling_terms, response_terms
from palpate.signals.recording import CELLS, TEMPERATURE, Recording
from palpate.spatial.arguments import takes_arrays

# of the presses, each left out in turn; where the taxels bear all of a force, nearly all train
PARTS, FOLDS = 4, 12
ROUNDS = 10
PATCHES = np.concatenate([np.linspace(LEAST_PATCH, 0.0, 4)[:-1], [0.0, 0.05, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0]])
_LOOSE = 0.3  # squared pitches: deviation of a patch before it is learned
_ALIKE = 1e-2  # weight of the mean gains in those of a taxel
FADES = 2e-3  # share of a reading that a kelvin takes away, before it is learned
_INNER = 0.6  # of the skin's half width, within which all of a force is on the taxels
FACTORS, BESIDES = np.geomspace(0.1, 4.0, 20).tolist(), np.geomspace(1e-4, 0.3, 24).tolist()
UNUSUAL = np.array([0.0, *np.geomspace(1e-3, 1.0, 15)])
TURNED = {  # forces across that a truth may state by mistake, of which pillars show the least
    "fx and fy exchanged": np.array([[0.0, 1.0], [1.0, 0.0]]),
    "the other sign of fx, or of fy": np.array([[-1.0, 0.0], [0.0, 1.0]]),
    "fx and fy exchanged and the other sign of one": np.array([[0.0, 1.0], [-1.0, 0.0]]),
}
FITS = 0.97  # of the misfit; right truths have 1.08 or more
UNLIKE = np.array([0.4, 0.3, 0.3])  # pitches and shares of the force by which medians of errors are off: no response
# error of a place [pitches] along both tangents and its covariance; the force found, its covariance, and the true one,
# along both tangents and into the body; and the feature `shape`
_Row = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]
CHI2 = (3.841458820694124, CHI2_95, 7.814727903251179)  # 95 % points with one, two and three degrees of freedom


@takes_arrays
def identify_response(
    body: TaxelBody, recording: Recording, truth: TrueSamples, *, provenance: Mapping[str, str] | None = None
) -> TaxelResponse:
    """Return the `TaxelResponse` of a body from presses with known forces, between which nothing touches it.

    Args:
        body: the places of the taxels; `along` of `TaxelBody.anywhere` states their first axis.
        recording: readings (n, k, 3) of the taxels.
        truth: points and forces on the body, in the body's frame, while it is pressed.
        provenance: origin of the log.

    Raises:
        InputError: no readings of this body, or a truth without forces, or with forces along other axes.
        NotIdentifiable: too few presses, no frames at rest, no shear, or readings that do not follow the forces.
    """
    presses = known_presses(body, recording, truth)
    first, unusual = _fitted(presses, False)
    presses = presses.unfaded(first.fade)
    names, number = np.unique(presses.press, return_inverse=True)
    names = names[np.argsort(np.bincount(number, unusual) / np.bincount(number))]  # of tips of all sizes in each part
    alike = [
        _left_out(presses, [names[i::count] for i in range(count)], sums)
        for count, sums in ((PARTS, False), (FOLDS, True))
    ]
    found = [_corrected([row for each in parts for row in _alone(*each)]) for parts in alike]
    sums = int(np.argmin([off.sum() for _, _, off in found]))
    curve, parts = found[sums][0], alike[sums]
    if not sums:  # taxels that bear all of a force know no tips
        parts = _left_out(presses, np.array_split(names, PARTS), False)
    rows, misfits = zip(*(_in_turn(recording, *each) for each in parts), strict=True)
    in_turn = [row for part in rows for row in part]
    _, wide, off = _corrected(in_turn, curve)
    left_out = (
        f"{len(in_turn)} frames, a part at a time predicted from the rest: {1e3 * first.pitch * off[0]:.2g} mm, "
        f"{off[1]:.1%} of the force along the normal, {off[2]:.1%} across, medians"
    )
    if not (off <= UNLIKE).all():
        raise _unrelated(f" ({left_out})")
    _require_axes(presses, first)
    record = {"left_out": left_out, **(provenance or {})}
    kept = dict(zip(("widening", "inexact", "unusual"), wide.T, strict=True), curve=curve)
    response, _ = _fitted(presses, bool(sums))
    notes = [f"{len(names)} presses"]
    if TEMPERATURE in recording.channels and not len(response.thermal):
        notes.append(f"the temperature changes by less than {WARMS:g} K: what it does is not learned")
    return replace(response, **kept, usual_misfit=float(np.mean(misfits)), provenance=record, notes=tuple(notes))


def _require_axes(presses: Presses, found: TaxelResponse) -> None:
    """Require that no exchange of the axes across makes the forces fit the places and readings better."""
    misfits = dict[str, float]()
    for name, turn in TURNED.items():
        force = np.column_stack([presses.force[:, :2] @ turn, presses.force[:, 2]])
        misfits[name] = float(np.linalg.norm(_fitted(replace(presses, force=force), False)[0].misfit))
    best = min(misfits, key=lambda name: misfits[name])
    if misfits[best] < FITS * np.linalg.norm(found.misfit):
        what = f"the true forces fit the places and readings better with {best}."
        raise InputError(what, where="truth", hint="State px, py, pz and fx, fy, fz along the same axes.")


def _left_out(presses: Presses, parts: list[np.ndarray], sums: bool) -> list[tuple[Presses, TaxelResponse]]:
    """Return the presses of each part, which lists their numbers, with the fit to all others."""
    out = [np.isin(presses.press, part) for part in parts]
    fits = [_fitted(presses.of(~each), sums)[0] for each in out]
    return [(presses.of(each).unfaded(fit.fade), fit) for each, fit in zip(out, fits, strict=True)]


def _unrelated(figures: str = "") -> NotIdentifiable:
    """Return the error that readings do not follow the true forces."""
    what = (
        f"the readings do not follow the true points and forces{figures}: check the order of the taxels, the axes of "
        "points and forces, and that log and truth are of one clock."
    )
    return NotIdentifiable(what, rank=0, missing=("gains", "shares"))


def _fitted(presses: Presses, sums: bool) -> tuple[TaxelResponse, Float[np.ndarray, " n"]]:
    """Fit gains, the spread of a force and the patch of each frame in turn, until they settle.

    Return by how much the patches exceed usual ones, too.
    """
    body, guess = presses.body, presses.guess
    force, readings, offset = presses.force, presses.readings, presses.offset
    count, taxels = offset.shape[:2]
    weight = (1.0 / (np.linalg.norm(force, axis=1) + PRESSED * np.abs(force).max()))[:, None, None]
    both = offset.reshape(-1, 2), np.repeat(force, taxels, axis=0)
    shares, patch, inside = guess.shares, np.zeros(count), _inside(body, presses.point)
    around = coupling_terms(body.steps * body.spacing[:, None, None] / guess.pitch, body.neighbours)
    between = np.moveaxis(around, 3, 2).reshape(taxels, -1, AXES * shares.size)
    coupling, coupled = np.zeros(shares.size), np.zeros((count, taxels, AXES))

    def spread(patches: np.ndarray) -> np.ndarray:
        return response_terms(*both, np.repeat(patches, taxels)).reshape(count, taxels, AXES, -1)

    terms = spread(patch)
    loads: np.ndarray = terms @ shares.ravel()
    gains = _summed_gains(presses, weight[:, 0, 0]) if sums else guess.gains
    for turn in range(ROUNDS):
        alike = 1.0 if turn == 0 else _ALIKE  # the spread is a guess
        gains = gains if sums else _gains(weight * (loads - coupled), weight * readings, alike)
        felt: np.ndarray = np.einsum("kab,nkb->nka", gains, readings)
        if not sums:
            ways = (felt[:, body.neighbours].reshape(count, taxels, 1, -1) @ between).reshape(count, taxels, AXES, -1)
            coupling = _ridged(weight[..., None] * ways, weight * (loads - felt))
            coupled = ways @ coupling
            felt += coupled
        if turn > 1:
            patch = _patches(felt, *both, replace(guess, shares=shares))
            terms = spread(patch)
        shares = _ridged(weight[..., None] * terms, weight * felt).reshape(shares.shape)
        loads = terms @ shares.ravel()
        total: np.ndarray = loads[inside, :, 2].sum(axis=1)
        press = force[inside, 2]
        scale = float(total @ press) / float(press @ press)
        if not sums:
            shares, loads = shares / scale, loads / scale
    gains = gains if sums else _gains(weight * (loads - coupled), weight * readings, _ALIKE)
    felt = np.einsum("kab,nkb->nka", gains, readings) + coupled
    peak = np.abs(loads).max(axis=(1, 2))
    misfit = _misfit((felt - loads) / peak[:, None, None], felt / peak[:, None, None])
    size = np.column_stack([np.ones(count), force[:, 2].clip(min=0.0) ** (2 / 3)])
    line = _least(size, patch)
    unusual = patch - size @ line
    learned = np.array([*line, max(float(np.std(unusual)), 1e-3)])
    found = {"gains": gains, "shares": shares, "patch": learned, "misfit": misfit}
    if presses.warmer.any():
        found |= _thermal(presses, felt.sum(axis=1), force if sums else loads.sum(axis=1))
    return replace(guess, sums=sums, coupling=coupling.reshape(shares.shape), **found), unusual


def _thermal(presses: Presses, felt: Float[np.ndarray, "n 3"], true: Float[np.ndarray, "n 3"]) -> dict[str, Any]:
    """Return what `TaxelResponse` knows of the temperature, by how the sums of felt loads fall short of true ones."""
    short = np.sum((true - felt) * true, axis=1) / np.sum(true**2, axis=1)
    warmer = presses.warmer - presses.warmer.mean()
    more = float(warmer @ short) / (float(warmer @ warmer) + EACH * float(np.var(short)) / FADES**2)
    fade = presses.guess.fade + more
    return {"fade": fade, "thermal": presses.guess.thermal + fade * presses.level}


def _misfit(left: Float[np.ndarray, "n k 3"], loads: Float[np.ndarray, "n k 3"]) -> Float[np.ndarray, "2"]:
    """Return the shares of the largest load, 1 here, and of a taxel's own, by which loads are off; both squared add."""
    own, square = (loads**2).sum(axis=2), (left**2).mean(axis=2)
    light = own < np.quantile(own, 0.5)
    far = float(square[light].mean())
    near = float(np.maximum(square - far, 0.0)[~light].mean() / own[~light].mean())
    return np.sqrt([far, near])


def _summed_gains(presses: Presses, weight: Float[np.ndarray, " n"]) -> Float[np.ndarray, "k 3 3"]:
    """Return the gains (k, 3, 3) with which all loads sum up to the force, and the normal ones to no moment about it.

    Those of a taxel stay near the mean where the presses tell little.
    """
    readings, offset = presses.readings, presses.offset
    count, taxels = readings.shape[:2]
    flat = weight[:, None] * readings.reshape(count, -1)
    levers = [weight[:, None] * (readings * offset[..., a, None]).reshape(count, -1) for a in range(2)]
    gains = np.empty((taxels, AXES, AXES))
    for axis in range(AXES):
        ways = np.concatenate([flat, *levers]) if axis == 2 else flat
        wanted = np.zeros(len(ways))
        wanted[:count] = weight * presses.force[:, axis]
        alike = ways.reshape(len(ways), taxels, AXES).sum(axis=1)
        usual = np.tile(_least(alike, wanted), taxels)
        gains[:, axis] = (usual + _ridged(ways, wanted - ways @ usual, _ALIKE)).reshape(taxels, AXES)
    return gains


def _inside(body: TaxelBody, point: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Return which points lie far from the skin's edges; all if none does."""
    middle, half = body.positions.mean(axis=0), 0.5 * np.ptp(body.positions, axis=0)
    inside = (np.abs(point - middle) <= np.maximum(_INNER * half, 1e-6)).all(axis=1)
    return inside if np.count_nonzero(inside) >= EACH else np.ones(len(point), dtype=bool)


def _gains(
    loads: Float[np.ndarray, "n k 3"], readings: Float[np.ndarray, "n k 3"], alike: float
) -> Float[np.ndarray, "k 3 3"]:
    """Return the gains (k, 3, 3) from readings to loads, those of each taxel near the mean where it tells little."""
    square = np.asarray(np.einsum("nka,nkb->kab", loads, loads))
    across = np.asarray(np.einsum("nka,nkb->kab", readings, loads))
    weight = alike * np.mean(square, axis=0)
    usual = _solved(np.sum(square, axis=0), np.sum(across, axis=0).T).T
    reads = np.swapaxes(_solved(square + weight, np.swapaxes(across + usual @ weight, 1, 2)), 1, 2)
    return np.linalg.inv(reads)


def _ridged(ways: np.ndarray, wanted: np.ndarray, share: float = 1e-6) -> np.ndarray:
    """Return the least-squares solution (q,) of ways (..., q), small where it is free, by a share of their square."""
    design = ways.reshape(-1, ways.shape[-1])
    square: np.ndarray = design.T @ design
    ridge = share * np.trace(square) / len(square) * np.eye(len(square))
    return _solved(square + ridge, design.T @ wanted.ravel())


def _least(ways: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the least-squares solution."""
    return np.asarray(np.linalg.lstsq(ways, wanted)[0])


def _solved(square: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the solution of square equations."""
    return np.asarray(np.linalg.solve(square, wanted))


def _patches(
    felt: Float[np.ndarray, "n k 3"], offset: np.ndarray, force: np.ndarray, spread: TaxelResponse
) -> Float[np.ndarray, " n"]:
    """Return the variance of each frame's patch: the least misfit on a grid, and a parabola through its neighbours."""
    peak, misfit = np.abs(felt).max(axis=(1, 2))[:, None, None], 0.02
    cost = np.empty((len(PATCHES), len(felt)))
    for i, patch in enumerate(PATCHES.tolist()):
        loads = spread.spread_of(offset, force, np.full(len(offset), patch)).reshape(felt.shape)
        left: np.ndarray = (felt - loads) / (misfit * peak)
        cost[i] = (left**2).sum(axis=(1, 2)) + (patch / _LOOSE) ** 2
    best, each = np.clip(cost.argmin(axis=0), 1, len(PATCHES) - 2), np.arange(len(felt))
    before, here, after = (PATCHES[best + step] for step in (-1, 0, 1))
    one, two, three = (cost[best + step, each] for step in (-1, 0, 1))
    ahead, behind = (here - before) * (two - three), (here - after) * (two - one)
    bend = ahead - behind
    shift = 0.5 * ((here - before) * ahead - (here - after) * behind) / np.where(np.abs(bend) > 1e-12, bend, np.inf)
    found = np.clip(here - shift, before, after)
    return np.maximum(found - np.median(found), LEAST_PATCH)


def _alone(presses: Presses, response: TaxelResponse) -> list[_Row]:
    """Return the errors on presses, frame by frame less the rest."""
    body = replace(presses.body, response=response, bits=None)
    noise = np.sqrt(np.einsum("kab,kb->ka", response.gains**2, presses.noise**2)).T
    zero, bad = np.zeros(len(body)), np.zeros(len(body), dtype=bool)
    health = Health(zero, noise[2], bad, bad, sideways=np.stack([np.zeros((2, len(body))), noise[:2]]))
    estimator = TaxelEstimator(body, health=health)
    rows = list[_Row]()
    for i in range(0, len(presses.press), EVERY):
        estimator.reset()
        found = estimator.run(Recording(np.zeros(1), {CELLS: presses.readings[i : i + 1]}))
        rows += _errors(found, 0, presses, i)
    return rows


def _in_turn(recording: Recording, presses: Presses, response: TaxelResponse) -> tuple[list[_Row], float]:
    """Return the errors on presses in the recording as it ran, where what earlier presses left behind counts.

    And the mean square of their misfits.
    """
    estimator = TaxelEstimator(replace(presses.body, response=response, bits=None))
    found = estimator.run(recording)
    rows = [_errors(found, frame, presses, i) for i, frame in enumerate(presses.frame.tolist())]
    return [row for frame in rows for row in frame], estimator.misfit


def _errors(found: Contacts, sample: int, presses: Presses, i: int) -> list[_Row]:
    """Return a row on the hardest contact of a sample, a frame of presses; none if there is none."""
    there, pitch = np.flatnonzero((found.sample == sample) & found.located), presses.guess.pitch
    if not len(there):
        return []
    best = there[int(np.argmax(np.linalg.norm(found.force[there], axis=1)))]
    turn = axes_at(presses.body, presses.point[i : i + 1], pitch)[0]
    error = turn[:2] @ (found.point[best] - presses.point[i]) / pitch
    place = turn[:2] @ found.covariance[best] @ turn[:2].T / pitch**2
    six = np.array([found.features[name][best] for name in SIX])
    spread = turn @ six[SQUARE].reshape(3, 3) @ turn.T
    return [(error, place, turn @ found.force[best], spread, presses.force[i], float(found.features["shape"][best]))]


def _corrected(
    rows: list[_Row], curve: Float[np.ndarray, "5"] | None = None
) -> tuple[Float[np.ndarray, "5"], Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Return `TaxelResponse.curve`; `.widening`, `.inexact` and `.unusual` as columns; medians; of rows of `_errors`.

    Errors are those of the place [pitches], and of the normal and the tangential force as shares of the force.

    Raises:
        NotIdentifiable: there are hardly any rows.
    """
    if len(rows) < FEWEST // 2:
        raise _unrelated()
    place, flat, fitted, spread, force, shape = (np.array(each) for each in zip(*rows, strict=True))
    weight = 1.0 / (np.linalg.norm(force, axis=1) + PRESSED * np.abs(force).max())
    normal, square = fitted[:, 2], (fitted[:, :2] ** 2).sum(axis=1)
    ways = weight[:, None] * np.column_stack([normal, normal**2, square])
    first = _least(ways, weight * force[:, 2])
    aside = weight[:, None, None] * np.stack([fitted[:, :2], normal[:, None] * fitted[:, :2]], axis=2)
    second = _least(aside.reshape(-1, 2), (weight[:, None] * force[:, :2]).ravel())
    first, second = (first, second) if curve is None else (curve[:3], curve[3:])
    along = fitted[:, :2] * (second[0] + second[1] * normal)[:, None]
    press: np.ndarray = np.column_stack([normal, normal**2, square]) @ first
    off, size = np.column_stack([along, press]) - force, np.linalg.norm(force, axis=1)
    slope = np.array([second[0], second[0], first[0]])
    spread = slope[:, None] * spread * slope
    forces = ((off[:, part], spread[:, part, part], size) for part in (slice(2, 3), slice(2)))
    wide = np.array([_widening(*each, shape) for each in ((place, flat, np.ones(len(rows))), *forces)])
    factor, inexact, unusual = wide[[2, 2, 1]].T
    more = size[:, None] ** 2 * (inexact**2 + (unusual * shape[:, None]) ** 2)
    both = factor[:, None] * spread * factor + more[:, None] * np.eye(3)
    wide[1:] *= _excess(off, both)
    errors = [np.linalg.norm(place, axis=1), np.abs(off[:, 2]) / size, np.linalg.norm(off[:, :2], axis=1) / size]
    return np.concatenate([first, second]), wide, np.median(errors, axis=1)


def _widening(
    error: Float[np.ndarray, "n d"],
    covariance: Float[np.ndarray, "n d d"],
    size: Float[np.ndarray, " n"],
    shape: Float[np.ndarray, " n"],
) -> list[float]:
    """Return the factor of standard deviations, and deviations over `size` and `size * shape`, which errors show.

    They are the likeliest of Gaussian errors, by which 95 % lie within their 95 % bounds.
    """
    values, ways = np.linalg.eigh(covariance)
    along: np.ndarray = np.einsum("nda,nd->na", ways, error) ** 2
    flat, wide = size[:, None] ** 2, (size * shape)[:, None] ** 2
    unlikely, best = np.inf, (1.0, 0.0, 0.0)
    for factor, beside in product(FACTORS, BESIDES):
        variance: np.ndarray = factor**2 * values + beside**2 * flat + UNUSUAL[:, None, None] ** 2 * wide
        cost = np.mean(along / variance + np.log(variance), axis=(1, 2))
        k = int(cost.argmin())
        if cost[k] < unlikely:
            unlikely, best = float(cost[k]), (factor, beside, float(UNUSUAL[k]))
    more = best[1] ** 2 * flat + best[2] ** 2 * wide
    excess = _excess(error, best[0] ** 2 * covariance + more[:, None] * np.eye(len(error.T)))
    return [excess * each for each in best]


def _excess(error: Float[np.ndarray, "n d"], covariance: Float[np.ndarray, "n d d"]) -> float:
    """Return the factor of standard deviations with which 95 % of errors lie within their 95 % bounds.

    The quantile is that which a further press exceeds in 5 % (conformal prediction), of presses with `EACH` rows.
    """
    off = np.sum(error * _solved(covariance, error[..., None])[..., 0], axis=1)
    return sqrt(float(np.quantile(off, min(1.0, 0.95 * (1.0 + EACH / len(off))))) / CHI2[len(error.T) - 1])
