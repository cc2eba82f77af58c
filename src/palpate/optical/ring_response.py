"""Learned response of a soft ring's markers to contacts: periodic in the angle, per newton."""

from __future__ import annotations

from dataclasses import field

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value, takes_arrays


@takes_arrays
def ring_basis(angle: Float[np.ndarray, "*batch"], order: int) -> Float[np.ndarray, "*batch terms"]:
    """Return 1, cos, sin, cos 2, sin 2, ... of an angle [rad], up to an order: (*batch, 2 order + 1).

    Raises:
        InputError: angle has another shape.
    """
    turns = np.multiply.outer(angle, np.arange(1, order + 1))
    both = np.stack([np.cos(turns), np.sin(turns)], axis=-1).reshape(*np.shape(angle), 2 * order)
    return np.concatenate([np.ones((*np.shape(angle), 1)), both], axis=-1)


def _slope(order: int) -> Float[np.ndarray, "terms terms"]:
    """Return the matrix from coefficients of `ring_basis` to those of its derivative."""
    matrix = np.zeros((2 * order + 1, 2 * order + 1))
    for k in range(1, order + 1):
        matrix[2 * k, 2 * k - 1], matrix[2 * k - 1, 2 * k] = -k, k
    return matrix


@frozen_value(repr=False)
class RingResponse(Value):
    """Displacement of a marker at the angle theta by a contact at phi, with delta = theta - phi.

        u = F (v0 + z v1 + z^2 v2 + t s),    v, s: functions of delta and phi, periodic in both.

    F is the radial force, z the contact's width, (depth / F - mean) / standard deviation, larger for a narrow tip than
    for a plate, and t = shear / F; both forces are along the axes of the pressed skin, which shear turns by `carried`.
    Several contacts add up.

    Attributes:
        coefficients: (b, 2 r, 2 K + 1, 2 M + 1) [m/N] of v0, v1, v2 and, where shear was calibrated, s; outwards and
            along rising angles, ring by ring; in `ring_basis` of delta and of phi.
        width: (2,) mean and standard deviation of depth / F [m/N] in the calibration.
        misfit: (2 r, B) rms residual [m/N], outwards and along, ring by ring, of markers in B equal parts of a turn
            from the contact on.
        spread: (2,) standard deviations of angle [rad] and of force, as a share of it, on presses left out of the fit,
            beyond the noise of the pixels.
        largest: (2,) depth [m] and force [N] up to which it was calibrated.
        usual: (3,) mean and standard deviation of z, and standard deviation of t, of the calibration's presses.
        grip: t up to which it was calibrated; 0: none is known.
        dragged: (3,) share of presses that were dragged, and standard deviations of t of the others and of those;
            share 0: all are of one kind.
        carried: (2,) angle by which a contact carries the skin under it along: per newton of shear [rad/N], and per
            newton of shear times depth / F [rad/m].
        sheared: (4,) what a shear as large as the force adds: standard deviations of angle [rad], of force and shear,
            as shares of the force, and a multiple of the misfit.
        left_out: (4,) rms error and expected error of the angle [rad], then of the force, as shares of it, on presses
            left out of the fit; NaN: not known.

    Raises:
        InputError: an array has another shape, a deviation that must be positive is not, or `grip` is negative.
    """

    coefficients: Float[np.ndarray, "b e k m"]
    width: Float[np.ndarray, "2"]
    misfit: Float[np.ndarray, "e parts"]
    spread: Float[np.ndarray, "2"]
    largest: Float[np.ndarray, "2"]
    usual: Float[np.ndarray, "3"] = field(default_factory=lambda: np.array([0.0, 2.0, 0.15]))
    grip: float = 0.0
    dragged: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    left_out: Float[np.ndarray, "4"] = field(default_factory=lambda: np.full(4, np.nan))
    carried: Float[np.ndarray, "2"] = field(default_factory=lambda: np.zeros(2))
    sheared: Float[np.ndarray, "4"] = field(default_factory=lambda: np.zeros(4))

    def __post_init__(self) -> None:
        shape = self.coefficients.shape
        if shape[0] not in (3, 4) or shape[1] % 2 or shape[2] % 2 == 0 or shape[3] % 2 == 0:
            raise InputError(
                "coefficients must have shape (3 or 4 terms, 2 numbers of each ring, an odd number of terms in delta, "
                f"and in phi), not {shape}."
            )
        if len(self.misfit) != shape[1]:
            raise InputError(
                f"misfit must have {shape[1]} rows, the second length of coefficients, not {len(self.misfit)}."
            )
        if not (self.width > 0).all() or not all(
            (each >= 0).all() for each in (self.misfit, self.spread, self.sheared)
        ):
            raise InputError("width must be positive, and misfit, spread and sheared 0 or more.")
        if not (self.usual[1:] > 0).all() or not self.grip >= 0:
            raise InputError(
                f"usual[1:], standard deviations, must be positive, not {self.usual[1:]}, and grip 0 or more, not "
                f"{self.grip}."
            )
        if not 0 <= self.dragged[0] < 1 or (self.dragged[0] and not 0 < self.dragged[1] <= self.dragged[2] < np.inf):
            raise InputError(
                "dragged must be a share from 0 to below 1, then two positive standard deviations, the larger one "
                f"last, not {self.dragged}."
            )
        tails = {"coefficients": shape[1:], "width": (2,), "misfit": (), "spread": (2,), "largest": (2,), "usual": (3,)}
        for name, tail in (tails | {"dragged": (3,), "left_out": (4,), "sheared": (4,), "carried": (2,)}).items():
            object.__setattr__(self, name, frozen(getattr(self, name), tail=tail, name=name))

    @property
    def shears(self) -> bool:
        """True if shear was calibrated."""
        return len(self.coefficients) == 4

    @property
    def rings(self) -> int:
        """Number of rings of markers."""
        return self.coefficients.shape[1] // 2

    @property
    def orders(self) -> tuple[int, int]:
        """Orders K and M of `ring_basis` of delta and of phi."""
        return self.coefficients.shape[2] // 2, self.coefficients.shape[3] // 2

    def at(self, delta: Float[np.ndarray, " n"], phi: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n e b"]:
        """Return v0, v1, v2 and, if shear was calibrated, s at n pairs of angles, (n, 2 r, b) [m/N].

        The second axis is outwards and along rising angles, ring by ring.

        Args:
            delta: (n,) [rad] the marker's angle less the contact's.
            phi: (n,) [rad] the contact's angle.

        Raises:
            InputError: arrays of other shapes.
        """
        of_delta, of_phi = (ring_basis(angle, order) for angle, order in zip((delta, phi), self.orders, strict=True))
        return np.einsum("bckm,nk,nm->ncb", self.coefficients, of_delta, of_phi, optimize=True)

    def skin(self, outer: float, inner: float) -> Float[np.ndarray, "2 b k m"]:
        """Return coefficients (2, b, 2 K + 1, 2 M + 1) [m/N] of the outer skin's movement along the ring, and slope.

        The slope is dw / dtheta, w the markers' movement outwards. With the thickness t and the inner radius r, the
        outer skin moves by u_outer = u (1 + t / r) - t / r dw / dtheta [Kirchhoff and Love]. For the first ring.

        Args:
            outer: radius [m] of the skin's outer surface.
            inner: radius [m] of the markers.
        """
        share = (outer - inner) / inner
        slope = np.einsum("jk,bkm->bjm", _slope(self.orders[0]), self.coefficients[:, 0])
        return np.stack([(1.0 + share) * self.coefficients[:, 1] - share * slope, slope])

    def tables(
        self, markers: Float[np.ndarray, " m"], count: int
    ) -> tuple[Float[np.ndarray, "a n b"], Float[np.ndarray, "a n b"]]:
        """Return `at` and its derivative by phi, (count, 2 m, b) each, for contacts at `count` angles all round.

        The second axis is outwards and along, marker by marker.

        Args:
            markers: (m,) [rad] of the markers, ring by ring, the same number in each.
            count: number of angles.

        Raises:
            InputError: `count` is less than 1, or the markers are not as many in each ring.
        """
        if count < 1:
            raise InputError(f"count must be 1 or more, not {count}.")
        phi = 2.0 * np.pi * np.arange(count) / count
        orders = self.orders
        of_delta = ring_basis(markers[None, :] - phi[:, None], orders[0])
        of_phi = ring_basis(phi, orders[1])
        by_delta = of_delta @ _slope(orders[0])
        by_phi = of_phi @ _slope(orders[1])

        def at(one: np.ndarray, other: np.ndarray) -> np.ndarray:
            each = zip(np.split(self.coefficients, self.rings, axis=1), np.split(one, self.rings, axis=1), strict=True)
            found = [np.einsum("bckm,aik,am->aicb", own, near, other, optimize=True) for own, near in each]
            return np.ascontiguousarray(np.concatenate(found, axis=1).reshape(count, 2 * len(markers), -1))

        return at(of_delta, of_phi), at(of_delta, by_phi) - at(by_delta, of_phi)
