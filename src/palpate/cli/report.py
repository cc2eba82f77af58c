"""Make the report of a finished run, with the comparison to the ground truth and advice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Int

from palpate.cli.evaluate import summaries
from palpate.contact.estimate import Status
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.contact.plausibility import UNLOADED
from palpate.errors import InputError
from palpate.evaluation.errors import HEADER
from palpate.evaluation.evaluate import EvaluationReport, evaluate
from palpate.setup.pipeline import Pipeline
from palpate.setup.view import view_of
from palpate.viewer import plots
from palpate.viewer.report import Picture, ReportTable, Section, Tile, percent, picture, require_report
from palpate.viewer.run_report import DownsampledRun, Run, coverage_tone
from palpate.viewer.run_summary import RunSummary
from palpate.viewer.samples import median

TITLE = "Against the ground truth"
TOLERANCE = 0.02  # s: between a sample and the ground truth's instant
FINE = "Nothing stands out: models are calibrated, and the samples are answered."
_REMEDY = {  # of a status that is common: from which share on, of the loaded samples or of all, and what to do
    Status.AMBIGUOUS: (0.05, "if only a part of the body can be touched, state it as surface.region."),
    Status.OFF_SURFACE: (0.02, "check pose, unit and mesh of the surface, the payload, and touches elsewhere."),
    Status.IMPLAUSIBLE: (0.02, "check payload and mounting; for a soft contact, estimate.friction and torsion."),
    Status.SATURATED: (0.0, "press less, or use a sensor of a larger range."),
    Status.INVALID: (0.0, "check the program that wrote the log."),
    Status.NO_POSE: (0.0, "poses are missing or too sparse: check orientation.max_gap, offset, and the poses' topic."),
}
ENOUGH = 50  # samples before their coverage means something


def require_page(report: Path, output: Path | None) -> None:
    """Check, before the work, that the page of a report can be made.

    Raises:
        InputError: contacts are not written to a file, the page is not HTML, or matplotlib or jinja2 is not installed.
    """
    if output is None:
        raise InputError("a report needs contacts that are written to a file.", where="--report", hint="Add -o FILE.")
    if report.suffix.lower() not in (".html", ".htm"):
        raise InputError("the report must end in .html.", where=str(report), hint="Use another name.")
    require_report()


def run_of(
    pipeline: Pipeline, summary: RunSummary, record: Mapping[str, str], output: str, warnings: tuple[str, ...]
) -> Run:
    """Return the `Run` of a finished estimate, with the additions of its sensor.

    Args:
        pipeline: pipeline that has run.
        summary: summary of its contacts.
        record: contents of OUTPUT.toml.
        output: name of the file of contacts.
        warnings: warnings shown to the user.

    Raises:
        InputError: matplotlib is not installed.
    """
    log, view = pipeline.log, view_of(pipeline.log.kind)
    settings = {*pipeline.settings, "sensor"}  # shown as such
    run = Run(
        log.path.name,
        output,
        f"and turned into contacts as those of {log.kind.called}",
        summary,
        settings=view.settings(pipeline.settings),
        provenance={name: text for name, text in record.items() if name not in settings and text != "whole"},
        stages={"read": log.seconds, **pipeline.seconds},
        notes=tuple(pipeline.notes()),
        warnings=warnings,
    )
    return view.report(run, log.setup, pipeline.estimator)


def judged(run: Run, truth: TrueSamples | TrueTouches | None = None, *, mounted: bool = False) -> Run:
    """Return a copy of a `Run` with the ground truth's section and tiles, and advice from statuses and coverage.

    Args:
        run: from `run_of`.
        truth: ground truth of the contacts, in the surface's frame; None: the section is empty.
        mounted: the ellipses contain the uncertainty of the body's mounting.

    Raises:
        InputError: matplotlib is not installed, for a `truth` that matches samples.
    """
    found, section = None, Section(TITLE)
    if truth is not None:
        found = evaluate(run.kept.contacts[run.kept.even], truth, tolerance=TOLERANCE)
        section = _section(run, truth, found)
    advice = (*run.advice, *status_advice(run.summary.statuses), *_coverage_advice(found, mounted=mounted)) or (FINE,)
    return replace(run, advice=advice, tiles=(*run.tiles, *_tiles(found)), sections=(section, *run.sections))


def _tiles(found: EvaluationReport | None) -> list[Tile]:
    if found is None or found.location is None:
        return []
    of = "touches" if found.touches else "samples"
    worst = f"mean of {found.location.count:,} {of}; worst {1e3 * found.location.worst:.2f} mm"
    tiles = [Tile("location error", f"{1e3 * found.location.mean:.2f} mm", worst)]
    if found.coverage.count:
        inside = found.coverage.inside
        tiles.append(Tile("truth in the ellipse", percent(inside), "should be 95 %", coverage_tone(inside)))
    return tiles


def _section(run: Run, truth: TrueSamples | TrueTouches, found: EvaluationReport) -> Section:
    if not found.matched:
        return Section(TITLE, text=("No sample matches the ground truth: both must be on one clock.",))
    kept = run.kept
    errors = evaluate(kept.contacts, truth, tolerance=TOLERANCE).errors  # of the peaks too, which no figure counts
    drawn = plots.errors(kept.contacts.time, errors, kept.radius)
    shown = [picture(drawn, "Distance of each located sample from the ground truth.")]
    if isinstance(truth, TrueTouches):
        shown.append(_touch_picture(kept, truth, found))
    few = f" (one in {run.summary.stride} of the log)" if run.summary.stride > 1 else ""
    matched = f"{found.matched:,} of {found.samples:,} samples{few} have a ground truth"
    text = f"{matched}, {found.answered:,} of these are answered."
    if found.coverage.count:
        text += (
            f" The 95 % ellipses hold it in {percent(found.coverage.inside)} of {found.coverage.count:,} samples, and "
            f"the mean square is {found.coverage.mean_square:.2f}, which should be 2."
        )
    table = ReportTable(("error", *HEADER), tuple(summaries(found)))
    return Section(TITLE, text=(text,), pictures=tuple(shown), tables=(table,) if table.rows else ())


def _touch_picture(kept: DownsampledRun, truth: TrueTouches, found: EvaluationReport) -> Picture:
    time = kept.contacts.time
    radius = [
        median(kept.radius[(time >= start) & (time <= end)]) for start, end in zip(truth.start, truth.end, strict=True)
    ]
    error = np.array([touch.error for touch in found.touches])
    drawn = plots.touch_errors([touch.label for touch in found.touches], error, np.array(radius))
    return picture(drawn, "The median point of each touch against the ground truth, and the 95 % radius of a sample.")


def status_advice(counts: Int[np.ndarray, " s"]) -> tuple[str, ...]:
    """Return sentences of advice on frequent statuses; `counts` (len(Status),): samples of each status."""
    total = int(counts.sum())
    loaded = total - int(counts[list(UNLOADED)].sum())
    advice: list[str] = []
    for kind, (least, remedy) in _REMEDY.items():
        of, name = (total, "samples") if kind in (Status.INVALID, Status.NO_POSE) else (loaded, "loaded samples")
        if counts[kind] and counts[kind] >= least * of:
            advice.append(f"{percent(counts[kind] / of)} of the {name} are {kind.words}: {remedy}")
    return tuple(advice)


def _coverage_advice(found: EvaluationReport | None, *, mounted: bool) -> tuple[str, ...]:
    """Return (sentence,) if ellipses are too large or small, else ()."""
    if found is None or found.coverage.count < ENOUGH:
        return ()
    inside = found.coverage.inside
    if inside > 0.995:
        return (f"The 95 % ellipses hold the truth in {percent(inside)}: the noise in the rig is too large.",)
    if inside >= 0.85:
        return ()
    likely = "noise or mesh are worse than stated" if mounted else "the error of the mounting is not in them"
    return (f"The 95 % ellipses hold the truth in {percent(inside)} only: {likely}.",)
