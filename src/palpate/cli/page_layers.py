"""The body of a rig and what its sensor adds to a page, for logs and for streams."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from palpate.io.rig.load_cells import LoadCellSection
from palpate.io.rig.marker_ring import MarkerRingSection
from palpate.io.rig.setup import Setup
from palpate.io.rig.skin import SkinSection
from palpate.sensors.recording import IMAGE, Recording
from palpate.surfaces import Surface
from palpate.viewer.load_cells import LoadCellLayer
from palpate.viewer.marker_ring import RingLayer, compressed
from palpate.viewer.scene import Layer
from palpate.viewer.taxels import TaxelLayer

__all__ = ["Kept", "body_of", "layers_of"]


@dataclass
class Kept:
    """What layers show of a log beside its contacts: forces [N] of cells, or frames with the places of markers."""

    parts: list[np.ndarray] = field(default_factory=list[np.ndarray])
    frames: list[bytes] = field(default_factory=list[bytes])

    def keep(self, block: Recording, seen: np.ndarray) -> None:
        """Keep what an estimator's `pairs` hands over of a block."""
        self.frames += [compressed(frame) for frame in block.channels.get(IMAGE, ())]
        self.parts.append(seen.astype(np.float32))

    def joined(self) -> np.ndarray | None:
        """Return what was kept of all blocks; None where it is nothing."""
        return np.concatenate(self.parts) if self.parts else None


def body_of(setup: Setup) -> Surface | None:
    """Return the link's surface; of a marker ring that has none a cylinder as large as the ring."""
    if setup.link.stated is None:
        return setup.of(MarkerRingSection).surface() if MarkerRingSection.name in setup.sensors else None
    return setup.link.surface()


def layers_of(setup: Setup, kept: Kept | None = None, live: tuple[int, ...] | None = None) -> tuple[Layer, ...]:
    """Return what a sensor adds to the page, if the files that it names are there.

    Args:
        setup: of the sensor.
        kept: of the log that is shown.
        live: shape of a reading of the stream that is shown; None: no stream is.
    """
    kept = kept or Kept()
    sensor = setup.kind.name
    there = all(path.exists() for name, path in setup.files().items() if name != "mesh")
    if there and sensor == "load_cells":
        return (LoadCellLayer(setup.of(LoadCellSection).cells),)
    if there and sensor == "marker_ring":
        shape = None if live is None else (live[0], live[1])
        return (RingLayer(setup.of(MarkerRingSection).ring, kept.frames, kept.joined(), shape),)
    felt = there and sensor in ("skin", "fusion")
    return (TaxelLayer(setup.of(SkinSection).body, kept.joined(), live is not None),) if felt else ()
