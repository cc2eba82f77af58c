"""`palpate estimate` where the log holds the voltages of load cells."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from time import perf_counter

import numpy as np

from palpate.cli.interrupts import uninterrupted
from palpate.cli.screen import counting, lines, note, percent, progress, title, wait
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.fingertip import WANTED, Fingertip
from palpate.contact.fingertip_stream import START, FingertipStream
from palpate.contact.frames import in_frame
from palpate.contact.plausibility import unexplained
from palpate.errors import InputError
from palpate.io.contacts import ContactsWriter, open_contacts
from palpate.io.logs import Log, open_log
from palpate.io.models import provenance, write_provenance
from palpate.io.rig import Rig
from palpate.viewer.downsample import Downsample

__all__ = ["estimate_load_cells"]

TORN, INTERRUPTED = 3, 130


def estimate_load_cells(log: Path, output: Path, beside: Path, rig: Rig, rig_path: Path | None, frame: str) -> None:
    """Every row of a log of voltages to a row of contacts.

    Raises:
        InputError: what the cells cannot be asked for, no model, a log that does not begin at rest.
    """
    if frame == "base":
        raise InputError("contacts of load cells are written in the frame of the surface or sensor.", where="--frame")
    if rig.filter.kind != "none":
        raise InputError("voltages of load cells are not filtered here.", where="filter", mend='Use kind = "none".')
    wait("compiling kernels (compiling happens once)")
    source, fingertip = open_log(log, rig.layout()), _fingertip(rig)
    stream = FingertipStream(fingertip, rig.estimate.tare or START)
    tally, spent = Downsample(), perf_counter()
    with ExitStack() as stack:
        writer = stack.enter_context(open_contacts(output, frame_id=frame))
        interrupted = _written(source, stream, writer, tally, rig, frame)
        with uninterrupted():
            stack.close()
    spent = perf_counter() - spent
    ended = "interrupted" if interrupted else "torn" if source.torn else "whole"
    options = {
        **vars(rig.estimate),
        "frame": frame,
        "without": rig.load_cells and rig.load_cells.without,
        "ended": ended,
    }
    write_provenance(beside, provenance({"log": log, "rig": rig_path, "cells": rig.cells_path()}, options))
    title(f"{log} -> {output}")
    lines(
        [("samples", f"{tally.count:,} in, {tally.count:,} rows out, {tally.count / max(spent, 1e-9):,.0f} a second")]
    )
    lines(_shares(tally))
    _say(stream, tally, rig, source)
    short = [f"interrupted: {output.name} holds the {writer.rows:,} samples done until then"] if interrupted else []
    short += [source.torn] if source.torn else []
    note(short, kind="warning")
    if short:
        raise SystemExit(INTERRUPTED if interrupted else TORN)


def _fingertip(rig: Rig) -> Fingertip:
    settings, table, cells = rig.estimate, rig.load_cells, rig.cells()
    without = () if table is None else table.without
    return Fingertip(
        cells,
        rig.surface.load(rig.folder),
        settings.method,
        settings.friction,
        settings.torsion,
        accuracy=None if table is None else table.accuracy,
        on=None if settings.contact is None else settings.contact.on,
        off=None if settings.contact is None else settings.contact.off,
        sound=~np.isin(np.arange(cells.cells) + 1, without),
    )


def _written(
    source: Log, stream: FingertipStream, writer: ContactsWriter, tally: Downsample, rig: Rig, frame: str
) -> bool:
    """All blocks, and whether Ctrl-C ended it; without a row there is nothing to keep."""
    pose = rig.surface.pose.pose()
    try:
        with counting():
            for block, found in stream.stream(source.blocks()):
                with uninterrupted():
                    writer.write(block.time, found if frame == "surface" else in_frame(found, pose))
                    tally.add(Contacts.single(block.time, found, tally.count))
                progress(tally.count, source.position / max(source.size, 1))
    except KeyboardInterrupt:
        if not writer.rows:
            raise
        return True
    return False


def _shares(tally: Downsample) -> list[tuple[str, str]]:
    return [
        (Status(k).label, f"{percent(n / tally.count):>7}  {n:>9,}") for k, n in enumerate(tally.statuses.tolist()) if n
    ]


def _say(stream: FingertipStream, tally: Downsample, rig: Rig, source: Log) -> None:
    """What was assumed, how light is too light, and which cells are wrong."""
    fingertip, table = stream.fingertip, rig.load_cells
    note([*stream.said, f"a contact begins at {fingertip.on:.3g} N and ends at {fingertip.off:.3g} N"])
    accuracy = WANTED if fingertip.accuracy is None else fingertip.accuracy
    top = np.array([0.0, 0.0, fingertip.surface.b])
    least = fingertip.smallest_force(top, [0.0, 0.0, -1.0], accuracy)
    if fingertip.accuracy is not None and tally.statuses[Status.TOO_LIGHT]:
        note([f"too light for {1e3 * accuracy:g} mm: {least:.2g} N would do, straight on the middle of the surface"])
    else:
        note([f"from {least:.2g} N a touch on the middle of the surface is located within {1e3 * accuracy:g} mm"])
    note(source.notes())
    names = () if table is None else table.names(fingertip.cells.cells)
    spared = [f"cell {cell} is left out, as the rig says" for cell in (() if table is None else table.without)]
    note(
        [*spared, *stream.doubted, *(fault.said for fault in stream.faults(names)), *unexplained(tally.statuses)],
        "warning",
    )
