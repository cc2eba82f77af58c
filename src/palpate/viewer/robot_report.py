"""Compose the report of a run of a robot: its sensors, the touches on its links, and each sensor's forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

import numpy as np

from palpate.contact.events import Events
from palpate.spatial.arguments import frozen_value
from palpate.viewer import plots
from palpate.viewer.drawing import Drawing, Mark
from palpate.viewer.heat import FineMesh
from palpate.viewer.report import Report, ReportTable, Section, Tile, picture
from palpate.viewer.run_report import NUMBERED, SHOWN, DownsampledRun, inputs, touch_table
from palpate.viewer.run_summary import RunSummary
from palpate.viewer.samples import strongest


@frozen_value
class EstimatedRobot:
    """All information about a finished run of a robot for its report.

    Attributes:
        log, output: names, as a reader knows them.
        frame: frame of the contacts: "base", "surface" or "sensor".
        facts: names and values of the robot's settings.
        sensors: a row of texts for each sensor.
        summaries: name of a sensor -> summary of its contacts.
        touches: of all sensors.
        body: the robot as it is drawn; None: it is not.
        marks: the touches on it.
        undrawn: why it is not drawn.
        provenance: inputs with their hashes, options.
        notes, warnings: messages printed for the user.
        advice: what to improve, a sentence each.
    """

    log: str
    output: str
    frame: str
    facts: tuple[tuple[str, str], ...]
    sensors: ReportTable
    summaries: Mapping[str, RunSummary]
    touches: Events
    body: FineMesh | None = None
    marks: tuple[Mark, ...] = ()
    undrawn: str = ""
    provenance: Mapping[str, str] = field(default_factory=lambda: {})
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()


def compose_robot(run: EstimatedRobot) -> Report:
    """Return the `Report` of a robot's run, with its figures drawn.

    Raises:
        InputError: matplotlib is not installed.
    """
    samples = sum(each.samples for each in run.summaries.values())
    touches = Section("Touches")
    if len(run.touches):
        touches = Section("Touches", tables=(touch_table(run.touches, SHOWN, spelled=True),))
    sections = (
        Section("Robot", settings=run.facts, tables=(run.sensors,)),
        _places(run),
        _forces(run.summaries),
        touches,
        Section("What to improve", points=run.advice),
        inputs(run.provenance),
        Section("Notes of the run", points=run.notes),
    )
    return Report(
        title=f"Contacts of a robot in {run.log}",
        summary=f"{samples:,} readings of {len(run.summaries)} sensors were read from {run.log}; contacts went to "
        f"{run.output}.",
        tiles=tuple(_tiles(run.summaries, run.touches)),
        warnings=run.warnings,
        sections=tuple(section for section in sections if section),
        footer=f"palpate {run.provenance.get('palpate', '')}. Lengths, forces and times in the units next to them; "
        f"points in {'the base frame' if run.frame == 'base' else f'the {run.frame} frame of each sensor'}.",
    )


def _tiles(summaries: Mapping[str, RunSummary], touches: Events) -> Sequence[Tile]:
    felt = f"of {len(set(touches.sensor.tolist()))} sensors"
    tiles = [Tile("sensors", f"{len(summaries)}"), Tile("touches", f"{len(touches):,}", felt)]
    if len(touches):
        k = int(touches.peak_force.argmax())
        tiles.append(Tile("peak force", f"{touches.peak_force[k]:.3g} N", f"{touches.sensor[k]}, touch {k + 1}"))
        sizes = 1e3 * touches.deviation[np.isfinite(touches.deviation)]
        tiles += (
            [Tile("standard deviation", f"{np.median(sizes):.2g} mm", "median of the touches")] if len(sizes) else []
        )
    return tiles


def _places(run: EstimatedRobot) -> Section:
    title, body = "Where it was touched", run.body
    if body is None:
        return Section(title, text=(run.undrawn,) if run.undrawn else ())
    point, normal = (np.array([getattr(mark, name) for mark in run.marks]) for name in ("point", "normal"))
    drawn = plots.silhouettes(body.vertices, body.faces, point, normal, run.touches.peak_force)
    words = (
        "The robot in its base frame as it stood at the strongest touch, to be turned, and from three sides. Each "
        "touch is drawn where it was on its link. Dots are on the near side, rings on the far one."
    )
    turned = Drawing(body.vertices, body.faces, run.marks[:NUMBERED], title=f"where the robot of {run.log} was touched")
    return Section(title, pictures=(picture(drawn, words),), drawing=turned.html())


def _forces(summaries: Mapping[str, RunSummary]) -> Section:
    curves = dict[str, tuple[np.ndarray, np.ndarray]]()
    for name, summary in summaries.items():
        kept = DownsampledRun(summary.contacts, summary.even)
        rows = strongest(kept.contacts, kept.starts)
        force = np.where(kept.contacts.answered, kept.strength, 0.0)[rows]
        curves[name] = kept.contacts.time[rows], force
    words = "Force of each sensor's strongest contact; 0 where none is located."
    return Section("Force over time", pictures=(picture(plots.sensor_forces(curves), words),))
