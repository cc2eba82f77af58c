"""`palpate calibrate marker-ring`: from frames of known presses to the model of a soft ring of markers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from palpate.calibration.marker_ring.calibrate import RingTruth, calibrate_marker_ring
from palpate.cli.console import counting, lines, note, progress, title
from palpate.cli.options import FileOption, Log, Output, RigFile
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs
from palpate.io.logs import open_log
from palpate.io.models import provenance, read_model, write_model
from palpate.io.models.marker_ring import of_marker_ring
from palpate.io.rig import load_rig
from palpate.io.rig.marker_ring import MarkerRingSection
from palpate.io.tables.table import read_table
from palpate.sensors.marker_ring import MarkerRing
from palpate.sensors.recording import Recording

__all__ = ["calibrate_marker_ring_command"]

_VIDEOS = (".avi", ".mkv", ".mov", ".mp4", ".webm")
_LOGS = (*_VIDEOS, ".mcap", ".bag")


def calibrate_marker_ring_command(
    run: Log, /, rig: RigFile, output: Output, truth: FileOption = None, like: FileOption = None
) -> None:
    """Calibrate a soft ring of markers from presses of known angle, depth and force.

    Begin with a second in which nothing touches. Press all round the ring, at several depths, with two indenters of
    different width, such as a plate and a narrow tip; move some of them sideways, and state the shear, for shear to be
    told apart.

    Args:
        run: folder with a video or frames and truth.csv, or the video, folder of frames, MCAP file or bag itself.
        rig: TOML with [marker_ring]: radius, thickness, markers, camera.
        output: model to write, such as ring.toml.
        truth: CSV with a row a frame: angle_deg (anticlockwise as the camera sees the ring), depth_mm, force_n and, if
            it is known, shear_n along rising angles; empty where nothing touches (default: truth.csv beside them).
        like: model of another unit: tens of presses then do.
    """
    setup = load_rig(rig).resolve("marker_ring")
    frames, table = _files(run, truth)
    keep_inputs(output, (frames, rig, table, like))
    before = None if like is None else read_model(like, MarkerRing).response
    log = open_log(frames, setup.layout())
    with counting():

        def watched() -> Iterator[Recording]:
            done = 0
            for block in log.blocks():
                yield block
                done += len(block)
                progress(done, log.position / max(log.size, 1))

        record = provenance({"log": frames, "truth": table, "rig": rig}, {} if like is None else {"like": str(like)})
        ring = calibrate_marker_ring(watched(), _truth(table), setup.of(MarkerRingSection).body(), before, record)
    write_model(output, ring)
    title(f"{run} -> {output}")
    lines(of_marker_ring(ring))
    note([*([log.torn] if log.torn else []), *log.notes(), *ring.notes])
    note([f'name it in the rig: model = "{output.name}" under [marker_ring]'])


def _files(run: Path, truth: Path | None) -> tuple[Path, Path]:
    """The log of images and the table of truth."""
    frames = run
    if run.is_dir():
        inside = sorted(path for path in run.iterdir() if path.suffix.lower() in _LOGS)
        if len(inside) == 1:
            frames = inside[0]
        elif (run / "frames").is_dir():
            frames = run / "frames"
    beside = (run / "truth.csv") if run.is_dir() else run.parent / "truth.csv"
    table = truth or beside
    if not table.is_file():
        hint = "Give --truth CSV with angle_deg, depth_mm and force_n, a row a frame."
        raise InputError("nothing says where and how hard the ring was pressed.", where=str(table), hint=hint)
    return frames, table


def _truth(path: Path) -> RingTruth:
    table = read_table(path)
    values, _ = table.numbers(["angle_deg", "depth_mm", "force_n"])
    shear = table.numbers(["shear_n"])[0][:, 0] if "shear_n" in table.names else np.full(len(values), np.nan)
    return RingTruth(np.radians(values[:, 0]), 1e-3 * values[:, 1], values[:, 2], shear)
