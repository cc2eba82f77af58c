"""`python -m benchmarks [--small] [--only NAME]`: every variant on every mesh, into benchmarks/RESULTS.md.

What has a target goes into benchmarks/TARGETS.md, section by section. With --small nothing is written; --only renews
one section and leaves the others.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from benchmarks import (
    checkouts,
    control,
    equations,
    fused,
    live,
    live_page,
    load_cells,
    long_log,
    many_logs,
    marker_ring,
    peers,
    processes,
    speed,
    start,
    streams,
    taxels,
)
from benchmarks.measure import FLAT, Batch, Meshes, Single, batches, singles
from evidence.machine import machine
from evidence.report import Theme, measure

PEERS = 1_000  # wrenches of a pitch
SIZES = (200, 2_000, 20_000, 200_000, 1_000_000)
NOTES = """\
The flat kernel searches a faceted mesh for every facet, edge and vertex contact within 45 degrees and writes them into
an array. A faceted mesh has three patches at vertices for each facet; *facets only* leaves them out, and is what the
NumPy forms and embree see. The full answer is `Locator` on the smooth mesh: choice, covariance, status, into a row.
*Three products a facet*: with the closed form put into a barycentric coordinate, what is left is the wrench's moment
about the facet's edge, so one matrix-vector product over all edges decides. *Closed form* is the derivation's, as
written. BLAS may use more than one thread. The clock's 0.05 us are in every figure."""
RESULTS, TARGETS = (Path(__file__).parent / name for name in ("RESULTS.md", "TARGETS.md"))
THEMES: dict[str, Theme] = {
    "speed": speed.rows,
    "checkouts": checkouts.rows,
    "equations": equations.rows,
    "fused": fused.rows,
    "control": control.rows,
    "live": live.rows,
    "live_page": live_page.rows,
    "load_cells": load_cells.rows,
    "long_log": long_log.rows,
    "many_logs": many_logs.rows,
    "marker_ring": marker_ring.rows,
    "processes": processes.rows,
    "start": start.rows,
    "taxels": taxels.rows,
}


def main() -> int:
    """0 when every row that has a target meets it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--small", action="store_true", help="meshes up to 20k facets, few queries, nothing written")
    parser.add_argument("--only", choices=["peers", *THEMES], help="one section")
    options = parser.parse_args()
    targets = None if options.small else TARGETS
    if options.only in THEMES:
        return int(not measure({options.only: THEMES[options.only]}, targets))
    if options.only:
        _peers(options.small)
        return 0
    _tables(options.small)
    return int(not measure(THEMES, targets, whole=True))


def _peers(small: bool) -> None:
    """The last section of RESULTS.md."""
    lines = peers.report(100 if small else PEERS)
    print("\n".join(lines))
    if not small:
        kept = RESULTS.read_text(encoding="utf-8").partition(f"\n{peers.TITLE}")[0]
        RESULTS.write_text(kept.rstrip("\n") + "\n" + "\n".join(lines), encoding="utf-8")


def _tables(small: bool) -> None:
    """All of RESULTS.md."""
    begin = time.perf_counter()
    one: dict[int, list[Single]] = {}
    many: dict[int, list[Batch]] = {}
    for size in SIZES[:3] if small else SIZES:
        print(f"{size:>9,} facets ...", file=sys.stderr, flush=True)
        meshes = Meshes(size)
        one[size] = singles(meshes, 100 if small else 1_000, 0.1 if small else 0.5)
        many[size] = batches(meshes, 2_000 if small else 100_000)
        del meshes
    print("   streams ...", file=sys.stderr, flush=True)
    lines = streams.report(2_000 if small else 100_000)
    print("   peers ...", file=sys.stderr, flush=True)
    lines += peers.report(100 if small else PEERS)
    text = "\n".join([report(one, many, time.perf_counter() - begin), *lines])
    print(text)
    if not small:
        RESULTS.write_text(text, encoding="utf-8")


def report(one: dict[int, list[Single]], many: dict[int, list[Batch]], took: float) -> str:
    """The page."""
    sizes = list(one)
    names = list(dict.fromkeys(entry.name for size in sizes for entry in one[size]))
    lines = [
        "# Timings",
        "",
        "Written by `make bench`. Everything in one table was measured in one run, the variants taking turns; trust",
        "the ratios more than the figures. Bumpy sphere, R = 10 mm, random touches, tan(theta) to 0.5, float64.",
        "",
        *[f"- {line}" for line in machine()],
        f"- {took:.0f} s in all",
        "",
        "## One query, called from Python [us]: median (99th percentile)",
        "",
        _line(["", *(f"{size:,}" for size in sizes)]),
        _line(["---"] + ["---:"] * len(sizes)),
        *(_line([name, *(_single(one[size], name) for size in sizes)]) for name in names),
        "",
        *NOTES.splitlines(),
        "",
        "### How many times slower than the flat kernel (medians)",
        "",
        _line(["", *(f"{size:,}" for size in sizes)]),
        _line(["---"] + ["---:"] * len(sizes)),
        *(_line([name, *(_ratio(one[size], name) for size in sizes)]) for name in names if name != FLAT),
        "",
        "## Batch, million queries a second, one thread",
        "",
        _line(["", *(f"{size:,}" for size in sizes)]),
        _line(["---"] + ["---:"] * len(sizes)),
    ]
    for name in dict.fromkeys(entry.name for size in sizes for entry in many[size]):
        lines.append(_line([name, *(f"{_of(many[size], name).rate * 1e-6:.2f}" for size in sizes)]))
    if any(entry.name.startswith("embreex") for entry in many[sizes[0]]):
        for name in ("flat, h = 0", "flat, facets only, h = 0"):
            share = [_of(many[s], name).rate / _of(many[s], "embreex, h = 0").rate for s in sizes]
            lines.append(_line([f"{name}, over embreex", *(f"{ratio:.2f}" for ratio in share)]))
    return "\n".join([*lines, ""])


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _of(entries: list[Batch], name: str) -> Batch:
    return next(entry for entry in entries if entry.name == name)


def _single(entries: list[Single], name: str) -> str:
    entry = next((entry for entry in entries if entry.name == name), None)
    return "" if entry is None else f"{_short(entry.at(50))} ({_short(entry.at(99))})"


def _ratio(entries: list[Single], name: str) -> str:
    entry = next((entry for entry in entries if entry.name == name), None)
    base = next(entry for entry in entries if entry.name == FLAT)
    return "" if entry is None else f"{_short(entry.at(50) / base.at(50))}"


def _short(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


if __name__ == "__main__":
    sys.exit(main())
