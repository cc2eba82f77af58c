"""A ring of markers in a rig: its table, the layout of images, and the estimator built of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from palpate.errors import InputError
from palpate.files.logs import LogContents, image_size
from palpate.files.logs.layout import ImageChannel, LogLayout
from palpate.files.models import read_model
from palpate.sensors.marker_ring.estimator import RingEstimator
from palpate.sensors.marker_ring.lens_file import read_lens
from palpate.sensors.marker_ring.locator import RingSettings
from palpate.sensors.marker_ring.model import MarkerRing, RingBody
from palpate.setup import guess
from palpate.setup.body import GivenBody
from palpate.setup.built import BuiltEstimator, Guess
from palpate.setup.setup import SensorKind, SensorSection, Setup
from palpate.setup.tables import require_path, require_positive
from palpate.signals.recording import IMAGE
from palpate.spatial.pose import Pose
from palpate.surfaces import Surface
from palpate.surfaces.quadric import Cylinder

_TEXT = """\
[marker_ring]
# model = "ring.toml"                # written by: palpate calibrate marker-ring
radius = 0.055                       # m, of the skin's outer surface at the markers: measure it
thickness = 0.004                    # m, of the skin
markers = 24                         # round the ring
# rings = [0.0, 0.01]                # m, heights of several rings of as many markers, towards the camera; first 0
# camera = "camera.toml"             # lens: of palpate calibrate camera, or a fisheye's YAML of ROS or OpenCV
{where}# tare = 1.0                         # s: the log starts so long untouched

"""
_NO_WRENCH = "a camera measures no wrench"


@dataclass(frozen=True)
class RigMarkerRing:
    """Rig table of a marker ring: its model, its dimensions, and the topic of its images.

    `model` is a file of `palpate calibrate marker-ring`. A calibration needs the `radius` [m] of the outer surface at
    the markers, the `thickness` [m] of the skin, the number of `markers` in a ring, the `camera`'s lens as a file, its
    `height` [m] above the markers, and the heights [m] of the `rings`, the first 0. `topic` is that of the images;
    `tare` [s] is the untouched time at the log's start; `contacts` are the settings of the search for contacts.

    Raises:
        ValueError: a number is out of its range, or `rings` are not below the camera, different and the first 0.
    """

    model: str | None = None
    radius: float | None = None
    thickness: float | None = None
    markers: int | None = None
    rings: tuple[float, ...] = (0.0,)
    camera: str | None = None
    height: float = 0.04
    topic: str | None = None
    tare: float | None = None
    contacts: RingSettings = field(default_factory=RingSettings)

    def __post_init__(self) -> None:
        for name in ("model", "camera"):
            require_path(name, getattr(self, name))
        require_positive(self, "radius", "thickness", "height", "tare")
        if self.markers is not None and self.markers < 6:
            raise ValueError(f"markers must be at least 6, not {self.markers}")
        heights = np.array(self.rings, dtype=np.float64)
        if not len(heights) or heights[0] != 0 or not (np.isfinite(heights) & (np.abs(heights) < self.height)).all():
            raise ValueError(f"rings must be heights [m] below the camera's {self.height:g}, and the first must be 0")
        if len(set(self.rings)) < len(self.rings):
            raise ValueError("no two rings can have the same height")
        if self.radius is not None and self.thickness is not None and self.thickness >= self.radius:
            raise ValueError("thickness must be less than radius")


class MarkerRingSection(SensorSection):
    """A ring of markers as a rig states it; its files are read once."""

    name: ClassVar[str] = "marker_ring"
    called: ClassVar[str] = "a ring of markers watched by a camera"
    table: RigMarkerRing

    @cached_property
    def ring(self) -> MarkerRing:
        """Calibrated `MarkerRing`, read from the model's file.

        Raises:
            InputError: no model is named, or it cannot be read.
        """
        if self.table.model is None:
            raise InputError(
                "the rig's [marker_ring] has no model.",
                where="marker_ring.model",
                hint="Run `palpate calibrate marker-ring` on a log of presses, then name its file: model = FILE.",
            )
        return read_model(self.link.folder / self.table.model, MarkerRing)

    def body(self) -> RingBody:
        """Return the dimensions that the rig states for a calibration, as a `RingBody`.

        Raises:
            InputError: radius, thickness or markers are missing, or the camera's file cannot be read.
        """
        table = self.table
        if table.radius is None or table.thickness is None or table.markers is None:
            lacking = [name for name in ("radius", "thickness", "markers") if getattr(table, name) is None]
            raise InputError(
                f"does not state {' and '.join(lacking)}.",
                where="marker_ring",
                hint="Measure the ring and write radius (of the outer surface, m), thickness (of the skin, m) and "
                "markers (their number).",
            )
        camera = None if table.camera is None else read_lens(self.link.folder / table.camera)
        return RingBody(table.radius, table.thickness, table.markers, camera, table.height, rings=table.rings)

    def surface(self) -> Surface:
        """Return a cylinder of the ring's radius about the sensor's z axis, as a `Surface`.

        Raises:
            InputError: no model is named, or it cannot be read.
        """
        radius, upright = self.ring.radius, np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        return Cylinder(radius, 0.6 * radius).transformed(Pose(upright, np.zeros(3)))  # its own axis is y


def _layout(setup: Setup) -> LogLayout:
    topic = setup.of(MarkerRingSection).table.topic
    return LogLayout(wrench=None, images=ImageChannel(topic, table="marker_ring"), **setup.common)


def _build(setup: Setup) -> BuiltEstimator:
    table, ring, head = setup.of(MarkerRingSection).table, setup.of(MarkerRingSection).ring, setup.head
    estimator = RingEstimator(ring, table.contacts, mount=setup.link.mount)
    made = BuiltEstimator(estimator, settings=dict(vars(table.contacts)))
    tare = setup.estimate.tare or table.tare
    if tare is not None and head is not None:
        made.tared(estimator.tare(head.first(tare)))
    return made


_SMALLEST = 64  # px: smaller images of a topic are those of a sheet of taxels


def _guess(log: Path, contents: LogContents, body: GivenBody | None) -> Guess | None:
    """Return a rig for a video, a folder or a topic of images; None if there are none that can show a ring."""
    topics = guess.topics_of(contents, "image")
    size = image_size(log, topics[0] if topics else None) if topics or not contents.topics else None
    if size is None or (topics and min(size[:2]) < _SMALLEST):
        return None
    where = f"topic = {guess.quoted(topics[0])}\n" if topics else ""
    layout = LogLayout(wrench=None, images=ImageChannel(topics[0] if topics else None, table="marker_ring"))
    why = f"it holds images of {size[1]} x {size[0]}"
    remarks = ("measure the ring's radius and thickness, and count its markers",)
    return Guess(why, layout, _TEXT.format(where=where), remarks)


MARKER_RING = SensorKind(
    name="marker_ring",
    called=MarkerRingSection.called,
    table=RigMarkerRing,
    section=MarkerRingSection,
    channels=(IMAGE,),
    layout=_layout,
    build=_build,
    guess=_guess,
    paths=("model", "camera"),
    refused={
        "payload": f"{_NO_WRENCH}, so no payload is in its images",
        "noise": f"{_NO_WRENCH}: the noise of the markers is found in the calibration",
        "method": "contacts are where the ring is dented: there is no line of action to locate",
        "friction": "friction in [marker_ring.contacts] states the usual shear",
        "torsion": "markers in one ring feel no torque about the normal",
        "contact": "thresholds are those of the markers: on and off in [marker_ring.contacts], in deviations of noise",
        "crease": "contacts are placed on the ring, not on a mesh",
        "mesh": "contacts are placed on the ring, not on a mesh",
        "filter": "images are not filtered",
        "cutoff": "images are not filtered",
    },
    needs_surface=False,
    view="palpate.sensors.marker_ring.view.MarkerRingView",
    start=lambda setup: setup.estimate.tare or setup.of(MarkerRingSection).table.tare or 0.0,
)
