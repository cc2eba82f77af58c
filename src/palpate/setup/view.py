"""Show a sensor that has no view of its own on the page and in the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any, ClassVar

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

__all__ = ["TRACKED", "Facts", "Feed", "LayerData", "SensorView", "Words", "layers_of", "view_of"]

Facts = tuple[tuple[str, str], ...]
Feed = Callable[[np.ndarray, bool], None]
"""Takes slots of the ring of a stream, and whether anybody watches."""
Words = tuple[str, float, str]
"""Of a setting: what it is, by how much it is multiplied, and its unit."""
TRACKED: Mapping[str, Words] = {
    "on": ("a contact begins at", 1.0, "deviations of the noise"),
    "off": ("a contact ends at", 1.0, "deviations of the noise"),
    "reach": ("from frame to frame a contact moves by", 1e3, "mm at most"),
    "speed": ("and at", 1e3, "mm/s at most"),
    "patience": ("a lost contact is waited for", 1.0, "s"),
}
"""Settings of contacts that have an identity."""


@dataclass
class LayerData:
    """What layers show of a log beside its contacts: forces [N] of cells, or frames with the places of markers."""

    parts: list[np.ndarray] = field(default_factory=list[np.ndarray])
    frames: list[bytes] = field(default_factory=list[bytes])

    def keep(self, block: Recording, seen: np.ndarray) -> None:
        """Keep what an estimator's `pairs` hands over of a block."""
        self.frames += [_jpeg(frame) for frame in block.channels.get(IMAGE, ())]
        self.parts.append(seen.astype(np.float32))

    def joined(self) -> np.ndarray | None:
        """Return what was kept of all blocks; None where it is nothing."""
        return np.concatenate(self.parts) if self.parts else None


class SensorView:
    """Show the contacts and the body of a sensor, and nothing more."""

    words: ClassVar[Mapping[str, Words]] = {}
    """Settings by their names in a rig; others are shown by their names."""

    def body(self, setup: Setup) -> Surface | None:
        """Return what is drawn under the contacts; None where the link has no surface."""
        return None if setup.link.stated is None else setup.link.surface()

    def layers(self, setup: Setup, kept: LayerData, live: tuple[int, ...] | None) -> tuple[Layer, ...]:
        """Return what is drawn beside the contacts.

        Args:
            setup: of the sensor.
            kept: of the log that is shown.
            live: shape of a reading of the stream that is shown; None: no stream is.
        """
        return ()

    def feed(self, setup: Setup, tares: Callable[[], int], layers: tuple[Layer, ...]) -> Feed:
        """Return what takes the readings of a stream to the layers.

        Args:
            setup: of the sensor.
            tares: how many tares the stream has had so far.
            layers: that are drawn.
        """
        return lambda slots, watched: None

    def settings(self, facts: Mapping[str, object]) -> Facts:
        """Return settings in words, with their units, of those in force."""
        return tuple(self._setting(name, value) for name, value in facts.items() if value is not None)

    def report(self, run: Run, setup: Setup, estimator: ContactEstimator) -> Run:
        """Return the run with what only this sensor has to report."""
        body = self.body(setup)
        drawn = None if body is None else body.drawn()
        return run if drawn is None else replace(run, body=(drawn.vertices, drawn.faces))

    def _setting(self, name: str, value: object) -> tuple[str, str]:
        words, scale, unit = self.words.get(name, (name.replace("_", " "), 1.0, ""))
        if value == inf:
            return words, "never"
        return words, f"{scale * value:g} {unit}".strip() if isinstance(value, int | float) else str(value)


def _jpeg(frame: UInt8[np.ndarray, "h w 3"]) -> bytes:
    """A log of frames does not fit into memory otherwise."""
    cv2 = opencv()
    return bytes(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 80])[1])


def view_of(kind: SensorKind) -> SensorView:
    """Return what page and report show of a kind of sensor."""
    made: Any = by_name(kind.view)
    return made()


def layers_of(setup: Setup, kept: LayerData | None = None, live: tuple[int, ...] | None = None) -> tuple[Layer, ...]:
    """Return what a sensor adds to the page, if the files that it names are there.

    Args:
        setup: of the sensor.
        kept: of the log that is shown.
        live: shape of a reading of the stream that is shown; None: no stream is.
    """
    there = all(path.exists() for name, path in setup.files().items() if name != "mesh")
    return view_of(setup.kind).layers(setup, kept or LayerData(), live) if there else ()
