"""Render a report, given as tiles, sections, facts, tables and figures, as one page of HTML."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from typing import TYPE_CHECKING

from palpate.errors import InputError
from palpate.viewer._style import inline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HOVER = "hover: "  # so begins the gid of an artist that says the rest of it when a pointer rests there
_SAID = re.compile(rf"<g id=([\"']){HOVER}(.*?)\1>")


@dataclass(frozen=True)
class Tile:
    """A figure that is read first: name, value, a short remark; `tone` is "", "good" or "poor"."""

    name: str
    value: str
    word: str = ""
    tone: str = ""


@dataclass(frozen=True)
class ReportTable:
    """A table of text cells; a row may be shorter than the header. `caption` stands above it."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


@dataclass(frozen=True)
class Picture:
    """An SVG element, and the sentence below it; made by `picture`."""

    svg: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A heading and its contents in this order; empty contents are omitted.

    Attributes:
        title: heading of the section.
        text: paragraphs.
        points: sentences of a list.
        pictures: figures, next to each other where there is room.
        settings: names and values.
        tables: each in a separate box.
        drawing: HTML that is inserted unchanged, such as by `Drawing.html`.
    """

    title: str
    text: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()
    settings: tuple[tuple[str, str], ...] = ()
    tables: tuple[ReportTable, ...] = ()
    drawing: str = ""

    def __bool__(self) -> bool:
        """Return whether anything stands below the heading."""
        return any((self.text, self.points, self.pictures, self.settings, self.tables, self.drawing))


@dataclass(frozen=True)
class Report:
    """A page: a one-sentence summary of the run, the main figures in tiles, warnings, sections."""

    title: str
    summary: str
    tiles: tuple[Tile, ...] = ()
    warnings: tuple[str, ...] = ()
    sections: tuple[Section, ...] = ()
    footer: str = ""


def require_report() -> None:
    """Check, before long work, that a report can be made.

    Raises:
        InputError: matplotlib or jinja2 is not installed.
    """
    if missing := [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]:
        raise InputError(f"a report needs {' and '.join(missing)}.", hint="pip install 'palpate[report]'")


def percent(share: float) -> str:
    """Return a share (1 is all) in percent, to a tenth, as text."""
    return f"{100 * share:.1f} %"


def first_rows(header: Sequence[str], rows: Sequence[Sequence[str]], most: int) -> ReportTable:
    """Return a `ReportTable` of the first `most` rows, with a caption if there are more."""
    more = f"The first {most:,} of {len(rows):,}." if len(rows) > most else ""
    return ReportTable(tuple(header), tuple(tuple(row) for row in rows[:most]), more)


def picture(drawn: Figure, caption: str) -> Picture:
    """Return a figure as a `Picture`; what follows `HOVER` in the gid of an artist becomes its tooltip.

    Raises:
        InputError: matplotlib is not installed.
    """
    return Picture(_SAID.sub(r"<g><title>\2</title>", inline(drawn)), caption)


def render(report: Report) -> str:
    """Return the report as a page of HTML that loads nothing.

    Raises:
        InputError: matplotlib or jinja2 is not installed.
    """
    require_report()
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    page = files("palpate.viewer").joinpath("report.html").read_text(encoding="utf-8")
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=_written
    )
    environment.filters["drawn"] = Markup  # an SVG or a drawing of our own making; everything else is escaped
    return environment.from_string(page).render(report=report)


def _written(value: object) -> object:
    """Replace "+-" in text by its sign."""
    return value.replace("+-", "±") if type(value) is str else value
