"""Describe what taxels with three axes read under a force: the gains of each, and how a force spreads to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from math import inf

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.sensors.taxels import _loads
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value

__all__ = ["AXES", "TaxelResponse"]

AXES = 3
_WIDTHS = np.array(_loads.WIDTHS)
FAR = 60.0  # K from the temperature of the calibration, which no skin is in use
_GUESS, _ROUGH = 0.6, 0.1  # pitches that a force reaches, and the share by which that is off, where nothing is known


@frozen_value
class TaxelResponse(Value):
    """The loads of k taxels with three axes by their readings, and how a force spreads to them.

    A load [N] is along the taxel's two tangents and into the body. Lengths are in pitches.

    Attributes:
        gains: (k, 3, 3) load [N] for each count: load = gains (reading - rest).
        pitch: [m], the unit of lengths.
        shares: (5, 4) of the Gaussians in the profiles A, B, C, G, H of `palpate.sensors.taxels._loads`.
        coupling: (5, 4) of the Gaussians with which a load spreads to the readings of its neighbours, as the field of
            a magnet does; what they read of each other is taken off.
        misfit: (2,) shares of the largest load, and of a taxel's own, by which loads differ from this model.
        patch: (3,) variance of the pressed patch, counted from a usual one: a + b F^(2/3) by the normal force F [N],
            and its standard deviation.
        curve: (5,) corrects a fitted force: normal c0 n + c1 n^2 + c2 t^2, tangential (c3 + c4 n) t.
        widening: (3,) factors of the standard deviations of place, normal and tangential force by the loads.
        inexact: (3,) standard deviations beside them: of the place, and of both as shares of the force. With these,
            `widening` and `unusual`, 95 % of presses that the fit left out lie within their 95 % bounds.
        unusual: (3,) what is added to `inexact`, squared, where the shape of a touch is 1, in proportion to the shape.
        usual_misfit: `TaxelEstimator.misfit` of the presses; inf: not known.
        sums: the taxels bear all of a force among them, as pillars do: force and place are sums of their loads.
        late: (3,) readings are the load and a share of what it was before, exponentially over a time: the time [s], the
            share, and its standard deviation.
        drift: [s] time within which the rest is followed best; inf: not known.
        limits: (2,) lowest and highest reading; a taxel with a reading there has no weight.
        temperature: [K or degrees C] to which readings are corrected.
        thermal: (k, 3) [counts] taken off each reading by a kelvin more, once `fade` is made good; (0, 3): not known.
        fade: share of a reading that a kelvin more takes away.
        provenance: origin of the response; {}: it is a guess.
        notes: notes for the user, a sentence each.

    Raises:
        InputError: arrays of other shapes, gains that are not finite, or a pitch that is not positive.
    """

    gains: Float[np.ndarray, "k 3 3"]
    pitch: float
    shares: Float[np.ndarray, "5 4"]
    misfit: Float[np.ndarray, "2"]
    patch: Float[np.ndarray, "3"]
    curve: Float[np.ndarray, "5"]
    widening: Float[np.ndarray, "3"]
    coupling: Float[np.ndarray, "5 4"] = field(default_factory=lambda: np.zeros((5, len(_loads.WIDTHS))))
    inexact: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    unusual: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    usual_misfit: float = inf
    sums: bool = False
    late: Float[np.ndarray, "3"] = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    drift: float = inf
    limits: Float[np.ndarray, "2"] = field(default_factory=lambda: np.array([-inf, inf]))
    temperature: float = 0.0
    thermal: Float[np.ndarray, "m 3"] = field(default_factory=lambda: np.zeros((0, AXES)))
    fade: float = 0.0
    provenance: Mapping[str, str] = field(default_factory=lambda: {})
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        vars(self).update({name: frozen(each) for name, each in vars(self).items() if hasattr(each, "flags")})
        if not (self.pitch > 0 and np.isfinite(self.gains).all()):
            raise InputError("gains must be finite, and the pitch positive.", where="response")

    def __len__(self) -> int:
        return len(self.gains)

    @classmethod
    def guessed(cls, count: int, pitch: float, gain: float = 1.0) -> TaxelResponse:
        """Return a response of `count` taxels that was not measured: one count is taken for `gain` [N] on each axis."""
        shares = np.zeros((5, len(_loads.WIDTHS)))
        shares[[0, 2], _loads.WIDTHS.index(_GUESS)] = 0.5 / (np.pi * _GUESS**2)
        gains = np.tile(gain * np.eye(AXES), (count, 1, 1))
        straight = np.array([1.0, 0.0, 0.0, 1.0, 0.0])
        misfit, patch = np.array([0.5 * _ROUGH, _ROUGH]), np.array([0.0, 0.0, _ROUGH])
        return cls(gains, pitch, shares, misfit, patch, straight, np.ones(3))

    def loads(self, readings: Float[np.ndarray, "n k 3"]) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n m"]]:
        """Return loads [N] by readings (n, k, 3): into the body (n, k), and along the tangents (n, 2 k), one in front.

        Neither the rest nor `coupling` is taken off. Where one reading of a taxel is not finite or at its limit, its
        loads are NaN.

        Raises:
            InputError: readings of another shape.
        """
        full = self._full(readings)
        found = np.einsum("kab,nkb->nak", self.gains, np.where(full, np.nan, readings) if full.any() else readings)
        return np.ascontiguousarray(found[:, 2]), found[:, :2].reshape(len(found), 2 * readings.shape[1])

    def corrected(
        self, readings: Float[np.ndarray, "n k 3"], kelvin: Float[np.ndarray, " n"], source: str = ""
    ) -> Float[np.ndarray, "n k 3"]:
        """Return readings as they would be at `temperature`, NaN where `kelvin` is; those at `limits` are unchanged.

        Args:
            readings: (n, k, 3) [counts].
            kelvin: (n,) temperature of each frame, in the unit of `temperature`.
            source: names the readings in messages.

        Raises:
            InputError: the temperatures are far from those of the calibration, or arrays of other shapes.
        """
        if not len(self.thermal):
            return readings
        warmer = np.where(np.abs(kelvin - self.temperature) > FAR, np.nan, kelvin - self.temperature)
        if np.isfinite(kelvin).any() and not np.isfinite(warmer).any():
            what = f"the temperature is {np.nanmedian(kelvin):.4g}, and was {self.temperature:.4g} in the calibration."
            raise InputError(what, where=source, hint="Name a temperature of the same sensor, in the same unit.")
        usual = readings + (self.fade * readings - self.thermal) * warmer[:, None, None]
        return frozen(np.where(self.full(readings), readings, usual))

    def full(self, readings: Float[np.ndarray, "n k 3"]) -> Bool[np.ndarray, "n k 3"]:
        """Return which readings are at `limits`.

        Raises:
            InputError: readings of another shape.
        """
        return self._full(readings)

    def _full(self, readings: Float[np.ndarray, "n k 3"]) -> Bool[np.ndarray, "n k 3"]:
        return (readings <= self.limits[0]) | (readings >= self.limits[1])

    def numbers(self) -> Float[np.ndarray, " m"]:
        """Return the model as the array that the compiled fit reads."""
        parts = [self.pitch], self.misfit, self.patch, self.curve, self.widening, self.inexact, self.unusual
        return frozen(np.concatenate([self.shares.ravel(), *parts, [self.sums], self.late]))

    def spread_of(
        self, offset: Float[np.ndarray, "n 2"], force: Float[np.ndarray, "n 3"], patch: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n 3"]:
        """Return the loads (n, 3) [N] at offsets [pitches] from forces [N], along both tangents and into the body.

        Raises:
            InputError: arrays of other shapes.
        """
        value, ratio, wide = _smeared(offset, patch)
        even, odd, own, turned, pushed = self.shares
        narrow, along, press = ratio * value, (offset * force[:, :2]).sum(axis=1), force[:, 2]
        inwards = (value @ even) * press + (narrow @ (odd / _WIDTHS)) * along
        away = (narrow / wide) @ turned * along + narrow @ (pushed / _WIDTHS) * press
        across = (value @ own + (value - narrow) @ turned)[:, None] * force[:, :2] + away[:, None] * offset
        return np.column_stack([across, inwards])


def _smeared(offset: np.ndarray, patch: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the Gaussians (n, 4) at offsets, smeared by a patch, by how much they fall, and their variances."""
    wide = _WIDTHS**2 + patch[:, None]
    ratio = _WIDTHS**2 / wide
    return ratio * np.exp(-0.5 * (offset**2).sum(axis=1)[:, None] / wide), ratio, wide


def response_terms(
    offset: Float[np.ndarray, "n 2"], force: Float[np.ndarray, "n 3"], patch: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 3 5 4"]:
    """Return the loads (n, 3, 5, 4) of which `TaxelResponse.shares` makes the sum; arguments as of `spread_of`."""
    value, ratio, wide = _smeared(offset, patch)
    along = (offset * force[:, :2]).sum(axis=1)
    terms = np.zeros((len(offset), AXES, 5, len(_WIDTHS)))
    terms[:, 2, 0], terms[:, 2, 1] = value * force[:, 2:], ratio * value / _WIDTHS * along[:, None]
    own, turned = force[:, :2, None], (offset * along[:, None])[..., None]
    terms[:, :2, 2] = value[:, None] * own
    terms[:, :2, 3] = (ratio * value / wide)[:, None] * turned + ((1.0 - ratio) * value)[:, None] * own
    terms[:, :2, 4] = (ratio * value / _WIDTHS)[:, None] * (offset * force[:, 2:])[..., None]
    return terms


def coupling_terms(
    steps: Float[np.ndarray, "k m 2"], neighbours: Int[np.ndarray, "k m"]
) -> Float[np.ndarray, "k m 3 3 5 4"]:
    """Return the loads of which `TaxelResponse.coupling` makes the sum, of each taxel by the loads of its neighbours.

    Args:
        steps: (k, m, 2) to each neighbour [pitches].
        neighbours: (k, m), -1 for none.
    """
    away = -steps.reshape(-1, 2)
    ways = [response_terms(away, np.tile(way, (len(away), 1)), np.zeros(len(away))) for way in np.eye(AXES)]
    terms = np.stack(ways, axis=2).reshape(*neighbours.shape, AXES, AXES, 5, -1)
    return terms * (neighbours >= 0)[..., None, None, None, None]
