"""Match contacts to truths one to one: by time, then by place."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.spatial.arguments import takes_arrays

_AT_ONCE = 0.5  # of the shorter of two touches: those that overlap by more are two contacts
_RESOLUTION = 1e-6  # s: times of day have a resolution of 0.2 us in float64
_NOWHERE = 1e9  # m: how far a contact that is not answered is from every truth


@takes_arrays
def nearest_in_time(
    time: Float[np.ndarray, " n"], known: Float[np.ndarray, " k"], tolerance: float
) -> Int[np.ndarray, " n"]:
    """Return for each time the index of the nearest known one, (n,), -1 where none is within `tolerance` [s].

    Raises:
        InputError: arrays of other shapes.
    """
    order = np.argsort(known)
    order = order[np.isfinite(known[order])]
    if not len(order):
        return np.full(len(time), -1)
    right = np.searchsorted(known[order], time).clip(max=len(order) - 1)
    either = np.stack([order[(right - 1).clip(min=0)], order[right]])
    apart: Float[np.ndarray, "2 n"] = np.abs(known[either] - time)
    best: Int[np.ndarray, " n"] = np.take_along_axis(either, apart.argmin(axis=0)[None], axis=0)[0]
    return np.where(np.min(apart, axis=0) <= tolerance + _RESOLUTION, best, -1)


def _between(time: Float[np.ndarray, " n"], known: Float[np.ndarray, " k"], tolerance: float) -> Bool[np.ndarray, " n"]:
    """Return whether each time [s] is inside a stretch of the truth, or within the tolerance of a single instant.

    Instants at most twice the tolerance apart are one stretch, which reaches half their usual distance beyond its ends.
    """
    instants = np.unique(known[np.isfinite(known)])
    nearest = nearest_in_time(time, instants, tolerance)
    joined: Bool[np.ndarray, " g"] = np.diff(instants) <= 2 * tolerance
    if not joined.any():
        return nearest >= 0
    before, after = np.append(False, joined), np.append(joined, False)
    usual = 0.5 * float(np.median(np.diff(instants)[joined]))
    reach = np.where(before | after, min(usual, tolerance), tolerance) + _RESOLUTION
    step = time - instants[nearest]
    inside = np.where(step < 0, before[nearest], after[nearest]) | (np.abs(step) <= reach[nearest])
    return inside & (nearest >= 0)


def match_instants(
    contacts: Contacts, truth: TrueSamples, tolerance: float
) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Return the number of each contact's truth, (n,), -1 for none, and masks (n,): a truth is at its time; only near.

    Times may differ by `tolerance` [s]. Contacts of one sample have different truths, with the least sum of distances.
    Instants at most twice the tolerance apart are one stretch: a time beyond its ends by more than half their usual
    distance is only near a truth, as the force may have changed since, and has none.
    """
    nearest = nearest_in_time(contacts.time, truth.time, tolerance)
    due = _between(contacts.time, truth.time, tolerance)
    match = np.where(due, nearest, -1)
    _, instant, together = np.unique(truth.time, return_inverse=True, return_counts=True)
    _, sample, felt = np.unique(contacts.sample, return_inverse=True, return_counts=True)
    several = due & (felt[sample] > 1)
    several[due] |= together[instant[match[due]]] > 1
    point = np.where(contacts.answered[:, None], contacts.point, np.nan)
    rows = np.flatnonzero(several)
    rows = rows[np.argsort(sample[rows], kind="stable")]
    order, ends = np.argsort(instant, kind="stable"), np.cumsum(together)
    for group in np.split(rows, np.flatnonzero(np.diff(sample[rows])) + 1) if len(rows) else ():
        which = instant[match[group[0]]]
        there = order[ends[which] - together[which] : ends[which]]
        match[group] = np.append(there, -1)[_nearest_pairs(point[group], truth.point[there])]
    return match, due, (nearest >= 0) & ~due


def _nearest_pairs(points: Float[np.ndarray, "n 3"], known: Float[np.ndarray, "k 3"]) -> Int[np.ndarray, " n"]:
    """Return the known point of each point, -1 for none, by the least sum of distances."""
    from scipy.optimize import linear_sum_assignment  # here: scipy is slow to import

    apart = np.linalg.norm(points[:, None] - known, axis=-1)
    rows, columns = linear_sum_assignment(np.where(np.isfinite(apart), apart, _NOWHERE))
    found = np.full(len(points), -1)
    found[rows] = columns
    return found


def match_touches(
    contacts: Contacts, truth: TrueTouches
) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"], list[Int[np.ndarray, " _"]]]:
    """Return the number of each contact's touch, (n,), -1 for none; a mask (n,) of those within one; each touch's rows.

    Rows are indices. A touch has those of the identity nearest to it, and those without a point. Where touches overlap
    at an end only, a row belongs to the first of them.
    """
    inside = [
        np.flatnonzero((contacts.time >= start) & (contacts.time <= end))
        for start, end in zip(truth.start, truth.end, strict=True)
    ]
    chosen = _identities(contacts, truth, inside)
    nowhere = ~np.asarray(np.isfinite(contacts.point).all(axis=1))
    match, due = np.full(len(contacts), -1), np.zeros(len(contacts), dtype=bool)
    own: list[Int[np.ndarray, " _"]] = []
    for rows, identity in zip(inside, chosen, strict=True):
        due[rows] = True
        its = nowhere[rows] | np.equal(contacts.identity[rows], identity or 0)
        own.append(rows[~contacts.answered[rows] if identity is None else its])
    for felt in (False, True):  # a touch that has an identity comes before one that has none
        for k in reversed(range(len(truth))):
            if (chosen[k] is not None) == felt:
                match[own[k]] = k
    return match, due, own


def _identities(contacts: Contacts, truth: TrueTouches, inside: list[Int[np.ndarray, " _"]]) -> list[int | None]:
    """Return the identity of each touch, nearest pairs first; two at once do not share one."""
    pairs: list[tuple[float, int, int]] = []
    for k, rows in enumerate(inside):
        answered = rows[contacts.answered[rows]]
        for identity in np.unique(contacts.identity[answered]).tolist():
            middle = np.median(contacts.point[answered[contacts.identity[answered] == identity]], axis=0)
            pairs.append((float(np.linalg.norm(middle - truth.point[k])), k, identity))
    chosen: list[int | None] = [None] * len(truth)
    for _, k, identity in sorted(pairs):
        taken = [other for other, one in enumerate(chosen) if one == identity]
        if chosen[k] is None and not any(_at_once(truth, k, other) for other in taken):
            chosen[k] = identity
    return chosen


def _at_once(truth: TrueTouches, one: int, other: int) -> bool:
    shared = min(truth.end[one], truth.end[other]) - max(truth.start[one], truth.start[other])
    shorter = min(truth.end[one] - truth.start[one], truth.end[other] - truth.start[other])
    return bool(shared > _AT_ONCE * shorter)
