"""Run `palpate estimate`: find the contacts in a log with a rig."""

from __future__ import annotations

from os import cpu_count
from pathlib import Path
from shlex import join
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Int
from tyro.conf import arg

from palpate.cli.contact_files import compared_blocks
from palpate.cli.estimate_log import INTERRUPTED, TORN, Estimated, estimate_log, record_of
from palpate.cli.estimate_robot import estimate_robot, require_robot_options
from palpate.cli.events import say_touches
from palpate.cli.report import judged, require_page, run_of
from palpate.cli.rig_options import RigOptions
from palpate.console.console import counting, lines, note, progress, shares, title, wait
from palpate.console.options import CountOption, FileOption, Log
from palpate.contact.estimate import Status
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs, write_text
from palpate.files.contacts import require_format
from palpate.files.ground_truth import read_ground_truth
from palpate.setup.link import Link
from palpate.setup.load import robot_of
from palpate.setup.pipeline import OpenedLog
from palpate.viewer.report import render
from palpate.viewer.run_compare import compared
from palpate.viewer.run_report import compose
from palpate.viewer.run_summary import RunSummary

UNBELIEVABLE = 4
LONG = 100_000_000  # bytes of a log from which other processes are worth their start


def estimate(
    log: Log,
    /,
    *,
    output: Annotated[FileOption, arg(aliases=["-o"])] = None,
    setup: Annotated[RigOptions, arg(name="")],
    frame: Literal["surface", "sensor", "base"] = "surface",
    report: FileOption = None,
    truth: FileOption = None,
    compare: FileOption = None,
    workers: CountOption = None,
) -> None:
    """Estimate contacts in a log, with a rig or with a mesh alone.

    Options given here override the rig. OUTPUT.toml is written next to OUTPUT: versions, input hashes, options. Ctrl-C
    keeps the contacts found so far. Exit code 3: done, but the log was cut off; 4: done, but nothing in it can be
    believed, for a reason that is printed last.

    Args:
        log: CSV, Parquet, NumPy, MCAP or a ROS bag. Wrenches: columns time,fx,fy,fz,tx,ty,tz and, where orientation
            matters, qx,qy,qz,qw, or topics with WrenchStamped and PoseStamped. Load cells: their voltages. A taxel
            sheet: one column a cell, or arrays, or images. The rig states other names and units.
        output: contacts to write: .csv, .parquet or .mcap. Without it only a summary and the touches are printed.
        setup: what is touched, and how contacts are found.
        frame: coordinate frame of the result; base needs the sensor's orientation and position in the log.
        report: page to write as well (.html): what was done, pictures, what to improve.
        truth: ground truth of the contacts, drawn and evaluated in the report (see `palpate evaluate`).
        compare: other contacts, such as of the same log by other settings, to compare with these in the report.
        workers: 1: one process does everything; 2 or more: other processes read and write, and this many threads
            locate, with identical results. By default 1; for logs of 100 MB and more, one thread per core.

    Raises:
        InputError: a file or an option cannot be used, or an output is an input.
        OSError: an input file cannot be read for its digest.
        KeyboardInterrupt: Ctrl-C before the first row.
        SystemExit: 130: interrupted; 3: the log was cut off; 4: nothing in it can be believed.
        GeometryError: the mesh has no usable surface.
    """
    if workers is not None and workers < 1:
        raise InputError(f"must be at least 1, not {workers}.", where="--workers")
    if setup.rig is not None and (robot := robot_of(setup.rig)) is not None:
        require_robot_options(robot, setup, truth=truth, compare=compare, workers=workers)
        estimate_robot(log, robot, output, frame, setup.sensor, report)
        return
    rig = setup.load()
    inputs = (log, setup.rig, *rig.files().values(), truth, compare)
    if output is not None:  # this and what follows: before the work, not after it
        keep_inputs(output, inputs, siblings=(record_of(output), *([report] if report else [])))
        require_format(output)
    if report is not None:
        require_page(report, output)
    known, other = _ground_truth(truth, report), _compared(compare, report, rig.resolve().link)
    opened = setup.open(log, rig)
    wait("preparing the surface")
    files = {"log": log, "rig": setup.rig, **opened.files(), "truth": truth}
    with counting():
        done = estimate_log(opened, output, frame, files, progress, workers=_workers(opened, workers))
    _say(str(log) if output is None else f"{log} -> {output}", done)
    if output is None:
        say_touches(done.summary.finder.touches(), "add -o FILE, and list them all with `palpate events FILE`")
    elif report is not None:
        warnings = (*([done.nothing] if done.nothing else []), *done.warnings, *done.short)
        run = run_of(done.pipeline, done.summary, done.record, output.name, warnings)
        run = judged(run, known, mounted=opened.setup.link.mount_covariance is not None)
        write_text(report, render(compose(run if other is None else compared(run, *other))))
    note(done.short, kind="warning")
    note([done.nothing] if done.nothing else [], kind="warning")
    note(_next(log, setup, done.summary.statuses))
    if done.short or done.nothing:
        raise SystemExit(INTERRUPTED if done.ended == "interrupted" else TORN if done.short else UNBELIEVABLE)


def _next(log: Path, setup: RigOptions, statuses: Int[np.ndarray, " s"]) -> list[str]:
    """Return the command to try if a mesh alone gives implausible contacts, else []."""
    answered = statuses[Status.CONTACT] + statuses[Status.AMBIGUOUS]
    if setup.rig is not None or setup.mesh is None or statuses[Status.IMPLAUSIBLE] <= answered:
        return []
    made = join(["palpate", "rig", "new", str(log), str(setup.mesh), "-o", "rig.toml"])
    return [f"next: `{made}`; then state in that rig the payload, the tare and the pose of the mesh"]


def _workers(opened: OpenedLog, requested: int | None) -> int:
    """Return the number of threads that locate; 1, as for a pipe: nothing runs in parallel."""
    count = requested or ((cpu_count() or 1) if opened.size >= LONG else 1)
    return count if opened.path.is_file() or opened.path.is_dir() else 1


def _ground_truth(truth: Path | None, report: Path | None) -> TrueSamples | TrueTouches | None:
    if report is None and truth is not None:
        hint = "Add --report FILE, or compare with palpate evaluate."
        raise InputError("is used only in the report, but --report is missing.", where="--truth", hint=hint)
    return None if truth is None else read_ground_truth(truth)


def _compared(path: Path | None, report: Path | None, link: Link) -> tuple[str, RunSummary] | None:
    """Return name and summary of the contacts to compare."""
    if path is None:
        return None
    if report is None:
        raise InputError("is used only in a report: add --report FILE.", where="--compare")
    other = RunSummary()
    for block in compared_blocks(path, link):
        other.add(block)
    return path.name, other


def _say(heading: str, done: Estimated) -> None:
    pipeline, summary = done.pipeline, done.summary
    title(heading)
    several = f"; up to {summary.most} contacts at once" if summary.most > 1 else ""
    lines([("samples", f"{summary.samples:,} in, {summary.rows:,} rows out{several}")])
    lines(shares(summary.statuses))
    spent = {"read": pipeline.log.seconds, **pipeline.seconds}
    busy = min(sum(spent.values()) - spent["prepare"] - spent["compile"], done.took)  # processes work at the same time
    rate = summary.samples / max(busy, 1e-9)
    parts = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in spent.items())
    lines([("time", f"{parts}; {rate:,.0f} samples/s once prepared and compiled")])
    note(pipeline.notes())
    note(done.warnings, kind="warning")
