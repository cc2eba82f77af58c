"""Group rows of contacts by their sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.spatial.arguments import takes_arrays


def sample_starts(contacts: Contacts) -> Int[np.ndarray, " m"]:
    """Return the number of the first row of each sample, (m,)."""
    return np.flatnonzero(np.diff(contacts.sample, prepend=contacts.sample[:1] - 1))


@takes_arrays
def strongest(contacts: Contacts, starts: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """Return for each sample the row with the largest force, (m,); its first if no force is known.

    Raises:
        InputError: starts has another shape.
    """
    counted = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(contacts)))  # a file may not be in order
    return starts if len(starts) == len(contacts) else replace(contacts, sample=counted, origins=None).strongest()


def sheet_places(contacts: Contacts) -> Float[np.ndarray, "n 2"] | None:
    """Return row and column on the unrolled sheet, (n, 2), NaN where not known; None if the sensor is no sheet."""
    features = contacts.features
    on_sheet = {"row", "column"} <= set(features)
    return np.column_stack([features["row"], features["column"]]) if on_sheet else None


@takes_arrays
def thinned(rows: Int[np.ndarray, " n"], most: int) -> Int[np.ndarray, " k"]:
    """Return at most `most` of the row numbers, evenly spread, (k,).

    Raises:
        InputError: rows has another shape.
    """
    return rows[:: 1 + len(rows) // most]


@takes_arrays
def totals(contacts: Contacts, starts: Int[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Return for each sample the sum of its forces' magnitudes, (m,) [N]; NaN if none is known.

    Raises:
        InputError: starts has another shape.
    """
    force = np.linalg.norm(contacts.force, axis=1)
    if len(starts) == len(force):
        return force
    known = np.logical_or.reduceat(np.isfinite(force), starts)
    return np.where(known, np.add.reduceat(np.nan_to_num(force, posinf=0.0), starts), np.nan)


@takes_arrays
def median(values: Float[np.ndarray, " n"]) -> float:
    """Return the median of the finite values; NaN without one.

    Raises:
        InputError: values has another shape.
    """
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")
