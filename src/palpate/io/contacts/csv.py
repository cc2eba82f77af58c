"""contacts.csv: written and read in pieces, to the last bit; one that somebody edited is read with care."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import polars as pl

from palpate.errors import InputError
from palpate.io.contacts.rows import (
    CELL,
    COLUMNS,
    LABELS,
    NUMBERS,
    SKIN_TYPES,
    TYPES,
    WHOLE,
    Contacts,
    assembled,
    from_frame,
    noted,
    pointless,
    require_columns,
    to_frame,
)
from palpate.io.tables.table import Table, read_table
from palpate.io.units import near

__all__ = ["HEADER", "SKIN_HEADER", "csv_blocks", "read_csv", "to_csv"]

HEADER = (",".join(COLUMNS) + "\n").encode()
SKIN_HEADER = (",".join((*COLUMNS, *CELL)) + "\n").encode()
_SCHEMAS = {HEADER: TYPES, SKIN_HEADER: SKIN_TYPES}
_PIECE = 1 << 23  # bytes of text parsed at a time


def to_csv(contacts: Contacts) -> bytes:
    """Rows of a contacts.csv, without its header; numbers read back the same to the last bit."""
    text = io.BytesIO()
    to_frame(contacts).write_csv(text, include_header=False)
    return text.getvalue()


def csv_blocks(path: Path, *, torn: bool = False) -> Iterator[Contacts]:
    """The rows of a contacts.csv in pieces, at least one; where it is not as it was written, all at once by `read_csv`.

    Args:
        path: of the file.
        torn: the last line may be cut; it is left out, and noted.
    """
    done = 0
    try:
        with path.open("rb") as file:
            schema = _SCHEMAS.get(file.readline())
            plain = schema is not None
            for rows in () if schema is None else _pieces(file, torn, schema):
                yield rows
                done += len(rows)
    except (pl.exceptions.PolarsError, ValueError, OSError):
        plain = False
    if not plain:
        yield read_csv(path)[done:]


def read_csv(path: Path) -> Contacts:
    """Read a contacts.csv that somebody may have edited, and say what is wrong with it.

    Raises:
        InputError: not a contacts.csv, a status that there is none of, a field that is no number, or an answered row
            without a point.
    """
    table = read_table(path)
    require_columns(path, table.names)
    whole, _ = table.numbers(WHOLE, strict=True)
    odd = np.flatnonzero(~((whole == np.rint(whole)) & (np.abs(whole) < 2**53)).all(axis=1))  # NaN and infinite too
    if len(odd):
        table.refuse(int(odd[0]), "sample, contact and candidates must be whole numbers")
    sample, contact, candidates = whole.astype(np.int64).T
    numbers, _ = table.numbers(NUMBERS, strict=True)
    cell = table.numbers(CELL, strict=True)[0] if set(CELL) <= set(table.names) else None
    contacts = assembled(sample, contact, candidates, _statuses(table), numbers, table.notes, cell)
    if (row := pointless(contacts.estimate)) is not None:
        table.refuse(row, "is answered, but has no point")
    return contacts


def _pieces(file: BinaryIO, torn: bool, schema: dict[str, Any]) -> Iterator[Contacts]:
    """At least one."""
    while True:
        text = file.read(_PIECE) + file.readline()
        whole, end, rest = text.rpartition(b"\n") if torn else (text, b"", b"")
        yield noted(from_frame(_parsed(whole + end, schema)), "the last line is cut and was left out" if rest else "")
        if len(text) < _PIECE:
            return


def _parsed(text: bytes, schema: dict[str, Any]) -> pl.DataFrame:
    """Lines of text whose columns are those of a header of ours, strictly."""
    return pl.read_csv(text, has_header=False, schema=schema, quote_char=None) if text else pl.DataFrame(schema=schema)


def _statuses(table: Table) -> np.ndarray:
    text = table.strings("status")
    codes = text.replace_strict(LABELS, range(len(LABELS)), default=None, return_dtype=pl.Int8)
    if codes.null_count():
        at = int(np.flatnonzero(codes.is_null().to_numpy())[0])
        raise InputError(
            f"unknown status {text[at]!r}.",
            where=f"{table.path}, line {table.lines[at]}",
            mend=near(str(text[at]), LABELS),
        )
    return codes.to_numpy().copy()
