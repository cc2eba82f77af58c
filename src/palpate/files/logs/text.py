"""Read text: CSV, and frames of several lines, in blocks of rows, as Tekscan writes, or with one row a taxel."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import groupby
from os import SEEK_END
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.files.inputs import open_input, read_some
from palpate.files.logs.arrays import HeldLog
from palpate.files.logs.columns import ColumnLog, Columns, Read
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.log import LogContents
from palpate.files.tables.dialect import find_dialect
from palpate.files.tables.fields import Fields, RowCount
from palpate.files.tables.stated import Stated
from palpate.files.tables.table import TextTable, read_table, tables
from palpate.files.units import positive, split_unit
from palpate.signals.recording import Recording
from palpate.surfaces.mesh import UNITS

PIECE = 1 << 21  # bytes of a table
_HEAD = 1 << 16  # bytes of a text in which its form and its header are looked for
_FEWEST, _ALIKE = 3, 0.8  # frames that show the form, and their share: others may have lost a line
_FIELD = r"(?:[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|nan|B|\*)"  # B: no cell there, as Tekscan writes
_ROW = re.compile(rf"\s*{_FIELD}(?:\s*[,;\s]\s*{_FIELD})+\s*[,;]?\s*", re.IGNORECASE)
_TIME = re.compile(r"\b(?:time\w*|t)\b\W*([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)", re.IGNORECASE)
_NUMBERED = re.compile(r"^\W*frame\W*(\d+)", re.IGNORECASE | re.MULTILINE)
_Read = tuple[dict[str, np.ndarray], Stated, str]  # arrays by name, what the text states of them, how it is written
_IDS = {"taxel", "taxel_id", "cell", "cell_id", "sensel", "sensor", "sensor_id", "channel", "id", "index"}
_VALUES = {"value", "reading", "pressure", "force", "raw", "adc", "counts", "intensity", "signal"}


class CsvLog(ColumnLog):
    """A log in delimited text, whose dialect `palpate.files.tables.dialect` determines."""

    def __init__(self, path: Path, layout: LogLayout) -> None:
        super().__init__(path, layout)
        self._rows = RowCount()

    def contents(self) -> LogContents:
        """Return the names, units and dialect of the table, from its header.

        Raises:
            InputError: the file cannot be read, or is no table of text.
        """
        with open_input(self.path) as file:
            table = next(tables(file, self.path, _HEAD))
        stated = Stated.of_dialect(table.dialect)
        return LogContents(self.path, _shapes(table), stated=stated, written=table.dialect.described())

    def blocks(self) -> Iterator[Recording]:
        """Yield the rows as recordings in SI.

        Raises:
            InputError: the file cannot be read, is no table, or has no rows that fit its header or a column without
                numbers; or the layout does not fit.
        """
        self._rows, self._columns, self.torn = RowCount(), None, ""
        shapes: dict[str, tuple[int, ...]] = {}
        with open_input(self.path, pipe=True) as file:
            for table in tables(file, self.path, PIECE):
                self.position = file.tell() if file.seekable() else 0
                if self._columns is None:
                    shapes, stated = _shapes(table), Stated.of_dialect(table.dialect)
                    self._columns = Columns(self._layout, self.path, shapes, stated, self.pose_log)
                table.counted(self._rows)
                if len(table):
                    yield from self._columns.blocks(self._reader(table, self._columns, shapes))
            if self._rows.cut and file.seekable():
                file.seek(-1, SEEK_END)
                if file.read(1) not in b"\r\n":
                    self.torn = "the file is torn: its last line ends within a row"
        self._rows.require(self.path)
        if self._columns is not None:
            yield from self._columns.finish()

    def _reader(self, table: TextTable, columns: Columns, shapes: Mapping[str, tuple[int, ...]]) -> Read:
        """Return the function that reads columns of a table, and those that are lists in one of its columns."""
        lists = {name: shape[0] for name, shape in shapes.items() if shape}

        def read(names: Sequence[str], fields: Fields) -> Float[np.ndarray, "n k"]:
            of = {columns.places[name][0] for name in names}
            if not of & lists.keys():
                return table.read(names, fields)
            read_one = {name: table.list_numbers(name, lists[name]) for name in of & lists.keys()}
            read_one |= {name: table.read([name], fields) for name in of - lists.keys()}
            return columns.taken(read_one, int(table.lines[0]) - 1, names, fields)

        return read if lists else table.read

    def notes(self) -> tuple[str, ...]:
        """Return notes on the rows read so far, one sentence each."""
        return tuple(dict.fromkeys((*self._rows.notes(), *super().notes())))


def _shapes(table: TextTable) -> dict[str, tuple[int, ...]]:
    """Return column -> (), or the shape of its lists."""
    return {**dict.fromkeys(table.names, ()), **table.lists()}


class TextFrames(HeldLog):
    """A log in a text with a frame in several lines, read at once."""

    def __init__(self, path: Path, layout: LogLayout) -> None:
        super().__init__({}, layout)
        self.path, self.size = path, path.stat().st_size

    @cached_property
    def _read(self) -> _Read:
        with open_input(self.path) as file:
            names = _long_names(self.path, read_some(file, self.path, _HEAD))
        return _of_blocks(self.path) if names is None else _of_table(read_table(self.path), names)

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
    lines = head.decode(errors="replace").splitlines() if b"\0" not in head else []
    breaks = sum(not line.strip() or line.lstrip()[0] not in "+-.0123456789Bb*nN" for line in lines)
    runs = [len(rows) for rows in _runs(lines)[1][:-1]] if breaks >= _FEWEST - 1 else []
    alike = max(Counter(runs).values(), default=0)
    return alike >= max(_FEWEST, _ALIKE * len(runs)) or _long_names(path, head) is not None


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


def _of_blocks(path: Path) -> _Read:
    """Read frames, NaN where one has another size than most, and their times, if something above them states any."""
    with open_input(path) as file:
        labels, runs = _runs(read_some(file, path, -1).decode(errors="replace").splitlines())
    split = [[re.split(r"[,;\s]+", re.sub(r"[Bb*]", "0", row.strip(" ,;\t"))) for row in run] for run in runs]
    sizes: list[tuple[int, ...]] = [(len(run), *{len(row) for row in run}) for run in split]
    size = Counter(sizes).most_common(1)[0][0]
    if len(size) > 2:
        raise InputError("has frames whose rows differ in length.", where=str(path), hint="Export it again.")
    last = len(runs) - (sizes[-1] != size)  # one that was cut
    frames = np.full((last, *size), np.nan)
    whole = [k for k in range(last) if sizes[k] == size]
    frames[whole] = np.array([split[k] for k in whole], dtype=np.float64)
    lines = [line.strip().partition(" ") for line in labels[0].splitlines()]
    facts = {key.upper(): value.strip() for key, _, value in lines}
    arrays = {"frames": frames, **_times(facts, labels[:last])}
    number, _, unit = facts.get("ROW_SPACING", "").partition(" ")
    pitch = positive(number) * UNITS.get(unit.strip(), 0.0) or None
    stated = Stated({"frames": facts["UNITS"]} if "UNITS" in facts else {}, pitch=pitch)
    rows, columns = frames.shape[1:]
    written = f"in frames of {rows} lines with {columns} numbers; B and *, where there is no cell, are read as 0"
    return arrays, stated, written


def _times(facts: Mapping[str, str], labels: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the times [s] of frames by the period that a text states, or by what stands above each; {} without."""
    step = positive(facts.get("SECONDS_PER_FRAME", "").partition(" ")[0])
    if step:
        numbers = [_NUMBERED.search(label) for label in labels]
        return {"time": step * np.array([int(match[1]) - 1 if match else k for k, match in enumerate(numbers)])}
    stated = [_TIME.findall(label)[-1:] for label in labels]
    return {"time": np.array(stated, dtype=np.float64)[:, 0]} if all(stated) else {}


def _long_names(path: Path, head: bytes) -> dict[str, str] | None:
    """Return the names of the columns of a table with one row a taxel: "id" or "row" and "column", "value", "time".

    None if it is no such table.
    """
    first = head.lstrip().partition(b"\n")[0]
    if not 2 < len(re.split(rb"[,;\t| ]+", first.strip())) < 7:  # names of two words, too
        return None
    try:
        names = find_dialect(head, path).names
    except InputError:
        return None
    bare = {split_unit(name)[0].strip().lower(): name for name in names}
    found = {"id": _IDS, "row": {"row", "r"}, "column": {"col", "column", "c"}, "value": _VALUES}
    roles = {role: [name for word, name in bare.items() if word in words] for role, words in found.items()}
    named = {role: each[0] for role, each in roles.items() if len(each) == 1}
    rest = [name for name in names if name not in named.values()]
    placed = named.keys() in ({"id", "value"}, {"row", "column", "value"})
    return {**named, "time": rest[0]} if placed and len(rest) == 1 else None


def _of_table(table: TextTable, names: Mapping[str, str]) -> _Read:
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
