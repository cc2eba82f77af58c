"""Contacts as the rows of a table: the columns that every format has."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from palpate.contact.estimate import ContactEstimate, Status
from palpate.errors import InputError

__all__ = [
    "CELL",
    "COLUMNS",
    "LABELS",
    "NUMBERS",
    "SKIN_TYPES",
    "TYPES",
    "WHOLE",
    "Contacts",
    "assembled",
    "from_frame",
    "noted",
    "pointless",
    "require_columns",
    "to_frame",
]

WHOLE = ("sample", "contact", "candidates")
_VECTORS = ("px", "py", "pz", "nx", "ny", "nz", "fx", "fy", "fz", "torque")
_VARIANCES = ("var_xx", "var_xy", "var_xz", "var_yy", "var_yz", "var_zz")
NUMBERS = ("time", *_VECTORS, *_VARIANCES)
COLUMNS = ("sample", "time", "contact", "status", *_VECTORS, *_VARIANCES, "candidates")
CELL = ("row", "column", "area")  # of contacts that a sheet of taxels felt: the first two between cell centres, m^2
_UPPER = np.triu_indices(3)
LABELS = [status.label for status in Status]  # at the place of their code
TYPES: dict[str, Any] = {name: pl.Int64 if name in WHOLE else pl.Float64 for name in COLUMNS} | {"status": pl.String}
SKIN_TYPES: dict[str, Any] = TYPES | dict.fromkeys(CELL, pl.Float64)


@dataclass(frozen=True)
class Contacts:
    """Rows of a file of contacts, SI.

    Attributes:
        sample: (n,) row of the log, counted from 0.
        time: (n,) [s].
        contact: (n,) which of the sample's contacts; it keeps its identity.
        estimate: batch of n. Its residual is NaN when read: files do not hold it.
        notes: what was met in reading.
        cell: (n, 3) row, column and area [m^2] on a sheet of taxels; None where another sensor felt them.
    """

    sample: Int[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    contact: Int[np.ndarray, " n"]
    estimate: ContactEstimate
    notes: tuple[str, ...] = ()
    cell: Float[np.ndarray, "n 3"] | None = None

    def __len__(self) -> int:
        return len(self.sample)

    def __getitem__(self, which: slice) -> Contacts:
        """Some of the rows."""
        cell = None if self.cell is None else self.cell[which]
        part = self.sample[which], self.time[which], self.contact[which], self.estimate[which]
        return Contacts(*part, self.notes, cell)


def to_frame(contacts: Contacts) -> pl.DataFrame:
    """The columns of `COLUMNS`, and of `CELL` where there are; null where a number is NaN, the status's label."""
    estimate = contacts.estimate
    numbers = np.column_stack([estimate.point, estimate.normal, estimate.force, estimate.torque])
    variances = estimate.covariance[:, *_UPPER]
    return pl.DataFrame(
        {
            "sample": contacts.sample,
            "time": contacts.time,
            "contact": contacts.contact,
            "status": pl.Series(LABELS, dtype=pl.String).gather(estimate.status),
            **dict(zip(_VECTORS, numbers.T, strict=True)),
            **dict(zip(_VARIANCES, variances.T, strict=True)),
            "candidates": estimate.candidates,
            **({} if contacts.cell is None else dict(zip(CELL, contacts.cell.T, strict=True))),
        },
        schema=TYPES if contacts.cell is None else SKIN_TYPES,
    ).with_columns(pl.col(pl.Float64).fill_nan(None))


def from_frame(frame: pl.DataFrame) -> Contacts:
    """The inverse of `to_frame`; columns may stand in any order.

    Raises:
        ValueError: a whole number or a status is missing, there is no such status, or an answered row has no point.
    """
    whole = frame.select(WHOLE)
    if whole.null_count().sum_horizontal().item():
        raise ValueError("sample, contact and candidates must be whole numbers")
    codes = frame["status"].replace_strict(LABELS, range(len(LABELS)), default=None, return_dtype=pl.Int8)
    if codes.null_count():
        raise ValueError(f"unknown status {frame['status'].filter(codes.is_null())[0]!r}")
    numbers = frame.select(*NUMBERS).fill_null(float("nan")).to_numpy()
    sample, contact, candidates = whole.to_numpy().T
    skin = set(CELL) <= set(frame.columns)
    cell = frame.select(*CELL).fill_null(float("nan")).to_numpy() if skin else None
    contacts = assembled(sample, contact, candidates, codes.to_numpy(), numbers, cell=cell)
    if (row := pointless(contacts.estimate)) is not None:
        raise ValueError(f"row {row} of a block is answered, but has no point")
    return contacts


def noted(contacts: Contacts, note: str) -> Contacts:
    """The same rows, with a note if there is something to say."""
    return replace(contacts, notes=(note,)) if note else contacts


def pointless(estimate: ContactEstimate) -> int | None:
    """The first row that is answered, but has no point."""
    rows = np.flatnonzero(estimate.answered & ~np.isfinite(estimate.point).all(axis=1))
    return int(rows[0]) if len(rows) else None


def require_columns(path: Path, names: list[str] | tuple[str, ...]) -> None:
    """Raise an InputError if a column is missing."""
    if missing := [name for name in COLUMNS if name not in names]:
        raise InputError(
            f"is not a contacts.csv: there is no column {missing[0]!r}.",
            where=str(path),
            mend="`palpate estimate` writes one.",
        )


def assembled(
    sample: Int[np.ndarray, " n"],
    contact: Int[np.ndarray, " n"],
    candidates: Int[np.ndarray, " n"],
    status: Int[np.ndarray, " n"],
    numbers: Float[np.ndarray, "n 17"],
    notes: tuple[str, ...] = (),
    cell: Float[np.ndarray, "n 3"] | None = None,
) -> Contacts:
    """From columns; `numbers` are those of `NUMBERS`, `cell` those of `CELL`."""
    vectors, variances = numbers[:, 1:11], numbers[:, 11:]
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
    cell = None if cell is None else np.array(cell, dtype=np.float64)
    return Contacts(sample.copy(), numbers[:, 0].copy(), contact.copy(), estimate, notes, cell)
