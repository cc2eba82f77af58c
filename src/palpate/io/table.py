"""A delimited text file as named columns of text, every row of it accounted for."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.io.units import near

__all__ = ["Table", "read_table"]

_DELIMITERS = (b",", b";", b"\t")
_INSIDE = b"\x1f"  # stands for a delimiter inside quotes, so that every line parses on its own


@dataclass(frozen=True)
class Table:
    """The text of a file's columns; numbers are made on request, so that a bad field can be named.

    Attributes:
        path: the file.
        delimiter: one of comma, semicolon, tab.
        names: the column names, as the header gives them.
        lines: (n,) the line of the file that each row stands on, counted from 1.
        ragged: (n,) True where a row has more or fewer fields than the header, or a quote that is not closed.
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

    def numbers(
        self, names: Sequence[str], *, strict: bool = False
    ) -> tuple[Float[np.ndarray, "n k"], tuple[str, ...]]:
        """Columns as float64, NaN where a field is not a number or its row is ragged, and a note when there is one.

        Args:
            names: of the columns.
            strict: refuse a ragged row and a field that is no number, unless it is empty or says nan.

        Raises:
            InputError: a column is missing, or holds no number at all, or `strict` finds a row.
        """
        if strict and self.ragged.any():
            self.refuse(
                int(np.argmax(self.ragged)), f"does not have {len(self.names)} fields, or a quote is not closed"
            )
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
                if strict:
                    self.refuse(at, f"{text[at]!r} in column {name!r} is not a number")
                first = f" (first: line {self.lines[at]}, column {name!r}, {text[at]!r})"
            bad |= np.isnan(column)
            values[:, k] = column
        values[self.ragged] = np.nan
        return values, self._bad_note(bad, first)

    def refuse(self, row: int, what: str) -> NoReturn:
        """Raise an InputError that names the line of a row."""
        raise InputError(f"{what}.", where=f"{self.path}, line {self.lines[row]}")

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
        stripped = frame.with_columns(_unquoted(pl.all(), self.delimiter).replace("", None))
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
    header = raw.lstrip(b"\n\r ").split(b"\n", 1)[0]
    bare = re.sub(rb'"[^"]*"', b"", header)
    delimiter = max(_DELIMITERS, key=bare.count)
    if delimiter not in bare:
        raise InputError("found one column only.", where=str(path), mend="Separate columns by , or ; or tab.")
    raw, numbers, fields = _lines(raw, delimiter)
    if fields[0] < 0:
        raise InputError("a quote is not closed in the header.", where=f"{path}, line {numbers[0]}")
    first = _parse(raw.split(b"\n", 1)[0], delimiter.decode(), path, None)
    names = first.select(_unquoted(pl.all(), delimiter.decode()).fill_null("")).row(0)
    if all(re.fullmatch(r"[-+\d.eE]+|nan|inf", name.lower()) for name in names):
        raise InputError("the first line holds numbers.", where=str(path), mend="It must name the columns.")
    if len(numbers) == 1:
        raise InputError("there is a header, but no rows.", where=str(path))
    ragged = fields != len(names)
    if ragged[1:].all():
        found = str(fields[1]) if fields[1] >= 0 else "a quote that is not closed"
        raise InputError(
            f"no row has the {len(names)} fields of the header; line {numbers[1]} has {found}.",
            where=str(path),
            mend="Is the decimal point a comma?" if delimiter == b"," else "",
        )
    notes: tuple[str, ...] = ()
    for rows, what in (
        (fields < 0, "have a quote that is not closed"),
        (ragged & (fields > 0), f"do not have {len(names)} fields"),
    ):
        if rows.any():
            at = int(np.flatnonzero(rows)[0])
            notes += (f"{np.count_nonzero(rows)} rows {what} (first: line {numbers[at]})",)
    return Table(path, delimiter.decode(), names, numbers[1:], ragged[1:], notes, raw)


def _read_bytes(path: Path) -> bytes:
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        siblings = [other.name for other in path.parent.glob("*")] if path.parent.is_dir() else []
        raise InputError("there is no such file.", where=str(path), mend=near(path.name, siblings)) from None
    except (OSError, ValueError) as problem:  # the second: a NUL in the name
        raise InputError(f"cannot be read ({problem}).", where=str(path)) from problem
    raw = raw.removeprefix(b"\xef\xbb\xbf")
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError("is UTF-16 text.", where=str(path), mend="Save it as UTF-8.")
    if b"\0" in raw[:4096]:
        raise InputError("is not a text file.", where=str(path), mend="A log is a CSV file here.")
    if b"\n" not in raw:
        raw = raw.replace(b"\r", b"\n")
    raw = raw.rstrip(b"\r\n ")
    if not raw:
        raise InputError("the file is empty.", where=str(path))
    return raw


def _lines(raw: bytes, delimiter: bytes) -> tuple[bytes, Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """The text without blank lines and with `_INSIDE` for delimiters inside quotes; each line's number and fields.

    A line is a row, whatever its quotes say: where one is not closed, the count of fields is -1.
    """
    text = np.frombuffer(raw, dtype=np.uint8)
    ends = np.append(np.flatnonzero(text == ord("\n")), len(text))
    starts = np.append(0, ends[:-1] + 1)
    marks = np.flatnonzero(text == ord(delimiter))
    unclosed = np.zeros(len(ends), dtype=bool)
    if b'"' in raw:
        quotes = np.flatnonzero(text == ord('"'))
        before = np.searchsorted(quotes, starts)
        unclosed = np.diff(before, append=len(quotes)) % 2 == 1
        inside = (np.searchsorted(quotes, marks) - before[np.searchsorted(ends, marks)]) % 2 == 1
        text = text.copy()
        text[marks[inside]] = ord(_INSIDE)
        raw, marks = text.tobytes(), marks[~inside]
    fields = np.diff(np.searchsorted(marks, ends), prepend=0) + 1
    blank = [k for k in np.flatnonzero(fields == 1) if not raw[starts[k] : ends[k]].strip()]
    if blank:
        drop = set(blank)
        raw = b"\n".join(line for k, line in enumerate(raw.split(b"\n")) if k not in drop)
    fields[unclosed] = -1
    return raw, np.delete(np.arange(1, len(ends) + 1), blank), np.delete(fields, blank)


def _unquoted(text: pl.Expr, delimiter: str) -> pl.Expr:
    bare = text.str.strip_chars().str.strip_prefix('"').str.strip_suffix('"').str.strip_chars()
    return bare.str.replace_all('""', '"', literal=True).str.replace_all(_INSIDE.decode(), delimiter, literal=True)


def _parse(text: bytes, delimiter: str, path: Path, columns: list[int] | None) -> pl.DataFrame:
    try:
        return pl.read_csv(
            io.BytesIO(text),
            separator=delimiter,
            quote_char=None,
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
