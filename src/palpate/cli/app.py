"""Import and run the called command; help on the others comes from a table, without importing them."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass, field
from importlib import import_module
from shutil import get_terminal_size
from textwrap import wrap
from typing import Any

from palpate.cli.spelling import command_of, unknown_command, unknown_option
from palpate.errors import PalpateError
from palpate.interrupts import importing

__all__ = ["run"]

USAGE = 2  # the exit code of a call that the parser refuses


@dataclass(frozen=True)
class _Command:
    """A function of a module, or a calibration, and the first paragraph of its docstring."""

    module: str
    function: str
    about: str

    def load(self) -> Callable[..., Any]:
        """Import and return the command."""
        with importing():
            return getattr(import_module(self.module, "palpate.cli"), self.function)


@dataclass(frozen=True)
class _Group:
    """Commands of two words with the same first word, and a description of them all."""

    about: str
    commands: dict[str, _Command] = field(default_factory=dict[str, _Command])


_GROUPS = {
    "calibrate": "Make a model from a log",
    "design": "What a sensor can resolve before it is built",
    "map": "Find where the cells of a sensor sit on a robot",
    "plan": "What to measure next",
    "rig": "Write a rig to start from",
}
_EACH = {
    "estimate": _Command(
        ".estimate",
        "estimate",
        "Find contacts in the log of any sensor, with a rig, or in a log of wrenches with a mesh alone.",
    ),
    "batch": _Command(
        ".batch",
        "batch",
        "Find contacts in many logs, each exactly as `palpate estimate` would, and write one page about all of them.",
    ),
    "calibrate camera": _Command(
        "palpate.sensors.marker_ring.camera_command",
        "CalibrateCamera",
        "Calibrate a fisheye lens from pictures of a chessboard, held at all angles and to the edges of the picture.",
    ),
    "calibrate clock": _Command(
        "palpate.sensors.force_torque.clock_command",
        "CalibrateClock",
        "Find how late or early the poses are stamped, from how the payload's weight turns, and write it into the rig.",
    ),
    "calibrate drift": _Command(
        ".calibrate_drift",
        "CalibrateDrift",
        "Find how the zero of a force/torque sensor or of load cells wanders, and write it into the rig.",
    ),
    "calibrate intensity": _Command(
        "palpate.sensors.taxels.commands",
        "CalibrateIntensity",
        "Fit the curve from intensity to force, and each cell's gain where the log says which cell was pressed.",
    ),
    "calibrate load-cells": _Command(
        "palpate.sensors.load_cells.commands",
        "CalibrateLoadCells",
        "Calibrate three-axis force cells under a rigid frame, from a bench log with a reference.",
    ),
    "calibrate marker-ring": _Command(
        "palpate.sensors.marker_ring.commands",
        "CalibrateMarkerRing",
        "Calibrate a soft ring of markers from presses of known angle, depth and force.",
    ),
    "calibrate payload": _Command(
        "palpate.sensors.force_torque.commands",
        "CalibratePayload",
        "Identify weight, centre of mass and biases from a log in which nothing is touched.",
    ),
    "calibrate mounting": _Command(
        "palpate.sensors.force_torque.mounting_command",
        "CalibrateMounting",
        "Find the pose of the surface in the sensor's frame, starting from the rig's, and write it into the rig.",
    ),
    "calibrate taxels": _Command(
        "palpate.sensors.taxels.poking.commands",
        "CalibrateTaxels",
        "Find where each taxel of a skin sits, from the wrenches of pokes in several arm configurations.",
    ),
    "design load-cells": _Command(
        "palpate.sensors.load_cells.design_command",
        "design_load_cells",
        "Draw how well place, force and torque can be known over the surface, and the smallest force that will do.",
    ),
    "evaluate": _Command(
        ".evaluate",
        "evaluate",
        "Errors of location, direction and force, coverage of the ellipses, share of each status.",
    ),
    "events": _Command(
        ".events",
        "events",
        "Touches: start, end, peak force, place; of several contacts at a time each by itself.",
    ),
    "inspect": _Command(
        ".inspect",
        "inspect",
        "Say what is in a log, a mesh, a rig, a model, a result or a truth; draw the spectrum of a log or a result.",
    ),
    "live": _Command(
        ".live",
        "live",
        "Find contacts in the samples of a device as they come; Ctrl-C ends it, and the end of a log that is replayed.",
    ),
    "map skin": _Command(
        "palpate.sensors.taxels.skin_map.commands",
        "map_skin",
        "Fit a smooth surface to a link's mesh, lay the sheet on it without stretching, and write where its cells are.",
    ),
    "plan pokes": _Command(
        "palpate.sensors.taxels.poking.plan_command",
        "plan_pokes_command",
        "Say which pokes shrink the largest deviation of a taxel most, one after the other, until it is small enough.",
    ),
    "recover": _Command(
        ".recover",
        "recover",
        "Put together what `palpate live --record OUTPUT` left when it was killed: OUTPUT.part and OUTPUT.ring.",
    ),
    "replay": _Command(
        ".replay",
        "replay",
        "Play a log as a device, on this machine alone, until Ctrl-C; it says the [source] of a rig that reaches it.",
    ),
    "view": _Command(
        ".view",
        "view",
        "Show contacts on the body, with a timeline to scrub and play, in a browser; Ctrl-C ends it.",
    ),
    "rig new": _Command(
        ".rig_new",
        "rig_new",
        "Guess a rig from the log of any sensor, and a mesh: which sensor, columns, units, noise.",
    ),
}


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
    """Add commands of other packages: entry points `palpate.commands` and `palpate.calibrations`.

    Those that cannot be imported, or are no such table, are skipped; `BROKEN` keeps the reasons, which are printed
    where a call names an unknown command.
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


def run(argv: Sequence[str]) -> None:
    """Parse and run one command; leaves by `SystemExit` on --help and on a wrong call.

    A misspelt word is reported in one sentence, as the exit code; other errors in the call are reported by the parser.
    """
    words = list(argv)
    named = [word for word in words if not word.startswith("-")]
    if not {" ".join(named[:1]), " ".join(named[:2])} & set(_EACH):
        join_others()
    names = {name: tuple(each.commands) if isinstance(each, _Group) else () for name, each in COMMANDS.items()}
    if sentence := unknown_command(words, names):
        raise SystemExit(" ".join([sentence, *BROKEN]))
    asked = bool({"-h", "--help"} & set(words))
    called = command_of(words, names)
    if any(word.startswith("--tyro-") for word in words):
        _complete(words)
    elif " ".join(called) in _EACH:
        _call(called, words, asked)
    elif asked:
        print(_listed(called))
    else:
        missing = f"a command is missing; `{' '.join(['palpate', *called, '--help'])}` lists them."
        raise SystemExit(unknown_option(words, called, _options(called)) or missing)


def _call(called: tuple[str, ...], words: list[str], asked: bool) -> None:
    try:
        _parse(called, words, speaks=asked)
    except SystemExit as leaving:
        if asked or leaving.code != USAGE:
            raise
        if sentence := unknown_option(words, called, _options(called)):
            raise SystemExit(sentence) from None
        _parse(called, words, speaks=True)  # no command has run yet, and none will: the parser says why


def _parse(called: tuple[str, ...], words: list[str], *, speaks: bool) -> None:
    with importing():
        import tyro  # here: lists of commands do without it
    prog = " ".join(["palpate", *called])
    made = tyro.cli(_EACH[" ".join(called)].load(), prog=prog, args=words[len(called) :], console_outputs=speaks)
    if made is not None:  # a calibration: the call has set its fields
        made.run()


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
    """Return the help of `palpate`, or of a group: its commands, a paragraph each."""
    group = COMMANDS[called[0]] if called else None
    if isinstance(group, _Group):
        about, commands = f"{group.about}.", {name: command.about for name, command in group.commands.items()}
    else:
        about = _DESCRIPTION
        commands = {
            name: f"{each.about}: {', '.join(each.commands)}." if isinstance(each, _Group) else each.about
            for name, each in COMMANDS.items()
        }
    width, indent = min(get_terminal_size().columns, 100), max(map(len, commands)) + 5
    lines = [f"usage: {' '.join(['palpate', *called])} COMMAND ...", "", about, "", "commands:"]
    for name, each in commands.items():
        lines += wrap(f"  {name:<{indent - 3}} {each}", width, subsequent_indent=" " * indent, break_on_hyphens=False)
    lines += ["", f"`{' '.join(['palpate', *called])} COMMAND --help` has the options of each."]
    return "\n".join(lines)


def _options(called: Sequence[str]) -> set[str]:
    """Return the options of a command, as its help lists them."""
    every = {"--help", *_EVERYWHERE[bool(called)]}
    if " ".join(called) not in _EACH:
        return every
    text = io.StringIO()
    with redirect_stdout(text), suppress(SystemExit):
        _parse(tuple(called), [*called, "--help"], speaks=True)
    return every | set(re.findall(r"--[a-z][\w-]*", text.getvalue()))


_EVERYWHERE = (("--version",), ("--json", "--quiet"))  # without a command, and with one
_DESCRIPTION = """Where, how hard and in which direction a robot is being touched.

Every command takes --quiet (nothing but warnings and errors, on stderr) and --json (what it says, as JSON)."""
