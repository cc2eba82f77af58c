"""Import and run the called command; help on the others comes from a table, without importing them."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from shutil import get_terminal_size
from textwrap import wrap
from typing import Any

from palpate.cli.spelling import unknown_command, unknown_option
from palpate.errors import PalpateError
from palpate.interrupts import importing

__all__ = ["command_of", "find"]

USAGE = 2  # the exit code of a call that the parser refuses


@dataclass(frozen=True)
class _Command:
    """A function or calibration of a module, and its docstring's first paragraph."""

    module: str
    function: str
    about: str

    def load(self) -> Callable[..., Any]:
        """Import and return the command."""
        with importing():
            return getattr(import_module(self.module, "palpate.cli"), self.function)


@dataclass(frozen=True)
class _Group:
    """Commands with the same first word, and a description of them."""

    about: str
    commands: dict[str, _Command] = field(default_factory=dict[str, _Command])


_GROUPS = {
    "calibrate": "Calibrate a sensor from a log",
    "design": "Design a sensor",
    "map": "Map a skin onto a robot",
    "plan": "Plan measurements",
    "rig": "Write a rig",
}
_FORCE_TORQUE = "palpate.sensors.force_torque.commands"
_LOAD_CELLS = "palpate.sensors.load_cells.commands"
_MARKER_RING = "palpate.sensors.marker_ring.commands"
_MOUNTING = "palpate.sensors.force_torque.mounting_command"
_POKING = "palpate.sensors.taxels.poking.commands"
_SKIN_MAP = "palpate.sensors.taxels.skin_map.commands"
_TAXELS = "palpate.sensors.taxels.commands"
_CALIBRATIONS = {  # name -> module, class, and the first paragraph of its docstring
    "camera": (_MARKER_RING, "CalibrateCamera", "Calibrate a fisheye lens from pictures of a board."),
    "clock": (_FORCE_TORQUE, "CalibrateClock", "Find the clock offset of the poses, and write it into the rig."),
    "drift": (".calibrate_drift", "CalibrateDrift", "Find how the bias drifts, and write it into the rig."),
    "intensity": (_TAXELS, "CalibrateIntensity", "Fit the curve from a taxel's reading to its force."),
    "load-cells": (
        _LOAD_CELLS,
        "CalibrateLoadCells",
        "Calibrate load cells: three-axis ones under a fingertip on a bench, or single-axis ones under a plate.",
    ),
    "marker-ring": (_MARKER_RING, "CalibrateMarkerRing", "Calibrate a soft ring of markers from known presses."),
    "payload": (_FORCE_TORQUE, "CalibratePayload", "Identify mass, center of mass and bias: gravity compensation."),
    "mounting": (_MOUNTING, "CalibrateMounting", "Find the surface's pose in the sensor's frame from touches."),
    "registration": (
        "palpate.sensors.taxels.poking.registration_command",
        "CalibrateRegistration",
        "Find the surface's pose among places of taxels.",
    ),
    "response": (_TAXELS, "CalibrateResponse", "Fit what taxels with three axes read under known forces."),
    "servo": (".calibrate_servo", "CalibrateServo", "Find the delay and lag with which a robot follows commands."),
    "taxels": (_POKING, "CalibrateTaxels", "Find where each taxel sits, from the wrenches of pokes."),
}
_ROWS = {  # name of a command -> module, function, and the first paragraph of its docstring
    "estimate": (".estimate", "estimate", "Estimate contacts in a log, with a rig or with a mesh alone."),
    "batch": (".batch", "batch", "Estimate contacts in many logs, and write one page about them."),
    **{f"calibrate {name}": row for name, row in _CALIBRATIONS.items()},
    "design load-cells": (_LOAD_CELLS, "design_load_cells", "Draw what a layout of load cells can resolve."),
    "evaluate": (".evaluate", "evaluate", "Compare contacts with the ground truth."),
    "events": (".events", "events", "List touches: start, end, peak force, contact point."),
    "inspect": (".inspect", "inspect", "Show what is in a log, mesh, rig, model or result."),
    "live": (".live", "live", "Estimate contacts in the samples of a device, live."),
    "map skin": (_SKIN_MAP, "map_skin", "Lay a flexible taxel sheet on a link's mesh."),
    "plan pokes": (_POKING, "plan_pokes_command", "Propose where to poke a skin next."),
    "recover": (".recover", "recover", "Recover a live record after its recorder was killed."),
    "replay": (".replay", "replay", "Play a log as a device, to try a set-up without one."),
    "view": (".view", "view", "Show contacts on the body in a browser."),
    "rig new": (".rig_new", "rig_new", "Guess a rig from a log and a mesh."),
}
_EACH = {name: _Command(*row) for name, row in _ROWS.items()}


def _tree() -> dict[str, _Command | _Group]:
    tree: dict[str, _Command | _Group] = {}
    groups = {name: _Group(about) for name, about in _GROUPS.items()}
    for name, command in _EACH.items():
        first, _, below = name.partition(" ")
        if below:
            groups.setdefault(first, _Group("")).commands[below] = command
        tree[first] = groups.get(first, command)
    return tree


COMMANDS = _tree()
BROKEN: list[str] = []  # what is wrong with other packages


def join_others() -> None:
    """Add commands of other packages to `COMMANDS`: entry points `palpate.commands` and `palpate.calibrations`.

    Those that cannot be used are skipped; `BROKEN` keeps the reasons, printed when a call names an unknown command.
    """
    from palpate.registry import Registry

    BROKEN.clear()
    own, commands = set(_EACH), Registry[Mapping[str, Any]]({}, Mapping, "palpate.commands")
    for name in commands:
        with _noted():
            for command, row in commands[name].items():
                if isinstance(row, str):
                    _GROUPS.setdefault(command, row)
                elif command not in own:
                    _EACH[command] = _Command(*row)
    calibrations = Registry[type]({}, type, "palpate.calibrations")
    for name in calibrations:
        with _noted():
            if f"calibrate {name}" not in own:
                found = calibrations[name]
                about = " ".join((found.__doc__ or "").split("\n\n")[0].split())
                _EACH[f"calibrate {name}"] = _Command(found.__module__, found.__qualname__, about)
    COMMANDS.update(_tree())


@contextmanager
def _noted() -> Generator[None]:
    try:
        yield
    except (PalpateError, TypeError, AttributeError) as problem:  # of a package that is not ours
        BROKEN.append(str(problem))


def find(argv: Sequence[str]) -> Callable[[], None]:
    """Return a function that runs the command that `argv`, without a program name, calls.

    It raises `SystemExit` after --help, with 0 or None; for a misspelt option, with a sentence; for another wrong call,
    with 2; and what the command raises.

    Raises:
        SystemExit: there is no such command, with a sentence.
    """
    words = list(argv)
    named = [word for word in words if not word.startswith("-")]
    if not {" ".join(named[:1]), " ".join(named[:2])} & set(_EACH):
        join_others()
    names = {name: tuple(each.commands) if isinstance(each, _Group) else () for name, each in COMMANDS.items()}
    helps, completes = bool({"-h", "--help"} & set(words)), any(word.startswith("--tyro-") for word in words)
    called = command_of(words, names)
    if " ".join(called) in _EACH and not completes:
        return partial(_call, called, words, helps)
    if sentence := unknown_command(words, called, names):
        raise SystemExit(" ".join([sentence, *BROKEN]))
    if completes:
        return partial(_complete, words)
    if helps:
        return partial(print, _listed(called))
    missing = f"a command is missing; `{' '.join(['palpate', *called, '--help'])}` lists them."
    raise SystemExit(unknown_option(words, called, _options(called)) or missing)


def command_of(words: Sequence[str], groups: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return the first words of a call that name a command or a group; `groups`: first word -> commands below it."""
    if not words or words[0] not in groups:
        return ()
    below = len(words) > 1 and words[1] in groups[words[0]]
    return tuple(words[: 1 + below])


def _call(called: tuple[str, ...], words: list[str], helps: bool) -> None:
    with importing():
        import tyro  # here: lists of commands do without it
    command, prog = _EACH[" ".join(called)].load(), " ".join(["palpate", *called])
    for speaks in (helps, True):  # first silent: no command runs where the parser refuses the call
        try:
            made = tyro.cli(command, prog=prog, args=words[len(called) :], console_outputs=speaks)
        except SystemExit as leaving:
            if speaks or leaving.code != USAGE:
                raise
            if sentence := unknown_option(words, called, _options(called)):
                raise SystemExit(sentence) from None
        else:
            if made is not None:  # a calibration: the call has set its fields
                made.run()
            return


def _complete(words: list[str]) -> None:
    """Print or write the shell completion of all commands with their options."""
    from tyro.extras import SubcommandApp

    app = SubcommandApp()
    for name, each in COMMANDS.items():
        if isinstance(each, _Group):
            group = SubcommandApp()
            for below, command in each.commands.items():
                group.command(name=below)(command.load())
            app.command(group, name=name, help=each.about)
        else:
            app.command(name=name)(each.load())
    app.cli(prog="palpate", description=_DESCRIPTION, args=words)


def _listed(called: tuple[str, ...]) -> str:
    """Return the help of `palpate` or of a group."""
    group = COMMANDS[called[0]] if called else None
    if isinstance(group, _Group):
        about, commands = f"{group.about}.", {name: command.about for name, command in group.commands.items()}
    else:
        about = _DESCRIPTION
        commands = {
            name: f"{each.about} ({_few(each.commands)})." if isinstance(each, _Group) else each.about
            for name, each in COMMANDS.items()
        }
    width, indent = min(get_terminal_size().columns, 100), max(map(len, commands)) + 5
    lines = [f"usage: {' '.join(['palpate', *called])} COMMAND ...", "", about, "", "commands:"]
    for name, each in commands.items():
        lines += wrap(f"  {name:<{indent - 3}} {each}", width, subsequent_indent=" " * indent, break_on_hyphens=False)
    lines += ["", f"`{' '.join(['palpate', *called])} COMMAND --help` has the options of each."]
    return "\n".join(lines)


def _few(names: Collection[str]) -> str:
    """Return the names of a group's commands, or their number if it is large."""
    return f"{len(names)} commands" if len(names) > 3 else ", ".join(names)


def _options(called: Sequence[str]) -> set[str]:
    """Return the options of a command, as its help lists them."""
    every = {"--help", *(("--json", "--quiet") if called else ("--version",))}
    if " ".join(called) not in _EACH:
        return every
    text = io.StringIO()
    with redirect_stdout(text), suppress(SystemExit):
        _call(tuple(called), [*called, "--help"], helps=True)
    return every | set(re.findall(r"--[a-z][\w-]*", text.getvalue()))


_DESCRIPTION = """Where, how hard and in which direction a robot is being touched.

Every command takes --quiet (only warnings and errors, on stderr) and --json (the output as JSON)."""
