"""contacts.csv: what was estimated, at least one row for every sample of the log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from palpate.contact.estimate import ContactEstimate, Status
from palpate.errors import InputError
from palpate.io.atomic import replacing
from palpate.io.table import Table, read_table
from palpate.io.units import near

__all__ = ["COLUMNS", "Contacts", "read_contacts", "write_contacts"]

_VECTORS = ("px", "py", "pz", "nx", "ny", "nz", "fx", "fy", "fz", "torque")
_VARIANCES = ("var_xx", "var_xy", "var_xz", "var_yy", "var_yz", "var_zz")
COLUMNS = ("sample", "time", "contact", "status", *_VECTORS, *_VARIANCES, "candidates")
_UPPER = np.triu_indices(3)
_LABELS = {status.label: int(status) for status in Status}


@dataclass(frozen=True)
class Contacts:
    """The rows of a contacts.csv, SI.

    Attributes:
        sample: (n,) row of the log, counted from 0.
        time: (n,) [s].
        contact: (n,) which of the sample's contacts; it keeps its identity.
        estimate: batch of n. Its residual is NaN: the file does not hold it.
        notes: what was met in reading.
    """

    sample: Int[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    contact: Int[np.ndarray, " n"]
    estimate: ContactEstimate
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.sample)


def write_contacts(
    path: Path,
    time: Float[np.ndarray, " n"],
    estimate: ContactEstimate,
    *,
    sample: Int[np.ndarray, " n"] | None = None,
    contact: Int[np.ndarray, " n"] | None = None,
) -> None:
    """Write estimates in the surface's frame, whole or not at all; numbers read back the same to the last bit.

    Args:
        path: of the file.
        time: (n,) [s] as in the log.
        estimate: batch of n.
        sample: (n,) rows of the log; None: one row each, in order.
        contact: (n,) which of the sample's contacts; None: 0.
    """
    count = len(time)
    numbers = np.column_stack([estimate.point, estimate.normal, estimate.force, estimate.torque])
    variances = estimate.covariance[:, *_UPPER]
    labels = np.array([status.label for status in Status])
    frame = pl.DataFrame(
        {
            "sample": np.arange(count) if sample is None else sample,
            "time": time,
            "contact": np.zeros(count, dtype=np.int64) if contact is None else contact,
            "status": labels[estimate.status],
            **dict(zip(_VECTORS, numbers.T, strict=True)),
            **dict(zip(_VARIANCES, variances.T, strict=True)),
            "candidates": estimate.candidates,
        }
    )
    with replacing(path) as temporary:
        frame.with_columns(pl.col(pl.Float64).fill_nan(None)).write_csv(temporary)


def read_contacts(path: Path) -> Contacts:
    """Read a contacts.csv back.

    Raises:
        InputError: not a contacts.csv, a status that there is none of, a field that is no number, or an answered row
            without a point.
    """
    table = read_table(path)
    if missing := [name for name in COLUMNS if name not in table.names]:
        raise InputError(
            f"is not a contacts.csv: there is no column {missing[0]!r}.",
            where=str(path),
            mend="`palpate estimate` writes one.",
        )
    whole, _ = table.numbers(["sample", "contact", "candidates"], strict=True)
    odd = np.flatnonzero(~((whole == np.rint(whole)) & (np.abs(whole) < 2**53)).all(axis=1))  # NaN and infinite too
    if len(odd):
        table.refuse(int(odd[0]), "sample, contact and candidates must be whole numbers")
    sample, contact, candidates = whole.astype(np.int64).T
    time, _ = table.numbers(["time"], strict=True)
    vectors, _ = table.numbers(_VECTORS, strict=True)
    variances, _ = table.numbers(_VARIANCES, strict=True)
    status = _statuses(table)
    answered = np.isin(status, (Status.CONTACT, Status.AMBIGUOUS))
    pointless = np.flatnonzero(answered & ~np.isfinite(vectors[:, :3]).all(axis=1))
    if len(pointless):
        table.refuse(int(pointless[0]), "is answered, but has no point")
    covariance = np.empty((len(table), 3, 3))
    covariance[:, *_UPPER] = variances
    covariance[:, *_UPPER[::-1]] = variances
    estimate = ContactEstimate(
        point=vectors[:, 0:3].copy(),
        normal=vectors[:, 3:6].copy(),
        force=vectors[:, 6:9].copy(),
        torque=vectors[:, 9].copy(),
        covariance=covariance,
        residual=np.full(len(table), np.nan),
        candidates=candidates.copy(),
        status=status,
    )
    return Contacts(sample.copy(), time[:, 0].copy(), contact.copy(), estimate, table.notes)


def _statuses(table: Table) -> np.ndarray:
    text = table.strings("status")
    codes = text.replace_strict(_LABELS, default=None, return_dtype=pl.Int8)
    if codes.null_count():
        at = int(np.flatnonzero(codes.is_null().to_numpy())[0])
        raise InputError(
            f"unknown status {text[at]!r}.",
            where=f"{table.path}, line {table.lines[at]}",
            mend=near(str(text[at]), _LABELS),
        )
    return codes.to_numpy().copy()
