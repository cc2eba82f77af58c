"""Every public callable that takes arrays, with wrong arguments, and with right ones in other containers.

The calls are made in a process of their own (`claims.evidence.call_walk`): one that ends it is told by its name,
and the walk goes on behind it.
"""

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from claims.evidence.call_walk import LATER, UNCALLED, uncalled
from claims.row import ROOT, Row

SEED = 40
FULL, SMALL = 10_000, 150
SHOWN = 6  # callables that are named in a row
ALLOWED = "PalpateError, never a raw error; a missing or unknown argument is Python's own TypeError, and is not tried"


@dataclass
class _Walk:
    """What came out."""

    callables: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    made: Counter[str] = field(default_factory=Counter)  # by kind
    raw: dict[str, Counter[str]] = field(default_factory=lambda: {"wrong": Counter(), "container": Counter()})
    crashed: list[str] = field(default_factory=list)


def rows(small: bool) -> Iterator[Row]:
    """In full 10,000 calls; small, some hundred of what takes no time to be set up."""
    walk = _walked(SMALL if small else FULL)
    for kind, what, due in (
        ("wrong", "wrong arguments", "0 raw errors"),
        ("container", "right arguments in other containers", "0 differ in a bit from float64 in C order"),
    ):
        raw = walk.raw[kind]
        worst = ", ".join(f"{name} {count}" for name, count in raw.most_common(SHOWN))
        found = f"{sum(raw.values())} {'raw errors' if kind == 'wrong' else 'differ'}" + f" ({worst})" * bool(raw)
        yield Row(f"{what}: {ALLOWED}", due, f"{found} of {walk.made[kind]:,} calls", not raw)
    ended = "; ".join([f"{len(walk.crashed)} of {sum(walk.made.values()):,}", *walk.crashed[:SHOWN]])
    yield Row("calls that end the process", "0", ended, not walk.crashed)
    yield _reached(walk, small)


def _reached(walk: _Walk, small: bool) -> Row:
    """Every public callable that takes arrays is called, or listed with a reason; no list names what is not there."""
    listed = uncalled(walk.callables)
    missing = sorted(set(walk.missing) - listed - (LATER if small else set()))
    classes = {name.rpartition(".")[0] for name in walk.callables}
    gone = sorted((UNCALLED - classes | LATER) - set(walk.callables))
    got = f"{len(walk.callables) - len(walk.missing)} of {len(walk.callables)} called, {len(listed)} listed, "
    got += f"{len(missing)} neither" + (f" ({', '.join(missing[:SHOWN])})" if missing else "")
    got += f"; listed and not there: {', '.join(gone)}" if gone else ""
    what = "public callables that take arrays, called or listed with a reason (claims/evidence/call_names.toml)"
    return Row(what, "all", got, not missing and not gone)


def _walked(count: int) -> _Walk:
    walk, first = _Walk(), 0
    with TemporaryDirectory() as folder:
        while first is not None:
            first = _part(walk, count, first, Path(folder) / str(first))
    return walk


def _short(names: list[str]) -> list[str]:
    return [name.removeprefix("palpate.") for name in names]


def _part(walk: _Walk, count: int, first: int, folder: Path) -> int | None:
    """One process, until all calls are made (None) or one of them ends it: where to go on."""
    command = [sys.executable, "-m", "claims.evidence.call_walk", str(count), str(SEED), str(first), str(folder)]
    call: dict[str, object] | None = None
    own = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    # in a folder of its own: some calls write files
    with subprocess.Popen(command, cwd=folder.parent, env=own, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout or ():
            if not line.startswith("{"):  # of a library that prints
                continue
            row = json.loads(line)
            if "callables" in row:
                walk.callables, walk.missing = (_short(row[key]) for key in ("callables", "missing"))
            elif "number" in row:
                call = row
                walk.made[row["kind"]] += 1
            elif call is not None:
                if row["how"] not in ("answered", "refused", "same"):
                    walk.raw[str(call["kind"])][_short([str(call["call"])])[0]] += 1
                call = None
    if process.returncode == 0:
        return None
    if call is None:
        raise RuntimeError(f"the walk ended with {process.returncode} outside of a call")
    walk.crashed.append(f"{call['call']}({call['argument']}: {call['what']}) ended it with {process.returncode}")
    return int(str(call["number"])) + 1
