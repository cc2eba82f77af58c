"""What makes valid calls of the public callables: the examples, and the commands of the tutorials."""

import contextlib
import dataclasses
import io
import os
import runpy
import sys
import time
from pathlib import Path
from typing import Any

from claims.evidence.call_more import fused_calls, more_calls
from claims.evidence.call_values import Seen, attempts
from claims.evidence.call_walk import ROOMS, Call, Known, answer, public, watch
from claims.row import ROOT

ROUNDS = 3  # of making values from values
COMMANDS = (
    "demo -o demo --no-view",
    "estimate demo/touches.mcap --rig demo/rig.toml -o demo/filtered.csv --filter butterworth --cutoff 15",
    "simulate load-cells -o fingertip/",
    "calibrate load-cells fingertip/bench_log.csv --rig fingertip/rig.toml -o fingertip/fingertip.toml",
    "estimate fingertip/log.csv --rig fingertip/rig.toml -o fingertip/contacts.csv --report fingertip/report.html",
    "evaluate fingertip/contacts.csv fingertip/truth.csv",
    "design load-cells fingertip/rig.toml -o fingertip/design.html",
    "simulate forearm -o forearm/ --seconds 12 --touches 2 --seed 7",
    "map skin forearm/link.stl --unit m --sheet 10x22 --cell 10 --origin 0.03515,-0.00498,-0.05 --heading 0,1,0"
    " -o forearm/my_map.toml",
    "calibrate intensity forearm/load_cell_log.csv --bits 8 -o forearm/my_intensity.toml",
    "estimate forearm/both.mcap --rig forearm/both.toml -o forearm/both.csv --report forearm/both.html",
    "evaluate forearm/both.csv forearm/truth.csv",
    "simulate pokes -o pokes/",
    "calibrate taxels pokes/pokes.mcap --rig pokes/rig.toml -o pokes/skin.toml",
    "evaluate pokes/skin.toml pokes/truth.csv",
    "plan pokes pokes/rig.toml --skin pokes/skin.toml -o pokes/next.csv --wanted 1.6e-3",
    "simulate marker-ring -o ring/ --small",
    "calibrate marker-ring ring/frames.avi --rig ring/rig.toml -o ring/ring.toml",
    "simulate arena --layout u --seed 3 --seconds 4 -o u.mcap",
    "simulate phantom --seconds 2 -o phantom.mcap",
)


EXAMPLES = ("01_", "02_", "03_", "05_", "09_", "10_")  # that take no time


def made_calls(known: list[Known], folder: Path, *, small: bool) -> dict[str, Call]:
    """One valid call of each that can be called: as examples and commands call it, or with values seen there."""
    seen = Seen()
    calls = watch(public(ROOMS), seen)
    _run(folder, small=small)
    if not small:
        fused_calls(seen)
    for _ in range(ROUNDS):
        for each in known:
            if each.name not in calls:
                _try(each, calls, seen)
    return {each.name: calls[each.name] for each in known if each.name in calls}


def _run(folder: Path, *, small: bool) -> None:
    from palpate.cli import main

    failed, made = list[str](), dict[str, dict[str, Any]]()
    here = Path.cwd()
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
            for example in sorted((ROOT / "examples").glob("[0-9]*.py")):
                if not small or example.name.startswith(EXAMPLES):
                    made[example.name[:2]] = runpy.run_path(str(example))
            more_calls(made, small=small)
            for command in () if small else COMMANDS:
                if main(command.split()) not in (0, 4):
                    failed.append(f"palpate {command}: {said.getvalue()[-300:]}")
    finally:
        os.chdir(here)
    for problem in failed:
        print(problem, file=sys.stderr)


def _try(known: Known, calls: dict[str, Call], seen: Seen) -> None:
    for bound in attempts(known.called, known.owner, seen):
        call = Call(known, bound, 0.0)
        begun = time.perf_counter()
        how, found = answer(call, {})
        if how == "answered":
            calls[known.name] = dataclasses.replace(call, seconds=time.perf_counter() - begun)
            seen.call(bound)
            seen.value(found)
            return
