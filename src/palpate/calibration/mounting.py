"""Identify the pose of a surface in its sensor's frame from touches: the largest error of most real set-ups."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from palpate.calibration._screws import name_motions
from palpate.calibration._touch_evidence import Evidence, KnownPoints, SomewhereOnSurface, Spreads, fit, offset
from palpate.calibration.touch_error import FEWEST, TouchError
from palpate.calibration.validation import Validation, cross_validate
from palpate.calls import called_as
from palpate.errors import InputError, NotIdentifiable
from palpate.spatial._arrays import frozen
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import Pose, skew
from palpate.spatial.shown import one_line
from palpate.spatial.uncertain import noise_covariance
from palpate.surfaces import Mesh

__all__ = ["Mounting", "Spreads", "identify_mounting", "mean_touches"]

SAID = 3  # notes in a refusal
ENOUGH = 8  # touches of which some can be left out
CONTRADICTED = 20.0  # times the expected residual: no pose explains such touches
UNKNOWN = 3e-3  # m: assumed error of touches too few to show it, as much as those of a finger on a flat pad have
WRONG = 5.0  # of a touch: beyond it the touch is left out and named: another mark, or a slip
SURE = 2.0  # over sqrt(n): the relative excess of the variance of n touches that is no chance, two sigma
_USUAL = Spreads()
Rows = Int[np.ndarray, " k"]


@frozen_value
class Mounting:
    """The pose of a surface in its sensor's frame, with how well the touches determine it.

    Attributes:
        pose: T_sensor_surface.
        covariance: (6, 6) of (rotation vector [rad], translation [m]), T = exp(xi) T_mean, in the sensor's frame and
            about its origin.
        residual: rms of the residuals over their expected standard deviations.
        observable: small motions, in the surface's axes, that the touches determine better than the prior does.
        unobservable: the other motions.
        touches: (k,) numbers of the touches that were used.
        validation: errors of touches that a fit did not use.
        error: errors of touches at known points beyond the noise of their wrenches.
        notes: messages for the user, one sentence each.
        provenance: sources of the data.

    Raises:
        InputError: the covariance is not (6, 6).
    """

    pose: Pose
    covariance: Float[np.ndarray, "6 6"]
    residual: float
    observable: tuple[str, ...]
    unobservable: tuple[str, ...]
    touches: Int[np.ndarray, " k"]
    validation: Validation = field(default_factory=Validation)
    error: TouchError = field(default_factory=TouchError)
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=lambda: {})

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", frozen(self.covariance, tail=(6, 6), name="covariance"))
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        self.touches.flags.writeable = False

    @property
    def position_covariance(self) -> Float[np.ndarray, "3 3"]:
        """Covariance (3, 3) [m^2] of the surface's origin in the sensor's axes."""
        moves = np.concatenate([-skew(self.pose.translation), np.eye(3)], axis=1)  # rho + omega x t, by exp(xi) T
        return moves @ self.covariance @ moves.T

    def __repr__(self) -> str:
        return one_line(self)


@called_as("palpate.identify_mounting(wrenches, mesh, initial=palpate.Pose.identity(), points=marks)")
@takes_arrays
def identify_mounting(
    wrenches: Float[np.ndarray, "n 6"],
    surface: Mesh,
    *,
    initial: Pose,
    points: Float[np.ndarray, "n 3"] | None = None,
    noise: ArrayLike | None = None,
    labels: Sequence[str] | None = None,
    spreads: Spreads = _USUAL,
) -> Mounting:
    """Identify the pose of the surface from one compensated wrench per touch, and return a `Mounting`.

    It is the most probable pose under the touches and a Gaussian prior about `initial`; outliers are omitted, one at a
    time, and named in the notes.

    With points, a touch gives M - (R p + t) x F = tau R n, two numbers for six unknowns: three touches whose forces
    differ in direction and whose points are not on one line determine all. Fewer than four do not show their own error:
    3 mm each is assumed, in addition to `placement`.

    Without points a touch informs only through the *prior* that forces press more than they drag: the unit force is
    expected within the friction of `Spreads` about -n, which on a surface of curvature radius r places the touch to
    about friction * r. An ellipsoid of 60 x 25 x 40 mm is placed to 1.2 mm and 6 degrees by 30 touches at friction 0.2.
    Touches that all drag the same way give a wrong answer without a warning. A body that looks the same when turned or
    slid keeps the initial pose in that direction.

    Args:
        wrenches: (n, 6) in the sensor frame, one per touch (`mean_touches`); a row with NaN is omitted.
        surface: mesh in the surface's frame.
        initial: T_sensor_surface as drawn or measured by hand.
        points: (n, 3) [m] touched, in the surface's frame; None: not known.
        noise: two or six standard deviations, one covariance (6, 6), or one for each touch (n, 6, 6); None: small
            relative to the placement.
        labels: names of the touches, for messages; None: their numbers.
        spreads: standard deviations of prior, placement, torsion and friction.

    Raises:
        NotIdentifiable: the touches determine no direction of the pose better than the prior.
        InputError: a mark is further from the surface than its size, no pose explains the touches, or the noise has
            another shape.
    """
    names = [f"touch {k + 1}" for k in range(len(wrenches))] if labels is None else list(labels)
    known = np.zeros((len(wrenches), 3)) if points is None else points
    used = np.flatnonzero(np.isfinite(np.concatenate([wrenches, known], axis=1)).all(axis=1) & wrenches[:, :3].any(1))
    notes = [
        f"{names[k]} is left out: it has no point, or no usable sample" for k in np.setdiff1d(range(len(names)), used)
    ]
    covariances = _noise(noise, len(wrenches))
    if len(used) == 0:
        raise _refusal(points is None, np.eye(6), spreads, notes)
    if points is not None:
        notes += _strays(points[used], surface, [names[k] for k in used], spreads.placement)
    few = points is not None and len(used) < FEWEST
    if few:
        spreads = replace(spreads, placement=float(np.hypot(spreads.placement, UNKNOWN)))
        notes.append(f"fewer than {FEWEST} touches do not show their own error: {1e3 * UNKNOWN:g} mm each is assumed")

    def evidence(rows: Rows, placed: float) -> Evidence:
        touched = wrenches[rows], covariances[rows], replace(spreads, placement=placed)
        if points is None:
            return SomewhereOnSurface(*touched, surface)
        return KnownPoints(*touched, points[rows], surface.project(points[rows])[1])

    of = partial(evidence, placed=spreads.placement)
    kept, pose, outliers = _fitted(of, used, initial, names)
    residual = _misfit(of(kept), pose)
    error = TouchError(spreads.placement) if few else of(kept).error(pose)
    if residual > CONTRADICTED:
        raise InputError(
            f"the touches fit no pose of the surface: they are {residual:.0f} times further from it than expected.",
            hint="Check that the marks are in the surface's frame, in metres and in the order of the touches, and "
            "check payload and axes in the rig.",
        )
    if error.jitter**2 > spreads.placement**2 * (1.0 + SURE / len(kept) ** 0.5):  # again, weighted by their error
        of = partial(evidence, placed=error.jitter)
        kept, pose, outliers = _fitted(of, used, initial, names)
        error = of(kept).error(pose)
    return _judged(of, kept, pose, initial, error, residual, [*notes, *outliers])


@takes_arrays
def mean_touches(
    time: Float[np.ndarray, " m"],
    wrenches: Float[np.ndarray, "m 6"],
    start: Float[np.ndarray, " n"],
    end: Float[np.ndarray, " n"],
    noise: ArrayLike | None = None,
    covariances: Float[np.ndarray, "m 6 6"] | None = None,
) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"]]:
    """Return a wrench (n, 6) and its covariance (n, 6, 6) of each touch, the mean of its finite samples.

    The wrench of a touch without samples is NaN.

    Args:
        time: (m,) [s].
        wrenches: (m, 6) [N, N m].
        start: (n,) [s] of the touches.
        end: (n,) [s] of the touches, included.
        noise: two or six standard deviations, or covariance (6, 6), of one sample, which average out; None: 0.
        covariances: (m, 6, 6) common to the samples of a touch; None: 0.

    Raises:
        InputError: `noise` is no standard deviations or covariance; or arrays of other shapes.
    """
    single = np.zeros((6, 6)) if noise is None else noise_covariance(noise)
    means, spreads = np.full((len(start), 6), np.nan), np.zeros((len(start), 6, 6))
    finite = np.isfinite(wrenches).all(axis=1)
    for k, (first, last) in enumerate(zip(start, end, strict=True)):
        inside = finite & (time >= first) & (time <= last)
        if inside.any():
            means[k] = wrenches[inside].mean(axis=0)
            common = 0.0 if covariances is None else covariances[inside].mean(axis=0)
            spreads[k] = single / inside.sum() + common
    return means, spreads


def _noise(noise: ArrayLike | None, count: int) -> Float[np.ndarray, "n 6 6"]:
    array = np.zeros(6) if noise is None else np.asarray(noise, dtype=np.float64)
    if array.shape == (count, 6, 6):
        return array
    return np.broadcast_to(noise_covariance(array), (count, 6, 6))


def _fitted(
    of: Callable[[Rows], Evidence], rows: Rows, initial: Pose, names: Sequence[str]
) -> tuple[Int[np.ndarray, " j"], Pose, list[str]]:
    """Return the rows of the touches without outliers, the pose by them, and a note on each outlier."""
    notes = list[str]()
    pose, distances, scale = fit(of(rows), initial)
    while distances.max() > WRONG * scale and len(rows) > 4:
        worst = int(np.argmax(distances))
        notes.append(
            f"{names[rows[worst]]} is left out: it is {distances[worst] / scale:.0f} standard deviations from the fit"
        )
        rows = np.delete(rows, worst)
        pose, distances, scale = fit(of(rows), initial)
    return rows, pose, notes


def _judged(
    of: Callable[[Rows], Evidence],
    used: Rows,
    pose: Pose,
    initial: Pose,
    error: TouchError,
    residual: float,
    notes: list[str],
) -> Mounting:
    """Return the mounting, with its covariance and the directions that the touches determine."""
    evidence = of(used)
    spreads, sizes, white = evidence.spreads, evidence.spreads.sizes, max(1.0, _misfit(evidence, pose)) ** 2

    def predict(left: Bool[np.ndarray, " k"]) -> tuple[np.ndarray, np.ndarray]:
        others, omitted = of(used[~left]), of(used[left])
        rest = fit(others, initial)[0]
        away, slopes = omitted.whitened(rest)
        each = omitted.information(rest) / white
        own = each.sum(axis=0)
        spread = own + error.carried(each[:, :, 3:]) + own @ _covariance(others, rest, error, white) @ own
        return slopes.T @ away / white, spread

    left = cross_validate(len(used), predict) if len(used) >= ENOUGH else Validation()
    covariance = _covariance(evidence, pose, error, white, left.widening)
    unit = np.kron(np.eye(2), pose.rotation.T) / sizes[:, None]  # to the surface's axes, in units of the prior
    shares, motions = np.linalg.eigh(unit @ covariance @ unit.T)
    seen, blind = motions[:, shares < 0.5], motions[:, shares >= 0.5]
    if not seen.shape[1]:
        raise _refusal(isinstance(evidence, SomewhereOnSurface), blind, spreads, notes)
    shift = np.eye(6)
    shift[3:, :3] = skew(pose.translation)  # exp(xi) T moves the origin by rho + omega x t
    return Mounting(
        pose,
        shift @ covariance @ shift.T,
        residual,
        name_motions(seen, *spreads.prior),
        name_motions(blind, *spreads.prior),
        used,
        left,
        error,
        (*notes, *_remarks(residual, error, spreads, offset(initial, pose)), *left.notes),
    )


def _remarks(residual: float, error: TouchError, spreads: Spreads, moved: Float[np.ndarray, "6"]) -> Iterator[str]:
    """Yield notes on what is unusual about the touches or the pose."""
    if residual > 2.0:
        yield (
            f"the touches disagree {residual:.1f} times as much as expected, so the covariance is widened by this "
            "factor"
        )
    if error.drift > spreads.placement:
        yield (
            f"touches that follow each other have similar errors of {1e3 * error.drift:.2g} mm, alike over some "
            f"{error.lasting:.0f} touches: marks or sensor drift, which the covariances include"
        )
    far = float(np.abs(moved / spreads.sizes).max())
    if far > 3.0:
        yield (
            f"the pose is {far:.1f} prior standard deviations from the initial one: check the initial pose's frame and "
            "unit"
        )


def _misfit(evidence: Evidence, pose: Pose) -> float:
    """Return the rms of the touches' residuals at their fitted pose, in expected standard deviations."""
    residual, slope = evidence.whitened(pose)
    sizes = evidence.spreads.sizes
    fitted = np.sum(np.linalg.eigvalsh(slope.T @ slope * np.outer(sizes, sizes)) > 1.0)
    return float(np.sum(residual**2) / max(1.0, 3 * len(evidence.wrenches) - fitted)) ** 0.5


def _covariance(
    evidence: Evidence, pose: Pose, error: TouchError, white: float, widening: float = 1.0
) -> Float[np.ndarray, "6 6"]:
    """Return the covariance of (omega, delta) of a pose fitted to touches and its prior.

    It is the fit's own, (sum I + 1/prior)^-1, and that by a drift of the touches, which is a shift of the surface.
    """
    each, prior = evidence.information(pose) / (white * widening), np.diag(1.0 / evidence.spreads.sizes**2)
    fitted = np.asarray(np.linalg.inv(each.sum(axis=0) + prior), dtype=np.float64)
    return fitted + widening * fitted @ error.carried(each[:, :, 3:]) @ fitted


def _refusal(free: bool, blind: Float[np.ndarray, "6 k"], spreads: Spreads, notes: Sequence[str]) -> NotIdentifiable:
    hint = (
        "Touch more places, where the surface curves in different ways, or touch marked points."
        if free
        else "Touch at least three marks that are not on one line, and push in different directions."
    )
    more = f"; and {len(notes) - SAID} more notes" if len(notes) > SAID else ""
    found = f" Also: {'; '.join(notes[:SAID])}{more}." if notes else ""
    return NotIdentifiable(
        f"the touches determine the mounting no better than the initial pose and its prior do. {hint}{found}",
        rank=0,
        missing=name_motions(blind, *spreads.prior),
    )


def _strays(points: Float[np.ndarray, "n 3"], surface: Mesh, names: Sequence[str], placement: float) -> list[str]:
    """Return notes on marks off the surface."""
    gaps = np.linalg.norm(surface.project(points)[0] - points, axis=1)
    absurd = np.flatnonzero(gaps > surface.size)
    if len(absurd):
        raise InputError(
            f"{len(absurd)} of {len(names)} marks are further from the surface than its size "
            f"({names[absurd[0]]}: {gaps[absurd[0]]:.3g} m).",
            hint="Check that the marks are in the surface's frame, in metres, and that the unit of the mesh is right.",
        )
    return [
        f"{name} is {gap * 1e3:.1f} mm off the surface: check that the marks are in its frame and in metres"
        for name, gap in zip(names, gaps, strict=True)
        if gap > max(4 * placement, 1e-3)
    ]
