"""Write and read contacts.csv in pieces, exact to the last bit; an edited file is checked row by row."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import polars as pl

from palpate.contact.contacts import Contacts
from palpate.contact.table import (
    COLUMNS,
    LABELS,
    NUMBERS,
    ORIGIN,
    WHOLE,
    assembled,
    features_of,
    from_frame,
    origins_of,
    pointless,
    schema,
)
from palpate.contact.table import to_frame as table_of
from palpate.errors import InputError
from palpate.files.tables.table import TextTable, read_table
from palpate.files.units import near

_PIECE = 1 << 23  # bytes of text parsed at a time


def header(added: tuple[str, ...]) -> bytes:
    """Return the first line of a contacts.csv, the names of its columns, as bytes with a newline."""
    return (",".join((*COLUMNS, *added)) + "\n").encode()


def to_csv(contacts: Contacts) -> bytes:
    """Return the rows of a contacts.csv, without the header; numbers read back exactly."""
    text = io.BytesIO()
    table_of(contacts).write_csv(text, include_header=False)
    return text.getvalue()


def csv_blocks(path: Path, *, torn: bool = False) -> Iterator[Contacts]:
    """Yield the rows of a contacts.csv in pieces, at least one; an edited file is read at once.

    If `torn`, a cut last line is omitted, with a note.

    Raises:
        InputError: the file cannot be read or is no contacts.csv, or a row in it is invalid.
    """
    done = 0
    try:
        with path.open("rb") as file:
            types = _types(file.readline())
            for rows in () if types is None else _pieces(file, torn, types):
                yield rows
                done += len(rows)
    except (pl.exceptions.PolarsError, ValueError, OSError):
        types = None
    if types is None:
        yield read_csv(path)[done:]


def read_csv(path: Path) -> Contacts:
    """Read a contacts.csv that may have been edited by hand, and check every row.

    Raises:
        InputError: the file cannot be read or is no contacts.csv, or a row in it is invalid.
    """
    table = read_table(path)
    require_columns(path, table.names)
    whole, _ = table.numbers(WHOLE, strict=True)
    odd = np.flatnonzero(~((whole == np.rint(whole)) & (np.abs(whole) < 2**53)).all(axis=1))  # NaN and infinite too
    if len(odd):
        table.refuse(int(odd[0]), "sample, contact and candidates must be whole numbers")
    sample, contact, candidates = whole.astype(np.int64).T
    numbers, _ = table.numbers(NUMBERS, strict=True)
    names = features_of(table.names)
    added = table.numbers(names, strict=True)[0] if names else np.empty((len(table), 0))
    features = {name: added[:, k].copy() for k, name in enumerate(names)}
    contacts = assembled(sample, contact, candidates, _statuses(table), numbers, features, table.notes)
    if set(ORIGIN) <= set(table.names):
        contacts = replace(contacts, origins=origins_of(*(table.strings(name) for name in ORIGIN)))
    if (row := pointless(contacts.estimate)) is not None:
        table.refuse(row, "has a status that needs a point, but has no point")
    return contacts


def require_columns(path: Path, names: list[str] | tuple[str, ...]) -> None:
    """Check that `names` has every column of a contacts.csv.

    Raises:
        InputError: one is missing.
    """
    if missing := [name for name in COLUMNS if name not in names]:
        what = f"is not a contacts.csv: there is no column {missing[0]!r}."
        raise InputError(what, where=str(path), hint="`palpate estimate` writes one.")


def noted(contacts: Contacts, note: str) -> Contacts:
    """Return the same rows with `note` in place of their notes, unless it is ""."""
    return replace(contacts, notes=(note,)) if note else contacts


def _types(line: bytes) -> dict[str, Any] | None:
    """Return the types of the columns that our header names; None for another header."""
    names = line.decode("utf-8", "replace").rstrip("\n").split(",")
    added = tuple(names[len(COLUMNS) :])
    ours = tuple(names[: len(COLUMNS)]) == COLUMNS and len(set(names)) == len(names)
    return schema(added) if ours and all(name.isidentifier() for name in added) else None


def _pieces(file: BinaryIO, torn: bool, types: dict[str, Any]) -> Iterator[Contacts]:
    """Yield the rows in pieces of about 8 MB, at least one."""
    while True:
        text = file.read(_PIECE) + file.readline()
        whole, end, rest = text.rpartition(b"\n") if torn else (text, b"", b"")
        yield noted(from_frame(_parsed(whole + end, types)), "the last line is cut and was left out" if rest else "")
        if len(text) < _PIECE:
            return


def _parsed(text: bytes, types: dict[str, Any]) -> pl.DataFrame:
    quote = '"' if set(ORIGIN) <= set(types) else None  # only names have any
    return pl.read_csv(text, has_header=False, schema=types, quote_char=quote) if text else pl.DataFrame(schema=types)


def _statuses(table: TextTable) -> np.ndarray:
    text = table.strings("status")
    codes = text.replace_strict(LABELS, range(len(LABELS)), default=None, return_dtype=pl.Int8)
    if codes.null_count():
        at = int(np.flatnonzero(codes.is_null().to_numpy())[0])
        table.refuse(at, f"unknown status {text[at]!r}", near(str(text[at]), LABELS))
    return codes.to_numpy().copy()
