"""The calibrated model of a soft ring of markers that a fisheye camera watches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.optical.fisheye import STEPS, Fisheye, RingView, flat_pixels
from palpate.optical.markers import MarkerColour
from palpate.optical.ring_response import RingResponse
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value
from palpate.spatial.shown import one_line


@dataclass(frozen=True)
class RingBody:
    """The dimensions of a unit that are known before it is calibrated.

    Attributes:
        radius: of the outer surface at the first ring [m].
        thickness: of the skin [m].
        markers: number of markers in each ring.
        camera: lens; None: an equidistant lens, whose focal length is fitted.
        height: of the camera above the first ring [m], roughly.
        colour: of the markers; None: found in the images.
        rings: heights of the rings of markers, towards the camera [m]; the first is 0.
    """

    radius: float
    thickness: float
    markers: int
    camera: Fisheye | None = None
    height: float = 0.04
    colour: MarkerColour | None = None
    rings: tuple[float, ...] = (0.0,)


@frozen_value(repr=False)
class MarkerRing(Value):
    """A calibrated unit of a marker ring.

    Attributes:
        radius: of the skin's outer surface at the markers [m].
        view: the camera, its place in the ring, and the angles at which markers rest on the inner surface.
        colour: of the markers.
        rest: (m, 2) places of the markers at rest [px].
        area: (m,) sizes of the markers [px].
        jitter: standard deviation of a marker's place along each axis from image to image [px].
        response: displacements of the markers under contacts.
        notes: notes on the calibration, one sentence each.
        provenance: origin of the calibration.

    Raises:
        InputError: the response has other rings than the view, `rest` or `area` is not of the view's markers,
            `radius` is not above that of the markers, or `jitter` is not positive.
    """

    radius: float
    view: RingView
    colour: MarkerColour
    rest: Float[np.ndarray, "m 2"]
    area: Float[np.ndarray, " m"]
    jitter: float
    response: RingResponse
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=lambda: {})

    def __post_init__(self) -> None:
        count = len(self.view.angles)
        if self.response.rings != len(self.view.rings):
            raise InputError(f"the response has {self.response.rings} rings, but the view has {len(self.view.rings)}.")
        object.__setattr__(self, "rest", frozen(self.rest, tail=(2,), name="rest"))
        object.__setattr__(self, "area", frozen(self.area, name="area"))
        if self.rest.shape != (count, 2) or self.area.shape != (count,):
            raise InputError(
                f"rest and area must be those of {count} markers, not {self.rest.shape} and {self.area.shape}."
            )
        if not (self.radius > self.view.radius > 0 and self.jitter > 0):
            raise InputError("radius must be larger than that of the markers, and jitter positive.")

    def __len__(self) -> int:
        return len(self.view.angles)

    def displacements(self, pixels: Float[np.ndarray, "*batch m 2"]) -> Float[np.ndarray, "*batch m 2"]:
        """Return the displacements (*batch, m, 2) [m], outwards and along rising angles, of markers at pixels.

        A marker at NaN has a displacement of NaN.

        Raises:
            InputError: the pixels are not real numbers (*batch, m, 2).
        """
        from palpate.optical._fisheye import displaced  # compiled: loaded when first needed

        flat, out = flat_pixels(pixels), np.empty(np.shape(pixels))
        lens, pose, heights, resting, axes = self.numbers
        displaced(flat, lens, pose, heights, STEPS, resting, axes, out.reshape(-1, 2))
        return out

    @cached_property
    def numbers(self) -> tuple[np.ndarray, ...]:
        """Lens (10,), pose (12,), markers' heights (m,) [m] and rest places (m, 2) [m], and `axes` (m, 2, 2)."""
        resting = self.view.to_plane(self.rest, self.view.heights)
        return *self.view.numbers, self.view.heights, resting, np.ascontiguousarray(self.axes())

    def axes(self) -> Float[np.ndarray, "m 2 2"]:
        """Return unit vectors outwards and along rising angles at each marker, as columns (m, 2, 2)."""
        c, s = np.cos(self.view.angles), np.sin(self.view.angles)
        return np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=-1)

    def noise(self) -> Float[np.ndarray, "m 2"]:
        """Return the standard deviation (m, 2) [m] of each displacement, due to `jitter`."""
        along = np.swapaxes(self.axes(), -1, -2) @ self.view.to_plane_with_slope(self.rest, self.view.heights)[1]
        return self.jitter * np.linalg.norm(along, axis=-1)

    def __repr__(self) -> str:
        return one_line(self)
