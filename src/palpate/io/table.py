"""A delimited text file as named columns of text, every row of it accounted for."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.io.units import near

__all__ = ["Table", "read_table"]

_DELIMITERS = (b",", b";", b"\t")


@dataclass(frozen=True)
class Table:
    """The text of a file's columns; numbers are made on request, so that a bad field can be named.

    Attributes:
        path: the file.
        delimiter: one of comma, semicolon, tab.
        names: the column names, as the header gives them.
        lines: (n,) the line of the file that each row stands on, counted from 1.
        ragged: (n,) True where a row has more or fewer fields than the header.
        notes: what was met on the way.
    """

    path: Path
    delimiter: str
    names: tuple[str, ...]
    lines: Int[np.ndarray, " n"]
    ragged: Bool[np.ndarray, " n"]
    notes: tuple[str, ...]
    _text: bytes

    def __len__(self) -> int:
        return len(self.lines)

    def strings(self, name: str) -> pl.Series:
        """One column as text, stripped, null where empty."""
        self._require([name])
        return self._columns([name])[0]

    def numbers(self, names: Sequence[str]) -> tuple[Float[np.ndarray, "n k"], tuple[str, ...]]:
        """Columns as float64, NaN where a field is not a number or its row is ragged, and a note when there is one.

        Raises:
            InputError: a column is missing, or holds no number at all.
        """
        self._require(names)
        values = np.empty((len(self), len(names)))
        bad = self.ragged.copy()
        first = ""
        for k, (name, text) in enumerate(zip(names, self._columns(names), strict=True)):
            column = self._cast(text)
            unread = text.is_not_null().to_numpy() & np.isnan(column) & ~_says_nan(text)
            if len(self) and not self.ragged.all() and np.all(np.isnan(column)) and unread.any():
                at = int(np.flatnonzero(unread)[0])
                raise InputError(
                    f"no number in column {name!r}; line {self.lines[at]} has {text[at]!r}.", where=str(self.path)
                )
            if unread.any() and not first:
                at = int(np.flatnonzero(unread)[0])
                first = f" (first: line {self.lines[at]}, column {name!r}, {text[at]!r})"
            bad |= np.isnan(column)
            values[:, k] = column
        values[self.ragged] = np.nan
        return values, self._bad_note(bad, first)

    def _bad_note(self, bad: Bool[np.ndarray, " n"], first: str) -> tuple[str, ...]:
        if not bad.any():
            return ()
        if not first:
            first = f" (first: line {self.lines[int(np.flatnonzero(bad)[0])]})"
        return (f"{np.count_nonzero(bad)} of {len(self)} rows have a field that is missing or not a number{first}",)

    def _require(self, names: Sequence[str]) -> None:
        for name in names:
            if self.names.count(name) > 1:
                raise InputError(f"column {name!r} is there {self.names.count(name)} times.", where=str(self.path))
            if name not in self.names:
                raise InputError(f"there is no column {name!r}.", where=str(self.path), mend=near(name, self.names))

    def _columns(self, names: Sequence[str]) -> list[pl.Series]:
        indices = [self.names.index(name) for name in names]
        frame = _parse(self._text, self.delimiter, self.path, indices)[1:]
        if len(frame) != len(self):
            raise InputError("the quotes in this file are not balanced.", where=str(self.path))
        stripped = frame.with_columns(pl.all().str.strip_chars().replace("", None))
        order = {column: k for k, column in enumerate(sorted(set(indices)))}  # polars gives them in the file's order
        return [stripped.to_series(order[index]) for index in indices]

    def _cast(self, text: pl.Series) -> Float[np.ndarray, " n"]:
        if self.delimiter != ",":  # then a comma can only be a decimal point
            text = text.str.replace(",", ".", literal=True)
        return text.cast(pl.Float64, strict=False).fill_null(float("nan")).to_numpy().copy()


def read_table(path: Path) -> Table:
    """Read a comma, semicolon or tab separated file whose first line names the columns.

    Raises:
        InputError: the file is not there, not text, empty, or has no header.
    """
    raw = _read_bytes(path)
    lines = raw.split(b"\n", 1)
    delimiter = max(_DELIMITERS, key=lines[0].count)
    if delimiter not in lines[0]:
        raise InputError("found one column only.", where=str(path), mend="Separate columns by , or ; or tab.")
    names = tuple((name or "").strip() for name in _parse(lines[0], delimiter.decode(), path, None).row(0))
    if all(re.fullmatch(r"[-+\d.eE]+|nan|inf", name.lower()) for name in names):
        raise InputError("the first line holds numbers.", where=str(path), mend="It must name the columns.")
    if len(lines) == 1:
        raise InputError("there is a header, but no rows.", where=str(path))
    raw, numbers, fields = _drop_blank_lines(raw, delimiter)
    ragged = fields != len(names)
    if b'"' in raw:  # a delimiter may then stand inside quotes: fields cannot be counted this way
        quoted = _parse(raw, delimiter.decode(), path, [0])
        numbers, ragged = np.arange(1, len(quoted) + 1), np.zeros(len(quoted), dtype=bool)
    if ragged[1:].all():
        raise InputError(
            f"no row has the {len(names)} fields of the header; line {numbers[1]} has {fields[1]}.",
            where=str(path),
            mend="Is the decimal point a comma?" if delimiter == b"," else "",
        )
    notes = ()
    if ragged.any():
        at = int(np.flatnonzero(ragged)[0])
        notes = (f"{np.count_nonzero(ragged)} rows do not have {len(names)} fields (first: line {numbers[at]})",)
    return Table(path, delimiter.decode(), names, numbers[1:], ragged[1:], notes, raw)


def _read_bytes(path: Path) -> bytes:
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        siblings = [other.name for other in path.parent.glob("*")] if path.parent.is_dir() else []
        raise InputError("there is no such file.", where=str(path), mend=near(path.name, siblings)) from None
    except OSError as problem:
        raise InputError(f"cannot be read ({problem.strerror}).", where=str(path)) from problem
    raw = raw.removeprefix(b"\xef\xbb\xbf")
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError("is UTF-16 text.", where=str(path), mend="Save it as UTF-8.")
    if b"\0" in raw[:4096]:
        raise InputError("is not a text file.", where=str(path), mend="A log is a CSV file here.")
    if b"\n" not in raw:
        raw = raw.replace(b"\r", b"\n")
    raw = raw.strip(b"\r\n ")
    if not raw:
        raise InputError("the file is empty.", where=str(path))
    return raw


def _drop_blank_lines(raw: bytes, delimiter: bytes) -> tuple[bytes, Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """The text without blank lines, the number of each line left, and its count of fields."""
    text = np.frombuffer(raw, dtype=np.uint8)
    ends = np.append(np.flatnonzero(text == ord("\n")), len(text))
    marks = np.flatnonzero(text == ord(delimiter))
    fields = np.diff(np.searchsorted(marks, ends), prepend=0) + 1
    numbers = np.arange(1, len(ends) + 1)
    starts = np.append(0, ends[:-1] + 1)
    blank = [k for k in np.flatnonzero(fields == 1) if not raw[starts[k] : ends[k]].strip()]
    if blank:
        drop = set(blank)
        raw = b"\n".join(line for k, line in enumerate(raw.split(b"\n")) if k not in drop)
        numbers, fields = np.delete(numbers, blank), np.delete(fields, blank)
    return raw, numbers, fields


def _parse(text: bytes, delimiter: str, path: Path, columns: list[int] | None) -> pl.DataFrame:
    try:
        return pl.read_csv(
            io.BytesIO(text),
            separator=delimiter,
            has_header=False,
            infer_schema=False,
            truncate_ragged_lines=True,
            encoding="utf8-lossy",
            columns=sorted(set(columns)) if columns is not None else None,
        )
    except pl.exceptions.PolarsError as problem:
        raise InputError(f"is not a table ({str(problem).splitlines()[0]}).", where=str(path)) from problem


def _says_nan(text: pl.Series) -> Bool[np.ndarray, " n"]:
    return text.str.to_lowercase().is_in(["nan", "-nan", "+nan", "null", "none"]).fill_null(value=False).to_numpy()
