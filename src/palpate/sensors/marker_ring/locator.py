"""Find contacts in the displacements of a soft ring's markers: number, angles, forces, widths and shears."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, radians

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.optical.fisheye import STEPS, flat_pixels
from palpate.optical.ring_response import RingResponse
from palpate.sensors.marker_ring.model import MarkerRing
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import frozen_value, takes_arrays

_TABLE = 720  # angles of the response's table
_ROUGH = 0.8  # coefficient of friction of bodies, at most, where none is stated
_NO_SHEAR = 1e-6  # standard deviation of shear / force where shear was not calibrated: none


@dataclass(frozen=True)
class RingSettings:
    """Settings of the search for contacts.

    Args:
        on: standard deviations of the markers' noise that a contact must explain to begin.
        off: standard deviations of the markers' noise below which a contact ends.
        apart: least angle between two contacts [deg].
        dropped: number of markers of an image that may be omitted.
        shift: standard deviation of the shift of a contact by a neighbour 30 degrees away [deg].
        friction: standard deviation of shear / force; None: that of the calibration, and intervals have shears by
            neighbours up to 0.8 of the force.
        wide: standard deviation of a contact's width, in those of the calibration's widths.
        reach: distance by which a contact may move between images and keep its identity [m].
        speed: at which a contact may move in addition [m/s].
        patience: time for which a lost contact keeps its identity [s].

    Raises:
        InputError: a setting is out of its range.
    """

    on: float = 5.5
    off: float = 4.0
    apart: float = 18.0
    dropped: int = 4
    shift: float = 0.5
    friction: float | None = None
    wide: float = 1.0
    reach: float = 0.008
    speed: float = 0.5
    patience: float = 0.2

    def __post_init__(self) -> None:
        if not 0 < self.off <= self.on < inf:
            raise InputError(f"off ({self.off:g}) must be between 0 and on ({self.on:g}).")
        if not 0 < self.apart < 180:
            raise InputError(f"apart must be between 0 and 180 degrees, not {self.apart:g}.")
        if self.dropped < 0 or not (self.wide > 0 and self.shift >= 0 and (self.friction is None or self.friction > 0)):
            raise InputError("dropped and shift must not be negative, and friction and wide must be positive.")
        if not (self.reach > 0 and self.speed >= 0 and self.patience >= 0):
            raise InputError("reach must be positive, and speed and patience must not be negative.")


@frozen_value
class RingFound:
    """Contacts of n images.

    Attributes:
        states: (n, most, 9) angle [rad], force [N], width (in standard deviations of the calibration's), shear / force,
            standard deviations of angle [rad], force [N] and depth [m], the rise of chi-square without the contact, and
            the standard deviation of shear [N].
        counts: (n,) number of contacts; -1: fewer than half of the markers were seen.
        residual: (n,) root of chi-square over its degrees of freedom.
    """

    states: Float[np.ndarray, "n most 9"]
    counts: Int[np.ndarray, " n"]
    residual: Float[np.ndarray, " n"]


@takes_arrays
class RingLocator:
    """Finder of contacts in displacements; each search starts from the contacts of the image before.

    Args:
        response: response of the ring.
        markers: (m,) angles at rest [rad], ring by ring.
        noise: (m, 2) standard deviation of a displacement [m], outwards and along.
        settings: settings of the search; None: the defaults.
        skin: radii of the outer surface and of the markers [m]; None: contacts do not move the skin under others.

    Attributes:
        grip: largest shear / force with which a contact is expected to resist the skin's motion by its neighbours.
    """

    def __init__(
        self,
        response: RingResponse,
        markers: Float[np.ndarray, " m"],
        noise: Float[np.ndarray, "m 2"],
        settings: RingSettings | None = None,
        skin: tuple[float, float] | None = None,
    ) -> None:
        from palpate.sensors.marker_ring import _kernels as _ring  # compiled: loaded when first needed

        self.response, self.settings = response, settings or RingSettings()
        self.markers = np.array(markers, dtype=np.float64)
        set_, (middle, wide, usual), kinds = self.settings, response.usual.tolist(), np.zeros(3)
        self.grip, most = response.grip, max(response.grip, _ROUGH) if response.grip else 0.0
        if not response.shears:
            usual, self.grip, most = _NO_SHEAR, 0.0, 0.0
        elif set_.friction is None:
            kinds = response.dragged.copy()
        else:
            self.grip = most = response.grip * min(1.0, set_.friction / usual)
            usual = set_.friction
        table, slope = response.tables(self.markers, _TABLE)
        model = (table, slope, np.array([set_.wide * wide, max(usual, kinds[2]), middle, response.sheared[3]]))
        numbers = np.array([set_.on, set_.off, radians(set_.apart), float(set_.dropped), radians(set_.shift)])
        moved = np.zeros((2, 3, 1, 1)) if skin is None else response.skin(*skin)
        outer, grips = (np.inf, np.zeros(2)) if skin is None else (skin[0], np.array([self.grip, most]))
        spread = np.concatenate([response.spread, response.sheared[:3]])
        learned = (response.width.copy(), spread, moved, outer, grips, usual, response.carried.copy(), kinds)
        squares = np.ascontiguousarray(np.square(noise).reshape(-1))
        self._known = (self.markers, model, response.misfit, squares, numbers, learned)
        self._left = np.zeros((_ring.MOST + 1, _ring.STATE))

    def reset(self) -> None:
        """Forget the contacts of the last image."""
        self._left[:] = 0.0

    def run(self, displacements: Float[np.ndarray, "n m 2"]) -> RingFound:
        """Return the contacts of successive images as `RingFound`.

        Args:
            displacements: (n, m, 2) [m] outwards and along rising angles; NaN: not seen.

        Raises:
            InputError: the displacements have another shape.
        """
        from palpate.sensors.marker_ring import _kernels as _ring

        displacements = shaped(displacements, (None, len(self.markers), 2), "displacements")
        flat = displacements.reshape(len(displacements), 2 * len(self.markers))
        found = self._room(len(displacements))
        _ring.frames(flat, *self._known, found.states, found.counts, self._left, found.residual)
        return found

    def run_pixels(
        self, pixels: Float[np.ndarray, "n m 2"], ring: MarkerRing
    ) -> tuple[RingFound, Int[np.ndarray, " n"]]:
        """Return the contacts of successive images as `RingFound`, and the number (n,) of markers seen in each.

        Args:
            pixels: (n, m, 2) of the markers; NaN: not seen.
            ring: calibrated ring, with the rest of the markers.

        Raises:
            InputError: the pixels have another shape.
        """
        from palpate.sensors.marker_ring import _kernels as _ring

        pixels = shaped(pixels, (None, len(self.markers), 2), "pixels")
        found, many = self._room(len(pixels)), np.empty(len(pixels), dtype=np.int64)
        answer = found.states, found.counts, self._left, found.residual, many
        _ring.shown(flat_pixels(pixels), ring.numbers, STEPS, self._known, *answer)
        return found, many

    def _room(self, count: int) -> RingFound:
        return RingFound(np.zeros((count, *self._left[1:].shape)), np.zeros(count, dtype=np.int64), np.zeros(count))

    def depth(self, states: Float[np.ndarray, "*batch 9"]) -> Float[np.ndarray, "*batch"]:
        """Return the depth (*batch,) [m] of contacts (*batch, 9) of `RingFound.states`.

        Raises:
            InputError: states has another shape.
        """
        mean, deviation = self.response.width
        return states[..., 1] * (mean + deviation * states[..., 2])


@takes_arrays
def turned(angle: ArrayLike) -> Float[np.ndarray, "*batch"]:
    """Return angles [rad] from -pi to below pi, in the shape of `angle`."""
    return np.asarray((np.asarray(angle, dtype=np.float64) + pi) % (2.0 * pi) - pi)
