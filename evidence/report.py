"""A page of claims, written section by section: each says when, with what and on what it was measured."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from evidence.machine import machine
from evidence.row import Row

__all__ = ["Theme", "measure", "pruned", "renewed"]

Theme = Callable[[bool], Iterator[Row]]  # few samples or all of them
MISSED = "## Missed"
VERDICTS = ("met", r"\*\*missed\*\*", "reported", "skipped")
COUNTS = "{} rows met, {} missed, {} reported, {} skipped"


def measure(themes: Mapping[str, Theme], page: Path | None, *, whole: bool = False) -> bool:
    """Measure theme by theme, each into its section as soon as it is done; the others stay as they were.

    Args:
        themes: to measure.
        page: to renew; None: few samples, printed.
        whole: these are all of the page's themes; sections of others go at the end.

    Returns:
        Whether every row that has a target meets it.
    """
    passed, seen = True, set[str]()
    for theme in themes.values():
        begin, rows = time.perf_counter(), list[Row]()
        for row in theme(page is None):
            rows.append(row)
            took = time.perf_counter() - begin
            said = f"{took:6.1f} s  {row.verdict.strip('*'):8}  {row.row}: {row.what}: {row.got}"
            print(said, file=sys.stderr, flush=True)
        passed = passed and not any(row.passed is False for row in rows)
        seen |= {row.row for row in rows}
        measured = "; ".join([*machine(), f"{time.perf_counter() - begin:.0f} s"])
        if page is None:
            names = dict.fromkeys(row.row for row in rows)
            print("\n".join(line for name in names for line in _section(name, rows, "")))
        else:
            page.write_text(renewed(page.read_text(encoding="utf-8"), rows, measured), encoding="utf-8")
    if whole and page is not None:
        page.write_text(pruned(page.read_text(encoding="utf-8"), seen), encoding="utf-8")
    return passed


def renewed(page: str, rows: list[Row], measured: str) -> str:
    """The page with the sections of these rows in place of what they were; the rest was measured before.

    Args:
        page: its head, a list of what was missed, and a section a theme, under headings of the second order.
        rows: of one theme or several.
        measured: when, with what and on what.
    """
    head, kept = _sections(page)
    themes = dict.fromkeys(row.row for row in rows)
    before = kept.pop(MISSED, "").splitlines()[2:]
    missed = [line for line in before if line and line[2:].split(":", 1)[0] not in themes]
    missed += [f"- {r.row}: {r.what}. Target {r.target}; got {r.got}" for r in rows if r.passed is False]
    return _page(head, missed, kept | {_title(name): "\n".join(_section(name, rows, measured)) for name in themes})


def pruned(page: str, sections: set[str]) -> str:
    """The page without sections of another name: of claims that are no longer made."""
    head, kept = _sections(page)
    before = kept.pop(MISSED, "").splitlines()[2:]
    missed = [line for line in before if line[2:].split(":", 1)[0] in sections]
    titles = {_title(name) for name in sections}
    return _page(head, missed, {title: text for title, text in kept.items() if title in titles})


def _sections(page: str) -> tuple[str, dict[str, str]]:
    head, *sections = re.split(r"^(?=## )", page, flags=re.MULTILINE)
    return head, {section.split("\n", 1)[0]: section for section in sections}


def _page(head: str, missed: list[str], sections: dict[str, str]) -> str:
    """Put together again, with the verdicts counted."""
    listed = {MISSED: "\n".join([MISSED, "", *missed])} if missed else {}
    body = "\n\n".join(text.rstrip("\n") for text in (listed | sections).values()) + "\n"
    counts = [len(re.findall(rf"\| {verdict} \|$", body, re.MULTILINE)) for verdict in VERDICTS]
    return re.sub(COUNTS.format(*[r"\d+"] * 4), COUNTS.format(*counts), head) + body


def _title(theme: str) -> str:
    return f"## {theme[0].upper()}{theme[1:]}"


def _section(theme: str, rows: list[Row], measured: str) -> list[str]:
    some = [row for row in rows if row.row == theme]
    command = " or ".join(dict.fromkeys(row.command for row in some))
    table = ["| " + " | ".join(_cell(text) for text in (r.what, r.target, r.got, r.verdict)) + " |" for r in some]
    said = [f"`{command}`", "", measured] if measured else [f"`{command}`"]
    return [_title(theme), "", *said, "", "| row | target | got | |", "| --- | --- | --- | --- |", *table, ""]


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
