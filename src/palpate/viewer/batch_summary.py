"""Summarise a batch of logs on one page: a row for each log, failures with their reasons, and totals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np
from jaxtyping import Int

from palpate.contact.estimate import Status
from palpate.viewer.report import Report, ReportTable, Section, Tile, first_rows, percent

SHOWN = 5_000  # logs in a table


@dataclass(frozen=True)
class LogResult:
    """The result of one log of a batch.

    Attributes:
        log: path as the user gave it.
        output: name of its file of contacts; "" if it failed.
        samples: number of samples.
        contacts: number of rows with status contact or ambiguous.
        touches: number of touches.
        peak: [N] largest force of a touch; NaN without one.
        statuses: number of rows of each `Status`; () if it failed.
        warnings: sentences on what may be wrong.
        ended: "whole", or "torn" if the log is cut off.
        believed: False if nothing in it can be believed.
        failure: why there is no output, as a sentence; "" if there is one.
    """

    log: str
    output: str = ""
    samples: int = 0
    contacts: int = 0
    touches: int = 0
    peak: float = nan
    statuses: tuple[int, ...] = ()
    warnings: tuple[str, ...] = ()
    ended: str = "whole"
    believed: bool = True
    failure: str = ""


def figures(results: Sequence[LogResult]) -> list[tuple[str, str, float]]:
    """Return the totals over all logs (at least one) as a list of (name, text, number)."""
    failed, torn = sum(bool(each.failure) for each in results), sum(each.ended == "torn" for each in results)
    samples, touches = sum(each.samples for each in results), sum(each.touches for each in results)
    warned = sum(bool(each.warnings) for each in results)
    peak = max((each.peak for each in results if isfinite(each.peak)), default=nan)
    found = [
        ("done", f"{len(results) - failed:,} of {len(results):,} logs", float(len(results) - failed)),
        ("failed", f"{failed:,}", float(failed)),
        ("samples", f"{samples:,}", float(samples)),
        ("touches", f"{touches:,}", float(touches)),
        ("largest force", f"{_number(peak)} N", peak),
        ("with warnings", f"{warned:,}", float(warned)),
    ]
    return [*found, ("cut off", f"{torn:,}", float(torn))] if torn else found


def compose(results: Sequence[LogResult], settings: tuple[tuple[str, str], ...]) -> Report:
    """Return the `Report` about a batch.

    Args:
        results: at least one.
        settings: names and values of the settings that all logs share.
    """
    found = {name: text for name, text, _ in figures(results)}
    failed = [each for each in results if each.failure]
    tiles = (
        Tile("logs done", found["done"].partition(" ")[0], f"of {len(results):,}", "poor" if failed else "good"),
        Tile("failed", found["failed"], tone="poor" if failed else ""),
        Tile("samples", found["samples"]),
        Tile("touches", found["touches"]),
        Tile("largest force", found["largest force"]),
        Tile("with warnings", found["with warnings"]),
    )
    failures = first_rows(("log", "why"), [(each.log, each.failure) for each in failed], SHOWN)
    sections = (
        Section("Logs that failed", tables=(failures,) if failed else ()),
        Section("All logs", tables=(_table(results),)),
        _warnings(results),
        _statuses(results),
        Section("Settings", settings=settings),
    )
    return Report(
        title="Contacts in many logs",
        summary=f"{len(results):,} logs through one rig, each as `palpate estimate` does it.",
        tiles=tiles,
        sections=tuple(section for section in sections if section),
        footer="A log with warnings has a file of contacts too: `palpate estimate LOG --report` says more about it.",
    )


def _table(results: Sequence[LogResult]) -> ReportTable:
    header = ("log", "samples", "contacts", "touches", "peak [N]", "statuses", "warnings", "output or failure")
    rows = [
        (
            each.log, f"{each.samples:,}", f"{each.contacts:,}", f"{each.touches:,}", _number(each.peak),
            _shares(each.statuses), f"{len(each.warnings)}", each.failure or _said(each),
        )
        for each in results
    ]  # fmt: skip
    return first_rows(header, rows, SHOWN)


def _said(result: LogResult) -> str:
    return f"{result.output}{' (the log is cut off)' if result.ended == 'torn' else ''}"


def _shares(statuses: Sequence[int]) -> str:
    total = max(sum(statuses), 1)
    return ", ".join(f"{kind.words} {percent(statuses[kind] / total)}" for kind in Status if sum(statuses[kind:][:1]))


def _warnings(results: Sequence[LogResult]) -> Section:
    """Return a section of each warning once, with its logs."""
    logs = dict[str, list[str]]()
    for each in results:
        for said in each.warnings:
            logs.setdefault(said, []).append(each.log)
    rows = [(said, f"{len(names):,}", ", ".join(names[:3]) + (", ..." if len(names) > 3 else ""))
            for said, names in sorted(logs.items(), key=lambda each: -len(each[1]))]  # fmt: skip
    return Section("Warnings", tables=(first_rows(("warning", "logs", "of them"), rows, SHOWN),) if rows else ())


def _statuses(results: Sequence[LogResult]) -> Section:
    counts: Int[np.ndarray, "9"] = np.array([each.statuses or [0] * len(Status) for each in results]).sum(axis=0)
    total = max(int(counts.sum()), 1)
    facts = tuple((kind.words, f"{percent(counts[kind] / total)}, {counts[kind]:,}") for kind in Status if counts[kind])
    return Section("Samples of all logs", settings=facts)


def _number(value: float) -> str:
    return f"{value:.2f}" if isfinite(value) else "-"
