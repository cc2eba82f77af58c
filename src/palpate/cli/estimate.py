"""`palpate estimate`: a log and a rig go in, contacts come out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import Annotated, Literal

from tyro.conf import arg

from palpate.cli.console import counting, lines, note, progress, shares, title, wait
from palpate.cli.contact_files import compared_blocks
from palpate.cli.interrupts import import_mesh_reader, uninterrupted
from palpate.cli.options import FileOption, Log, Output
from palpate.cli.report import judged
from palpate.cli.report_advice import mounting_known
from palpate.cli.run_report import run_of
from palpate.cli.setup import Setup
from palpate.contact.ground_truth import Samples, Touches
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs, write_text
from palpate.io.contacts import ContactsWriter, open_contacts, require_format
from palpate.io.ground_truth import read_ground_truth
from palpate.io.models import provenance, write_provenance
from palpate.io.pipeline import OpenedLog, Pipeline
from palpate.io.rig import Rig
from palpate.viewer.report import render, require_report
from palpate.viewer.run_compare import beside
from palpate.viewer.run_report import compose
from palpate.viewer.run_summary import RunSummary

__all__ = ["estimate"]

TORN, UNBELIEVABLE, INTERRUPTED = 3, 4, 130


def estimate(
    log: Log,
    /,
    output: Output,
    setup: Annotated[Setup, arg(name="")],
    frame: Literal["surface", "sensor", "base"] = "surface",
    report: FileOption = None,
    truth: FileOption = None,
    compare: FileOption = None,
) -> None:
    """Find contacts in the log of any sensor, with a rig, or in a log of wrenches with a mesh alone.

    Options given here win over the rig. Beside OUTPUT stands OUTPUT.toml: versions, input hashes, options. Ctrl-C
    leaves the contacts found so far. Exit code 3: done, but the log was cut off; 4: done, but nothing in it can be
    believed, for a reason that is said last.

    Args:
        log: CSV, Parquet, NumPy, MCAP or a ROS bag. Wrenches: columns time,fx,fy,fz,tx,ty,tz and, where orientation
            matters, qx,qy,qz,qw, or topics with WrenchStamped and PoseStamped. Load cells: their voltages. A taxel
            sheet: one column a cell, or arrays, or images. Other names and units stand in the rig.
        output: contacts to write: .csv, .parquet or .mcap.
        setup: what is touched, and how contacts are found.
        frame: of the result; base needs the sensor's orientation and position in the log.
        report: page to write as well (.html): what was done, pictures, what to improve.
        truth: what is known of the contacts, to be drawn and judged in the report (see `palpate evaluate`).
        compare: other contacts, such as of the same log by other settings, to stand beside these in the report.
    """
    rig = setup.load()
    record_file = output.with_name(f"{output.name}.toml") if output.name else output
    inputs = (log, setup.rig, *rig.files().values(), truth, compare)
    keep_inputs(output, inputs, beside=(record_file, *([report] if report else [])))
    require_format(output)  # this and what follows: before the work, not after it
    known, other = _ground_truth(truth, report), _compared(compare, report, rig)
    opened = setup.open(log, rig)
    import_mesh_reader()
    wait("preparing the surface and compiling kernels (compiling happens once)")
    pipeline, summary = Pipeline.of(opened, frame), RunSummary()
    pipeline.seconds["write"] = 0.0
    with ExitStack() as stack:
        writer = stack.enter_context(open_contacts(output, frame_id=frame, features=pipeline.estimator.features))
        interrupted = _interrupted(pipeline, writer, summary)
        with uninterrupted():  # a second Ctrl-C waits until the file is whole
            stack.close()
    ended = "interrupted" if interrupted else "torn" if opened.torn else "whole"
    files = {"log": log, "rig": setup.rig, **rig.files(opened.kind), "truth": truth}
    options = {**pipeline.facts, "frame": frame, "sensor": opened.kind.name, "ended": ended}
    record = provenance(files, options)
    write_provenance(record_file, record)
    doubts = pipeline.doubts()
    short, nothing = list(_short(output, opened, summary, interrupted=interrupted)), pipeline.unbelievable()
    _say(f"{log} -> {output}", pipeline, summary, doubts)
    if report is not None:
        warnings = (*([nothing] if nothing else []), *doubts, *short)
        run = run_of(pipeline, summary, record, output.name, warnings)
        run = judged(run, known, mounted=mounting_known(rig))
        write_text(report, render(compose(run if other is None else beside(run, other[0], other[1]))))
    note(short, kind="warning")
    note([nothing] if nothing else [], kind="warning")
    if short or nothing:
        raise SystemExit(INTERRUPTED if interrupted else TORN if short else UNBELIEVABLE)


def _ground_truth(truth: Path | None, report: Path | None) -> Samples | Touches | None:
    if report is not None:
        if report.suffix.lower() not in (".html", ".htm"):
            raise InputError("the report is a page of HTML.", where=str(report), hint="Name it .html.")
        require_report()
    elif truth is not None:
        raise InputError(
            "the truth is for the report, and none is asked for.",
            where="--truth",
            hint="Add --report FILE, or compare with palpate evaluate.",
        )
    return None if truth is None else read_ground_truth(truth)


def _compared(path: Path | None, report: Path | None, rig: Rig) -> tuple[str, RunSummary] | None:
    """Name and summary of the contacts to stand beside these."""
    if path is None:
        return None
    if report is None:
        raise InputError("is for the report, and none is asked for.", where="--compare", hint="Add --report FILE.")
    other = RunSummary()
    for block in compared_blocks(path, rig):
        other.add(block)
    return path.name, other


def _interrupted(pipeline: Pipeline, writer: ContactsWriter, summary: RunSummary) -> bool:
    """Every sample of the log, block by block; whether Ctrl-C ended it. Without a row there is nothing to keep."""
    try:
        with counting():
            for _, found, placed in pipeline.stream():
                with uninterrupted():  # a block is written and counted, or neither
                    begin = perf_counter()
                    writer.write(placed)
                    pipeline.seconds["write"] += perf_counter() - begin
                    summary.add(found)
                progress(summary.samples, pipeline.log.position / max(pipeline.log.size, 1))
    except KeyboardInterrupt:
        if not writer.rows:
            raise
        return True
    return False


def _short(output: Path, log: OpenedLog, summary: RunSummary, *, interrupted: bool) -> Iterator[str]:
    """Why not all of the log is in the output."""
    if interrupted:
        yield f"interrupted: {output.name} holds the {summary.samples:,} samples done until then"
    if log.torn:
        yield log.torn


def _say(heading: str, pipeline: Pipeline, summary: RunSummary, doubts: list[str]) -> None:
    title(heading)
    several = f"; up to {summary.most} contacts at once" if summary.most > 1 else ""
    lines([("samples", f"{summary.samples:,} in, {summary.rows:,} rows out{several}")])
    lines(shares(summary.statuses))
    spent = {"read": pipeline.log.seconds, **pipeline.seconds}
    rate = summary.samples / max(sum(spent.values()) - spent["prepare"] - spent["compile"], 1e-9)
    parts = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in spent.items())
    lines([("time", f"{parts}; {rate:,.0f} samples/s once prepared and compiled")])
    note(pipeline.notes())
    note(doubts, kind="warning")
