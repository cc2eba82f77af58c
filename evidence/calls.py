"""Every public callable that takes arrays, with wrong arguments, and with right ones in other containers.

The calls are made in a process of their own (`evidence.call_walk`): one that ends it is told by its name, and the walk
goes on behind it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from evidence.row import ROOT, Row

__all__ = ["rows"]

COMMAND = "python -m evidence --only calls"
THEME = "calls"
SEED = 40
FULL, SMALL = 10_000, 300
SHOWN = 6  # callables that are named in a row
OPEN = {  # what the walk still finds, and is not counted against the claim
    "calibration.taxels.solve.eliminated": "a step of calibrate_taxels: its matrix is one that this made",
    "calibration._payload_hypotheses.Hypothesis": "an answer of diagnose_payload, and no argument",
    "contact.fused_unseen.ranked": "a step of FusedLocator, which made the places",
    "contact.ring_locator.RingFound": "an answer of RingLocator, and no argument",
    "sensors.taxels.TaxelBody": "made by sheet, anywhere and placed, which take arrays",
    "sensors.zero_filter.ZeroFilter.known_of": "a step of ZeroFollower, which made the state",
}
DRAWN = ("io.", "viewer.")  # rooms of which no figure is promised yet
ALLOWED = "PalpateError, never a raw error; a missing or unknown argument is Python's own TypeError, and is not tried"


@dataclass
class _Walk:
    """What came out."""

    callables: int = 0
    missing: list[str] = field(default_factory=list)
    made: Counter[str] = field(default_factory=Counter)  # by kind
    raw: dict[str, Counter[str]] = field(default_factory=lambda: {"wrong": Counter(), "container": Counter()})
    refused: int = 0
    crashed: list[str] = field(default_factory=list)


def rows(small: bool) -> Iterator[Row]:
    """In full 10,000 calls; small, some hundred of what two examples call."""
    walk = _walked(SMALL if small else FULL)
    tried = walk.callables - len(walk.missing)
    for kind, what in (("wrong", "wrong arguments"), ("container", "right arguments in other containers")):
        every = walk.raw[kind]
        raw = Counter({name: n for name, n in every.items() if name not in OPEN and not name.startswith(DRAWN)})
        left = sum(every.values()) - sum(raw.values())
        worst = ", ".join(f"{name} {count}" for name, count in raw.most_common(SHOWN))
        said = f"{sum(raw.values())} {'raw errors' if kind == 'wrong' else 'differ'}" + (f" ({worst})" if worst else "")
        said += f", {left} in io, viewer and what evidence.calls.OPEN lists,"
        due = "0 raw errors" if kind == "wrong" else "0 differ in a bit from float64 in C order"
        yield Row(THEME, f"{what}: {ALLOWED}", due, f"{said} of {walk.made[kind]:,} calls", not raw, COMMAND)
    ended = f"{len(walk.crashed)} of {sum(walk.made.values()):,}" + "".join(
        f"; {each}" for each in walk.crashed[:SHOWN]
    )
    yield Row(THEME, "calls that end the process", "0", ended, not walk.crashed, COMMAND)
    said = f"{tried} of {walk.callables} public callables that take arrays"
    yield Row(
        THEME, "callables that the examples and tutorials call, and the walk with them", "reported", said, None, COMMAND
    )


def _walked(count: int) -> _Walk:
    walk, first = _Walk(), 0
    with TemporaryDirectory() as folder:
        while first is not None:
            first = _part(walk, count, first, Path(folder) / str(first))
    return walk


def _part(walk: _Walk, count: int, first: int, folder: Path) -> int | None:
    """One process, until all calls are made (None) or one of them ends it: where to go on."""
    command = [sys.executable, "-m", "evidence.call_walk", str(count), str(SEED), str(first), str(folder)]
    call: dict[str, object] | None = None
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout or ():
            if not line.startswith("{"):  # of a library that prints
                continue
            row = json.loads(line)
            if "callables" in row:
                walk.callables, walk.missing = row["callables"], row["missing"]
            elif "number" in row:
                call = row
                walk.made[row["kind"]] += 1
            elif call is not None:
                walk.refused += row["how"] == "refused"
                if row["how"] not in ("answered", "refused", "same"):
                    walk.raw[str(call["kind"])][str(call["call"]).removeprefix("palpate.")] += 1
                call = None
    if process.returncode == 0:
        return None
    if call is None:
        raise RuntimeError(f"the walk ended with {process.returncode} outside of a call")
    walk.crashed.append(f"{call['call']}({call['argument']}: {call['what']}) ended it with {process.returncode}")
    return int(str(call["number"])) + 1
