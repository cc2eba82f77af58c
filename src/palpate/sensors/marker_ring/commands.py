"""`palpate calibrate marker-ring` and `palpate calibrate camera`: a ring of markers, and the lens that watches it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import arg

from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.console import progress
from palpate.console.options import FileOption, Log, Output, RigFile, require_positive
from palpate.errors import InputError
from palpate.files.logs import open_log
from palpate.files.logs.frame_folder import FrameFolder
from palpate.files.logs.layout import ImageChannel, LogLayout
from palpate.files.models import read_model
from palpate.files.tables.table import read_table
from palpate.sensors.marker_ring.calibrate import RingTruth, calibrate_marker_ring
from palpate.sensors.marker_ring.calibrate_camera import Pattern, calibrate_board
from palpate.sensors.marker_ring.files import of_camera, of_marker_ring
from palpate.sensors.marker_ring.model import MarkerRing
from palpate.sensors.marker_ring.section import MarkerRingSection
from palpate.signals.recording import IMAGE, Recording

STIFF = 1e4  # N/m: barrels of silicone have some 200
_VIDEOS = (".avi", ".mkv", ".mov", ".mp4", ".webm")
_LOGS = (*_VIDEOS, ".mcap", ".bag")
_MOST = 40  # pictures, evenly spread: more add no information


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
            OSError: an input cannot be read for its digest.
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
            warnings=_stiff(*ring.response.largest.tolist()),
            next=[f'name it in the rig: model = "{self.output.name}" under [marker_ring]'],
        )


def _stiff(depth: float, force: float) -> list[str]:
    """Return a warning, in a list, if no soft ring is as stiff as the largest press states."""
    if force <= STIFF * depth:
        return []
    return [f"{force:.3g} N at {1e3 * depth:.3g} mm is more than a soft ring takes: check that force_n is in N"]


def _truth(path: Path) -> RingTruth:
    table = read_table(path)
    values, _ = table.numbers(["angle_deg", "depth_mm", "force_n"])
    shear = table.numbers(["shear_n"])[0][:, 0] if "shear_n" in table.names else np.full(len(values), np.nan)
    return RingTruth(np.radians(values[:, 0]), 1e-3 * values[:, 1], values[:, 2], shear)


@dataclass(frozen=True)
class CalibrateCamera(Calibration):
    """Calibrate a fisheye lens from pictures of a board.

    Calibrate a fisheye lens from pictures of a chessboard or a grid of circles, held at all angles and to the edges of
    the picture.

    Args:
        log: folder of pictures, or a video.
        output: camera.toml to write.
        board: inner corners or circles of the board, columns and rows.
        square: side of one of its squares, or distance of its circles (of asymmetric ones: from row to row) [m].
        pattern: what is drawn on the board.
    """

    log: Log
    output: Output
    board: Annotated[str, arg(metavar="CxR")] = "9x6"
    square: Annotated[float, arg(metavar="METRES")] = 0.01
    pattern: Pattern = "chessboard"

    def identify(self) -> CalibrationResult:
        """Find the board in the pictures and fit the lens to its corners; return a `CalibrationResult` with it.

        Raises:
            InputError: `board` or `square` is invalid, the log has no images that can be read, fewer than three show
                the board, they do not determine a lens, or OpenCV is missing.
        """
        columns, _, rows = self.board.lower().partition("x")
        if not (columns.isdigit() and rows.isdigit() and int(columns) > 2 and int(rows) > 2):
            hint = "Write them as 9x6."
            what = f"must be columns and rows of the board's inner corners, at least 3 each, not {self.board!r}."
            raise InputError(what, where="--board", hint=hint)
        require_positive(self.square if np.isfinite(self.square) else np.nan, "--square")
        pictures, count = _pictures(self.log)
        fit = calibrate_board([frame for _, frame in pictures], (int(columns), int(rows)), self.square, self.pattern)
        hidden = len(pictures) - len(fit.used) - len(fit.far)
        return CalibrationResult(
            [
                *of_camera(fit.camera),
                ("deviation", f"{fit.deviation * fit.validation.widening**0.5:.2g} px/rad of the focal length"),
                ("corners", f"{fit.residual:.2g} px rms, in {len(fit.used)} of {count} pictures"),
                ("left out", str(fit.validation)),
            ],
            fit.camera,
            notes=[
                *([f"{hidden} of {len(pictures)} pictures do not show the complete board"] if hidden else []),
                *fit.validation.notes,
            ],
            warnings=[f"picture {pictures[k][0]} does not fit the others and is not used" for k in fit.far],
            next=[f'name it in the rig: camera = "{self.output.name}" under [marker_ring]'],
        )


def _pictures(path: Path) -> tuple[list[tuple[str, np.ndarray]], int]:
    """Return at most 40 pictures, evenly spread, with their files' names or numbers from 1, and the number of all."""
    log = open_log(path, LogLayout(wrench=None, images=ImageChannel()))
    names = [file.name for file in log.files] if isinstance(log, FrameFolder) else []
    kept, stride, count = list[tuple[str, np.ndarray]](), 1, 0
    for block in log.blocks():
        for frame in block.channels[IMAGE]:
            if count % stride == 0:
                kept.append((names[count] if names else str(count + 1), frame))
            count += 1
            if len(kept) > 2 * _MOST:
                kept, stride = kept[::2], 2 * stride
    return kept[:: -(-len(kept) // _MOST) or 1], count
