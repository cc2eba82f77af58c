"""What makes valid calls of the public callables: the examples, and the commands of the tutorials."""

from __future__ import annotations

import contextlib
import io
import os
import runpy
import sys
from collections.abc import Iterable
from pathlib import Path

from evidence.call_walk import Call, Known, watch
from evidence.row import ROOT

__all__ = ["made_calls"]

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


def made_calls(known: Iterable[Known], folder: Path) -> dict[str, Call]:
    """The first call of each that is made by the examples and the commands, in a folder of their own."""
    from palpate.cli import main

    calls, failed = watch(known), list[str]()
    here = Path.cwd()
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
            for example in sorted((ROOT / "examples").glob("[0-9]*.py")):
                runpy.run_path(str(example))
            for command in COMMANDS:
                if main(command.split()) not in (0, 4):
                    failed.append(f"palpate {command}: {said.getvalue()[-300:]}")
    finally:
        os.chdir(here)
    for problem in failed:
        print(problem, file=sys.stderr)
    return calls
