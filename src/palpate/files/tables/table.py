"""Read a delimited text file as named columns, at once or in pieces, with every row accounted for."""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import BinaryIO, NoReturn

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int, UInt8

from palpate.errors import InputError
from palpate.files.inputs import complete_lines, open_input
from palpate.files.tables.dialect import COMMENTS, LOOKED_AT, SPACES, Dialect, find_dialect, spaces_to_tabs
from palpate.files.tables.fields import Fields, RowCount
from palpate.files.tables.stamps import seconds
from palpate.files.units import near
from palpate.processes import require_polars_threads
from palpate.spatial.arguments import frozen_value

_COMMENTS = tuple(mark.encode() for mark in COMMENTS)
_MARKS = frozenset(mark[0] for mark in _COMMENTS)
_LISTED = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|nan|NaN|null|None")
_INSIDE = b"\x1f"  # stands for a delimiter inside quotes, so that every line parses on its own


@frozen_value(eq=True)
class TextTable:
    """The text of some rows of a file.

    Attributes:
        path: of the file.
        dialect: format of the text.
        lines: (n,) line number of each row in the file, counted from 1.
        fields: (n,) number of fields of each row; -1 where a quote is not closed.
    """

    path: Path
    dialect: Dialect
    lines: Int[np.ndarray, " n"]
    fields: Int[np.ndarray, " n"]
    _text: bytes

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, from the header."""
        return self.dialect.names

    @property
    def delimiter(self) -> str:
        """Character between the fields of the stored text: a tab in place of spaces."""
        return "\t" if self.dialect.delimiter == SPACES else self.dialect.delimiter

    @property
    def ragged(self) -> Bool[np.ndarray, " n"]:
        """(n,) True where a row has other fields than the header, or an open quote."""
        return self.fields != len(self.names)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on ragged rows, one sentence each."""
        return self.counted(RowCount()).notes()

    def counted(self, rows: RowCount) -> RowCount:
        """Add these rows to `rows`, and return that."""
        rows.add(self.lines, self.fields, len(self.names), self.delimiter)
        return rows

    def strings(self, name: str) -> pl.Series:
        """Return one column as a polars Series (n,) of text, stripped, null where empty.

        Raises:
            InputError: the column is missing or occurs more than once.
        """
        self.require([name])
        return self._strings([name])[0]

    def numbers(
        self, names: Sequence[str], *, strict: bool = False
    ) -> tuple[Float[np.ndarray, "n k"], tuple[str, ...]]:
        """Return columns (n, k), NaN where a field is no number or its row is ragged; and a tuple of notes.

        Args:
            names: of the columns.
            strict: refuse a ragged row, and a field that is neither a number nor empty nor nan.

        Raises:
            InputError: a column is missing, occurs more than once or has text but no number; or `strict` refuses a row.
        """
        if strict and self.ragged.any():
            what = f"does not have {len(self.names)} fields, or a quote is not closed"
            self.refuse(int(np.argmax(self.ragged)), what)
        fields = Fields()
        values = self.read(names, fields)
        fields.require_numbers(self.path)
        if strict and fields.unread:
            name, (place, text) = next(iter(fields.unread.items()))
            raise InputError(f"{text!r} in column {name!r} is not a number.", where=f"{self.path}, {place}")
        return values, fields.notes()

    def read(self, names: Sequence[str], fields: Fields) -> Float[np.ndarray, "n k"]:
        """Return columns (n, k), NaN where there is no number, and count the rows in `fields`.

        Raises:
            InputError: a column is missing or occurs more than once.
        """
        self.require(names)
        parsed = self._parse(names, numbers=True)
        unclear = [name for name, column in zip(names, parsed, strict=True) if column.null_count()]
        texts = dict(zip(unclear, self._strings(unclear), strict=True))
        values = np.empty((len(self), len(names)))
        for k, name in enumerate(names):
            values[:, k] = self._cast(name, texts[name], fields) if name in texts else parsed[k].to_numpy()
            fields.see(name, values[:, k])
            if name in texts and name not in fields.unread:
                self._find_unread(name, texts[name], values[:, k], fields)
        values[self.ragged] = np.nan
        fields.count(values, self._line)
        return values

    def lists(self) -> dict[str, tuple[int]]:
        """Return the columns whose first field is a list of numbers in brackets, with the shape of the list."""
        if b"[" not in self._text.partition(b"\n")[0]:
            return {}
        first = {name: str(self.strings(name)[0]) for name in self.names if self.names.count(name) == 1}
        return {name: (len(_LISTED.findall(text)),) for name, text in first.items() if text.startswith("[")}

    def list_numbers(self, name: str, count: int) -> Float[np.ndarray, "n k"]:
        """Return the lists of a column (n, count), NaN where a row has another count or is ragged.

        Raises:
            InputError: the column is missing or occurs more than once.
        """
        found = self.strings(name).str.extract_all(_LISTED.pattern)
        values, whole = np.full((len(self), count), np.nan), (found.list.len() == count).fill_null(value=False)
        numbers = found.filter(whole).explode().cast(pl.Float64, strict=False).fill_null(float("nan"))
        values[whole.to_numpy()] = numbers.to_numpy().reshape(-1, count)
        values[self.ragged] = np.nan
        return values

    def refuse(self, row: int, what: str, hint: str = "") -> NoReturn:
        """Raise an error on the row of an index: `what`, without a full stop, and a hint.

        Raises:
            InputError: always; it names the line.
        """
        raise InputError(f"{what}.", where=f"{self.path}, {self._line(row)}", hint=hint)

    def require(self, names: Sequence[str]) -> None:
        """Check that each of these columns exists exactly once.

        Raises:
            InputError: one does not.
        """
        there = Counter(self.names)
        for name in names:
            if there[name] > 1:
                what = f"column {name!r} occurs {there[name]} times."
                raise InputError(what, where=str(self.path), hint="Give each column its own name.")
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
        bare = _unquoted(pl.all(), self.delimiter).replace("", None)
        return [column.to_frame("").select(bare).to_series() for column in self._parse(names, numbers=False)]

    def _parse(self, names: Sequence[str], *, numbers: bool) -> list[pl.Series]:
        at = {name: k for k, name in enumerate(self.names)}
        indices = [at[name] for name in names]
        frame = _frame(self._text, self.delimiter, self.path, len(self.names), indices, numbers=numbers)
        return [frame[f"c{index}"] for index in indices]

    def _cast(self, name: str, text: pl.Series, fields: Fields) -> Float[np.ndarray, " n"]:
        if self.dialect.decimal == ",":
            text = text.str.replace(",", ".", literal=True)
        numbers = text.cast(pl.Float64, strict=False)
        if len(numbers) and numbers.null_count() == len(numbers):  # may be a clock's
            numbers = seconds(text)
            if numbers.null_count() < len(numbers):
                fields.stamped.add(name)
        return numbers.fill_null(float("nan")).to_numpy().copy()


def read_table(path: Path) -> TextTable:
    """Read a complete delimited text file, whose dialect is found.

    Raises:
        InputError: the file cannot be read, is not text, is empty, or has no header or no row that fits it.
    """
    with open_input(path) as file:
        whole = next(tables(file, path, -1))
    whole.counted(RowCount()).require(path)
    return whole


def tables(file: BinaryIO, path: Path, size: int) -> Iterator[TextTable]:
    """Yield the rows of an open file as a `TextTable` for each `size` bytes (-1: one); the first may have no rows.

    Raises:
        InputError: the file cannot be read, is not text or is XML or HTML, is empty, has no header or one column only,
            has too many columns or too long a line, an open quote in its header, or marks between thousands.
    """
    pieces, before, ahead = complete_lines(file, path, size), 0, list[bytes]()
    for text in pieces:  # until there is something, and enough of it to tell how it is written
        if ahead or re.search(rb"[^\n\r ]", text):
            ahead.append(text)
        else:
            before += text.count(b"\n") + 1
        if sum(map(len, ahead)) >= LOOKED_AT:
            break
    dialect = find_dialect(ahead[0] if len(ahead) == 1 else b"\n".join(ahead), path)
    delimiter, skipped = (b"\t" if dialect.delimiter == SPACES else dialect.delimiter.encode()), dialect.first
    for piece in chain(ahead, pieces):
        start = 0
        while skipped and start <= len(piece):
            start, skipped = (piece.find(b"\n", start) + 1 or len(piece) + 1), skipped - 1
            before += 1
        raw = piece[start:] if start else piece
        if dialect.delimiter == SPACES:
            raw = spaces_to_tabs(raw)
        if start > len(piece):
            yield TextTable(path, dialect, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), b"")
            continue
        raw, numbers, fields = _split(raw, delimiter)
        numbers += before
        before += piece.count(b"\n", start) + 1
        yield TextTable(path, dialect, numbers, fields, raw)


def _split(raw: bytes, delimiter: bytes) -> tuple[bytes, Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Drop blank lines and comments; return text, line numbers and field counts (-1: an open quote)."""
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
    blank += [k for k in _marked(text, starts) if raw[starts[k] : ends[k]].startswith(_COMMENTS)]
    if blank:
        drop = set(blank)
        raw = b"\n".join(line for k, line in enumerate(raw.split(b"\n")) if k not in drop)
    fields[unclosed] = -1
    return raw, np.delete(np.arange(1, len(ends) + 1), blank), np.delete(fields, blank)


def _marked(text: UInt8[np.ndarray, " size"], starts: Int[np.ndarray, " n"]) -> Int[np.ndarray, " k"]:
    """Return the lines that may be comments, by their first byte."""
    if not len(text):
        return np.zeros(0, dtype=np.int64)
    first = text.take(starts, mode="clip")
    return np.flatnonzero(np.logical_or.reduce([first == mark for mark in _MARKS]))


def _unquoted(text: pl.Expr, delimiter: str) -> pl.Expr:
    """Remove quotes and spaces around a text, and restore delimiters inside it."""
    bare = text.str.strip_chars().str.strip_prefix('"').str.strip_suffix('"').str.strip_chars()
    return bare.str.replace_all('""', '"', literal=True).str.replace_all(_INSIDE.decode(), delimiter, literal=True)


def _frame(
    text: bytes, delimiter: str, path: Path, count: int, columns: Sequence[int], *, numbers: bool
) -> pl.DataFrame:
    """Parse text as columns c0, c1, ...; null where a field cannot be converted."""
    require_polars_threads()
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
    return text.str.to_lowercase().is_in(["nan", "-nan", "+nan", "null", "none"]).fill_null(value=False).to_numpy()
