"""How commands speak: a title, lines of name and value, notes; progress on stderr where a person watches."""

from __future__ import annotations

import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager

__all__ = ["counting", "lines", "note", "percent", "progress", "table", "title", "wait"]

_WIDTH = 16


def title(text: str) -> None:
    """What this output is about."""
    print(text)


def lines(pairs: Iterable[tuple[str, object]]) -> None:
    """Name and value, one pair a line."""
    known = list(pairs)
    width = max([_WIDTH, *(len(name) for name, _ in known)])
    for name, value in known:
        print(f"  {name:<{width}} {value}")


def note(texts: Iterable[str], kind: str = "note") -> None:
    """Sentences that the reader should not miss."""
    for text in texts:
        print(f"  {kind}: {text}")


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Columns, the first to the left, the others to the right."""
    cells = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    for row in cells:
        first, *rest = (
            f"{cell:{'<' if k == 0 else '>'}{width}}" for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        print("  " + "  ".join([first, *rest]).rstrip())


def percent(share: float) -> str:
    """A share, to a tenth of a percent."""
    return f"{100 * share:.1f} %"


def wait(text: str) -> None:
    """Tell a person why nothing happens; on stderr, so that output stays clean."""
    if sys.stderr.isatty():
        print(f"palpate: {text}", file=sys.stderr, flush=True)


def progress(done: int, share: float) -> None:
    """One line that counts, for a person.

    Args:
        done: samples so far.
        share: of the file that was read.
    """
    if sys.stderr.isatty():
        print(f"\rpalpate: {done:,} samples, {share:4.0%} of the log", end="", file=sys.stderr, flush=True)


@contextmanager
def counting() -> Generator[None]:
    """Wipes the line of `progress` when the block ends, however it does."""
    try:
        yield
    finally:
        if sys.stderr.isatty():
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
