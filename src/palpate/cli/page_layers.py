"""The body of a rig and what its sensor adds to a page, for logs and for streams."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from palpate.io.rig import Rig
from palpate.io.rig.load_cells import RigLoadCells
from palpate.io.rig.marker_ring import rig_ring, ring_surface
from palpate.io.rig.skin import rig_body
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


def body_of(rig: Rig) -> Surface | None:
    """The rig's surface; of a marker ring that has none a cylinder as large as the ring."""
    if rig.surface is None:
        return ring_surface(rig) if "marker_ring" in rig.sensors else None
    return rig.surface.load(rig.folder)


def layers_of(
    rig: Rig, sensor: str, kept: Kept | None = None, live: tuple[int, ...] | None = None
) -> tuple[Layer, ...]:
    """What a sensor adds to the page, if the files that it names are there.

    Args:
        rig: of the sensor.
        sensor: name of its table.
        kept: of the log that is shown.
        live: shape of a reading of the stream that is shown; None: no stream is.
    """
    kept = kept or Kept()
    if sensor not in {kind.name for kind in rig.kinds} or not rig.sensors:
        return ()
    there = all(path.exists() for name, path in rig.files(rig.kind(sensor)).items() if name != "mesh")
    if there and sensor == "load_cells":
        return (LoadCellLayer(rig.table(RigLoadCells).cells(rig.folder)),)
    if there and sensor == "marker_ring":
        return (RingLayer(rig_ring(rig), kept.frames, kept.joined(), None if live is None else (live[0], live[1])),)
    felt = there and sensor in ("skin", "fusion")
    return (TaxelLayer(rig_body(rig), kept.joined(), live is not None),) if felt else ()
