"""Read texts in which a frame takes several lines: blocks of rows, as Tekscan writes, or one row a taxel."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.files.logs.arrays import HeldLog
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.log import LogContents
from palpate.files.tables.dialect import find_dialect
from palpate.files.tables.lines import open_input, read_some
from palpate.files.tables.stated import Stated
from palpate.files.tables.table import TextTable, read_table
from palpate.files.units import split_unit

_HEAD = 1 << 16  # bytes of a text in which its form is looked for
_FEWEST = 3  # frames that show the form
_FIELD = r"(?:[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|B|\*)"  # B: no cell there, as Tekscan writes
_ROW = re.compile(rf"\s*{_FIELD}(?:\s*[,;\s]\s*{_FIELD})+\s*[,;]?\s*", re.IGNORECASE)
_TIME = re.compile(r"\b(?:time\w*|t)\b\W*([-+]?\d+\.?\d*(?:[eE][-+]?\d+)?)", re.IGNORECASE)
_NUMBERED = re.compile(r"\W*frame\W*(\d+)", re.IGNORECASE)
_LENGTHS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
_IDS = {"taxel", "taxel_id", "cell", "cell_id", "sensel", "sensor", "sensor_id", "channel", "id", "index"}
_VALUES = {"value", "reading", "pressure", "force", "raw", "adc", "counts", "intensity", "signal"}


@dataclass(frozen=True)
class _Blocks:
    """Frames of a text, its lines before them, and the times or numbers that stand above each frame.

    Attributes:
        frames: (n, rows, columns).
        facts: key -> value.
        labels: of each frame, the lines above it.
    """

    frames: Float[np.ndarray, "n r c"]
    facts: Mapping[str, str] = field(default_factory=dict[str, str])
    labels: tuple[str, ...] = ()


class TextFrames(HeldLog):
    """A log in a text with a frame in several lines, read at once."""

    def __init__(self, path: Path, layout: LogLayout) -> None:
        super().__init__({}, layout)
        self.path, self.size = path, path.stat().st_size

    @cached_property
    def _read(self) -> tuple[dict[str, np.ndarray], Stated, str]:
        table = long_names(self.path)
        return _of_blocks(_blocks(self.path)) if table is None else _of_table(read_table(self.path), table)

    def contents(self) -> LogContents:
        """Return the frames and times of the text.

        Raises:
            InputError: the file cannot be read, or its frames have different sizes.
        """
        self._held, stated, written = self._read
        return LogContents(self.path, super().contents().names, stated=stated, written=written)


def holds_text_frames(path: Path) -> bool:
    """Return whether a text has frames of several lines, or one row a taxel.

    Raises:
        InputError: the file cannot be read.
    """
    with open_input(path) as file:
        head = read_some(file, path, _HEAD)
    if b"\0" in head:
        return False
    runs = [len(rows) for rows in _runs(head.decode(errors="replace").splitlines())[1][:-1]]
    return (len(runs) >= _FEWEST and len({*runs}) == 1) or long_names(path) is not None


def _runs(lines: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Return the lines before each run of rows of numbers, joined; and the runs, of two rows and more."""
    above, labels, found = list[str](), list[str](), list[list[str]]()
    for numbers, group in groupby(lines, key=lambda line: bool(_ROW.fullmatch(line))):
        run = list(group)
        if not numbers:
            above += run
        elif len(run) > 1 or found:
            labels.append("\n".join(above))
            found.append(run)
            above = []
    return labels, found


def _blocks(path: Path) -> _Blocks:
    """Read the frames of a text; raise an InputError if one but the last has another size."""
    with open_input(path) as file:
        text = read_some(file, path, -1).decode(errors="replace")
    labels, runs = _runs(text.splitlines())
    size = len(runs[0])
    if len(runs[-1]) < size:
        labels, runs = labels[:-1], runs[:-1]
    rows = [
        re.sub(r"[Bb*]", "0", re.sub(r"[,;\s]+", " ", row.strip(" ,;\t"))).split(" ") for run in runs for row in run
    ]
    if odd := next((k for k, run in enumerate(runs) if len(run) != size), None):
        what = f"frame {odd + 1} has {len(runs[odd])} rows, and the first has {size}."
        raise InputError(what, where=str(path), hint="Cut the file before it.")
    if odd := next((k for k, row in enumerate(rows) if len(row) != len(rows[0])), None):
        what = f"frame {odd // size + 1} has a row of {len(rows[odd])} numbers, and the first row has {len(rows[0])}."
        raise InputError(what, where=str(path), hint="Cut the file before it.")
    facts = dict(pair for line in labels[0].splitlines() if len(pair := line.strip().split(None, 1)) == 2)
    return _Blocks(np.array(rows, dtype=np.float64).reshape(len(runs), size, -1), facts, tuple(labels))


def _of_blocks(read: _Blocks) -> tuple[dict[str, np.ndarray], Stated, str]:
    """Return arrays by name, what the text states of them, and how it is written."""
    arrays, facts = {"frames": read.frames}, {key.upper(): value for key, value in read.facts.items()}
    step, times = float(facts.get("SECONDS_PER_FRAME", "nan").split()[0]), [_TIME.search(text) for text in read.labels]
    numbers = [_NUMBERED.search(text) for text in read.labels]
    if np.isfinite(step):
        first = [int(match[1]) - 1 if match else k for k, match in enumerate(numbers)]
        arrays["time"] = step * np.array(first)
    elif all(times) and len(times) > 1:
        arrays["time"] = np.array([float(match[1]) for match in times if match])
    number, _, unit = facts.get("ROW_SPACING", "").partition(" ")
    pitch = float(number) * _LENGTHS[unit.strip()] if number and unit.strip() in _LENGTHS else None
    units = {"frames": facts["UNITS"].strip()} if "UNITS" in facts else {}
    rows, columns = read.frames.shape[1:]
    written = f"in frames of {rows} lines with {columns} numbers; B and *, where there is no cell, are read as 0"
    return arrays, Stated(units, pitch=pitch), written


def long_names(path: Path) -> dict[str, str] | None:
    """Return the names of the columns of a table with one row a taxel: "id" or "row" and "column", "value", "time".

    None if it is no such table.

    Raises:
        InputError: the file cannot be read.
    """
    with open_input(path) as file:
        head = read_some(file, path, _HEAD)
    try:
        names = find_dialect(head, path).names if b"\0" not in head[:4096] else ()
    except InputError:
        return None
    bare = {split_unit(name)[0].strip().lower(): name for name in names}
    found = {"id": _IDS, "row": {"row", "r"}, "column": {"col", "column", "c"}, "value": _VALUES}
    roles = {role: [name for word, name in bare.items() if word in words] for role, words in found.items()}
    named = {role: each[0] for role, each in roles.items() if len(each) == 1}
    rest = [name for name in names if name not in named.values()]
    placed = named.keys() in ({"id", "value"}, {"row", "column", "value"})
    return {**named, "time": rest[0]} if placed and len(rest) == 1 else None


def _of_table(table: TextTable, names: Mapping[str, str]) -> tuple[dict[str, np.ndarray], Stated, str]:
    """Return a column a taxel, named by its id or by row and column; a frame ends where a taxel comes again."""
    keys = [names[role] for role in ("id", "row", "column") if role in names]
    time, value = table.numbers([names["time"], names["value"]])[0].T
    taxels, which = np.unique(table.numbers(keys, strict=True)[0].astype(np.int64), axis=0, return_inverse=True)
    frame = _frames(time, np.ravel(which))
    values = np.full((frame[-1] + 1 if len(frame) else 0, len(taxels)), np.nan)
    values[frame, np.ravel(which)] = value
    starts = np.flatnonzero(np.diff(frame, prepend=-1))
    unit = Stated.of_dialect(table.dialect).units.get(names["value"], "")
    called = [f"{keys[0]}_{ids[0]}" if len(keys) == 1 else f"r{ids[0]}c{ids[1]}" for ids in taxels.tolist()]
    arrays = {names["time"]: time[starts], **dict(zip(called, values.T, strict=True))}
    stated = Stated(dict.fromkeys(called, unit) if unit else {})
    return arrays, stated, f"with one row a taxel, {len(taxels)} in a frame"


def _frames(time: Float[np.ndarray, " n"], which: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Return the frame (n,) of each row: rows of one time, or, where times differ from row to row, of one scan."""
    same = np.diff(time) == 0
    starts = ~same if same.any() else np.diff(which) <= 0
    return np.cumsum(np.concatenate([[0], starts]))[: len(time)]
