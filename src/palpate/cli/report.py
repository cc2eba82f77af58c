"""What a run found, put together as a report: which figures, which words, and what to improve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.cli.console import percent
from palpate.cli.evaluate import HEADER, spreads
from palpate.cli.report_advice import MEANING, advice
from palpate.cli.report_settings import budget, inputs, models, settings, surface_name
from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.estimator import Estimator
from palpate.contact.events import Events
from palpate.contact.ground_truth import Samples, Touches
from palpate.contact.plausibility import UNLOADED
from palpate.evaluation.errors import CHI2_95, distances
from palpate.evaluation.evaluate import Report as Evaluation
from palpate.evaluation.evaluate import evaluate
from palpate.evaluation.matching import nearest_in_time
from palpate.io.atomic import write_text
from palpate.io.rig import Rig
from palpate.viewer import plots
from palpate.viewer.report import Picture, Report, Section, Table, Tile, picture, render
from palpate.viewer.thinned import Thinned

__all__ = ["Run", "compose", "write_report"]

SHOWN = 200  # touches in the table
TOLERANCE = 0.02  # s: between a sample and the truth's instant


@dataclass(frozen=True, eq=False)
class Run:
    """All that a command knows when it is done.

    Attributes:
        log, output: names, as a reader knows them.
        rig: with the options of the command line in it.
        estimator: that was run.
        thinned: the estimates, in the surface's frame.
        provenance: inputs with their hashes, options.
        stages: name -> seconds: of reading, locating, writing.
        touches: found in the estimates.
        truth: what is known of the contacts, in the surface's frame.
        notes, warnings: what was said to the user.
    """

    log: str
    output: str
    rig: Rig
    estimator: Estimator
    thinned: Thinned
    provenance: Mapping[str, str] = field(default_factory=lambda: {})
    stages: Mapping[str, float] = field(default_factory=lambda: {})
    touches: Events | None = None
    truth: Samples | Touches | None = None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def write_report(path: Path, run: Run) -> None:
    """Write the page, whole or not at all.

    Raises:
        InputError: it cannot be written, or matplotlib or jinja2 is missing.
    """
    write_text(path, render(compose(run)))


def compose(run: Run) -> Report:
    """The page of a run."""
    kept = _Kept.of(run)
    found = None if run.truth is None else evaluate(kept.time[kept.even], kept.estimate[kept.even], run.truth)
    radius = kept.median_radius()
    sections = (
        _over_time(kept),
        _places(run, kept),
        _truth(run, kept, found),
        _statuses(run),
        _touches(run),
        Section("What to improve", points=advice(run.rig, run.estimator, run.thinned.statuses, found, radius)),
        settings(run.rig, run.estimator, kept.rate),
        models(run.rig, run.estimator),
        inputs(run.provenance),
        budget(run.stages, run.thinned.count),
        Section("Notes of the run", points=run.notes),
    )
    return Report(
        title=f"Contacts in {run.log}",
        summary=_summary(run, kept),
        tiles=tuple(_tiles(run, kept, found)),
        warnings=run.warnings,
        sections=tuple(section for section in sections if _says_something(section)),
        footer=f"palpate {run.provenance.get('palpate', '')}. Lengths, forces and times in the units that stand beside "
        "them; points and forces in the surface's frame.",
    )


@dataclass(frozen=True, eq=False)
class _Kept:
    """The thinned samples, worked out once; NaN in `point`, `deviation` and `radius` where not answered [m]."""

    time: Float[np.ndarray, " n"]
    estimate: ContactEstimate
    even: np.ndarray
    strength: Float[np.ndarray, " n"]
    point: Float[np.ndarray, "n 3"]
    deviation: Float[np.ndarray, "n 3"]
    radius: Float[np.ndarray, " n"]
    rate: float

    @classmethod
    def of(cls, run: Run) -> _Kept:
        time, estimate, even = run.thinned.time, run.thinned.estimate, run.thinned.even
        answered = estimate.answered
        covariance = np.where(answered[:, None, None], estimate.covariance, np.nan)
        known = np.isfinite(covariance).all(axis=(1, 2))
        largest = np.full(len(time), np.nan)
        largest[known] = np.linalg.eigvalsh(covariance[known])[:, -1].clip(min=0)
        steps = np.diff(time[even & np.isfinite(time)])
        usual = float(np.median(steps)) if len(steps) else 0.0
        return cls(
            time,
            estimate,
            even,
            np.linalg.norm(estimate.force, axis=1),
            np.where(answered[:, None], estimate.point, np.nan),
            np.sqrt(np.diagonal(covariance, axis1=1, axis2=2).clip(min=0)),
            np.sqrt(CHI2_95 * largest),
            run.thinned.stride / usual if usual > 0 else float("nan"),
        )

    def median_radius(self) -> float:
        """[m] of the even ones, NaN where there is none."""
        known = self.radius[self.even & np.isfinite(self.radius)]
        return float(np.median(known)) if len(known) else float("nan")


def _says_something(section: Section) -> bool:
    return any((section.text, section.points, section.facts, section.pictures, section.tables))


def _summary(run: Run, kept: _Kept) -> str:
    method = run.rig.estimate.method.replace("_", " ")
    weight = "with" if run.estimator.payload is not None else "without"
    return (
        f"{run.thinned.count:,} wrenches were read from {run.log}, compensated {weight} a payload model, and located "
        f"on {surface_name(run.rig)} by the {method} method; contacts went to {run.output}."
    )


def _tiles(run: Run, kept: _Kept, found: Evaluation | None) -> list[Tile]:
    counts = run.thinned.statuses
    answered, total = int(counts[: Status.AMBIGUOUS + 1].sum()), max(int(counts.sum()), 1)
    loaded = total - int(counts[list(UNLOADED)].sum())
    share = answered / loaded if loaded else float("nan")
    known = kept.time[np.isfinite(kept.time)]
    span = float(np.ptp(known)) if len(known) else 0.0
    tiles = [
        Tile("samples", f"{run.thinned.count:,}", f"{span:.4g} s at {kept.rate:.4g} Hz"),
        Tile("answered", percent(share) if loaded else "-", f"of {loaded:,} loaded samples", _tone(share, 0.95, 0.7)),
    ]
    if np.isfinite(kept.strength).any():
        peak = int(np.nanargmax(kept.strength))
        tiles.append(Tile("peak force", f"{kept.strength[peak]:.3g} N", f"at {kept.time[peak]:.2f} s"))
    if run.touches is not None:
        tiles.append(Tile("touches", f"{len(run.touches):,}", "found in the estimates"))
    if np.isfinite(radius := kept.median_radius()):
        tiles.append(Tile("95 % radius", f"{1e3 * radius:.2g} mm", "median of the answered"))
    return tiles + _judged(found)


def _judged(found: Evaluation | None) -> list[Tile]:
    if found is None or found.location is None:
        return []
    of = "touches" if found.touches else "samples"
    tiles = [
        Tile(
            "location error",
            f"{1e3 * found.location.mean:.2f} mm",
            f"mean of {found.location.count:,} {of}; worst {1e3 * found.location.worst:.2f} mm",
        )
    ]
    if found.coverage.count:
        inside = found.coverage.inside
        tiles.append(Tile("truth in the ellipse", percent(inside), "should be 95 %", _tone(inside, 0.9, 0.8)))
    return tiles


def _tone(share: float, good: float, poor: float) -> str:
    return "good" if share >= good else "poor" if share < poor else ""


def _over_time(kept: _Kept) -> Section:
    drawn = plots.forces(kept.time, kept.estimate.force, kept.estimate.status)
    colours = "green: located, blue: ambiguous, light grey: no contact, dark grey: too light, others: see Statuses"
    shown = [picture(drawn, f"Force on the body, payload and bias taken off. Below, {colours}.")]
    if np.isfinite(kept.point).any():
        places = plots.locations(kept.time, kept.point, kept.deviation)
        shown.append(picture(places, "The contact point in the surface's frame, with its 95 % band."))
    return Section("Force and place over time", pictures=tuple(shown))


def _places(run: Run, kept: _Kept) -> Section:
    if not np.isfinite(kept.point).any():
        return Section("Where it was touched", text=("No sample was located.",))
    shown: list[Picture] = []
    drawn = run.estimator.locator.surface.drawn()
    body = plots.silhouettes(drawn.vertices, drawn.faces, kept.point, kept.estimate.normal, kept.strength)
    shown.append(picture(body, "The body from three sides. Dots are on the side one sees, rings on the far one."))
    if np.isfinite(kept.radius).any():
        sizes = plots.histogram(1e3 * kept.radius[kept.even], "long half axis of the 95 % ellipse [mm]")
        shown.append(picture(sizes, _ellipse_words(run)))
    return Section("Where it was touched", pictures=tuple(shown))


def _ellipse_words(run: Run) -> str:
    held = ["the sensor's noise"]
    if run.estimator.payload is not None:
        held.append("the payload's uncertainty")
    if run.rig.surface.pose_covariance is not None:
        held.append("the mounting's uncertainty")
    return f"How sure the points are. The ellipses hold {', '.join(held)}; errors of the mesh are not in them."


def _truth(run: Run, kept: _Kept, found: Evaluation | None) -> Section:
    truth = run.truth
    if found is None or truth is None or not found.matched:
        missed = ("No sample matches the truth: both must be on one clock.",) if truth is not None else ()
        return Section("Against the truth", text=missed)
    error = _errors(kept, truth)
    shown = [picture(plots.errors(kept.time, error, kept.radius), "Distance of each located sample from the truth.")]
    if isinstance(truth, Touches):
        shown.append(_touch_picture(kept, truth, found))
    few = f" (one in {run.thinned.stride} of the log)" if run.thinned.stride > 1 else ""
    text = f"{found.matched:,} of {found.samples:,} samples{few} have a truth, {found.answered:,} of these an answer."
    if found.coverage.count:
        text += (
            f" The 95 % ellipses hold it in {percent(found.coverage.inside)} of {found.coverage.count:,} samples, and "
            f"the mean square is {found.coverage.mean_square:.2f}, which should be 2."
        )
    table = Table(("error", *HEADER[1:]), tuple(spreads(found)))
    return Section("Against the truth", text=(text,), pictures=tuple(shown), tables=(table,) if table.rows else ())


def _errors(kept: _Kept, truth: Samples | Touches) -> Float[np.ndarray, " n"]:
    """[m] of each answered sample that has a truth, else NaN."""
    known = np.full((len(kept.time), 3), np.nan)
    if isinstance(truth, Samples):
        match = nearest_in_time(kept.time, truth.time, TOLERANCE)
        known[match >= 0] = truth.point[match[match >= 0]]
    else:
        for start, end, point in zip(truth.start, truth.end, truth.point, strict=True):
            known[(kept.time >= start) & (kept.time <= end)] = point
    return distances(kept.point, known)


def _touch_picture(kept: _Kept, truth: Touches, found: Evaluation) -> Picture:
    radius = [
        _median(kept.radius[(kept.time >= start) & (kept.time <= end)])
        for start, end in zip(truth.start, truth.end, strict=True)
    ]
    error = np.array([touch.error for touch in found.touches])
    labels = [touch.label for touch in found.touches]
    drawn = plots.touch_errors(labels, error, np.array(radius))
    return picture(drawn, "The median point of each touch against the truth, and how far a sample of it may be off.")


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


def _statuses(run: Run) -> Section:
    counts = run.thinned.statuses
    facts = tuple((kind.label, f"{counts[kind]:,} samples. {MEANING[kind]}") for kind in Status if counts[kind])
    shares = picture(plots.statuses(counts), "What became of the samples; answered are contact and ambiguous.")
    return Section("Statuses", pictures=(shares,), facts=facts)


def _touches(run: Run) -> Section:
    found = run.touches
    if found is None or not len(found):
        return Section("Touches")
    columns = (
        np.arange(1, len(found) + 1),
        found.start,
        found.end - found.start,
        found.peak_force,
        *(1e3 * found.point.T),
        1e3 * found.deviation,
        1e3 * found.slid,
    )
    written = ("{:.0f}", "{:.3f}", "{:.3f}", "{:.3g}", "{:.2f}", "{:.2f}", "{:.2f}", "{:.2f}", "{:.2f}")
    rows = [
        tuple(text.format(value) if np.isfinite(value) else "-" for text, value in zip(written, row, strict=True))
        for row in np.column_stack(columns)[:SHOWN]
    ]
    more = f"The first {SHOWN} of {len(found):,}." if len(found) > SHOWN else ""
    header = ("touch", "start [s]", "lasts [s]", "peak [N]", "x [mm]", "y [mm]", "z [mm]", "+- [mm]", "slid [mm]")
    text = "+- is one standard deviation of a sample in the direction in which it is largest."
    return Section("Touches", text=(text,), tables=(Table(header, tuple(rows), more),))
