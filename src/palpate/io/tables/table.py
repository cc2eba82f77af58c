"""A delimited text file as named columns of text, every row of it accounted for: whole, or in pieces."""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import BinaryIO, NoReturn

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.io.tables.fields import Fields, Rows
from palpate.io.tables.lines import open_input, whole_lines
from palpate.io.units import near

__all__ = ["Table", "read_table", "tables"]

_DELIMITERS = (b",", b";", b"\t")
_MOST = 20_000  # columns, of a sheet of 128 x 128 cells: more are rows whose ends were lost
_INSIDE = b"\x1f"  # stands for a delimiter inside quotes, so that every line parses on its own


@dataclass(frozen=True)
class Table:
    """The text of some rows of a file; numbers are made on request, so that a bad field can be named.

    Attributes:
        path: the file.
        delimiter: one of comma, semicolon, tab.
        names: the column names, as the header gives them.
        lines: (n,) the line of the file that each row stands on, counted from 1.
        fields: (n,) how many fields each row has; -1 where a quote is not closed.
    """

    path: Path
    delimiter: str
    names: tuple[str, ...]
    lines: Int[np.ndarray, " n"]
    fields: Int[np.ndarray, " n"]
    _text: bytes

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def ragged(self) -> Bool[np.ndarray, " n"]:
        """True where a row has more or fewer fields than the header, or a quote that is not closed."""
        return self.fields != len(self.names)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was met on the way."""
        return self.counted(Rows()).notes()

    def counted(self, rows: Rows) -> Rows:
        """Add these rows to an account of them."""
        rows.add(self.lines, self.fields, len(self.names), self.delimiter)
        return rows

    def strings(self, name: str) -> pl.Series:
        """One column as text, stripped, null where empty."""
        self.require([name])
        return self._strings([name])[0]

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
        fields = Fields()
        values = self.read(names, fields)
        fields.require_numbers(self.path)
        if strict and fields.unread:
            name, (place, text) = next(iter(fields.unread.items()))
            raise InputError(f"{text!r} in column {name!r} is not a number.", where=f"{self.path}, {place}")
        return values, fields.notes()

    def read(self, names: Sequence[str], fields: Fields) -> Float[np.ndarray, "n k"]:
        """Columns as float64, NaN where there is no number, of which `fields` keeps account.

        Raises:
            InputError: a column is missing.
        """
        self.require(names)
        parsed = self._parse(names, numbers=True)
        unclear = [name for name, column in zip(names, parsed, strict=True) if column.null_count()]
        texts = dict(zip(unclear, self._strings(unclear), strict=True))
        values = np.empty((len(self), len(names)))
        for k, name in enumerate(names):
            values[:, k] = self._cast(texts[name]) if name in texts else parsed[k].to_numpy()
            fields.see(name, values[:, k])
            if name in texts and name not in fields.unread:
                self._find_unread(name, texts[name], values[:, k], fields)
        values[self.ragged] = np.nan
        fields.count(values, self._line)
        return values

    def refuse(self, row: int, what: str) -> NoReturn:
        """Raise an InputError that names the line of a row."""
        raise InputError(f"{what}.", where=f"{self.path}, {self._line(row)}")

    def require(self, names: Sequence[str]) -> None:
        """Raise an InputError unless each of these columns is there, once."""
        there = Counter(self.names)
        for name in names:
            if there[name] > 1:
                raise InputError(f"column {name!r} is there {there[name]} times.", where=str(self.path))
            if not there[name]:
                raise InputError(f"there is no column {name!r}.", where=str(self.path), hint=near(name, self.names))

    def _line(self, row: int) -> str:
        return f"line {self.lines[row]}"

    def _find_unread(self, name: str, text: pl.Series, values: Float[np.ndarray, " n"], fields: Fields) -> None:
        unread = text.is_not_null().to_numpy() & np.isnan(values) & ~_says_nan(text)
        if unread.any():
            at = int(np.argmax(unread))
            fields.unread[name] = self._line(at), text[at]

    def _strings(self, names: Sequence[str]) -> list[pl.Series]:
        parsed = self._parse(names, numbers=False)
        return [
            column.to_frame("").select(_unquoted(pl.all(), self.delimiter).replace("", None)).to_series()
            for column in parsed
        ]

    def _parse(self, names: Sequence[str], *, numbers: bool) -> list[pl.Series]:
        at = {name: k for k, name in enumerate(self.names)}
        indices = [at[name] for name in names]
        frame = _frame(self._text, self.delimiter, self.path, len(self.names), indices, numbers=numbers)
        return [frame[f"c{index}"] for index in indices]

    def _cast(self, text: pl.Series) -> Float[np.ndarray, " n"]:
        if self.delimiter != ",":  # then a comma can only be a decimal point
            text = text.str.replace(",", ".", literal=True)
        return text.cast(pl.Float64, strict=False).fill_null(float("nan")).to_numpy().copy()


def read_table(path: Path) -> Table:
    """Read a comma, semicolon or tab separated file whose first line names the columns.

    Raises:
        InputError: the file is not there, not text, empty, or has no header or no row that fits it.
    """
    with open_input(path) as file:
        whole = next(tables(file, path, -1))
    whole.counted(Rows()).require(path)
    return whole


def tables(file: BinaryIO, path: Path, size: int) -> Iterator[Table]:
    """The rows of an opened file in pieces of about `size` bytes; the first may be without rows.

    Raises:
        InputError: it is not text, empty, or has no header.
    """
    pieces, before = whole_lines(file, path, size), 0
    for text in pieces:
        if header := text.lstrip(b"\n\r ").split(b"\n", 1)[0]:
            break
        before += text.count(b"\n") + 1
    else:
        raise InputError("the file is empty.", where=str(path))
    delimiter, names = _delimiter(header, path), ()
    for piece in chain([text], pieces):
        raw, numbers, fields = _split(piece, delimiter)
        numbers += before
        before += piece.count(b"\n") + 1
        if not names:
            if fields[0] < 0:
                raise InputError("a quote is not closed in the header.", where=f"{path}, line {numbers[0]}")
            header, _, raw = raw.partition(b"\n")
            names = _names(header, delimiter.decode(), path, int(fields[0]))
            numbers, fields = numbers[1:], fields[1:]
        yield Table(path, delimiter.decode(), names, numbers, fields, raw)


def _delimiter(header: bytes, path: Path) -> bytes:
    bare = re.sub(rb'"[^"]*"', b"", header)
    delimiter = max(_DELIMITERS, key=bare.count)
    if delimiter not in bare:
        raise InputError("found one column only.", where=str(path), hint="Separate columns by , or ; or tab.")
    return delimiter


def _names(header: bytes, delimiter: str, path: Path, count: int) -> tuple[str, ...]:
    if count > _MOST:
        raise InputError(f"the first line has {count:,} fields.", where=str(path), hint="It must name the columns.")
    parsed = _frame(header, delimiter, path, count, range(count), numbers=False)
    names = parsed.select(_unquoted(pl.all(), delimiter).fill_null("")).row(0)
    if all(re.fullmatch(r"[-+\d.eE]+|nan|inf", name.lower()) for name in names):
        raise InputError("the first line holds numbers.", where=str(path), hint="It must name the columns.")
    return names


def _split(raw: bytes, delimiter: bytes) -> tuple[bytes, Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
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
    """Without quotes and space around it, and with what the quotes protected."""
    bare = text.str.strip_chars().str.strip_prefix('"').str.strip_suffix('"').str.strip_chars()
    return bare.str.replace_all('""', '"', literal=True).str.replace_all(_INSIDE.decode(), delimiter, literal=True)


def _frame(
    text: bytes, delimiter: str, path: Path, count: int, columns: Sequence[int], *, numbers: bool
) -> pl.DataFrame:
    """Columns c0, c1, ... of text without a header; null where a field is empty or not of this kind."""
    names = [f"c{k}" for k in range(count)]
    try:
        return pl.read_csv(
            io.BytesIO(delimiter.join(names).encode() + b"\n" + text),  # polars takes the width from the first line
            separator=delimiter,
            quote_char=None,
            schema={name: pl.Float64 if numbers else pl.String for name in names},
            ignore_errors=True,
            truncate_ragged_lines=True,
            encoding="utf8-lossy",
            columns=[names[k] for k in sorted(set(columns))],
        )
    except pl.exceptions.PolarsError as problem:
        raise InputError(f"is not a table ({str(problem).splitlines()[0]}).", where=str(path)) from problem


def _says_nan(text: pl.Series) -> Bool[np.ndarray, " n"]:
    """Where a field says that there is no number."""
    return text.str.to_lowercase().is_in(["nan", "-nan", "+nan", "null", "none"]).fill_null(value=False).to_numpy()
