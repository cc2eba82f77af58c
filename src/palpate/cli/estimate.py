"""`palpate estimate`: a log and a surface go in, contacts come out."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import Annotated, Literal

import numpy as np
from tyro.conf import arg

from palpate.cli.estimate_load_cells import estimate_load_cells
from palpate.cli.interrupts import uninterrupted
from palpate.cli.options import FileOption, Log, Output
from palpate.cli.pipeline import Pipeline, open_pipeline
from palpate.cli.report import Run, write_report
from palpate.cli.screen import counting, lines, note, percent, progress, title
from palpate.cli.setup import Setup
from palpate.cli.skin import estimate_skin
from palpate.cli.tally import Tally
from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.frames import in_base, in_frame
from palpate.contact.truth import Samples, Touches
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs
from palpate.io.contacts import ContactsWriter, open_contacts, require_format
from palpate.io.models import provenance, write_provenance
from palpate.io.rig.skin import is_skin_rig
from palpate.io.truth import read_truth
from palpate.sensors.recording import ORIENTATION, POSITION, Recording
from palpate.viewer.report import require_report

__all__ = ["estimate"]

TORN, INTERRUPTED = 3, 130


def estimate(
    log: Log,
    /,
    output: Output,
    setup: Annotated[Setup, arg(name="")],
    frame: Literal["surface", "sensor", "base"] = "surface",
    report: FileOption = None,
    truth: FileOption = None,
) -> None:
    """Locate contacts in a log of wrenches, with a rig file, or with a mesh alone; or in frames of a taxel sheet.

    Options given here win over the rig. Beside OUTPUT stands OUTPUT.toml: versions, input hashes, options. Ctrl-C
    leaves the contacts found so far. Exit code 3: done, but the log was cut off.

    Args:
        log: CSV or Parquet with time,fx,fy,fz,tx,ty,tz and, where orientation matters, qx,qy,qz,qw; MCAP or a ROS bag
            with WrenchStamped and PoseStamped; or as the rig says. With [load_cells] in the rig: voltages. With [skin]:
            frames, as CSV with time and one column a cell, .npy, .npz, or MCAP with images or arrays.
        output: contacts to write: .csv, .parquet or .mcap.
        setup: what is touched and how it is located.
        frame: of the result; base needs the sensor's orientation and position in the log.
        report: page to write as well (.html): what was done, pictures, what to improve.
        truth: what is known of the contacts, to be drawn and judged in the report (see `palpate evaluate`).
    """
    if setup.rig is not None and is_skin_rig(setup.rig):
        _refuse_beside_skin(setup, frame, report, truth)
        estimate_skin(log, output, setup.rig)
        return
    rig = setup.load()
    beside = output.with_name(f"{output.name}.toml") if output.name else output
    inputs = (log, setup.rig, rig.mesh_path(), rig.payload_path(), rig.cells_path(), truth)
    keep_inputs(output, inputs, beside=(beside, *([report] if report else [])))
    require_format(output)  # this and what follows: before the work, not after it
    known = _known(truth, report)
    if rig.load_cells is not None:
        _require_no_report(report)
        estimate_load_cells(log, output, beside, rig, setup.rig, frame)
        return
    pipeline = open_pipeline(log, rig)
    if frame == "base":
        _require_pose(pipeline)
    tally = Tally()
    with ExitStack() as stack:
        writer = stack.enter_context(open_contacts(output, frame_id=frame))
        interrupted = _interrupted(pipeline, writer, tally, frame)
        with uninterrupted():  # a second Ctrl-C waits until the file is whole
            stack.close()
    record = provenance(
        {"log": log, "rig": setup.rig, "mesh": rig.mesh_path(), "payload": rig.payload_path(), "truth": truth},
        _options(pipeline, frame) | {"ended": _ended(pipeline, interrupted)},
    )
    write_provenance(beside, record)
    doubts = [*pipeline.doubted, *tally.doubts(pipeline.estimator)]
    short = [f"interrupted: {output.name} holds the {writer.rows:,} samples done until then"] if interrupted else []
    short += [pipeline.log.torn] if pipeline.log.torn else []
    _say(log, output, pipeline, tally, doubts)
    if report is not None:
        notes, warnings = (*pipeline.said, *pipeline.remarks(), *pipeline.notes()), (*doubts, *short)
        run = Run(
            log.name,
            output.name,
            rig,
            pipeline.estimator,
            tally.thinned,
            record,
            pipeline.seconds,
            tally.touches(),
            known,
            notes=notes,
            warnings=warnings,
        )
        write_report(report, run)
    note(short, kind="warning")
    if short:
        raise SystemExit(INTERRUPTED if interrupted else TORN)


def _refuse_beside_skin(setup: Setup, frame: str, report: Path | None, truth: Path | None) -> None:
    """Options that say something of a force/torque sensor."""
    said = {name: value for name, value in vars(setup).items() if name != "rig"}
    said |= {"report": report, "truth": truth, "frame": None if frame == "surface" else frame}
    wrong = [name for name, value in said.items() if value is not None]
    if wrong:
        raise InputError(
            "is for wrenches, and this rig has a [skin].",
            where=f"--{wrong[0]}",
            mend="Settings of a skin stand in the rig's [skin] and [contacts]; palpate evaluate judges the contacts.",
        )


def _ended(pipeline: Pipeline, interrupted: bool) -> str:
    """How, as it stands in OUTPUT.toml."""
    return "interrupted" if interrupted else "torn" if pipeline.log.torn else "whole"


def _require_no_report(report: Path | None) -> None:
    if report is not None:
        raise InputError(
            "a report is not written of load cells.", where="--report", mend="palpate view shows contacts."
        )


def _known(truth: Path | None, report: Path | None) -> Samples | Touches | None:
    if report is not None:
        if report.suffix.lower() not in (".html", ".htm"):
            raise InputError("the report is a page of HTML.", where=str(report), mend="Name it .html.")
        require_report()
    elif truth is not None:
        raise InputError(
            "the truth is for the report, and none is asked for.",
            where="--truth",
            mend="Add --report FILE, or compare with palpate evaluate.",
        )
    return None if truth is None else read_truth(truth)


def _interrupted(pipeline: Pipeline, writer: ContactsWriter, tally: Tally, frame: str) -> bool:
    """Locate, and whether Ctrl-C ended it; without a row there is nothing to keep."""
    try:
        with counting():
            _locate(pipeline, writer, tally, frame)
    except KeyboardInterrupt:
        if not writer.rows:
            raise
        return True
    return False


def _locate(pipeline: Pipeline, writer: ContactsWriter, tally: Tally, frame: str) -> None:
    """Every sample of the log, block by block."""
    pipeline.seconds["write"] = 0.0
    for block, found in pipeline.stream():
        placed = _in_frame(found, block, pipeline, frame)
        with uninterrupted():  # a block is written and counted, or neither
            begin = perf_counter()
            writer.write(block.time, placed)
            pipeline.seconds["write"] += perf_counter() - begin
            tally.add(block, found)
        progress(tally.samples, pipeline.log.position / max(pipeline.log.size, 1))


def _in_frame(found: ContactEstimate, block: Recording, pipeline: Pipeline, frame: str) -> ContactEstimate:
    mount = pipeline.estimator.mount
    if frame == "base":
        return in_base(found, block.channels[ORIENTATION], block.channels[POSITION], mount)
    return found if frame == "surface" else in_frame(found, mount)


def _require_pose(pipeline: Pipeline) -> None:
    for channel in (ORIENTATION, POSITION):
        if channel not in pipeline.channels:
            raise InputError(
                f"the base frame needs the sensor's {channel} in the base, which this log does not have.",
                where=str(pipeline.log.path),
                mend="A table needs columns qx,qy,qz,qw and x,y,z, messages a topic of poses; other names stand in the "
                "rig's [orientation] (columns, position, topic).",
            )


def _options(pipeline: Pipeline, frame: str) -> dict[str, object]:
    """What was in force, as it stands in OUTPUT.toml."""
    rig, estimator = pipeline.rig, pipeline.estimator
    locator, sensor, smooth = estimator.locator, estimator.sensor.sensor, estimator.filter
    source = "given" if rig.force_torque.noise else "unknown" if pipeline.noise is None else "steps of the log"
    return {
        **vars(rig.estimate),
        "contact": f"on {locator.on:g} N, off {locator.off:g} N",
        "crease": rig.surface.crease,
        "filter": "none" if smooth is None else f"{smooth} at {estimator.rate:.6g} Hz",
        "frame": frame,
        "noise": sensor.noise is not None and np.sqrt(np.diag(sensor.noise)).tolist(),
        "noise_source": source,
    }


def _say(log: Path, output: Path, pipeline: Pipeline, tally: Tally, doubts: list[str]) -> None:
    title(f"{log} -> {output}")
    lines([("samples", f"{tally.samples:,} in, {tally.samples:,} rows out")])
    lines(_shares(tally))
    spent = pipeline.seconds
    rate = tally.samples / max(spent["read"] + spent["locate"] + spent["write"], 1e-9)
    parts = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in spent.items())
    lines([("time", f"{parts}; {rate:,.0f} samples/s once prepared")])
    note([*pipeline.said, *pipeline.remarks()])
    note(pipeline.notes())
    note(doubts, kind="warning")


def _shares(tally: Tally) -> list[tuple[str, str]]:
    return [
        (Status(k).label, f"{percent(n / tally.samples):>7}  {n:>9,}") for k, n in enumerate(tally.counts.tolist()) if n
    ]
