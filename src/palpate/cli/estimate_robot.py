"""Estimate the contacts of all sensors of a robot in one log, for `palpate estimate`."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

import numpy as np

from palpate.cli.estimate_log import record_of, write_blocks
from palpate.cli.events import say_touches
from palpate.cli.rig_options import RigOptions
from palpate.cli.summarising_writer import SummedWriter
from palpate.console.console import counting, note, progress, table, title, wait
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.touch_finder import TouchFinder
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs
from palpate.files.contacts import open_contacts, require_format
from palpate.files.models import provenance
from palpate.setup.robot import Robot
from palpate.setup.robot_pipeline import RobotPipeline
from palpate.viewer.report import percent

LEFT_OUT, INTERRUPTED = 4, 130


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


def estimate_robot(log: Path, robot: Robot, output: Path | None, frame: str, sensors: str | None) -> None:
    """Estimate the contacts of a robot's sensors, write them, and print a line for each sensor and the touches.

    Args:
        log: the log.
        robot: the robot.
        output: file of contacts; OUTPUT.toml follows when it is complete. None: contacts are only summarised.
        frame: frame of the contacts: "surface" or "sensor", each sensor's own, or "base", that of the robot.
        sensors: names of sensors, with commas between; None: all.

    Raises:
        InputError: the log or the rig cannot be used, no sensor can be estimated, or the output cannot be written.
        SystemExit: 130: interrupted; 4: a sensor was left out.
        KeyboardInterrupt: Ctrl-C before the first row.
    """
    files = {"log": log, "rig": robot.path, **robot.files()}
    if output is not None:
        keep_inputs(output, files.values(), siblings=(record_of(output),))
        require_format(output)
    wait("preparing the surfaces")
    pipeline = RobotPipeline(robot, log, frame, None if sensors is None else tuple(sensors.split(",")))

    def made_from(*, interrupted: bool) -> dict[str, str]:
        names = ",".join(run.sensor.name for run in pipeline.runs)
        ended = "interrupted" if interrupted else "whole"
        return provenance(files, {"frame": frame, "sensors": names, "ended": ended})

    blocks = ((rows, rows, rows) for rows in pipeline.stream())
    summary = _RobotWriter()
    with counting():
        writing = summary.writing(pipeline, output)
        record = write_blocks(blocks, lambda: pipeline.share, writing, progress, output, made_from)[1]
    title(str(log) if output is None else f"{log} -> {output}")
    touches = summary.finder.touches()
    felt = dict(zip(*np.unique(touches.sensor, return_counts=True), strict=True))
    header = ("sensor", "kind", "link", "rows", "in contact", "touches")
    seen = [run.sensor for run in pipeline.runs]
    rows = [(each.name, each.kind.name, each.link, *summary.cells(each.name)) for each in seen]
    table(header, [(*cells, str(felt.get(cells[0], 0))) for cells in rows])
    say_touches(touches, "add -o FILE, and list them all with `palpate events FILE`")
    note(pipeline.notes())
    note(pipeline.warnings(), kind="warning")
    interrupted = record["ended"] == "interrupted"
    note(["interrupted: this covers the samples done until then"] if interrupted else [], kind="warning")
    if interrupted or pipeline.failed:
        raise SystemExit(INTERRUPTED if interrupted else LEFT_OUT)


class _RobotWriter(SummedWriter):
    """A writer that counts the rows of each sensor and finds the touches."""

    def __init__(self) -> None:
        super().__init__()
        self.statuses, self.finder = dict[str, np.ndarray](), TouchFinder()

    @contextmanager
    def writing(self, pipeline: RobotPipeline, output: Path | None) -> Generator[SummedWriter]:
        """Open a context in which contacts are written to a file; None: they are only counted."""
        if output is None:
            yield self
            return
        with open_contacts(output, frame_id=pipeline.frames(), features=pipeline.features) as writer:
            self._writer = writer
            yield self

    def write(self, found: Contacts, placed: Contacts) -> None:
        """Write and count a block."""
        if self._writer is not None:
            self._writer.write(placed)
        self.finder.add(found)
        for name in np.unique(found.sensor).tolist():
            counted = np.bincount(found.status[found.sensor == name], minlength=len(Status))
            self.statuses[name] = self.statuses.get(name, 0) + counted
        self.rows += len(placed)

    def cells(self, sensor: str) -> tuple[str, str]:
        """Return texts: the number of a sensor's rows, and the share of them that are in contact."""
        counts = self.statuses.get(sensor, np.zeros(len(Status), dtype=np.int64))
        answered = int(counts[Status.CONTACT] + counts[Status.AMBIGUOUS])
        return f"{counts.sum():,}", percent(answered / max(int(counts.sum()), 1))
