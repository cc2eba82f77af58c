"""How commands speak: a title, lines of name and value, notes; progress on stderr where a person watches."""

from __future__ import annotations

import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager

import numpy as np

from palpate.contact.estimate import Status
from palpate.viewer.report import percent

__all__ = ["counting", "lines", "note", "progress", "shares", "span", "table", "title", "wait"]

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
        sided = zip(row, widths, ["<", *">" * len(row[1:])], strict=True)
        print("  " + "  ".join(f"{cell:{side}{width}}" for cell, width, side in sided).rstrip())


def span(times: np.ndarray) -> str:
    """From the first of some times to the last."""
    known = times[np.isfinite(times)]
    return f"{known.min():.3f} to {known.max():.3f}" if len(known) else "none"


def shares(counts: np.ndarray) -> list[tuple[str, str]]:
    """Each status that occurs, with its share and its count; `counts` (len(Status),)."""
    total = counts.sum()
    return [(kind.label, f"{percent(counts[kind] / total):>7}  {counts[kind]:>9,}") for kind in Status if counts[kind]]


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
