"""Displacements of the markers of a soft ring become contacts: how many, where, how hard, how wide, how sheared."""

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
from palpate.spatial.arguments import takes_arrays

__all__ = ["RingFound", "RingLocator", "RingSettings", "turned"]

_TABLE = 720  # angles of the response's table
_NO_SHEAR = 1e-6  # deviation of shear / force where shear was not calibrated: none


@dataclass(frozen=True)
class RingSettings:
    """How contacts are found.

    Args:
        on, off: a contact begins where it explains so many deviations of the markers' noise more than without it, and
            ends where it explains fewer than `off`.
        apart: [deg] nearer to each other no two contacts are told apart.
        dropped: markers of a frame that may be left out because no contact explains them.
        shift: [deg] by which a neighbour 30 degrees away may shift a contact, as a deviation; one farther away by less.
        friction: usual shear / force, as a deviation; None: that of the calibration. Where it is less, what neighbours
            leave a contact with is held by as much less.
        wide: deviations of the calibration's widths that a contact's width usually has.
        reach, speed, patience: of identities: a contact may be `reach` [m] off from one frame to the next, and move at
            `speed` [m/s] beside that; one that is lost is waited for `patience` [s].
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
            raise InputError(f"off ({self.off:g}) must lie between 0 and on ({self.on:g}).")
        if not 0 < self.apart < 180:
            raise InputError(f"apart must lie between 0 and 180 degrees, not {self.apart:g}.")
        if self.dropped < 0 or not (self.wide > 0 and self.shift >= 0 and (self.friction is None or self.friction > 0)):
            raise InputError("dropped and shift must not be negative, friction and wide must be positive.")
        if not (self.reach > 0 and self.speed >= 0 and self.patience >= 0):
            raise InputError("reach must be positive, speed and patience not negative.")


@takes_arrays
@dataclass(frozen=True, eq=False)
class RingFound:
    """Contacts of frames, in the form of the compiled loops.

    Attributes:
        states: (n, most, 8) angle [rad], force [N], width (deviations of the calibration's), shear / force, deviations
            of angle [rad], force [N] and depth [m], and by how much the frame's chi-square would rise without it.
        counts: (n,) of contacts; -1: fewer than half of the markers were seen.
        residual: (n,) root of chi-square over its degrees of freedom.
    """

    states: Float[np.ndarray, "n most 8"]
    counts: Int[np.ndarray, " n"]
    residual: Float[np.ndarray, " n"]


@takes_arrays
class RingLocator:
    """Contacts from displacements, frame after frame: each starts from those of the frame before.

    Args:
        response: of the ring.
        markers: (m,) [rad] angles at rest, ring by ring.
        noise: (m, 2) [m] deviation of a displacement, outwards and along.
        settings: how contacts are found.
        skin: radii [m] of the outer surface and of the markers; None: of a skin that no contact moves along.

    Attributes:
        grip: shear / force up to which a contact is held where its neighbours carry the skin along.
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
        set_, (middle, wide, usual) = self.settings, response.usual.tolist()
        shear = (set_.friction or usual) if response.shears else _NO_SHEAR
        self.grip = response.grip * min(1.0, shear / usual) if response.shears else 0.0
        table, slope = response.tables(self.markers, _TABLE)
        model = (table, slope, np.array([set_.wide * wide, shear, middle]))
        numbers = np.array([set_.on, set_.off, radians(set_.apart), float(set_.dropped), radians(set_.shift)])
        moved = np.zeros((2, 3, 1, 1)) if skin is None else response.skin(*skin)
        outer, grip = (np.inf, 0.0) if skin is None else (skin[0], self.grip)
        kinds = response.dragged.copy() if set_.friction is None and response.shears else np.zeros(3)
        learned = (response.width.copy(), response.spread.copy(), moved, outer, grip, kinds)
        squares = np.ascontiguousarray(np.square(noise).reshape(-1))
        self._known = (self.markers, model, response.misfit, squares, numbers, learned)
        self._left = np.zeros((_ring.MOST + 1, _ring.STATE))
        self.most = _ring.MOST

    def reset(self) -> None:
        """Forget the contacts of the frame before."""
        self._left[:] = 0.0

    def run(self, displacements: Float[np.ndarray, "n m 2"]) -> RingFound:
        """Contacts of frames one after the other.

        Args:
            displacements: (n, m, 2) [m] outwards and along rising angles; NaN: not seen.
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
        """`run` of markers of a ring that are seen at pixels, NaN: not seen; and how many are seen in each frame."""
        from palpate.sensors.marker_ring import _kernels as _ring

        pixels = shaped(pixels, (None, len(self.markers), 2), "pixels")
        found, many = self._room(len(pixels)), np.empty(len(pixels), dtype=np.int64)
        answer = found.states, found.counts, self._left, found.residual, many
        _ring.shown(flat_pixels(pixels), ring.numbers, STEPS, self._known, *answer)
        return found, many

    def _room(self, count: int) -> RingFound:
        return RingFound(np.zeros((count, *self._left[1:].shape)), np.zeros(count, dtype=np.int64), np.zeros(count))

    def depth(self, states: Float[np.ndarray, "*batch 8"]) -> Float[np.ndarray, "*batch"]:
        """[m] of contacts: force times the depth of a newton."""
        mean, deviation = self.response.width
        return states[..., 1] * (mean + deviation * states[..., 2])


@takes_arrays
def turned(angle: ArrayLike) -> Float[np.ndarray, "*batch"]:
    """Angles [rad] into -pi ... pi."""
    return np.asarray((np.asarray(angle, dtype=np.float64) + pi) % (2.0 * pi) - pi)
