"""`palpate estimate` where the log holds the voltages of load cells."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from time import perf_counter

import numpy as np

from palpate.cli.interrupts import uninterrupted
from palpate.cli.screen import counting, lines, note, percent, progress, title, wait
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.frames import in_frame
from palpate.contact.locate import Locator
from palpate.contact.plausibility import unexplained
from palpate.contact.resolution import WANTED, resolution
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.errors import InputError
from palpate.io.contacts import ContactsWriter, open_contacts
from palpate.io.logs import Log, join, open_log
from palpate.io.models import provenance, write_provenance
from palpate.io.rig import Rig
from palpate.sensors.load_cell_array import START, LoadCellArray
from palpate.sensors.recording import Recording
from palpate.sensors.wrench_sensor import Tare
from palpate.viewer.thinned import Thinned

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
    source, array = open_log(log, rig.layout()), _array(rig)
    estimator = _estimator(rig, array)
    blocks = source.blocks()
    first = _start(blocks, seconds := rig.estimate.tare or START)
    known = first.time[np.isfinite(first.time)]
    zero = estimator.tare(first.picked(first.time <= (known[0] if len(known) else np.inf) + seconds))
    tally, spent = Thinned(), perf_counter()
    with ExitStack() as stack:
        writer = stack.enter_context(open_contacts(output, frame_id=frame))
        pairs = estimator.pairs(chain([first], blocks))
        interrupted = _written(source, pairs, writer, tally, rig, frame)
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
    _say(zero, estimator, array, tally, rig, source)
    short = [f"interrupted: {output.name} holds the {writer.rows:,} samples done until then"] if interrupted else []
    short += [source.torn] if source.torn else []
    note(short, kind="warning")
    if short:
        raise SystemExit(INTERRUPTED if interrupted else TORN)


def _array(rig: Rig) -> LoadCellArray:
    table, cells = rig.load_cells, rig.cells()
    sound = ~np.isin(np.arange(cells.cells) + 1, () if table is None else table.without)
    return LoadCellArray(cells, sound, names=() if table is None else table.names(cells.cells))


def _estimator(rig: Rig, array: LoadCellArray) -> WrenchEstimator:
    settings, table = rig.estimate, rig.load_cells
    locator = Locator(
        rig.surface.load(rig.folder),
        settings.method,
        settings.friction,
        settings.torsion,
        array.noise,
        on=None if settings.contact is None else settings.contact.on,
        off=None if settings.contact is None else settings.contact.off,
        indentation=array.cells.indentation,
        accuracy=None if table is None else table.accuracy,
    )
    return WrenchEstimator(locator, array)


def _start(blocks: Iterator[Recording], seconds: float) -> Recording:
    """The first blocks, of so many seconds if there are."""
    first = list[Recording]()
    for block in blocks:
        first.append(block)
        times = np.concatenate([part.time for part in first])
        if np.nanmax(times, initial=-np.inf) > np.nanmin(times, initial=np.inf) + seconds:
            break
    return join(first)


def _written(
    source: Log,
    pairs: Iterator[tuple[Recording, Contacts]],
    writer: ContactsWriter,
    tally: Thinned,
    rig: Rig,
    frame: str,
) -> bool:
    """All blocks, and whether Ctrl-C ended it; without a row there is nothing to keep."""
    pose = rig.surface.pose.pose()
    try:
        with counting():
            for block, contacts in pairs:
                found = contacts.estimate
                with uninterrupted():
                    writer.write(block.time, found if frame == "surface" else in_frame(found, pose))
                    tally.add(block.time, found)
                progress(tally.count, source.position / max(source.size, 1))
    except KeyboardInterrupt:
        if not writer.rows:
            raise
        return True
    return False


def _shares(tally: Thinned) -> list[tuple[str, str]]:
    return [
        (Status(k).label, f"{percent(n / tally.count):>7}  {n:>9,}") for k, n in enumerate(tally.statuses.tolist()) if n
    ]


def _say(zero: Tare, estimator: WrenchEstimator, array: LoadCellArray, tally: Thinned, rig: Rig, source: Log) -> None:
    """What was assumed, how light is too light, and which cells are wrong."""
    locator, table = estimator.locator, rig.load_cells
    note([zero.said, f"a contact begins at {locator.on:.3g} N and ends at {locator.off:.3g} N"])
    accuracy = WANTED if locator.accuracy is None else locator.accuracy
    up = np.array([[0.0, 0.0, 1.0]])
    top = locator.surface.project(locator.surface.centre + locator.surface.size * up)[0]
    least = float(resolution(array.cells, top, up, tare=1.0 / array.zero.share).smallest(accuracy)[0])
    if locator.accuracy is not None and tally.statuses[Status.TOO_LIGHT]:
        note([f"too light for {1e3 * accuracy:g} mm: {least:.2g} N would do, straight on the middle of the surface"])
    else:
        note([f"from {least:.2g} N a touch on the middle of the surface is located within {1e3 * accuracy:g} mm"])
    note(source.notes())
    spared = [f"cell {cell} is left out, as the rig says" for cell in (() if table is None else table.without)]
    doubts = [zero.doubt] if zero.doubt else []
    note([*spared, *doubts, *estimator.doubts(), *unexplained(tally.statuses)], "warning")
