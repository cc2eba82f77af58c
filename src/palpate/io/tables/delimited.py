"""Delimited text taken apart: a line is a row, whatever its quotes say."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Bool, Int

from palpate.errors import InputError

__all__ = ["parse", "says_nan", "split", "unquoted"]

_INSIDE = b"\x1f"  # stands for a delimiter inside quotes, so that every line parses on its own


def split(raw: bytes, delimiter: bytes) -> tuple[bytes, Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
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


def unquoted(text: pl.Expr, delimiter: str) -> pl.Expr:
    """Without quotes and space around it, and with what the quotes protected."""
    bare = text.str.strip_chars().str.strip_prefix('"').str.strip_suffix('"').str.strip_chars()
    return bare.str.replace_all('""', '"', literal=True).str.replace_all(_INSIDE.decode(), delimiter, literal=True)


def parse(
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


def says_nan(text: pl.Series) -> Bool[np.ndarray, " n"]:
    """Where a field says that there is no number."""
    return text.str.to_lowercase().is_in(["nan", "-nan", "+nan", "null", "none"]).fill_null(value=False).to_numpy()
