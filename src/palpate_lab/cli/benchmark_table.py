"""Format the benchmark's table as cells, as Markdown and as a page."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from math import isfinite

from palpate import __version__
from palpate.viewer.report import Report, ReportTable, Section, percent, render
from palpate_lab.benchmark.files import Task
from palpate_lab.benchmark.scoring import NEAR, Score

LEGEND = (
    "answered: share of the contacts that have an answer",
    "median, 95 %: distance within which so many of all contacts were found; a miss is infinitely far off, and "
    "`miss` stands where that is the figure",
    f"{1e3 * NEAR:g} mm: share of all contacts found within it",
    "force: median error of the force vector, of the answers",
    "ellipse: share of the answers whose stated 95 % ellipse holds the truth (should be 95)",
    "false: answers where nothing touches, or beyond the contacts of a sample",
    "time: of a sample; Palpate's at logs with reading the file, -: nobody measured it",
)


@dataclass(frozen=True)
class Row:
    """The score of an entrant at one task, and its time per sample [s]."""

    name: str
    score: Score
    seconds: float


def header() -> tuple[str, ...]:
    """Return the titles of the nine columns of a task's table, a tuple of texts."""
    return ("", "answered", "median [mm]", "95 % [mm]", f"{1e3 * NEAR:g} mm", "force [N]", "ellipse", "false", "time")


def cells(row: Row) -> tuple[str, ...]:
    """Return the cells of one entrant's row, a text for each column of `header`; "-" for a figure that is not known."""
    got = row.score
    return (
        row.name,
        percent(got.answered),
        _length(got.median),
        _length(got.p95),
        percent(got.near),
        f"{got.force:.3f}" if isfinite(got.force) else "-",
        percent(got.coverage.inside) if got.coverage.count else "-",
        f"{got.false:,}",
        _time(row.seconds),
    )


def as_markdown(tasks: Mapping[str, Task], results: Mapping[str, Sequence[Row]]) -> str:
    """Return a Markdown text with a heading and a table per task, and the meaning of the columns."""
    parts = [f"{_made(tasks)}\n"]
    for name, rows in results.items():
        parts += [f"## {name}\n", f"{_about(tasks[name], rows)}\n", _line(header())]
        parts += [_line(("---", *["---:"] * (len(header()) - 1))), *(_line(cells(row)) for row in rows), ""]
    return "\n".join([*parts, *(f"- {said}" for said in LEGEND), ""])


def as_page(tasks: Mapping[str, Task], results: Mapping[str, Sequence[Row]]) -> str:
    """Return the results as the HTML text of one page.

    Raises:
        InputError: matplotlib or jinja2 is not installed.
    """
    first = ("task", "median [mm]", *header()[3:5])
    best = {name: min(rows, key=lambda row: (row.score.median, row.score.p95)) for name, rows in results.items()}
    short = tuple((name, f"{cells(row)[2]} ({row.name})", *cells(row)[3:5]) for name, row in best.items())
    sections = (
        Section("The least median of each task", tables=(ReportTable(first, short),)),
        *(
            Section(name, text=(_about(tasks[name], rows),), tables=(ReportTable(header(), tuple(map(cells, rows))),))
            for name, rows in results.items()
        ),
        Section("What the columns mean", points=LEGEND),
    )
    return render(Report(title="A benchmark of contact sensing", summary=_made(tasks), sections=sections))


def _about(task: Task, rows: Sequence[Row]) -> str:
    about = str(task.facts.get("about", task.kind))
    noise = task.facts.get("noise", {})
    said = "; noise: " + ", ".join(f"{name} {value:.3g}" for name, value in noise.items()) if noise else ""
    return f"{about[:1].upper()}{about[1:]}{said}. {rows[0].score.contacts:,} contacts in {task.samples:,} samples."


def _made(tasks: Mapping[str, Task]) -> str:
    facts = next(iter(tasks.values())).facts
    versions = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy"))
    return (
        f"Tasks of `palpate benchmark make --seed {facts.get('seed')}`, {facts.get('size')} size; "
        f"Palpate {__version__}, Python {platform.python_version()}, {versions}, {platform.machine()}."
    )


def _line(row: Sequence[str]) -> str:
    return "| " + " | ".join(row) + " |"


def _length(value: float) -> str:
    """Return a length [m] as text in mm."""
    return "miss" if not isfinite(value) else f"{1e3 * value:.2g}" if value < 1e-4 else f"{1e3 * value:.2f}"


def _time(seconds: float) -> str:
    return (
        "-" if not isfinite(seconds) else f"{1e6 * seconds:,.0f} us" if seconds < 0.01 else f"{1e3 * seconds:,.0f} ms"
    )
