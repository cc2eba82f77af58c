"""Find the forces of several contacts: a skin gives place and normal force of each, a wrench the sum of all.

The two give each contact's complete force, because friction bounds the tangential force.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.sensors.fused import _kernels
from palpate.sensors.fused.cones import within_cones
from palpate.sensors.fused.unseen import PUSHES, LockedValue, Unseen, candidates, ranked
from palpate.spatial._arrays import require_finite, require_shape, shaped
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.surfaces.surface import Surface

__all__ = ["Fused", "FusedLocator", "FusionSettings"]

WAYS = 32  # places that stand for all where an unseen contact may be: with 16, forces hold 1 to 2 % less often
_BINDS = 1e-6  # slack over 1 N plus the normal force below which a cone binds


@dataclass(frozen=True)
class FusionSettings:
    """Settings of the fusion: the prior of the forces, and the rate of false alarms.

    Args:
        friction: bound of a contact's tangential over its normal force, > 0.
        tangential: standard deviation of each of the two components of the tangential force, as a share of the normal
            force, from 0 to `friction`; 0.25 if it is uniform in a disc of half the normal force.
        gain: standard deviation of the skin's normal force as a share of it, in [0, 1).
        floor: [N] standard deviation of the normal force in addition, >= 0.
        alarm: accepted share of false alarms, between 0 and 0.5.
        turns: number of times that what is proportional to the forces is computed again.

    Raises:
        InputError: a setting is out of its range.
    """

    friction: float = 0.6
    tangential: float = 0.25
    gain: float = 0.10
    floor: float = 0.0
    alarm: float = 0.01
    turns: int = 2

    def __post_init__(self) -> None:
        if not 0 < self.friction < inf:
            raise InputError(f"friction must be positive, not {self.friction:g}.")
        if not 0 <= self.tangential <= self.friction:
            raise InputError(f"tangential ({self.tangential:g}) must be between 0 and friction ({self.friction:g}).")
        if not 0 <= self.gain < 1:
            raise InputError(f"gain must be from 0 to below 1, not {self.gain:g}.")
        if not 0 <= self.floor < inf:
            raise InputError(f"floor must be finite and not negative, not {self.floor:g} N.")
        if self.turns < 0:
            raise InputError(f"turns must not be negative, not {self.turns}.")
        if not 0 < self.alarm < 0.5:
            raise InputError(f"alarm must be between 0 and 0.5, not {self.alarm:g}.")


@frozen_value
class Fused(LockedValue):
    """Forces of n contacts, and how well the wrenches of k sensors fit them.

    Attributes:
        force: (n, 3) [N] on the body, within the cones of friction.
        covariance: (3n, 3n) [N^2] of the forces, not narrowed by cones.
        share: (n,) posterior over prior standard deviation of the tangential force.
        slack: (n,) [N] friction times the normal less the tangential force.
        bound: (n,) whether the cone of friction binds.
        expected: (k, 6) [N, N m] from the skin alone; NaN without a wrench, as `surprise` and `p`.
        surprise: (k,) squared Mahalanobis distance of the wrench from the expected one, for one sensor with the step
            into the cones.
        p: (k,) share of touches without an unseen contact whose wrench is as far off.
        alarm: whether a contact pushes that the skin does not feel.
        whitened: (h, 6) of the h finite wrenches: less the expected one, whitened by `factors`.
        factors: (h, 6, 6) L D L^T of that difference's covariance.
        notes: a sentence each.
    """

    force: Float[np.ndarray, "n 3"]
    covariance: Float[np.ndarray, "m m"]
    share: Float[np.ndarray, " n"]
    slack: Float[np.ndarray, " n"]
    bound: Bool[np.ndarray, " n"]
    expected: Float[np.ndarray, "k 6"]
    surprise: Float[np.ndarray, " k"]
    p: Float[np.ndarray, " k"]
    alarm: bool
    whitened: Float[np.ndarray, "h 6"]
    factors: Float[np.ndarray, "h 6 6"]
    notes: tuple[str, ...] = ()


class FusedFrames(NamedTuple):
    """Forces of the m contacts of n frames, frame by frame, and how well each frame's wrench fits them.

    Attributes:
        force, share, bound: (m, 3) [N], (m,) and (m,), see `Fused`.
        spread: (m, 6) [N^2] covariance of each force: xx, xy, xz, yy, yz, zz.
        p, alarm: (n,), see `Fused`.
        whitened, factors: (n, 6) and (n, 6, 6), see `Fused`; NaN without a wrench.
        notes: a sentence each.
    """

    force: Float[np.ndarray, "m 3"]
    share: Float[np.ndarray, " m"]
    bound: Bool[np.ndarray, " m"]
    spread: Float[np.ndarray, "m 6"]
    p: Float[np.ndarray, " n"]
    alarm: Bool[np.ndarray, " n"]
    whitened: Float[np.ndarray, "n 6"]
    factors: Float[np.ndarray, "n 6 6"]
    notes: tuple[str, ...]


@takes_arrays
class FusedLocator:
    """An estimator of the forces of several contacts of a body, from its skin and its force/torque sensors.

    All quantities are in the surface's frame, wrenches about its origin.

    Args:
        surface: of the body, searched for contacts that the skin does not feel.
        settings: None: the defaults.
    """

    def __init__(self, surface: Surface, settings: FusionSettings | None = None) -> None:
        self.surface, self.settings = surface, settings or FusionSettings()
        set_ = self.settings
        self._settings = np.array([set_.tangential, set_.gain, set_.floor, set_.friction, set_.turns])

    def fuse(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        forces: ArrayLike,
        deviations: ArrayLike,
        spreads: ArrayLike,
        wrenches: ArrayLike,
        covariances: ArrayLike,
        carries: ArrayLike | None = None,
        shear: ArrayLike | None = None,
    ) -> Fused:
        """Return the forces of n contacts felt by k sensors as a `Fused`.

        Args:
            points: (n, 3) [m] on the skin.
            normals: (n, 3) outward, of any length.
            forces: (n,) [N] normal forces from the skin, >= 0.
            deviations: (n,) [N] of the forces, in addition to the settings' gain and floor.
            spreads: (n, 3, 3) [m^2] covariances of the points.
            wrenches: (k, 6) [N, N m]; one that is not finite is not used.
            covariances: (k, 6, 6) of the wrenches' noise.
            carries: (k, n) whether a sensor feels a contact; None: each feels all.
            shear: as of `rows`.

        Raises:
            InputError: shapes do not fit, a force or deviation is negative, a contact is not finite, or a normal is 0.
        """
        contacts = self.rows(points, normals, forces, deviations, spreads, shear)
        wrenches = shaped(wrenches, (None, 6), "wrenches")
        covariances = shaped(covariances, (len(wrenches), 6, 6), "covariances")
        shape = (len(wrenches), len(contacts))
        felt = np.ones(shape, np.bool_) if carries is None else np.array(carries, np.bool_)
        require_shape(felt, shape, "carries")
        return self._fused(contacts, wrenches, covariances, felt)

    def fuse_frames(
        self,
        contacts: Float[np.ndarray, "m 21"],
        counts: Int[np.ndarray, " n"],
        wrenches: Float[np.ndarray, "n 6"],
        covariances: Float[np.ndarray, "n 6 6"],
    ) -> FusedFrames:
        """Return the forces of n frames, each as by `fuse` with one wrench that feels all contacts, as `FusedFrames`.

        Args:
            contacts: (m, 21) rows of `rows`, frame by frame.
            counts: (n,) number of contacts in each frame.
            wrenches: (n, 6) [N, N m]; one that is not finite is not used.
            covariances: (n, 6, 6) of the wrenches' noise.

        Raises:
            InputError: a count is negative, or the counts do not add up to m; or arrays of other shapes.
        """
        if counts.min(initial=0) < 0 or counts.sum() != len(contacts):
            raise InputError(f"counts must not be negative, and must add up to the {len(contacts)} contacts.")
        out, spread, broken = np.zeros((len(contacts), 5)), np.zeros((len(contacts), 6)), np.zeros_like(counts)
        totals, factors = np.zeros((len(counts), 16)), np.zeros((len(counts), 6, 6))
        ends = np.cumsum(9 * counts**2)
        covariance = np.zeros(ends[-1] if len(ends) else 0)
        into = (out, spread, covariance, totals, factors, broken)
        _kernels.fuse_frames(contacts, counts, wrenches, covariances, self._settings, *into)
        outside, notes = broken > 0, tuple[str, ...]()
        if outside.any():
            which, off = np.repeat(outside, counts), totals[outside]
            size, at = 3 * counts[outside], ends[outside]
            wholes = [covariance[end - n * n : end].reshape(n, n) for n, end in zip(size, at, strict=True)]
            given = (out[which, :3], contacts[which, 3:6], counts[outside], wholes)
            out[which, :3], notes = self._within(*given, off)
            totals[outside] = off
        force, p, whitened = out[:, :3].copy(), totals[:, 9], totals[:, 10:].copy()
        _, bound = self._slack(force, contacts[:, 3:6])
        return FusedFrames(force, out[:, 3], bound, spread, p, p < self.settings.alarm, whitened, factors, notes)

    @staticmethod
    def rows(
        points: ArrayLike,
        normals: ArrayLike,
        forces: ArrayLike,
        deviations: ArrayLike,
        spreads: ArrayLike,
        shear: ArrayLike | None = None,
    ) -> Float[np.ndarray, "n 21"]:
        """Return contacts (n, 21): point [m], unit normal, force, its deviation [N], spread [m^2] row by row, shear.

        Arguments are those of `fuse`, and shear (n, 4): the tangential force [N] that the skin feels, and one over the
        variance of each component [1/N^2], 0 for none; None: it feels none.

        Raises:
            InputError: shapes do not fit, a force or deviation is negative, a number is not finite, or a normal is 0.
        """
        points = shaped(points, (None, 3), "points")
        count = len(points)
        normals, spreads = shaped(normals, (count, 3), "normals"), shaped(spreads, (count, 3, 3), "spreads")
        forces, deviations = shaped(forces, (count,), "forces"), shaped(deviations, (count,), "deviations")
        felt = np.zeros((count, 4)) if shear is None else shaped(shear, (count, 4), "shear")
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            contacts = np.column_stack([points, normals / length, forces, deviations, spreads.reshape(-1, 9), felt])
        if not np.isfinite(contacts).all():
            raise InputError("contacts must be finite, and normals must not be zero.")
        if (forces < 0).any() or (deviations < 0).any():
            raise InputError(
                "normal forces and their deviations must not be negative.",
                hint="Write a force that presses as positive.",
            )
        return contacts

    def _fused(
        self,
        contacts: Float[np.ndarray, "n 21"],
        wrenches: Float[np.ndarray, "k 6"],
        covariances: Float[np.ndarray, "k 6 6"],
        carries: Bool[np.ndarray, "k n"],
    ) -> Fused:
        heard = np.isfinite(wrenches).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
        count, sensors = len(contacts), int(heard.sum())
        work = np.zeros(_kernels.room(count, sensors))
        out, covariance = np.zeros((count, 5)), np.zeros((3 * count, 3 * count))
        totals, factors = np.full((sensors, 16), np.nan), np.empty((sensors, 6, 6))
        given = (contacts, wrenches[heard], covariances[heard], carries[heard])
        broken = _kernels.fuse(*given, self._settings, work, out, covariance, totals, factors)
        force, notes = out[:, :3], tuple[str, ...]()
        if broken:  # of several sensors, nothing says whose wrench is that much further off
            off = totals if sensors == 1 else np.zeros((1, 16))
            force, notes = self._within(force, contacts[:, 3:6], np.array([count]), [covariance], off)
        slack, bound = self._slack(force, contacts[:, 3:6])
        fit = np.full((len(wrenches), 10), np.nan)
        fit[heard] = totals[:, :10]
        alarm = bool((totals[:, 9] * sensors < self.settings.alarm).any())
        by_sensor = (fit[:, :6].copy(), fit[:, 6].copy(), fit[:, 9].copy())
        misfit = (totals[:, 10:].copy(), factors)
        return Fused(force, covariance, out[:, 3].copy(), slack, bound, *by_sensor, alarm, *misfit, notes)

    def _within(
        self,
        force: Float[np.ndarray, "m 3"],
        normals: Float[np.ndarray, "m 3"],
        counts: Int[np.ndarray, " n"],
        covariances: list[np.ndarray],
        totals: Float[np.ndarray, "n 16"],
    ) -> tuple[Float[np.ndarray, "m 3"], tuple[str, ...]]:
        """Return forces within their cones, and notes; add each frame's squared step to `totals`."""
        force, further, notes = within_cones(force, normals, counts, covariances, self.settings.friction)
        totals[:, 6] += further
        totals[:, 9] = [_kernels.rarity(*each) for each in totals[:, 6:9].tolist()]
        return force, notes

    def _slack(
        self, force: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        """Return friction times the normal less the tangential force (n,) [N], and whether the cone binds (n,)."""
        normal = -np.einsum("ni,ni->n", force, normals)
        across = np.linalg.norm(force + normal[:, None] * normals, axis=1)
        slack = self.settings.friction * normal - across
        return slack, slack <= _BINDS * (1.0 + np.abs(normal))

    def unseen_by(self, whitened: Float[np.ndarray, "6"], factor: Float[np.ndarray, "6 6"]) -> Unseen:
        """Return as `Unseen` the places of one more contact that a wrench feels and the skin does not.

        `whitened` and `factor`: of a wrench, as in `Fused` and `FusedFrames`.

        Raises:
            InputError: a number is not finite, as in a frame without a wrench.
        """
        require_finite(whitened, "whitened")
        require_finite(factor, "factor")
        out = np.zeros((len(self._places), 4))
        _kernels.explained(self._places, whitened, factor, self.settings.tangential, PUSHES, out)
        return ranked(self._places, out, self._width)

    def unseen_rows(self, unseen: Unseen) -> Float[np.ndarray, "w 21"]:
        """Return an unseen contact as rows (w, 21) of `rows`, one for each of `WAYS` places that are equally likely.

        Its force is 5.8 N with a deviation of 6.0 N.
        """
        shares: Float[np.ndarray, " c"] = np.cumsum(unseen.belief)
        evenly: Float[np.ndarray, " w"] = shares[-1] * (np.arange(WAYS) + 0.5) / WAYS
        places: Int[np.ndarray, " w"] = np.searchsorted(shares, evenly)
        normals = unseen.normals[places]
        spreads = self._width**2 * (np.eye(3) - normals[:, :, None] * normals[:, None, :])
        pushes = np.tile([PUSHES.mean(), PUSHES.std()], (len(places), 1))
        none = np.zeros((len(places), 4))
        return np.concatenate([unseen.points[places], normals, pushes, spreads.reshape(-1, 9), none], axis=1)

    @cached_property
    def _places(self) -> Float[np.ndarray, "c 8"]:
        """Places (c, 8) that are searched for unseen contacts, see `candidates`."""
        return candidates(self.surface)

    @cached_property
    def _width(self) -> float:
        """Median standard deviation [m] of the area that a place stands for."""
        return float(np.median(self._places[:, 7]))
