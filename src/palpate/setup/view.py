"""Show a sensor on the page and in the report; kinds of sensors derive their views from the one here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import ClassVar

import numpy as np
from jaxtyping import UInt8

from palpate.calls import by_name
from palpate.contact.estimator import ContactEstimator
from palpate.opencv import opencv
from palpate.setup.setup import SensorKind, Setup
from palpate.signals.recording import IMAGE, Recording
from palpate.surfaces import Surface
from palpate.viewer.run_report import Run
from palpate.viewer.scene import Layer

Facts = tuple[tuple[str, str], ...]
Feed = Callable[[np.ndarray, bool], None]
"""Function of (slots of a stream's ring, whether anybody watches the page) that passes readings to layers."""
Words = tuple[str, float, str]
"""Description, factor and unit by which a setting is shown."""
TRACKED: Mapping[str, Words] = {
    "on": ("a contact begins at", 1.0, "deviations of the noise"),
    "off": ("a contact ends at", 1.0, "deviations of the noise"),
    "reach": ("from frame to frame a contact moves by", 1e3, "mm at most"),
    "speed": ("and at", 1e3, "mm/s at most"),
    "patience": ("a lost contact is waited for", 1.0, "s"),
}
"""Settings of contacts that have an identity, name -> `Words`."""


@dataclass
class LayerData:
    """Data of a log that layers show in addition to contacts.

    Attributes:
        parts: one array for each block, float32: forces [N] of taxels, or positions [px] of markers.
        frames: images as JPEG.
    """

    parts: list[np.ndarray] = field(default_factory=list[np.ndarray])
    frames: list[bytes] = field(default_factory=list[bytes])

    def keep(self, block: Recording, seen: np.ndarray) -> None:
        """Append a block's images to `frames`, and the array `seen` that the sensor shows of it to `parts`.

        Raises:
            InputError: there are images and OpenCV is not installed.
        """
        self.frames += [_jpeg(frame) for frame in block.channels.get(IMAGE, ())]
        self.parts.append(seen.astype(np.float32))

    def joined(self) -> np.ndarray | None:
        """Return `parts` joined along the first axis; None if there are none."""
        return np.concatenate(self.parts) if self.parts else None


class SensorView:
    """The view of a sensor's contacts and body; subclasses add layers, settings and sections."""

    words: ClassVar[Mapping[str, Words]] = {}
    """Name of a setting in a rig -> its `Words`; other settings are shown by their names."""

    def body(self, setup: Setup) -> Surface | None:
        """Return the surface that is drawn under the contacts; None if the link has none.

        Raises:
            InputError: a file of the surface cannot be read.
            GeometryError: it has no usable surface.
        """
        return None if setup.link.stated is None else setup.link.surface()

    def layers(self, setup: Setup, kept: LayerData, live: tuple[int, ...] | None) -> tuple[Layer, ...]:
        """Return the layers that are drawn in addition to the contacts; here (). Arguments are those of `layers_of`."""
        return ()

    def feed(self, setup: Setup, tares: Callable[[], int], layers: tuple[Layer, ...]) -> Feed:
        """Return the function that passes a stream's readings to its layers; here it does nothing.

        `tares` returns the number of tares so far.
        """
        return lambda slots, watched: None

    def settings(self, facts: Mapping[str, object]) -> Facts:
        """Return (words, value with unit) for each setting that is not None."""
        return tuple(self._setting(name, value) for name, value in facts.items() if value is not None)

    def report(self, run: Run, setup: Setup, estimator: ContactEstimator) -> Run:
        """Return the run with the sensor's additions to the report; here the vertices and faces of the body.

        Raises:
            InputError: a file of the rig cannot be read.
            GeometryError: the file of the surface has no usable surface.
        """
        body = self.body(setup)
        drawn = None if body is None else body.drawn()
        return run if drawn is None else replace(run, body=(drawn.vertices, drawn.faces))

    def _setting(self, name: str, value: object) -> tuple[str, str]:
        words, scale, unit = self.words.get(name, (name.replace("_", " "), 1.0, ""))
        if value == inf:
            return words, "never"
        return words, f"{scale * value:g} {unit}".strip() if isinstance(value, int | float) else str(value)


def _jpeg(frame: UInt8[np.ndarray, "h w 3"]) -> bytes:
    """Compress an image as JPEG, without which a log of images does not fit into memory."""
    cv2 = opencv()
    return bytes(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 80])[1])


def view_of(kind: SensorKind) -> SensorView:
    """Return the view of a kind of sensor.

    Raises:
        ImportError, AttributeError: `kind.view` names no class.
    """
    return by_name(kind.view)()


def layers_of(setup: Setup, kept: LayerData | None = None, live: tuple[int, ...] | None = None) -> tuple[Layer, ...]:
    """Return the layers that a sensor adds to the page; () if a file that the rig names is missing.

    Args:
        setup: the link and its sensors.
        kept: data of the log that is shown; None: no log is.
        live: shape of a reading of the stream that is shown; None: no stream is.

    Raises:
        InputError: a file that the rig names cannot be used.
        GeometryError: the file of the surface has no usable surface.
    """
    there = all(path.exists() for name, path in setup.files().items() if name != "mesh")
    return view_of(setup.kind).layers(setup, kept or LayerData(), live) if there else ()
