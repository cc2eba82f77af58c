"""Fit the response of a ring's markers by regression on presses of known angle, depth and force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import InputError
from palpate.optical.ring_response import RingResponse, ring_basis
from palpate.sensors.marker_ring.locator import RingLocator, RingSettings, turned
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import frozen_value

ORDERS = (16, 2)  # of the angle between marker and contact, and of the contact's own angle
PARTS = 48  # parts of a turn, each with a misfit
_BLOCK = 256  # presses at once
_FOLDS = 8  # parts of the presses, each omitted from a fit in turn [Bishop 2006, 1.3]
_LEAST = 8  # presses that a fit needs
_PLAIN = 0.02  # of the force: assumed accuracy of a shear gauge next to a ring; a judgement, not measured
_ROUNDS = 3  # of the search for `carried`
_TURNS = 200  # of expectation and maximisation
_STEEPEST = 2.0  # shear / force: that of silicone on anything is below
_FAR_OFF = 10.0  # times the depth: under a press no marker moves farther, nor all of them less than its inverse
_AGAINST = 0.3  # correlation of shear and motion along the ring: friction drags the skin with it
_ASTRAY, _WRONG = 0.35, 0.5  # rad, share of force: larger errors on omitted presses mean a wrong truth
_STEP = 1e-4  # rad, of a numerical derivative
_SHEAR = 0.15  # usual shear / force where none was calibrated
_NEW_SKIN = 1.0, 4.0, 0.03  # numbers of `_deviations` that the search for the likeliest begins with: of a new kind,
_NEW_UNIT = 0.1, 4.0, 0.3  # and of another unit of a known kind, once its stiffness is taken off
_Prior = tuple[float, float, float] | np.ndarray  # what its search begins with, or the coefficients' deviations


@frozen_value
class RingPresses:
    """Single contacts of known truth with the displacements of the markers.

    Attributes:
        angle: (n,) of the centre of pressure [rad].
        depth: (n,) [m].
        force: (n,) radial, positive inwards [N].
        shear: (n,) along rising angles [N]; NaN: not known.
        displacements: (n, m, 2) outwards and along [m]; NaN: not seen.
        markers: (m,) angles at rest [rad], ring by ring, the same number in each.
        noise: (m, 2) standard deviation of a displacement [m].
        rings: number of rings of markers.
    """

    angle: Float[np.ndarray, " n"]
    depth: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    shear: Float[np.ndarray, " n"]
    displacements: Float[np.ndarray, "n m 2"]
    markers: Float[np.ndarray, " m"]
    noise: Float[np.ndarray, "m 2"]
    rings: int = 1

    def __len__(self) -> int:
        return len(self.angle)

    def picked(self, rows: Bool[np.ndarray, " n"]) -> RingPresses:
        """Return the `RingPresses` that a mask (n,) selects.

        Raises:
            InputError: the mask is not of n bools.
        """
        rows = shaped(rows, self.angle.shape, "rows", np.dtype(np.bool_))
        names = ("angle", "depth", "force", "shear", "displacements")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def by_ring(self) -> list[RingPresses]:
        """Return `RingPresses` for each ring, with the displacements of its markers."""
        if self.rings == 1:
            return [self]
        own = [np.split(each, self.rings) for each in (np.swapaxes(self.displacements, 0, 1), self.markers, self.noise)]
        return [
            replace(self, displacements=np.swapaxes(moved, 0, 1), markers=markers, noise=noise, rings=1)
            for moved, markers, noise in zip(*own, strict=True)
        ]


def fit_response(presses: RingPresses, before: RingResponse | None = None) -> RingResponse:
    """Fit the `RingResponse` that explains presses, with its errors on presses omitted from the fit.

    It is a regression with a prior: smooth in the angle from the contact, and nearly the same all round the ring; or,
    with `before`, that response times a stiffness that varies round the ring.

    Args:
        presses: presses all round the ring, of two widths at least; with shear, if it is known.
        before: response of another unit, with which tens of presses are enough; None: not known.

    Raises:
        InputError: the presses are too few, or only on a part of the ring; `before` has another number of rings; a
            shear is more than friction allows; or omitted presses are not found with the response of the others.
    """
    _require_presses(presses, before)
    whole, scales = _fitted(presses, before)
    judged = replace(whole, **_left_out(presses, before, (whole.carried, scales)))
    angle, _, force, _ = judged.left_out.tolist()
    if not (angle <= _ASTRAY and force <= _WRONG):  # NaN too: hardly one is found
        off = f"found {np.degrees(angle):.0f} degrees and {force:.0%} of their force off"
        raise InputError(
            f"presses that were not fitted are {'mostly not found' if np.isnan(angle) else off}: the markers do not "
            "move as angle, depth and force state.",
            where="truth",
            hint="Check that each row belongs to its frame, and that angle_deg is in degrees, depth_mm in mm and "
            "force_n in N.",
        )
    return judged


def _require_presses(presses: RingPresses, before: RingResponse | None) -> None:
    if len(presses) < _LEAST:
        raise InputError(f"{len(presses)} presses are too few: the fit needs at least {_LEAST}.", where="truth")
    if before is not None and before.rings != presses.rings:
        what = f"the model of another unit has {before.rings} rings of markers, but this unit has {presses.rings}."
        raise InputError(what, where="like", hint="Name a unit with as many rings, or calibrate without one.")
    moved = np.nanmedian(np.nanmax(np.linalg.norm(presses.displacements, axis=2), axis=1) / presses.depth)
    if not 1.0 / _FAR_OFF < moved < _FAR_OFF:
        what = f"the markers move {moved:.3g} times as far as the presses are deep."
        raise InputError(what, where="truth", hint="Write depth_mm in mm, and radius and thickness of the rig in m.")
    along = np.nanmean(presses.displacements[..., 1], axis=1) / presses.force
    dragged = presses.shear / presses.force
    if np.nanstd(dragged) > _PLAIN and np.corrcoef(along, dragged)[0, 1] < -_AGAINST:
        what = "the markers move against the stated shear: its sign is reversed."
        raise InputError(what, where="truth", hint="Write shear_n along rising angles, as it acts on the ring.")
    share = np.abs(dragged)[presses.force >= np.median(presses.force)]
    steep = float(np.nanquantile(share, 0.95)) if np.isfinite(share).any() else 0.0
    if steep > _STEEPEST:
        raise InputError(
            f"the shear is up to {steep:.1f} times the force, and friction allows at most {_STEEPEST:g} times.",
            where="truth",
            hint="Write shear_n in N, along rising angles; leave the column out if it was not measured.",
        )
    angles = np.sort(np.mod(presses.angle, 2.0 * np.pi))
    gap = np.degrees(np.diff(angles, append=angles[0] + 2.0 * np.pi).max())
    if gap > 60.0 + 60.0 * (before is not None):
        raise InputError(
            f"an arc of {gap:.0f} degrees of the ring has no press.", where="truth", hint="Press all round the ring."
        )


def _fitted(
    presses: RingPresses, before: RingResponse | None, known: tuple[np.ndarray, Sequence[_Prior]] | None = None
) -> tuple[RingResponse, Sequence[_Prior]]:
    """Return the fitted response, with a misfit and spread of zero, and each ring's prior.

    `known`: `carried` and priors of a fit to more presses.
    """
    if before is None:
        ratio = presses.depth / presses.force
        sheared = bool(np.isfinite(presses.shear).all() and np.ptp(presses.shear / presses.force) > 0.1)
        weight = presses.force**2
        mean = float(np.average(ratio, weights=weight))
        width = np.array([mean, max(float(np.sqrt(np.average((ratio - mean) ** 2, weights=weight))), 0.02 * mean)])
        start = np.zeros((3 + sheared, 2 * presses.rings, 2 * ORDERS[0] + 1, 2 * ORDERS[1] + 1))
        usual, grip = _usual(presses, width, sheared)
        dragged = _dragged(presses.shear / presses.force) if sheared else np.zeros(3)
    else:
        start, width = _rescaled(presses, before)
        usual, grip, dragged = before.usual, before.grip, before.dragged
    first = [_NEW_SKIN if before is None else _NEW_UNIT] * presses.rings
    carried, priors = known or (np.zeros(2) if before is None else before.carried, first)
    for _ in range(_ROUNDS if known is None and before is None and len(start) == 4 else 0):
        carried, priors = _carried(presses, carried, start, width, priors)
    coefficients, priors = _regressions(_pressed(presses, carried), start, width, _weights(presses), priors)
    largest = np.array([presses.depth.max(), presses.force.max()])
    nothing = np.zeros((2 * presses.rings, PARTS))
    fitted = RingResponse(coefficients, width, nothing, np.zeros(2), largest, usual, grip, dragged, carried=carried)
    return fitted, priors


def _carried(
    presses: RingPresses, carried: np.ndarray, start: np.ndarray, width: np.ndarray, priors: Sequence[_Prior]
) -> tuple[Float[np.ndarray, "2"], Sequence[_Prior]]:
    """Return `carried` of a `RingResponse` after a Gauss-Newton step, and the priors.

    A response is that of the pressed part of the skin, which shear carries along: the wall by an angle per newton, and
    the skin at the contact by one in proportion to its compliance, depth / F; neither is negative. A change of
    coefficients imitates a part of either motion: the step is fitted to the rest.
    """
    from scipy.optimize import nnls  # here: it takes a while to import

    here, weights = _pressed(presses, carried), _weights(presses)
    coefficients, priors = _regressions(here, start, width, weights, priors)
    terms, seen = _terms(here, width, len(coefficients)), np.isfinite(here.displacements)
    ahead, behind = (_predicted(replace(here, angle=here.angle + e), coefficients, terms) for e in (-_STEP, _STEP))
    turned = (ahead - behind) / (2.0 * _STEP) * here.shear[:, None, None]
    ways = [np.where(seen, way, np.nan) for way in (turned, turned * (presses.depth / presses.force)[:, None, None])]
    fits = [_regressions(replace(here, displacements=way), 0.0 * start, width, weights, priors)[0] for way in ways]
    rest = [way - _predicted(here, fit, terms) for way, fit in zip(ways, fits, strict=True)]
    weight = np.repeat(weights, len(here.markers) // here.rings, axis=1)[..., None]
    across, beyond, left = (
        np.nan_to_num(weight * np.stack(each)).reshape(len(each), -1)
        for each in (ways, rest, [here.displacements - 0.5 * (ahead + behind)])
    )
    normal = across @ beyond.T
    root = np.linalg.cholesky(0.5 * (normal + normal.T) + 1e-9 * np.diag(np.diag(normal)))
    right = np.asarray(np.linalg.solve(root, across @ left[0] + normal @ carried), dtype=np.float64)
    return nnls(root.T, right)[0], priors


def _pressed(presses: RingPresses, carried: Float[np.ndarray, "2"]) -> RingPresses:
    """Return the presses at the angles of the skin that they press, their forces in the axes there."""
    shear = np.nan_to_num(presses.shear)
    turn = (carried[0] + carried[1] * presses.depth / presses.force) * shear
    force = presses.force * np.cos(turn) + shear * np.sin(turn)
    along = presses.shear * np.cos(turn) - presses.force * np.sin(turn)
    return replace(presses, angle=presses.angle - turn, force=force, shear=along)


def _usual(presses: RingPresses, width: np.ndarray, sheared: bool) -> tuple[Float[np.ndarray, "3"], float]:
    """Return `usual` and `grip` of a `RingResponse`, grip from the heavier half of the presses."""
    z = (presses.depth / presses.force - width[0]) / width[1]
    if not sheared:
        return np.array([z.mean(), z.std(), _SHEAR]), 0.0
    share = presses.shear / presses.force
    grip = float(np.abs(share[presses.force >= np.median(presses.force)]).max())
    return np.array([z.mean(), z.std(), float(np.sqrt(np.mean(share**2)))]), grip


def _dragged(share: Float[np.ndarray, " n"]) -> Float[np.ndarray, "3"]:
    """Return `dragged` of a `RingResponse`: two normal distributions about 0, by expectation and maximisation.

    Zeros if one distribution explains them as well, by Schwarz's criterion [Bishop 2006, 4.4.1 and 9.2.2].
    """
    square, deviations = share**2, np.maximum([np.median(np.abs(share)), np.abs(share).max()], _PLAIN)
    weights = np.array([0.5, 0.5])

    def likely(weights: np.ndarray, deviations: np.ndarray) -> Float[np.ndarray, "n k"]:
        return weights / deviations * np.exp(-0.5 * square[:, None] / deviations**2) + 1e-300

    for _ in range(_TURNS):
        each = likely(weights, deviations)
        each /= each.sum(axis=1, keepdims=True)
        weights = each.mean(axis=0)
        deviations = np.maximum(np.sqrt(square @ each / np.maximum(each.sum(axis=0), 1e-300)), _PLAIN)
    two = np.log(likely(weights, deviations).sum(axis=1)).sum()
    one = np.log(likely(np.ones(1), np.maximum(np.sqrt(square.mean(keepdims=True)), _PLAIN))).sum()
    if two - one < np.log(len(share)):  # two numbers more
        return np.zeros(3)
    return np.array([weights[1], *deviations])


def _terms(presses: RingPresses, width: np.ndarray, terms: int) -> Float[np.ndarray, "n b"]:
    """Return F, F z, F z^2 and the shear of each press, (n, b)."""
    force, z = presses.force, (presses.depth / presses.force - width[0]) / width[1]
    return np.stack([force, force * z, force * z * z, np.nan_to_num(presses.shear)][:terms], axis=1)


def _rescaled(presses: RingPresses, before: RingResponse) -> tuple[np.ndarray, np.ndarray]:
    """Return another unit's response and width times a softness: u = g(phi) u_before, width = mean(g) width_before."""
    g, gain = np.ones(len(presses)), np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    for _ in range(3):
        terms = _terms(presses, before.width * np.mean(g), len(before.coefficients))
        guess = _predicted(presses, before.coefficients, terms)
        seen = np.isfinite(presses.displacements)
        basis = ring_basis(presses.angle, 2)
        there, wanted = np.where(seen, guess, 0.0), np.where(seen, presses.displacements, 0.0)
        normal = np.einsum("na,nb,nmc->ab", basis, basis, there**2) + np.diag([0.0, *([1e-2] * 4)]) * (there**2).sum()
        right: np.ndarray = np.einsum("na,nmc,nmc->a", basis, there, wanted)
        gain = np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
        g = np.maximum(basis @ gain, 0.2)
    return _times(before.coefficients, gain, before.orders[1]), before.width * float(np.mean(g))


def _times(coefficients: np.ndarray, gain: np.ndarray, order: int) -> np.ndarray:
    """Return coefficients times a series in the contact's angle, truncated at their order."""
    phi = 2.0 * np.pi * np.arange(64) / 64
    of_phi = ring_basis(phi, order)
    values = np.einsum("bckm,am->bcka", coefficients, of_phi) * (ring_basis(phi, 2) @ gain)
    back: np.ndarray = np.asarray(np.linalg.pinv(of_phi))
    return np.einsum("bcka,ma->bckm", values, back)


def _predicted(presses: RingPresses, coefficients: np.ndarray, terms: np.ndarray) -> Float[np.ndarray, "n m 2"]:
    orders = coefficients.shape[2] // 2, coefficients.shape[3] // 2
    of_phi, found = ring_basis(presses.angle, orders[1]), list[np.ndarray]()
    for seen, own in zip(presses.by_ring(), np.split(coefficients, presses.rings, axis=1), strict=True):
        of_delta = ring_basis(seen.markers[None, :] - seen.angle[:, None], orders[0])
        found.append(np.einsum("nb,bckm,nik,nm->nic", terms, own, of_delta, of_phi, optimize=True))
    return np.concatenate(found, axis=1)


def _weights(presses: RingPresses) -> Float[np.ndarray, "n rings"]:
    """Return one over the standard deviation of a displacement, by noise and 3 % of a usual one, ring by ring [1/m]."""
    each = [(np.sqrt(np.mean(own.noise**2)), 0.03 * _per_newton(own) * own.force) for own in presses.by_ring()]
    return np.stack([1.0 / np.hypot(*both) for both in each], axis=1)


def _per_newton(presses: RingPresses) -> float:
    """Return the rms displacement of a newton [m/N]."""
    return float(np.sqrt(np.nanmean((presses.displacements / presses.force[:, None, None]) ** 2)))


def _regressions(
    presses: RingPresses, start: np.ndarray, width: np.ndarray, weights: np.ndarray, priors: Sequence[_Prior]
) -> tuple[Float[np.ndarray, "b e k m"], Sequence[_Prior]]:
    """Return the response by ridge regression towards `start`, and each ring's prior."""
    each = zip(presses.by_ring(), np.split(start, presses.rings, axis=1), weights.T, priors, strict=True)
    both = [_regression(own, begun, width, weight, prior) for own, begun, weight, prior in each]
    fits, found = zip(*both, strict=True)
    return np.concatenate(fits, axis=1), found


def _regression(
    presses: RingPresses, start: np.ndarray, width: np.ndarray, weight: np.ndarray, prior: _Prior
) -> tuple[np.ndarray, np.ndarray]:
    """Return one ring's response, and its prior; one whose numbers are given is searched for."""
    shape = start.shape
    normal, right = _sums(presses, start, width, weight)
    scale = prior if isinstance(prior, np.ndarray) else _most_likely(normal, right, shape, _per_newton(presses), prior)
    found: np.ndarray = np.linalg.solve(normal + np.diag(scale**-2.0), right)
    return start + np.moveaxis(found.reshape(shape[0], shape[2], shape[3], 2), 3, 1), scale


def _sums(
    presses: RingPresses, start: np.ndarray, width: np.ndarray, weight: np.ndarray
) -> tuple[Float[np.ndarray, "size size"], Float[np.ndarray, "size 2"]]:
    """Return the normal matrix and its right sides for the residuals of `start`."""
    terms, shape = _terms(presses, width, len(start)), start.shape
    size = shape[0] * shape[2] * shape[3]
    normal, right = np.zeros((size, size)), np.zeros((size, 2))
    left = presses.displacements - _predicted(presses, start, terms)
    for first in range(0, len(presses), _BLOCK):
        rows = slice(first, first + _BLOCK)
        delta = presses.markers[None, :] - presses.angle[rows, None]
        of_delta, of_phi = ring_basis(delta, shape[2] // 2), ring_basis(presses.angle[rows], shape[3] // 2)
        design = np.einsum("nb,nik,nm->nibkm", terms[rows], of_delta, of_phi, optimize=True)
        seen = np.asarray(np.isfinite(left[rows]).all(axis=2), dtype=bool)
        scaled = np.where(seen, weight[rows, None], 0.0)
        flat = (design * scaled[:, :, None, None, None]).reshape(-1, size)
        normal += flat.T @ flat
        right += flat.T @ (np.where(seen[..., None], left[rows], 0.0) * scaled[..., None]).reshape(-1, 2)
    return normal, right


def _most_likely(
    normal: np.ndarray, right: np.ndarray, shape: tuple[int, ...], usual: float, first: tuple[float, float, float]
) -> Float[np.ndarray, " size"]:
    """Return the coefficients' standard deviations under the prior of the largest evidence [Bishop 2006, 3.5.1].

    log p(u) = sum over both axes of (log|P| - log|N + P| + r' (N + P)^-1 r) / 2 + a constant, with P the precision, N
    the normal matrix, r its right side. The search starts from the numbers `first` of `_deviations`.
    """
    from scipy.linalg import cho_factor, cho_solve  # here: they take a while to import
    from scipy.optimize import minimize

    start = np.log(first)

    def deviations(x: np.ndarray) -> Float[np.ndarray, " size"]:
        return usual * _deviations(shape, *np.exp(np.clip(x, start - 4.0, start + 4.0)).tolist())

    def unlikely(x: np.ndarray) -> float:
        precision = deviations(x) ** -2.0
        factor = cho_factor(normal + np.diag(precision), lower=True, check_finite=False)
        spread = np.sum(np.log(precision)) - 2.0 * np.sum(np.log(np.diag(factor[0])))
        return float(-spread - 0.5 * np.sum(right * cho_solve(factor, right)))

    simplex = start + np.concatenate([np.zeros((1, 3)), 0.5 * np.eye(3)])
    options: Any = {"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.5, "maxfev": 200}
    return deviations(minimize(unlikely, start, method="Nelder-Mead", options=options).x)


def _deviations(shape: tuple[int, ...], size: float, smooth: float, uneven: float) -> Float[np.ndarray, " size"]:
    """Return prior standard deviations of the coefficients' differences from the start.

    Args:
        shape: of the coefficients.
        size: standard deviation of the lowest orders.
        smooth: order in delta from which they decrease.
        uneven: share of the first order in phi.
    """
    of_term = np.array([1.0, 0.5, 0.25, 1.0])[: shape[0]]
    k = np.repeat(np.arange(1, shape[2] // 2 + 1), 2)
    of_delta = np.concatenate([[1.0], 1.0 / (1.0 + (k / smooth) ** 3)])
    m = np.repeat(np.arange(1, shape[3] // 2 + 1), 2)
    of_phi = np.concatenate([[1.0], uneven / m])
    return size * np.einsum("b,k,m->bkm", of_term, of_delta, of_phi).reshape(-1)


def _left_out(
    presses: RingPresses, before: RingResponse | None, whole: tuple[np.ndarray, Sequence[_Prior]]
) -> dict[str, np.ndarray]:
    """Return `misfit`, `spread` and `left_out`, from fits that omit a part of the angles, tested on that part.

    `whole`: `carried` and priors of the fit to all presses, which these fits keep.
    """
    _, which = np.unique(np.round(np.mod(presses.angle, 2.0 * np.pi), 2), return_inverse=True)
    folds = (which if which.max() + 1 >= _FOLDS else np.arange(len(presses))) % _FOLDS
    fits = [_fitted(presses.picked(folds != fold), before, whole)[0] for fold in range(_FOLDS)]
    parts = [presses.picked(folds == fold) for fold in range(_FOLDS)]
    misfit, sheared = _misfit(fits, parts, 2 * presses.rings)
    judged = [replace(fit, misfit=misfit, sheared=sheared) for fit in fits]
    every = np.concatenate([_errors(fit, part) for fit, part in zip(judged, parts, strict=True)])
    steep, force = np.abs(every[:, 7]), every[:, 6]
    plain = steep <= _rms(steep.tolist() or [0.0])
    spread, expected = np.zeros(3), np.full(6, np.nan)
    for e, scale in enumerate((np.ones(len(every)), force, force)):
        off, known = np.abs(every[:, 2 * e] / scale), every[:, 2 * e + 1] / scale
        spread[e] = _beside(off[plain], known[plain], 1.0) if e < 2 else spread[1]
        known = np.hypot(known, spread[e])
        sheared[e] = _beside(off[~plain], known[~plain], steep[~plain])
        if 2 * len(every) >= len(presses):  # else NaN: most are not found
            expected[2 * e : 2 * e + 2] = _rms(off.tolist()), _rms(np.hypot(known, sheared[e] * steep).tolist())
    return {"misfit": misfit, "spread": spread[:2], "sheared": sheared, "left_out": expected[:4]}


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _misfit(
    fits: Sequence[RingResponse], parts: Sequence[RingPresses], rows: int
) -> tuple[Float[np.ndarray, "rows parts"], Float[np.ndarray, "4"]]:
    """Return `misfit` by presses of little shear, and `sheared` with what the others have in addition."""
    square, number = np.zeros((2, 2, rows, PARTS))  # presses of little shear, and the others
    steep = [np.abs(np.nan_to_num(part.shear / part.force)) for part in parts]
    usual = _rms(np.concatenate(steep).tolist())
    for fit, part, share in zip(fits, parts, steep, strict=True):
        for k, mask in enumerate((share <= usual, share > usual)):
            _add_misfit(fit, _pressed(part.picked(mask), fit.carried), square[k], number[k])
    misfit = np.sqrt(np.maximum(square[0], 0.0) / np.maximum(number[0], 1e-30))
    more = square[1].sum() / max(float((number[1] * misfit**2).sum()), 1e-30) - 1.0
    dragged = np.concatenate([share[share > usual] for share in steep])
    return misfit, np.array([0.0, 0.0, 0.0, np.sqrt(max(more, 0.0)) / _rms(dragged.tolist()) if len(dragged) else 0.0])


def _add_misfit(fit: RingResponse, part: RingPresses, square: np.ndarray, number: np.ndarray) -> None:
    """Add squared residuals, less the noise, to `square`, and squared forces to `number`."""
    left = part.displacements - _predicted(part, fit.coefficients, _terms(part, fit.width, len(fit.coefficients)))
    delta = np.mod(part.markers[None, :] - part.angle[:, None], 2.0 * np.pi)
    where = np.minimum((delta / (2.0 * np.pi) * PARTS).astype(np.int64), PARTS - 1)
    ring = np.arange(len(part.markers)) // (len(part.markers) // part.rings)
    for row in range(len(square)):
        seen = np.isfinite(left[..., row % 2]) & (ring == row // 2)
        over = np.where(seen, left[..., row % 2] ** 2 - part.noise[None, :, row % 2] ** 2, 0.0)
        square[row] += np.bincount(where[seen], over[seen], PARTS)
        number[row] += np.bincount(where[seen], np.broadcast_to(part.force[:, None] ** 2, where.shape)[seen], PARTS)


def _errors(fit: RingResponse, part: RingPresses) -> Float[np.ndarray, "n 8"]:
    """Return errors and deviations of angle [rad], force and shear [N] in turns, the force, and found shear / force."""
    locator = RingLocator(fit, part.markers, part.noise, RingSettings())
    rows = list[list[float]]()
    for k in range(len(part)):
        locator.reset()
        found = locator.run(part.displacements[k : k + 1])
        if found.counts[0] != 1:
            continue
        angle, force, _, t, angle_sd, force_sd, _, _, shear_sd = found.states[0, 0]
        off, wrong = float(turned(np.asarray(angle - part.angle[k]))), force * t - np.nan_to_num(part.shear[k])
        rows.append([off, angle_sd, force - part.force[k], force_sd, wrong, shear_sd, part.force[k], t])
    return np.array(rows).reshape(-1, 8)


def _beside(off: np.ndarray, known: np.ndarray, scale: np.ndarray | float) -> float:
    """Return b so that 95 % of the errors lie within 1.96 deviations of sqrt(known^2 + (b scale)^2)."""
    if not len(off):
        return 0.0
    lower, upper = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (lower + upper)
        inside = np.mean(off <= 1.96 * np.sqrt(known**2 + (middle * scale) ** 2))
        lower, upper = (lower, middle) if inside >= 0.95 else (middle, upper)
    return upper if upper > 1e-9 else 0.0
