"""Identify the pose of a surface in its sensor's frame from touches: the largest error of most real set-ups."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from palpate.calibration._screws import name_motions
from palpate.calibration._touch_evidence import Evidence, KnownPoints, SomewhereOnSurface, Spreads, fit, offset
from palpate.calibration.touch_error import spread_in_time
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
WRONG = 5.0  # of a touch: beyond it the touch is left out and named: another mark, or a slip
_USUAL = Spreads()


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
    differ in direction and whose points are not on one line determine all.

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

    def evidence(rows: Int[np.ndarray, " k"]) -> Evidence:
        touched = wrenches[rows], covariances[rows], spreads
        if points is None:
            return SomewhereOnSurface(*touched, surface)
        return KnownPoints(*touched, points[rows], surface.project(points[rows])[1])

    if len(used) == 0:
        raise _refusal(points is None, np.eye(6), spreads, notes)
    if points is not None:
        notes += _strays(points[used], surface, [names[k] for k in used], spreads.placement)
    pose, distances, scale = fit(evidence(used), initial)
    while distances.max() > WRONG * scale and len(used) > 4:
        worst = int(np.argmax(distances))
        notes.append(
            f"{names[used[worst]]} is left out: it is {distances[worst] / scale:.0f} standard deviations from the fit"
        )
        used = np.delete(used, worst)
        pose, distances, scale = fit(evidence(used), initial)
    return _judged(evidence, pose, initial, used, notes)


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


def _judged(
    evidence_of: Callable[[Int[np.ndarray, " k"]], Evidence],
    pose: Pose,
    initial: Pose,
    used: Int[np.ndarray, " k"],
    notes: list[str],
) -> Mounting:
    """Return the mounting, with its covariance and the directions that the touches determine."""
    evidence = evidence_of(used)
    prior, sizes = evidence.spreads.prior, evidence.spreads.sizes
    residual, slope = evidence.whitened(pose)
    turned = np.kron(np.eye(2), pose.rotation) * sizes  # from the surface's axes, in units of the prior
    seen = (slope @ turned).T @ (slope @ turned)
    freedom = max(1.0, 3 * len(used) - float(np.sum(np.linalg.eigvalsh(seen) > 1.0)))
    ratio = float(np.sum(residual**2)) / freedom
    if ratio > CONTRADICTED**2:
        raise InputError(
            f"the touches fit no pose of the surface: they are {ratio**0.5:.0f} times further from it than expected.",
            hint="Check that the marks are in the surface's frame, in metres and in the order of the touches, and "
            "check payload and axes in the rig.",
        )
    alike = 1.0 if isinstance(evidence, SomewhereOnSurface) else spread_in_time(residual.reshape(len(used), -1))
    widened = max(1.0, ratio) * alike

    def predict(left: Bool[np.ndarray, " k"]) -> tuple[np.ndarray, np.ndarray]:
        others = evidence_of(used[~left])
        rest = fit(others, initial)[0]
        known = _known(others.whitened(rest)[1], widened, sizes)
        away, slopes = evidence_of(used[left]).whitened(rest)
        own = slopes.T @ slopes / widened
        return slopes.T @ away / widened, own + own @ known @ own

    left = cross_validate(len(used), predict) if len(used) >= ENOUGH else Validation()
    widened *= left.widening
    values, vectors = np.linalg.eigh(seen / widened)
    blind = vectors[:, values <= 1.0]
    if blind.shape[1] == 6:
        raise _refusal(isinstance(evidence, SomewhereOnSurface), blind, evidence.spreads, notes)
    if ratio > 4.0:
        notes.append(
            f"the touches disagree {ratio**0.5:.1f} times as much as expected, so the covariance is widened by this "
            "factor"
        )
    if alike > 1.0:
        notes.append(f"successive touches have similar errors: in the covariance, {alike:.1f} of them count as one")
    far = np.abs(offset(initial, pose) / sizes).max()
    if far > 3.0:
        notes.append(
            f"the pose is {far:.1f} prior standard deviations from the initial one: check the initial pose's frame and "
            "unit"
        )
    decoupled = _known(slope, widened, sizes)
    shift = np.eye(6)
    shift[3:, :3] = skew(pose.translation)  # exp(xi) T moves the origin by rho + omega x t
    return Mounting(
        pose,
        shift @ decoupled @ shift.T,
        ratio**0.5,
        name_motions(vectors[:, values > 1.0], *prior),
        name_motions(blind, *prior),
        used,
        left,
        (*notes, *left.notes),
    )


def _known(slopes: Float[np.ndarray, "m 6"], widened: float, sizes: Float[np.ndarray, "6"]) -> np.ndarray:
    """Return the covariance of a pose by touches and its prior."""
    return np.asarray(np.linalg.inv(slopes.T @ slopes / widened + np.diag(1 / sizes**2)))


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
