"""Rows of contacts grouped by the sample that they belong to: there may be several contacts at once."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts

__all__ = ["sample_starts", "strongest", "totals"]


def sample_starts(contacts: Contacts) -> Int[np.ndarray, " m"]:
    """(m,) the first row of each sample."""
    return np.flatnonzero(np.diff(contacts.sample, prepend=contacts.sample[:1] - 1))


def strongest(contacts: Contacts, starts: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """(m,) of each sample the row with the largest force; the first where none is known."""
    if len(starts) == len(contacts):
        return starts
    force = np.nan_to_num(np.linalg.norm(contacts.force, axis=1), nan=-1.0)
    most = np.maximum.reduceat(force, starts)
    rows = np.flatnonzero(force == np.repeat(most, np.diff(starts, append=len(force))))
    return rows[np.searchsorted(rows, starts)]


def totals(contacts: Contacts, starts: Int[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """(m,) [N] sum of the lengths of a sample's forces; NaN where none is known."""
    force = np.linalg.norm(contacts.force, axis=1)
    if len(starts) == len(force):
        return force
    known = np.logical_or.reduceat(np.isfinite(force), starts)
    return np.where(known, np.add.reduceat(np.nan_to_num(force, posinf=0.0), starts), np.nan)
