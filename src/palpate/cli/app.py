"""Which commands there are."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, field

from tyro.extras import SubcommandApp

from palpate.cli.batch import batch
from palpate.cli.benchmark_make import benchmark_make
from palpate.cli.benchmark_score import benchmark_score
from palpate.cli.calibrate_camera import calibrate_camera
from palpate.cli.calibrate_clock import calibrate_clock
from palpate.cli.calibrate_drift import calibrate_drift
from palpate.cli.calibrate_intensity import calibrate_intensity
from palpate.cli.calibrate_load_cells import calibrate_load_cells
from palpate.cli.calibrate_marker_ring import calibrate_marker_ring_command
from palpate.cli.calibrate_mounting import calibrate_mounting
from palpate.cli.calibrate_payload import calibrate_payload
from palpate.cli.calibrate_taxels import calibrate_taxels_command
from palpate.cli.demo import demo
from palpate.cli.design_load_cells import design_load_cells
from palpate.cli.estimate import estimate
from palpate.cli.evaluate import evaluate
from palpate.cli.events import events
from palpate.cli.inspect import inspect
from palpate.cli.live import live
from palpate.cli.map_skin import map_skin
from palpate.cli.plan_pokes import plan_pokes_command
from palpate.cli.recover import recover
from palpate.cli.replay import replay
from palpate.cli.rig_new import rig_new
from palpate.cli.simulate import simulate_marker_ring
from palpate.cli.simulate_arena import simulate_arena
from palpate.cli.simulate_forearm import simulate_forearm_command
from palpate.cli.simulate_load_cells import simulate_load_cells
from palpate.cli.simulate_phantom import simulate_phantom
from palpate.cli.simulate_pokes import simulate_pokes
from palpate.cli.spelling import command_of, unknown_command, unknown_option
from palpate.cli.view import view

__all__ = ["run"]

USAGE = 2  # the exit code of a call that the parser refuses
Command = Callable[..., None]


@dataclass(frozen=True)
class _Group:
    """Commands of two words, and what they have in common."""

    about: str
    commands: dict[str, Command] = field(default_factory=dict[str, Command])


COMMANDS: dict[str, Command | _Group] = {
    "estimate": estimate,
    "batch": batch,
    "benchmark": _Group(
        "Score any estimator of contacts on simulated tasks", {"make": benchmark_make, "score": benchmark_score}
    ),
    "calibrate": _Group(
        "Make a model from a log",
        {
            "camera": calibrate_camera,
            "clock": calibrate_clock,
            "drift": calibrate_drift,
            "intensity": calibrate_intensity,
            "load-cells": calibrate_load_cells,
            "marker-ring": calibrate_marker_ring_command,
            "payload": calibrate_payload,
            "mounting": calibrate_mounting,
            "taxels": calibrate_taxels_command,
        },
    ),
    "demo": demo,
    "design": _Group("What a sensor can resolve before it is built", {"load-cells": design_load_cells}),
    "evaluate": evaluate,
    "events": events,
    "inspect": inspect,
    "live": live,
    "map": _Group("Find where the cells of a sensor sit on a robot", {"skin": map_skin}),
    "plan": _Group("What to measure next", {"pokes": plan_pokes_command}),
    "recover": recover,
    "replay": replay,
    "view": view,
    "rig": _Group("Write a rig to start from", {"new": rig_new}),
    "simulate": _Group(
        "Record what is simulated, with its truth",
        {
            "arena": simulate_arena,
            "forearm": simulate_forearm_command,
            "load-cells": simulate_load_cells,
            "marker-ring": simulate_marker_ring,
            "phantom": simulate_phantom,
            "pokes": simulate_pokes,
        },
    ),
}
_NAMES = {name: tuple(each.commands) if isinstance(each, _Group) else () for name, each in COMMANDS.items()}


def run(argv: Sequence[str]) -> None:
    """Parse and run one command; leaves by `SystemExit` on --help and on a wrong call.

    What is misspelt is said in one sentence, as the exit code; everything else that is wrong is said by the parser.
    """
    words = list(argv)
    if sentence := unknown_command(words, _NAMES):
        raise SystemExit(sentence)
    asked = bool({"-h", "--help"} & set(words))
    try:
        _parse(words, speaks=asked)
    except SystemExit as leaving:
        if asked or leaving.code != USAGE:
            raise
        if sentence := unknown_option(words, command_of(words, _NAMES), _options(words)):
            raise SystemExit(sentence) from None
        _parse(words, speaks=True)  # no command has run yet, and none will: the parser says why


def _parse(words: list[str], *, speaks: bool) -> None:
    app = SubcommandApp()
    for name, each in COMMANDS.items():
        if isinstance(each, _Group):
            group = SubcommandApp()
            for below, command in each.commands.items():
                group.command(name=below)(command)
            app.command(group, name=name, help=f"{each.about}: {', '.join(each.commands)}.")
        else:
            app.command(name=name)(each)
    app.cli(prog="palpate", description=_DESCRIPTION, args=words, console_outputs=speaks)


def _options(words: list[str]) -> set[str]:
    """The options of the command of a call, as its help lists them."""
    text = io.StringIO()
    with redirect_stdout(text), suppress(SystemExit):
        _parse([*command_of(words, _NAMES), "--help"], speaks=True)
    every = {"--help", "--json", "--quiet"} if command_of(words, _NAMES) else {"--help", "--version"}
    return every | set(re.findall(r"--[a-z][\w-]*", text.getvalue()))


_DESCRIPTION = """Where, how hard and in which direction a robot is being touched.

Every command takes --quiet (nothing but warnings and errors, on stderr) and --json (what it says, as JSON)."""
