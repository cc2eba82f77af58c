"""Print a command's title, lines of name and value, and notes; show progress on stderr if it is a terminal.

The output is text, one JSON object (`--json`), or only the warnings on stderr (`--quiet`). On a terminal no command
is silent for more than two seconds: where nothing is printed, a line on stderr counts the seconds.
"""

from __future__ import annotations

import json
import logging
import re
import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isfinite
from threading import Event, Thread
from time import monotonic
from typing import Any, cast

import numpy as np

from palpate.contact.estimate import Status
from palpate.viewer.report import percent
from palpate.viewer.timeline import since

__all__ = [
    "Quantity",
    "announce",
    "counting",
    "in_full",
    "lines",
    "muted",
    "note",
    "overwrite",
    "part",
    "progress",
    "shares",
    "span",
    "spoken",
    "step",
    "table",
    "title",
    "wait",
]

_WIDTH = 16
_NUMBER = re.compile(r"[-+]?\d[\d,]*(\.\d*)?(e[-+]?\d+)?")
_OTHERS = {"note": "notes", "warning": "warnings", "check": "checks"}


@dataclass(frozen=True)
class Quantity:
    """A text for a person with the number, or numbers, that it stands for."""

    text: str
    value: object

    def __str__(self) -> str:
        return self.text


@dataclass
class _Voice:
    """Settings of the output, and for JSON everything that was printed so far."""

    quiet: bool = False
    json: bool = False
    said: dict[str, Any] = field(default_factory=lambda: _about(""))
    part: dict[str, Any] | None = None

    @property
    def here(self) -> dict[str, Any]:
        """Dictionary that the next output is added to: that of the current part, or of all."""
        return self.said if self.part is None else self.part


def _about(text: str) -> dict[str, Any]:
    return {"title": text, "facts": {}, "tables": []}


class _Counter:
    """A counter of seconds on one line of stderr, shown where nothing else is printed for a second."""

    def __init__(self) -> None:
        self.doing: str | None = None  # None: nobody waits
        self._since, self._shown = monotonic(), False

    def printing(self, doing: str | None = "working") -> None:
        """Note that something is printed now, and that the activity `doing` follows; None: nothing is counted."""
        if self._shown:
            _wipe()
        self.doing, self._since, self._shown = doing, monotonic(), False

    def run(self, ended: Event) -> None:
        """Count until the event is set; runs in a separate thread."""
        self.printing()
        while not ended.wait(_TICK):
            seconds = monotonic() - self._since
            if self.doing is not None and seconds > _SILENT:
                self._shown = True
                print(f"\rpalpate: {self.doing}, {seconds:.0f} s", end="\x1b[K", file=sys.stderr, flush=True)
        self.printing(None)


_TICK, _SILENT = 0.5, 1.0  # s
_COUNTER = _Counter()
_VOICES = [_Voice()]  # the last one speaks


@contextmanager
def _counted(wanted: bool) -> Generator[None]:
    """Count the seconds of silence within the block; commands within commands share one counter."""
    if not (wanted and len(_VOICES) == 2 and sys.stderr.isatty()):
        yield
        return
    ended = Event()
    thread = Thread(target=_COUNTER.run, args=(ended,), daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextmanager
def spoken(*, quiet: bool, json: bool) -> Generator[None]:
    """Print output within the block as text, or as one JSON object at its end or exit with a code of 3 or more."""
    _VOICES.append(_Voice(quiet=quiet, json=json))
    library = logging.getLogger("palpate")
    level = library.level
    library.setLevel(logging.ERROR)  # commands say themselves what takes long
    try:
        with _counted(not quiet):
            yield
    except SystemExit as leaving:
        if leaving.code not in (0, 1, 2) and not isinstance(leaving.code, str):  # a wrong call
            _finish()
        raise
    else:
        _finish()
    finally:
        library.setLevel(level)
        _VOICES.pop()


def _finish() -> None:
    voice = _VOICES[-1]
    if voice.json:
        print(json.dumps(voice.said, ensure_ascii=False, indent=2))


def in_full() -> bool:
    """Return whether the output is JSON for a program, for which no table is too long."""
    return _VOICES[-1].json


def title(text: str) -> None:
    """Print the title of the output."""
    _VOICES[-1].said["title"] = text
    _print(text)


def part(text: str) -> None:
    """Begin a part, such as one of several topics; in JSON each is a separate object in `parts`."""
    voice = _VOICES[-1]
    voice.part = _about(text)
    voice.said.setdefault("parts", []).append(voice.part)


def lines(pairs: Iterable[tuple[str, object]]) -> None:
    """Print names and values, one pair per line; in JSON a `Quantity` is its value."""
    known = list(pairs)
    width = max([_WIDTH, *(len(name) for name, _ in known)])
    _VOICES[-1].here["facts"] |= {name: _plain(value) for name, value in known}
    for name, value in known:
        _print(f"  {name:<{width}} {value}")


def announce(text: str) -> None:
    """Print a message at once, and stop counting seconds, so that a command may wait, such as to serve a page."""
    _print(f"  {text}")
    sys.stdout.flush()
    _COUNTER.printing(None)


def step(text: str) -> None:
    """Print the next step of a command at once, for persons."""
    _print(text)
    sys.stdout.flush()


def muted() -> tuple[str, ...]:
    """Return ("--quiet",), for a command run by this one, where no person reads the output; else ()."""
    return ("--quiet",) if _VOICES[-1].quiet or _VOICES[-1].json else ()


def note(texts: Iterable[str], kind: str = "note") -> None:
    """Print sentences, each after its kind (note, warning, ...); with `--quiet` only warnings, on stderr."""
    voice = _VOICES[-1]
    for text in texts:
        voice.here.setdefault(_OTHERS.get(kind, kind), []).append(text)
        if voice.quiet and kind == "warning":
            print(f"palpate: warning: {text}", file=sys.stderr)
        _print(f"  {kind}: {text}")


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print columns, the first aligned left, the others right."""
    cells = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    keys = [name or "name" for name in header]
    _VOICES[-1].here["tables"].append([dict(zip(keys, map(_plain, row), strict=True)) for row in cells[1:]])
    for row in cells:
        sided = zip(row, widths, ["<", *">" * len(row[1:])], strict=True)
        _print("  " + "  ".join(f"{cell:{side}{width}}" for cell, width, side in sided).rstrip())


def _print(text: str) -> None:
    voice = _VOICES[-1]
    if not (voice.quiet or voice.json):
        _COUNTER.printing()
        print(text)


def _plain(value: Any) -> Any:
    """Convert a value for JSON: numeric text becomes a number; NaN, "-" and infinity become null."""
    if isinstance(value, Quantity):
        return _plain(value.value)
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in cast("dict[Any, Any]", value).items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(each) for each in cast("list[Any]", value)]
    if isinstance(value, str):
        return _number(value)
    plain: object = cast("Any", value).item() if isinstance(value, np.generic) else value
    if isinstance(plain, float):
        return plain if isfinite(plain) else None
    return plain if plain is None or isinstance(plain, bool | int) else str(plain)


def _number(text: str) -> str | int | float | None:
    if _NUMBER.fullmatch(text):
        bare = text.replace(",", "")
        return int(bare) if bare.lstrip("+-").isdigit() else float(bare)
    return None if text in ("-", "nan") else text


def span(times: np.ndarray) -> Quantity:
    """Return a `Quantity`: first and last finite time as text, and as its value [s]; "none" and None without any.

    Seconds since 1970 begin with a date.
    """
    known = times[np.isfinite(times)]
    if not len(known):
        return Quantity("none", None)
    ends = known.min(), known.max()
    start, after = since(known)
    return Quantity(f"{ends[0] - start:.3f} to {ends[1] - start:.3f} {after}".rstrip(), ends)


def shares(counts: np.ndarray) -> list[tuple[str, Quantity]]:
    """Return a list of (label, `Quantity` of share and count) of each status that occurs; `counts` (len(Status),)."""
    total = counts.sum()
    return [
        (
            kind.label,
            Quantity(
                f"{percent(counts[kind] / total):>7}  {counts[kind]:>9,}",
                {"share": counts[kind] / total, "count": counts[kind]},
            ),
        )
        for kind in Status
        if counts[kind]
    ]


def wait(text: str) -> None:
    """Print on stderr, if it is a terminal, what a person is waiting for; stdout stays clean."""
    if sys.stderr.isatty():
        _COUNTER.printing(text)
        print(f"palpate: {text}", file=sys.stderr, flush=True)


def progress(done: int, share: float) -> None:
    """Show the progress in one line of stderr, if it is a terminal.

    Args:
        done: samples so far.
        share: share of the file that was read.
    """
    overwrite(f"{done:,} samples, {share:4.0%} of the log")


def overwrite(text: str) -> None:
    """Write a line over the previous one on stderr, if it is a terminal."""
    if sys.stderr.isatty():
        _COUNTER.printing(_COUNTER.doing or "working")
        print(f"\rpalpate: {text}", end="\x1b[K", file=sys.stderr, flush=True)


def _wipe() -> None:
    print("\r\x1b[K", end="", file=sys.stderr, flush=True)


@contextmanager
def counting() -> Generator[None]:
    """Wipe the line of `progress` when the block ends, also by an error."""
    try:
        yield
    finally:
        if sys.stderr.isatty():
            _wipe()
