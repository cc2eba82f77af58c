"""Show a ring of markers that a camera watches on the page and in the report."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import ClassVar

import numpy as np

from palpate.sensors.marker_ring.estimator import RingEstimator
from palpate.sensors.marker_ring.layer import RingLayer
from palpate.sensors.marker_ring.section import MarkerRingSection
from palpate.setup.setup import Setup
from palpate.setup.view import TRACKED, Feed, LayerData, SensorView, Words
from palpate.surfaces import Surface
from palpate.viewer.scene import Layer

SHOWN = 0.25  # s between two images that are shown


class MarkerRingView(SensorView):
    """The view of a marker ring: the camera's image, and the markers on a surface."""

    words: ClassVar[Mapping[str, Words]] = {
        **TRACKED,
        "apart": ("two contacts are at least", 1.0, "° from each other"),
        "dropped": ("markers left out of a frame", 1.0, "at most"),
        "shift": ("a neighbour shifts a contact by", 1.0, "°"),
        "wide": ("widths differ by", 1.0, "deviations of the calibration's"),
    }

    def body(self, setup: Setup) -> Surface | None:
        """Return the link's `Surface`, or else a cylinder of the ring's radius.

        Raises:
            InputError: the model or the surface cannot be read.
            GeometryError: the file of the surface has no usable surface.
        """
        return super().body(setup) or setup.of(MarkerRingSection).surface()

    def layers(self, setup: Setup, kept: LayerData, live: tuple[int, ...] | None) -> tuple[Layer, ...]:
        """Return one `RingLayer`, which draws the ring's images and markers.

        Raises:
            InputError: the rig names no model, or it cannot be read.
        """
        shape = None if live is None else (live[0], live[1])
        return (RingLayer(setup.of(MarkerRingSection).ring, kept.frames, kept.joined(), shape),)

    def feed(self, setup: Setup, tares: Callable[[], int], layers: tuple[Layer, ...]) -> Feed:
        """Return a function that shows images of a stream, four a second at most, in the ring's layer.

        Raises:
            GeometryError: the file of the surface has no usable surface.
        """
        if layers and isinstance(layers[0], RingLayer):
            made = setup.prepared().estimator
            if isinstance(made, RingEstimator):
                return _Frames(made, layers[0])
        return super().feed(setup, tares, layers)


class _Frames:
    """A feed that shows the last image of a camera, and the markers in it."""

    def __init__(self, estimator: RingEstimator, layer: RingLayer) -> None:
        self._estimator, self._layer, self._at = estimator, layer, -np.inf

    def __call__(self, slots: np.ndarray, watched: bool) -> None:
        now = time.monotonic()
        if not watched or now - self._at < SHOWN:
            return
        self._at, frame = now, slots["values"][-1]
        pixels = np.full((len(self._estimator.ring), 2), np.nan)
        self._estimator.tracker.track(frame, pixels)
        self._layer.feed(frame, pixels)
