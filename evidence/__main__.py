"""`python -m evidence [--small] [--only NAME]`: measure every claim and write docs/evidence.md.

With --small the table is printed and the page is left as it is; --only NAME renews that theme's part of the page.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from benchmarks.machine import machine
from evidence import (
    answered,
    bad_input,
    clock,
    covariance,
    equations,
    filters,
    laws,
    load_cells,
    pad,
    page,
    payload,
    probes,
    same,
    skin_contacts,
    skin_map,
    speed,
    start,
    streams,
    torn,
)
from evidence.row import ROOT, Row

__all__ = ["THEMES", "main", "renewed", "report"]

THEMES: dict[str, Callable[[bool], Iterator[Row]]] = {
    "answered": answered.rows,
    "laws": laws.rows,
    "equations": equations.rows,
    "covariance": covariance.rows,
    "payload": payload.rows,
    "pad": pad.rows,
    "probes": probes.rows,
    "filters": filters.rows,
    "clock": clock.rows,
    "same": same.rows,
    "torn": torn.rows,
    "page": page.rows,
    "skin_contacts": skin_contacts.rows,
    "skin_map": skin_map.rows,
    "speed": speed.rows,
    "streams": streams.rows,
    "load_cells": load_cells.rows,
    "start": start.rows,
    "bad_input": bad_input.rows,
}
PAGE = ROOT / "docs" / "evidence.md"
MISSED = "## Missed"
VERDICTS = ("met", r"\*\*missed\*\*", "reported", "skipped")


def main() -> int:
    """0 when every row that has a target meets it."""
    parser = argparse.ArgumentParser(prog="python -m evidence", description=__doc__)
    parser.add_argument("--small", action="store_true", help="the same functions on few samples, in seconds")
    parser.add_argument("--only", choices=THEMES, help="one theme")
    options = parser.parse_args()
    begin = time.perf_counter()
    rows: list[Row] = []
    for name in [options.only] if options.only else THEMES:
        for row in THEMES[name](options.small):
            rows.append(row)
            took = time.perf_counter() - begin
            print(
                f"{took:6.1f} s  {row.verdict.strip('*'):8}  {row.row}: {row.what}: {row.got}",
                file=sys.stderr,
                flush=True,
            )
    text = report(rows, time.perf_counter() - begin)
    if options.small:
        print(text)
    else:
        _write(PAGE, renewed(PAGE.read_text(encoding="utf-8"), rows) if options.only else text)
    return int(any(row.passed is False for row in rows))


def report(rows: list[Row], took: float) -> str:
    """The page: what was missed first, then every row under its theme."""
    missed = [row for row in rows if row.passed is False]
    met = sum(row.passed is True for row in rows)
    skips = sum(row.verdict == "skipped" for row in rows)
    counted = f"{met} rows met, {len(missed)} missed, {len(rows) - met - len(missed) - skips} reported, {skips} skipped"
    lines = [
        "# Evidence",
        "",
        "Written by `make evidence`: every claim, what was measured, and the command that measures it again. Nothing",
        "here is typed by hand. *Reported* rows are not judged; rows that read recordings from outside the project say",
        "*skipped* where those are absent.",
        "",
        *[f"- {line}" for line in machine()],
        f"- {took:.0f} s in all; {counted}",
        "",
    ]
    sections = {theme: _section(theme, rows) for theme in dict.fromkeys(row.row for row in rows)}
    return "\n".join([*lines, *_missed(missed), *(line for section in sections.values() for line in section)])


def renewed(page: str, rows: list[Row]) -> str:
    """A page with the sections of these rows' themes in place of what they were; the rest was measured before."""
    head, *sections = re.split(r"^(?=## )", page, flags=re.MULTILINE)
    themes = dict.fromkeys(row.row for row in rows)
    fresh = {_title(theme): "\n".join(_section(theme, rows)) + "\n" for theme in themes}
    kept = {section.split("\n", 1)[0]: section for section in sections}
    before = kept.pop(MISSED, "").splitlines()[2:]
    others = [line for line in before if line and line[2:].split(":", 1)[0] not in themes]
    lines = _missed([row for row in rows if row.passed is False], others)
    body = "\n".join(lines) + ("\n" if lines else "") + "".join((kept | fresh).values()).rstrip("\n") + "\n"
    counts = [len(re.findall(rf"\| {verdict} \|$", body, re.MULTILINE)) for verdict in VERDICTS]
    counted = "{} rows met, {} missed, {} reported, {} skipped".format(*counts)
    return re.sub(r"\d+ rows met, \d+ missed, \d+ reported, \d+ skipped", counted, head) + body


def _missed(rows: list[Row], others: Sequence[str] = ()) -> list[str]:
    said = [*others, *(f"- {row.row}: {row.what}. Target {row.target}; got {row.got}" for row in rows)]
    return [MISSED, "", *said, ""] if said else []


def _title(theme: str) -> str:
    return f"## {theme[0].upper()}{theme[1:]}"


def _section(theme: str, rows: list[Row]) -> list[str]:
    some = [row for row in rows if row.row == theme]
    command = " or ".join(dict.fromkeys(row.command for row in some))
    table = ["| " + " | ".join(_cell(text) for text in (r.what, r.target, r.got, r.verdict)) + " |" for r in some]
    return [_title(theme), "", f"`{command}`", "", "| row | target | got | |", "| --- | --- | --- | --- |", *table, ""]


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
    print(f"{path.relative_to(ROOT)} written", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
