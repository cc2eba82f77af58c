"""Print a command's title, lines of name and value, and notes; show progress on stderr if it is a terminal.

The output is text, one JSON object (`--json`), or only the warnings on stderr (`--quiet`). On a terminal a line on
stderr counts the seconds in which nothing is printed.
"""

from __future__ import annotations

import logging
import re
import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from json import dumps
from math import isfinite
from threading import Event, RLock, Thread
from time import monotonic
from typing import Any, cast

import numpy as np

from palpate.contact.estimate import Status
from palpate.viewer.report import percent
from palpate.viewer.timeline import since

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
    """Settings of the output, and its JSON so far."""

    quiet: bool = False
    json: bool = False
    output: dict[str, Any] = field(default_factory=lambda: _titled(""))
    part: dict[str, Any] = field(init=False)  # of `output`, or all of it: the next output is added to it

    def __post_init__(self) -> None:
        self.part = self.output


def _titled(text: str) -> dict[str, Any]:
    return {"title": text, "facts": {}, "tables": []}


class _Counter:
    """Count the seconds in which nothing is printed, on a line of stderr."""

    def __init__(self) -> None:
        self.doing: str | None = None  # None: nobody waits
        self._since, self._shown, self._one = monotonic(), False, RLock()

    def printing(self, doing: str | None = "working") -> None:
        """Note that something is printed now, and that the activity `doing` follows; None: nothing is counted."""
        with self._one:
            if self._shown:
                _wipe()
            self.doing, self._since, self._shown = doing, monotonic(), False

    def run(self, ended: Event) -> None:
        """Count until the event is set; runs in a separate thread."""
        self.printing()
        while not ended.wait(_TICK):
            with self._one:  # or a late count would stand below what is served
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
    """Count within the block; commands within commands share one counter."""
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
    """Set the form of the output within the block; JSON is printed at its end, also by an exit with a code above 2."""
    _VOICES.append(_Voice(quiet=quiet, json=json))
    library = logging.getLogger("palpate")
    level = library.level
    library.setLevel(logging.ERROR)  # commands say themselves what takes long
    try:
        with _counted(not quiet):
            yield
    except SystemExit as leaving:
        if leaving.code not in (0, 1, 2) and not isinstance(leaving.code, str):  # a wrong call
            _print_json()
        raise
    else:
        _print_json()
    finally:
        library.setLevel(level)
        _VOICES.pop()


def _print_json() -> None:
    if _VOICES[-1].json:
        print(dumps(_VOICES[-1].output, ensure_ascii=False, indent=2))


def in_full() -> bool:
    """Return whether the output is JSON, so that no table is too long."""
    return _VOICES[-1].json


def title(text: str) -> None:
    """Print the title of the output."""
    _VOICES[-1].output["title"] = text
    _print(text)


def part(text: str) -> None:
    """Begin a part of the JSON output, such as one of several topics: an object in `parts`; text shows no title."""
    voice = _VOICES[-1]
    voice.part = _titled(text)
    voice.output.setdefault("parts", []).append(voice.part)


def lines(pairs: Iterable[tuple[str, object]]) -> None:
    """Print (name, value) pairs, a line each; in JSON they are `facts`, and a `Quantity` is its value."""
    known = list(pairs)
    width = max([_WIDTH, *(len(name) for name, _ in known)])
    _VOICES[-1].part["facts"] |= {name: _plain(value) for name, value in known}
    for name, value in known:
        _print(f"  {name:<{width}} {value}")


def announce(text: str) -> None:
    """Print a message at once, and stop counting seconds: the command may wait now, such as to serve a page."""
    _print(f"  {text}")
    sys.stdout.flush()
    _COUNTER.printing(None)


def step(text: str) -> None:
    """Print a line of text at once; JSON omits it."""
    _print(text)
    sys.stdout.flush()


def muted() -> tuple[str, ...]:
    """Return the options for a command that this one runs: ("--quiet",) where the output is quiet or JSON, else ()."""
    return ("--quiet",) if _VOICES[-1].quiet or _VOICES[-1].json else ()


def note(texts: Iterable[str], kind: str = "note") -> None:
    """Print sentences, each after its kind: note, warning, check or hint; with `--quiet` only warnings, on stderr."""
    voice = _VOICES[-1]
    for text in texts:
        voice.part.setdefault(_OTHERS.get(kind, kind), []).append(text)
        if voice.quiet and kind == "warning":
            print(f"palpate: warning: {text}", file=sys.stderr)
        _print(f"  {kind}: {text}")


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table, its first column aligned left, the others right; in JSON each row is an object in `tables`.

    Raises:
        ValueError: a row has more or fewer cells than the header.
    """
    cells = [header, *rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    keys = [name or "name" for name in header]
    _VOICES[-1].part["tables"].append([dict(zip(keys, map(_plain, row), strict=True)) for row in cells[1:]])
    for first, *others in cells:
        aligned = [first.ljust(widths[0]), *map(str.rjust, others, widths[1:])]
        _print(f"  {'  '.join(aligned)}".rstrip())


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
    """Return a `Quantity` of the first and last finite time [s]: text, and (first, last); without any "none" and None.

    Times since 1970 are printed as a date and seconds after it.
    """
    known = times[np.isfinite(times)]
    if not len(known):
        return Quantity("none", None)
    ends = known.min(), known.max()
    start, after = since(known)
    return Quantity(f"{ends[0] - start:.3f} to {ends[1] - start:.3f} {after}".rstrip(), ends)


def shares(counts: np.ndarray) -> list[tuple[str, Quantity]]:
    """Return (label, `Quantity` of share and count) of each status that occurs; `counts` (len(Status),)."""
    found = [(kind.label, counts[kind] / counts.sum(), counts[kind]) for kind in Status if counts[kind]]
    return [
        (label, Quantity(f"{percent(share):>7}  {count:>9,}", {"share": share, "count": count}))
        for label, share, count in found
    ]


def wait(text: str) -> None:
    """Print on stderr, if it is a terminal, what the command does now."""
    if sys.stderr.isatty():
        _COUNTER.printing(text)
        print(f"palpate: {text}", file=sys.stderr, flush=True)


def progress(done: int, share: float) -> None:
    """Show the samples done and the share (0 to 1) of the log that was read, by `overwrite`."""
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
    """Open a context whose end, also by an error, wipes the line of `progress`."""
    try:
        yield
    finally:
        if sys.stderr.isatty():
            _wipe()
