"""Estimate the contacts of all sensors of a robot in one log, for `palpate estimate`."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.cli.estimate_log import INTERRUPTED, TORN, Watch, ending, record_of, write_blocks
from palpate.cli.events import say_touches
from palpate.cli.report import require_page, status_advice
from palpate.cli.rig_options import RigOptions
from palpate.cli.summarising_writer import SummedWriter
from palpate.console.console import counting, note, progress, table, title, wait
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.events import Events
from palpate.errors import InputError, PalpateError
from palpate.files.atomic import keep_inputs, write_text
from palpate.files.contacts import open_contacts, require_format
from palpate.files.models import provenance
from palpate.setup.robot import Robot
from palpate.setup.robot_pipeline import RobotPipeline
from palpate.setup.robot_view import touched_robot
from palpate.viewer.report import ReportTable, percent, render
from palpate.viewer.robot_report import EstimatedRobot, compose_robot
from palpate.viewer.run_summary import RunSummary

LEFT_OUT = 4
_KEPT = 4_000  # samples of each sensor, for the report


def require_robot_options(robot: Robot, options: RigOptions, **others: object) -> None:
    """Check that no option is given that is of one sensor; `others`: further options by their names.

    Raises:
        InputError: one is.
    """
    given = {each.name: getattr(options, each.name) for each in fields(options)} | others
    for name, value in given.items():
        if name not in ("rig", "sensor") and value is not None:
            what = f"is of one sensor, but {robot.path} is the rig of a robot."
            raise InputError(what, where=f"--{name}", hint="Write it in the rig's [sensors.NAME].")


def estimate_robot(
    log: Path, robot: Robot, output: Path | None, frame: str, sensors: str | None, report: Path | None = None
) -> None:
    """Estimate the contacts of a robot's sensors, write them, and print a line for each sensor and the touches.

    Args:
        log: the log.
        robot: the robot.
        output: file of contacts; OUTPUT.toml follows when it is complete. None: contacts are only summarised.
        frame: frame of the contacts: "surface" or "sensor", each sensor's own, or "base", that of the robot.
        sensors: names of sensors, with commas between; None: all.
        report: page to write as well (.html), of contacts that are written to a file.

    Raises:
        InputError: the log or the rig cannot be used, no sensor can be estimated, or the output cannot be written.
        SystemExit: 130: interrupted; 3: the log was cut off; 4: a sensor was left out.
        KeyboardInterrupt: Ctrl-C before the first row.
    """
    if output is not None:
        inputs = (log, robot.path, *robot.files().values())
        keep_inputs(output, inputs, siblings=(record_of(output), *([report] if report else [])))
        require_format(output)
    if report is not None:
        require_page(report, output)
    wait("preparing the surfaces")
    with counting():
        pipeline, summary, record = write_robot(log, robot, output, frame, sensors, progress)
    title(str(log) if output is None else f"{log} -> {output}")
    touches, warnings, notes = summary.touches(), pipeline.warnings(), pipeline.notes()
    rows = summary.table(pipeline, touches)
    table(rows.header, rows.rows)
    say_touches(touches, "add -o FILE, and list them all with `palpate events FILE`")
    note(notes)
    note(warnings, kind="warning")
    if report is not None and output is not None:
        run = EstimatedRobot(
            log.name,
            output.name,
            frame,
            facts_of(robot),
            rows,
            summary.summaries,
            touches,
            provenance=record,
            notes=tuple(notes),
            warnings=tuple(warnings),
            advice=summary.advice(),
        )
        write_text(report, render(compose_robot(_drawn(run, robot, log))))
    ended = record["ended"]
    interrupted = ["interrupted: this covers the samples done until then"] if ended == "interrupted" else []
    note(interrupted, kind="warning")
    if ended != "whole" or pipeline.failed:
        raise SystemExit({"interrupted": INTERRUPTED, "torn": TORN}.get(ended, LEFT_OUT))


class WrittenRobot(NamedTuple):
    """Contacts of a robot's sensors in a file: the pipeline of its log, their summary, and contents of OUTPUT.toml."""

    pipeline: RobotPipeline
    summary: RobotWriter
    record: dict[str, str]


def write_robot(
    log: Path,
    robot: Robot,
    output: Path | None,
    frame: str,
    sensors: str | None,
    watch: Watch,
    *,
    keep_short: bool = True,
) -> WrittenRobot:
    """Write the contacts of a robot's sensors in one log, and summarise them; arguments as for `estimate_log`.

    Raises:
        InputError: the log or the rig cannot be used, no sensor can be estimated, or the output cannot be written.
        KeyboardInterrupt: Ctrl-C before the first row, or without `keep_short`.
    """
    pipeline = RobotPipeline(robot, log, frame, sensors)

    def made_from(*, interrupted: bool) -> dict[str, str]:
        names = ",".join(run.sensor.name for run in pipeline.runs)
        ended = ending(interrupted=interrupted, torn=pipeline.torn)
        options = {"frame": frame, "sensors": names, "ended": ended}
        return provenance({"log": log, "rig": robot.path, **robot.files()}, options)

    blocks = ((rows, rows, rows) for rows in pipeline.stream())
    summary = RobotWriter()
    writing = summary.writing(pipeline, output)
    _, record = write_blocks(blocks, lambda: pipeline.share, writing, watch, output, made_from, keep_short=keep_short)
    return WrittenRobot(pipeline, summary, record)


def facts_of(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Return names and values of a robot's settings."""
    stated, urdf = robot.table, robot.urdf
    moved = stated.joints if isinstance(stated.joints, str | None) else f"{len(stated.joints)} columns"
    links = "-" if urdf is None else f"{len(urdf.links)}, of which {len(urdf.shaped())} have a geometry"
    base = "-" if urdf is None else robot.base
    facts = {"urdf": stated.urdf, "links": links, "base": base, "joints": moved, "gravity": stated.gravity}
    return tuple((name, value or "-") for name, value in facts.items())


def _drawn(run: EstimatedRobot, robot: Robot, log: Path) -> EstimatedRobot:
    """Return the run with the robot drawn, or with the reason for which it is not."""
    if not len(run.touches):
        return replace(run, undrawn="No touch was found.")
    if run.frame != "base":
        return replace(run, undrawn="For a picture of the robot, estimate with --frame base.")
    try:
        layer, marks = touched_robot(robot, log, run.touches)
    except PalpateError as problem:  # contacts need fewer links than a picture
        return replace(run, undrawn=f"The robot is not drawn: {problem}")
    return replace(run, body=layer.body_at(0), marks=tuple(marks))


class RobotWriter(SummedWriter):
    """A writer that summarises the contacts of each sensor."""

    def __init__(self) -> None:
        super().__init__()
        self.summaries = dict[str, RunSummary]()

    @contextmanager
    def writing(self, pipeline: RobotPipeline, output: Path | None) -> Generator[SummedWriter]:
        """Open a context in which contacts are written to a file; None: they are only summarised."""
        self.summaries = {run.sensor.name: RunSummary(_KEPT) for run in pipeline.runs}
        if output is None:
            yield self
            return
        with open_contacts(output, frame_id=pipeline.frames(), features=pipeline.features) as writer:
            self._writer = writer
            yield self

    def write(self, found: Contacts, placed: Contacts) -> None:
        """Write and summarise a block."""
        if self._writer is not None:
            self._writer.write(placed)
        if found.origins is not None:
            for k, origin in enumerate(found.origins.among):
                own: Contacts = found[np.flatnonzero(found.origins.index == k)]
                self.summaries[origin.sensor].add(own)
        self.rows += len(placed)

    def touches(self) -> Events:
        """Return the touches of all sensors."""
        found = [each.finder.touches() for each in self.summaries.values()]
        return Events.joined([each for each in found if len(each)] or found[:1])

    def table(self, pipeline: RobotPipeline, touches: Events) -> ReportTable:
        """Return a table of the sensors: rows, the share of them that are in contact, and touches."""
        felt = dict(zip(*np.unique(touches.sensor, return_counts=True), strict=True))
        rows = list[tuple[str, ...]]()
        for each in (run.sensor for run in pipeline.runs):
            summary = self.summaries[each.name]
            answered = int(summary.statuses[Status.CONTACT] + summary.statuses[Status.AMBIGUOUS])
            share = percent(answered / max(summary.rows, 1))
            rows.append((each.name, each.kind.name, each.link, f"{summary.rows:,}", share, f"{felt.get(each.name, 0)}"))
        return ReportTable(("sensor", "kind", "link", "rows", "in contact", "touches"), tuple(rows))

    def advice(self) -> tuple[str, ...]:
        """Return sentences of advice on frequent statuses, after the names of the sensors."""
        return tuple(
            f"{name}: {said}" for name, each in self.summaries.items() for said in status_advice(each.statuses)
        )
