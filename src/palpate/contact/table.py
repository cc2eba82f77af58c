"""Convert contacts to and from tables with the columns of files."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.origins import Origins
from palpate.processes import require_polars_threads
from palpate.spatial.arguments import takes_arrays

WHOLE = ("sample", "contact", "candidates")
_VECTORS = ("px", "py", "pz", "nx", "ny", "nz", "fx", "fy", "fz", "torque")
_VARIANCES = ("var_xx", "var_xy", "var_xz", "var_yy", "var_yz", "var_zz")
NUMBERS = ("time", *_VECTORS, *_VARIANCES)
COLUMNS = ("sample", "time", "contact", "status", *_VECTORS, *_VARIANCES, "candidates")  # `contact` is the identity
ORIGIN = ("sensor", "link")  # further columns of a robot's contacts
_UPPER = np.triu_indices(3)
LABELS = [status.label for status in Status]  # at the place of their code


def schema(added: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return a dict of column name -> polars type: `COLUMNS`, then `added` ones, `ORIGIN` or features (Float64)."""
    types: dict[str, Any] = {name: pl.Int64 if name in WHOLE else pl.Float64 for name in COLUMNS}
    return types | {"status": pl.String} | {name: pl.String if name in ORIGIN else pl.Float64 for name in added}


def added_columns(contacts: Contacts) -> tuple[str, ...]:
    """Return a tuple of the columns of contacts besides `COLUMNS`: `ORIGIN` of a robot, and features."""
    return (*(() if contacts.origins is None else ORIGIN), *contacts.features)


def features_of(names: tuple[str, ...] | list[str]) -> tuple[str, ...]:
    """Return a tuple of the column names that are features of a sensor: those not in `COLUMNS` or `ORIGIN`."""
    return tuple(name for name in names if name not in (*COLUMNS, *ORIGIN))


def to_frame(contacts: Contacts) -> pl.DataFrame:
    """Return a polars `DataFrame` with `COLUMNS`, then `added_columns`; null for NaN, statuses as labels.

    Raises:
        InputError: the process was forked from one in which polars had started its threads.
    """
    require_polars_threads()
    estimate = contacts.estimate
    numbers = np.column_stack([estimate.point, estimate.normal, estimate.force, estimate.torque])
    variances = estimate.covariance[:, *_UPPER]
    return pl.DataFrame(
        {
            "sample": contacts.sample,
            "time": contacts.time,
            "contact": contacts.identity,
            "status": pl.Series(LABELS, dtype=pl.String).gather(estimate.status),
            **dict(zip(_VECTORS, numbers.T, strict=True)),
            **dict(zip(_VARIANCES, variances.T, strict=True)),
            "candidates": estimate.candidates,
            **({} if contacts.origins is None else {"sensor": contacts.sensor, "link": contacts.link}),
            **contacts.features,
        },
        schema=schema(added_columns(contacts)),
    ).with_columns(pl.col(pl.Float64).fill_nan(None))


def from_frame(frame: pl.DataFrame) -> Contacts:
    """Return the `Contacts` of a polars table, the inverse of `to_frame`; columns may have any order.

    Raises:
        ValueError: an integer or a status is missing, a status is unknown, or an answered row has no point.
    """
    whole = frame.select(WHOLE)
    if whole.null_count().sum_horizontal().item():
        raise ValueError("sample, contact and candidates must be whole numbers")
    codes = frame["status"].replace_strict(LABELS, range(len(LABELS)), default=None, return_dtype=pl.Int8)
    if codes.null_count():
        raise ValueError(f"unknown status {frame['status'].filter(codes.is_null())[0]!r}")
    numbers = frame.select(*NUMBERS).fill_null(float("nan")).to_numpy()
    sample, contact, candidates = whole.to_numpy().T
    features = {
        name: frame[name].fill_null(float("nan")).to_numpy().astype(np.float64) for name in features_of(frame.columns)
    }
    contacts = assembled(sample, contact, candidates, codes.to_numpy(), numbers, features)
    if set(ORIGIN) <= set(frame.columns):
        contacts = replace(contacts, origins=origins_of(*(frame[name] for name in ORIGIN)))
    if (row := pointless(contacts.estimate)) is not None:
        raise ValueError(f"row {row} of a block has the status of a located contact, but no point")
    return contacts


def origins_of(sensors: pl.Series, links: pl.Series) -> Origins:
    """Return the `Origins` of the columns `ORIGIN` of a table; "" where there is no name."""
    return Origins.of_names(sensors.fill_null("").to_list(), links.fill_null("").to_list())


def pointless(estimate: ContactEstimate) -> int | None:
    """Return the index of the first row that is answered but has no point; None if there is none."""
    rows = np.flatnonzero(estimate.answered & ~np.isfinite(estimate.point).all(axis=1))
    return int(rows[0]) if len(rows) else None


@takes_arrays
def assembled(
    sample: Int[np.ndarray, " n"],
    identity: Int[np.ndarray, " n"],
    candidates: Int[np.ndarray, " n"],
    status: Int[np.ndarray, " n"],
    numbers: Float[np.ndarray, "n 17"],
    features: dict[str, Float[np.ndarray, " n"]],
    notes: tuple[str, ...] = (),
) -> Contacts:
    """Make `Contacts` from columns, with those of `NUMBERS` in `numbers`. The residual, not in files, is NaN.

    Raises:
        InputError: arrays of other shapes.
    """
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
    return Contacts(sample.copy(), numbers[:, 0].copy(), identity.copy(), estimate, features, notes)
