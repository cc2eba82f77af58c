"""Compare two runs on one body and one clock, as a section of the report of the first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.events import Events
from palpate.contact.plausibility import UNLOADED
from palpate.errors import InputError
from palpate.viewer.report import Picture, ReportTable, Section, percent
from palpate.viewer.run_report import SHOWN, Body, DownsampledRun, Run, body_picture, force_picture
from palpate.viewer.run_summary import RunSummary
from palpate.viewer.timeline import since


def compared(run: Run, name: str, other: RunSummary) -> Run:
    """Return the `Run` with one more section, the first, that compares it with another run.

    Args:
        run: run of the report.
        name: name of the other's file.
        other: its contacts, on the same body and clock.

    Raises:
        InputError: the two have no time in common, or matplotlib is not installed.
    """
    kept = DownsampledRun(other.contacts, other.even)
    ours, theirs = run.kept.contacts.time, kept.contacts.time
    low, high = zip(*(_ends(time) for time in (ours, theirs)), strict=True)
    if not max(low) <= min(high):
        raise InputError(f"has no time in common with {run.log}, so they cannot be compared.", where=name)
    names = (run.output, name)
    section = Section(
        f"Compared with {name}",
        text=("Left and right, or above and below on a phone: the same pictures of both, on the same body.",),
        tables=(_figures(names, (run.summary, other), (run.kept, kept)), _touches(run.summary, other)),
        pictures=tuple(_pictures(names, (run.kept, kept), (run.summary, other), run.body)),
    )
    return replace(run, sections=(section, *run.sections))


def partners(ours: Events, theirs: Events) -> Int[np.ndarray, " k"]:
    """Return for each touch the number of the other run's touch that shares most time with it, (k,); -1 for none.

    Of touches that share equally long, the nearer one is taken.
    """
    found = np.full(len(ours), -1, dtype=np.int64)
    for k in range(len(ours)):
        shared = np.minimum(ours.end[k], theirs.end) - np.maximum(ours.start[k], theirs.start)
        apart = np.linalg.norm(theirs.point - ours.point[k], axis=1)
        order = np.lexsort((apart, -shared))
        if len(order) and shared[order[0]] >= 0:
            found[k] = order[0]
    return found


def _figures(
    names: tuple[str, str], runs: tuple[RunSummary, RunSummary], kept: tuple[DownsampledRun, DownsampledRun]
) -> ReportTable:
    figures: Sequence[tuple[str, Callable[[RunSummary, DownsampledRun], str]]] = (
        ("samples", lambda run, _: f"{run.samples:,}"),
        ("answered, of the loaded", lambda run, _: _answered(run)),
        ("touches", lambda run, _: f"{len(run.finder.touches()):,}"),
        ("peak force [N]", lambda _, held: f"{np.nanmax(held.strength, initial=0.0):.3g}"),
        ("95 % radius, median [mm]", lambda _, held: f"{1e3 * held.median_radius:.3g}"),
    )
    rows = [(what, *(said(run, held) for run, held in zip(runs, kept, strict=True))) for what, said in figures]
    return ReportTable(("", *names), tuple(rows))


def _answered(run: RunSummary) -> str:
    loaded = run.rows - int(run.statuses[list(UNLOADED)].sum())
    return percent(int(run.statuses[:2].sum()) / loaded) if loaded else "-"


def _touches(run: RunSummary, other: RunSummary) -> ReportTable:
    """Return a table of each touch with its partner."""
    ours, theirs = run.finder.touches(), other.finder.touches()
    with_whom, start = partners(ours, theirs), since(ours.start)[0]
    rows: list[tuple[str, ...]] = []
    for k in range(min(len(ours), SHOWN)):
        j, mine = int(with_whom[k]), (f"{k + 1}", f"{ours.start[k] - start:.3f}", f"{ours.peak_force[k]:.3f}")
        if j < 0:
            rows.append((*mine, "none", "-", "-", "-"))
            continue
        apart, later = float(np.linalg.norm(theirs.point[j] - ours.point[k])), theirs.start[j] - ours.start[k]
        rows.append((*mine, f"{j + 1}", f"{theirs.peak_force[j]:.3f}", f"{1e3 * apart:.2f}", f"{later:+.3f}"))
    alone = np.setdiff1d(np.arange(len(theirs)), with_whom)
    said = [f"The first {SHOWN} of {len(ours):,}."] if len(ours) > SHOWN else []
    if len(alone):
        said.append(f"Touches of the other run that have no match here: {', '.join(str(k + 1) for k in alone[:20])}.")
    header = ("touch", "start [s]", "peak [N]", "there", "peak there [N]", "apart [mm]", "later there [s]")
    return ReportTable(header, tuple(rows), " ".join(said))


def _pictures(
    names: tuple[str, str],
    kept: tuple[DownsampledRun, DownsampledRun],
    runs: tuple[RunSummary, RunSummary],
    body: Body | None,
) -> Iterator[Picture]:
    for name, held in zip(names, kept, strict=True):
        yield force_picture(held, f"Force over time in {name}.")
    if body is not None:
        for name, held, run in zip(names, kept, runs, strict=True):
            yield body_picture(body, held, run.finder.touches(), f"Where it was touched in {name}.")


def _ends(time: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Return the least and the largest known time [s]; inf and -inf without one."""
    known = time[np.isfinite(time)]
    return float(known.min(initial=np.inf)), float(known.max(initial=-np.inf))
