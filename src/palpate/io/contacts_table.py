"""Contacts as the rows of a table: the columns that every format has, as CSV and as Parquet."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from palpate.contact.estimate import ContactEstimate, Status
from palpate.errors import InputError
from palpate.io.table import Table, read_table
from palpate.io.units import near

__all__ = [
    "COLUMNS",
    "TYPES",
    "Contacts",
    "csv_blocks",
    "from_frame",
    "noted",
    "parquet_blocks",
    "read_csv",
    "to_csv",
    "to_frame",
]

_WHOLE = ("sample", "contact", "candidates")
_VECTORS = ("px", "py", "pz", "nx", "ny", "nz", "fx", "fy", "fz", "torque")
_VARIANCES = ("var_xx", "var_xy", "var_xz", "var_yy", "var_yz", "var_zz")
COLUMNS = ("sample", "time", "contact", "status", *_VECTORS, *_VARIANCES, "candidates")
_UPPER = np.triu_indices(3)
_LABELS = [status.label for status in Status]  # at the place of their code
TYPES: dict[str, Any] = {name: pl.Int64 if name in _WHOLE else pl.Float64 for name in COLUMNS} | {"status": pl.String}
_HEADER = (",".join(COLUMNS) + "\n").encode()
_PIECE = 1 << 23  # bytes of text parsed at a time
_ROWS = 65_536  # of a Parquet file read at a time


@dataclass(frozen=True)
class Contacts:
    """Rows of a file of contacts, SI.

    Attributes:
        sample: (n,) row of the log, counted from 0.
        time: (n,) [s].
        contact: (n,) which of the sample's contacts; it keeps its identity.
        estimate: batch of n. Its residual is NaN when read: files do not hold it.
        notes: what was met in reading.
    """

    sample: Int[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    contact: Int[np.ndarray, " n"]
    estimate: ContactEstimate
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.sample)

    def __getitem__(self, which: slice) -> Contacts:
        """Some of the rows."""
        return Contacts(self.sample[which], self.time[which], self.contact[which], self.estimate[which], self.notes)


def to_frame(contacts: Contacts) -> pl.DataFrame:
    """The columns of `COLUMNS`; null where a number is NaN, the label for the status."""
    estimate = contacts.estimate
    numbers = np.column_stack([estimate.point, estimate.normal, estimate.force, estimate.torque])
    variances = estimate.covariance[:, *_UPPER]
    return pl.DataFrame(
        {
            "sample": contacts.sample,
            "time": contacts.time,
            "contact": contacts.contact,
            "status": pl.Series(_LABELS, dtype=pl.String).gather(estimate.status),
            **dict(zip(_VECTORS, numbers.T, strict=True)),
            **dict(zip(_VARIANCES, variances.T, strict=True)),
            "candidates": estimate.candidates,
        },
        schema=TYPES,
    ).with_columns(pl.col(pl.Float64).fill_nan(None))


def from_frame(frame: pl.DataFrame) -> Contacts:
    """The inverse of `to_frame`; columns may stand in any order.

    Raises:
        ValueError: a whole number or a status is missing, there is no such status, or an answered row has no point.
    """
    whole = frame.select(_WHOLE)
    if whole.null_count().sum_horizontal().item():
        raise ValueError("sample, contact and candidates must be whole numbers")
    codes = frame["status"].replace_strict(_LABELS, range(len(_LABELS)), default=None, return_dtype=pl.Int8)
    if codes.null_count():
        raise ValueError(f"unknown status {frame['status'].filter(codes.is_null())[0]!r}")
    numbers = frame.select("time", *_VECTORS, *_VARIANCES).fill_null(float("nan")).to_numpy()
    sample, contact, candidates = whole.to_numpy().T
    return _contacts(sample, contact, candidates, codes.to_numpy(), numbers)


def noted(contacts: Contacts, note: str) -> Contacts:
    """The same rows, with a note if there is something to say."""
    return replace(contacts, notes=(note,)) if note else contacts


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
            plain = file.readline() == _HEADER
            for rows in _pieces(file, torn) if plain else ():
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
    _require_columns(path, table.names)
    whole, _ = table.numbers(_WHOLE, strict=True)
    odd = np.flatnonzero(~((whole == np.rint(whole)) & (np.abs(whole) < 2**53)).all(axis=1))  # NaN and infinite too
    if len(odd):
        table.refuse(int(odd[0]), "sample, contact and candidates must be whole numbers")
    sample, contact, candidates = whole.astype(np.int64).T
    numbers, _ = table.numbers(["time", *_VECTORS, *_VARIANCES], strict=True)
    return _contacts(sample, contact, candidates, _statuses(table), numbers, table)


def parquet_blocks(path: Path) -> Iterator[Contacts]:
    """The rows of a Parquet file of contacts, in pieces.

    Raises:
        InputError: it is none, or a row is not one of contacts.
    """
    try:
        rows = pl.scan_parquet(path, glob=False)
        _require_columns(path, rows.collect_schema().names())
        rows = rows.select(pl.col(name).cast(kind) for name, kind in TYPES.items())
        count = cast(int, rows.select(pl.len()).collect().item())
        for start in range(0, max(count, 1), _ROWS):
            yield from_frame(rows.slice(start, _ROWS).collect())
    except (pl.exceptions.PolarsError, ValueError, OSError) as problem:
        raise InputError(f"is no file of contacts ({str(problem).splitlines()[0]}).", where=str(path)) from problem


def _pieces(file: BinaryIO, torn: bool) -> Iterator[Contacts]:
    """At least one."""
    while True:
        text = file.read(_PIECE) + file.readline()
        whole, end, rest = text.rpartition(b"\n") if torn else (text, b"", b"")
        yield noted(from_frame(_parsed(whole + end)), "the last line is cut and was left out" if rest else "")
        if len(text) < _PIECE:
            return


def _parsed(text: bytes) -> pl.DataFrame:
    """Lines of text whose columns are those of `COLUMNS`, strictly."""
    return pl.read_csv(text, has_header=False, schema=TYPES, quote_char=None) if text else pl.DataFrame(schema=TYPES)


def _require_columns(path: Path, names: list[str] | tuple[str, ...]) -> None:
    if missing := [name for name in COLUMNS if name not in names]:
        raise InputError(
            f"is not a contacts.csv: there is no column {missing[0]!r}.",
            where=str(path),
            mend="`palpate estimate` writes one.",
        )


def _contacts(
    sample: Int[np.ndarray, " n"],
    contact: Int[np.ndarray, " n"],
    candidates: Int[np.ndarray, " n"],
    status: Int[np.ndarray, " n"],
    numbers: Float[np.ndarray, "n 17"],
    table: Table | None = None,
) -> Contacts:
    """From columns; `numbers` are the time, the vectors and the variances."""
    vectors, variances = numbers[:, 1:11], numbers[:, 11:]
    answered = np.isin(status, (Status.CONTACT, Status.AMBIGUOUS))
    pointless = np.flatnonzero(answered & ~np.isfinite(vectors[:, :3]).all(axis=1))
    if len(pointless):
        if table is None:
            raise ValueError("an answered row has no point")
        table.refuse(int(pointless[0]), "is answered, but has no point")
    covariance = np.empty((len(sample), 3, 3))
    covariance[:, *_UPPER] = variances
    covariance[:, *_UPPER[::-1]] = variances
    estimate = ContactEstimate(
        point=vectors[:, 0:3].copy(),
        normal=vectors[:, 3:6].copy(),
        force=vectors[:, 6:9].copy(),
        torque=vectors[:, 9].copy(),
        covariance=covariance,
        residual=np.full(len(sample), np.nan),
        candidates=candidates.copy(),
        status=status.astype(np.int8),
    )
    return Contacts(sample.copy(), numbers[:, 0].copy(), contact.copy(), estimate, table.notes if table else ())


def _statuses(table: Table) -> np.ndarray:
    text = table.strings("status")
    codes = text.replace_strict(_LABELS, range(len(_LABELS)), default=None, return_dtype=pl.Int8)
    if codes.null_count():
        at = int(np.flatnonzero(codes.is_null().to_numpy())[0])
        raise InputError(
            f"unknown status {text[at]!r}.",
            where=f"{table.path}, line {table.lines[at]}",
            mend=near(str(text[at]), _LABELS),
        )
    return codes.to_numpy().copy()
