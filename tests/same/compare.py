"""Compare two folders in which the same steps were played: arrays to the last bit, the rest as text."""

import re
from collections.abc import Iterator
from io import BytesIO
from itertools import zip_longest
from pathlib import Path
from typing import Any

import polars as pl
from mcap.reader import make_reader

WIDTH = 120  # letters that are shown of a line
VARIES = (  # what no two runs have in common
    (re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|\+00:00)?"), "DATE"),
    (re.compile(r"\b\d\d:\d\d:\d\d\b"), "CLOCK"),
    (re.compile(r"read [\d.]+ s, prepare .* once prepared and compiled"), "TOOK"),
    (re.compile(r"^.*[\d,]+ Hz  .* lost.*\n", re.MULTILINE), ""),  # of a live run, now and then
    (re.compile(r"Panic\(Id\(\d+\)"), "PANIC"),  # of a task of polars
    (re.compile(r"<tr><td[^>]*>(read|prepare|compile|locate|write|all)</td>.*</tr>"), "TOOK"),
    (re.compile(r"latency [\d,]+ .s \(.*\)"), "LATENCY"),
    (re.compile(r"^palpate: (finding the contacts|preparing) .*\n", re.MULTILINE), ""),  # after 2 s of silence
)
OF_A_RUN = ("live.mcap", ".arena.mcap.lock")  # a record with the clock of the run: its contacts are compared as a table


def differences(one: Path, other: Path) -> Iterator[str]:
    """Return a line for each file that is not the same, with the first place where it differs."""
    names = sorted({str(path.relative_to(side)) for side in (one, other) for path in side.rglob("*") if path.is_file()})
    for name in names:
        if Path(name).name in OF_A_RUN:
            continue
        here, there = one / name, other / name
        if not (here.exists() and there.exists()):
            yield f"{name}: only {'before' if here.exists() else 'after'}"
        elif here.read_bytes() != there.read_bytes():
            known, found = _text(here, one), _text(there, other)
            if known != found:
                yield f"{name}: {_first(known, found)}"


def _text(path: Path, root: Path) -> Any:
    """Return what a file holds as text, without what no two runs have in common."""
    try:
        if path.suffix == ".parquet":
            frame, written = pl.read_parquet(path), BytesIO()
            frame.write_ipc(written)
            return f"{frame.schema}\n{frame.fill_nan(None).write_json()}\n{written.getvalue().hex()}"
        if path.suffix == ".mcap":
            with path.open("rb") as file:
                return "\n".join(
                    f"{channel.topic} {schema.name if schema else ''} {message.log_time} {message.data.hex()}"
                    for schema, channel, message in make_reader(file).iter_messages()
                )
        text = path.read_text()
    except Exception:  # a spoilt file, or one that is not text: its bytes
        return path.read_bytes().hex()
    text = text.replace(str(root), "ROOT")
    for pattern, word in VARIES:
        text = pattern.sub(word, text)
    return text


def _first(known: str, found: str) -> str:
    """Return the first line in which two texts differ, where in it, and how many lines do."""
    if known.splitlines() == found.splitlines():
        return "the ends of lines differ"
    pairs = [pair for pair in zip_longest(known.splitlines(), found.splitlines(), fillvalue="") if pair[0] != pair[1]]
    at = max(0, next(k for k, (a, b) in enumerate(zip_longest(*pairs[0])) if a != b) - 40)
    return f"{len(pairs)} lines differ, first {pairs[0][0][at:][:WIDTH]!r}, now {pairs[0][1][at:][:WIDTH]!r}"
