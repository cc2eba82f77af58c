"""Complete a run's report with the comparison to the ground truth, and with advice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.cli.evaluate import summaries
from palpate.cli.report_advice import coverage_advice, status_advice
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.evaluation.errors import HEADER
from palpate.evaluation.evaluate import EvaluationReport as Evaluation
from palpate.evaluation.evaluate import evaluate
from palpate.viewer import plots
from palpate.viewer.report import Picture, ReportTable, Section, Tile, percent, picture
from palpate.viewer.run_report import DownsampledRun, Run, coverage_tone
from palpate.viewer.samples import median

__all__ = ["judged"]

TOLERANCE = 0.02  # s: between a sample and the ground truth's instant
FINE = "Nothing stands out: models are calibrated, and the samples are answered."


def judged(run: Run, truth: TrueSamples | TrueTouches | None = None, *, mounted: bool = False) -> Run:
    """Return the `Run` with the ground truth's section and tiles, and with advice from statuses and coverage.

    Args:
        run: with the advice of its sensor.
        truth: ground truth of the contacts, in the surface's frame.
        mounted: the ellipses contain the uncertainty of the body's mounting.
    """
    found, section = None, Section("Against the ground truth")
    if truth is not None:
        found = evaluate(run.kept.contacts[run.kept.even], truth, tolerance=TOLERANCE)
        section = _section(run, truth, found)
    said = (*run.advice, *status_advice(run.summary.statuses), *coverage_advice(found, mounted=mounted))
    return replace(
        run,
        advice=said or (FINE,),
        tiles=(*run.tiles, *_tiles(found)),
        sections=(section, *run.sections),
    )


def _tiles(found: Evaluation | None) -> list[Tile]:
    if found is None or found.location is None:
        return []
    of = "touches" if found.touches else "samples"
    worst = f"mean of {found.location.count:,} {of}; worst {1e3 * found.location.worst:.2f} mm"
    tiles = [Tile("location error", f"{1e3 * found.location.mean:.2f} mm", worst)]
    if found.coverage.count:
        inside = found.coverage.inside
        tiles.append(Tile("truth in the ellipse", percent(inside), "should be 95 %", coverage_tone(inside)))
    return tiles


def _section(run: Run, truth: TrueSamples | TrueTouches, found: Evaluation) -> Section:
    title = "Against the ground truth"
    if not found.matched:
        return Section(title, text=("No sample matches the ground truth: both must be on one clock.",))
    kept = run.kept
    errors = evaluate(kept.contacts, truth, tolerance=TOLERANCE).errors  # of the peaks too, which no figure counts
    drawn = plots.errors(kept.contacts.time, errors, kept.radius)
    shown = [picture(drawn, "Distance of each located sample from the ground truth.")]
    if isinstance(truth, TrueTouches):
        shown.append(_touch_picture(kept, truth, found))
    few = f" (one in {run.summary.stride} of the log)" if run.summary.stride > 1 else ""
    text = f"{found.matched:,} of {found.samples:,} samples{few} have a ground truth, {found.answered:,} of these are "
    text += "answered."
    if found.coverage.count:
        text += (
            f" The 95 % ellipses hold it in {percent(found.coverage.inside)} of {found.coverage.count:,} samples, and "
            f"the mean square is {found.coverage.mean_square:.2f}, which should be 2."
        )
    table = ReportTable(("error", *HEADER), tuple(summaries(found)))
    return Section(title, text=(text,), pictures=tuple(shown), tables=(table,) if table.rows else ())


def _touch_picture(kept: DownsampledRun, truth: TrueTouches, found: Evaluation) -> Picture:
    time = kept.contacts.time
    radius = [
        median(kept.radius[(time >= start) & (time <= end)]) for start, end in zip(truth.start, truth.end, strict=True)
    ]
    error = np.array([touch.error for touch in found.touches])
    drawn = plots.touch_errors([touch.label for touch in found.touches], error, np.array(radius))
    return picture(drawn, "The median point of each touch against the ground truth, and the 95 % radius of a sample.")
