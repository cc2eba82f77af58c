"""`palpate calibrate marker-ring`: identify the model of a soft ring of markers from images of known presses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.console import progress
from palpate.console.options import FileOption, Log, Output, RigFile
from palpate.errors import InputError
from palpate.files.logs import open_log
from palpate.files.models import read_model
from palpate.files.tables.table import read_table
from palpate.sensors.marker_ring.calibrate import RingTruth, calibrate_marker_ring
from palpate.sensors.marker_ring.files import of_marker_ring
from palpate.sensors.marker_ring.model import MarkerRing
from palpate.sensors.marker_ring.section import MarkerRingSection
from palpate.signals.recording import Recording

__all__ = ["CalibrateMarkerRing"]

_VIDEOS = (".avi", ".mkv", ".mov", ".mp4", ".webm")
_LOGS = (*_VIDEOS, ".mcap", ".bag")


@dataclass(frozen=True)
class CalibrateMarkerRing(Calibration):
    """Calibrate a soft ring of markers from known presses.

    Begin with a second in which nothing touches. Press all round the ring, at several depths, with two indenters of
    different width, such as a plate and a narrow tip; move some of them sideways, and state the shear, for shear to be
    told apart.

    Args:
        log: folder with a video or frames and truth.csv, or the video, folder of frames, MCAP file or bag itself.
        rig: TOML with [marker_ring]: radius, thickness, markers, camera.
        output: model to write, such as ring.toml.
        truth: CSV with a row a frame: angle_deg (anticlockwise as the camera sees the ring), depth_mm, force_n and, if
            it is known, shear_n along rising angles; empty where nothing touches (default: truth.csv next to the
            images).
        like: model of another unit: tens of presses then do.
    """

    replaces = "marker_ring.model"
    log: Log
    rig: RigFile
    output: Output
    truth: FileOption = None
    like: FileOption = None

    @cached_property
    def reads(self) -> dict[str, Path]:
        """Dict of name -> path of the inputs: log (images) and truth, in the folder or next to the file; rig and like.

        Raises:
            InputError: there is no table of truth.
        """
        frames, folder = self.log, self.log if self.log.is_dir() else self.log.parent
        if self.log.is_dir():
            inside = sorted(path for path in self.log.iterdir() if path.suffix.lower() in _LOGS)
            if len(inside) == 1:
                frames = inside[0]
            elif (self.log / "frames").is_dir():
                frames = self.log / "frames"
        truth = self.truth or folder / "truth.csv"
        if not truth.is_file():
            hint = "Give --truth CSV with columns angle_deg, depth_mm and force_n, and one row per frame."
            raise InputError(
                "does not exist, and it must state where and how hard the ring was pressed.",
                where=str(truth),
                hint=hint,
            )
        named = {"log": frames, "truth": truth, "rig": self.rig}
        return named if self.like is None else {**named, "like": self.like}

    def identify(self) -> CalibrationResult:
        """Track the markers through all images and fit the response; return a `CalibrationResult` with the ring.

        Raises:
            InputError: a file cannot be read or does not fit the images, the markers are not found, the presses do not
                determine the response, or OpenCV is missing.
            NotIdentifiable: the markers at rest are no even ring.
        """
        setup = self.stated.resolve("marker_ring")
        before = None if self.like is None else read_model(self.like, MarkerRing).response
        log = open_log(self.reads["log"], setup.layout())

        def watched() -> Iterator[Recording]:
            done = 0
            for block in log.blocks():
                yield block
                done += len(block)
                progress(done, log.position / max(log.size, 1))

        truth, body = _truth(self.reads["truth"]), setup.of(MarkerRingSection).body()
        ring = calibrate_marker_ring(watched(), truth, body, before, self.record())
        return CalibrationResult(
            of_marker_ring(ring),
            ring,
            notes=[*([log.torn] if log.torn else []), *log.notes(), *ring.notes],
            next=[f'name it in the rig: model = "{self.output.name}" under [marker_ring]'],
        )


def _truth(path: Path) -> RingTruth:
    table = read_table(path)
    values, _ = table.numbers(["angle_deg", "depth_mm", "force_n"])
    shear = table.numbers(["shear_n"])[0][:, 0] if "shear_n" in table.names else np.full(len(values), np.nan)
    return RingTruth(np.radians(values[:, 0]), 1e-3 * values[:, 1], values[:, 2], shear)
