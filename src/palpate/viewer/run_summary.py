"""Summarise a run of any length: counts, touches, an even share of the samples, and the peaks of force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.contact.touch_finder import TouchFinder
from palpate.viewer.samples import sample_starts


class RunSummary:
    """A summary of contacts, added block by block, that keeps at most `limit` samples.

    Counts and touches are those of all samples. Kept are every `stride`-th sample, where `stride` doubles when there
    are too many, and the strongest of each of some longer buckets: plots show all, statistics use `even`. A sample is
    kept with all its contacts.

    Args:
        limit: samples to keep; an eighth of them are peaks.

    Attributes:
        samples: number of samples added.
        most: largest number of answered and located contacts in one sample.
        statuses: (9,) number of rows of each `Status`.
        finder: finder of the touches.

    Raises:
        ValueError: `limit` is less than 8.
    """

    def __init__(self, limit: int = 20_000) -> None:
        if limit < 8:
            raise ValueError(f"limit must be at least 8, not {limit}")
        peaks = limit // 8
        self._even, self._peaks = _Thinned(limit - peaks, _first), _Thinned(peaks, _strongest)
        self.samples = self.most = 0
        self.statuses: Int[np.ndarray, "9"] = np.zeros(len(Status), dtype=np.int64)
        self.finder = TouchFinder()

    def add(self, contacts: Contacts) -> None:
        """Add the next samples, each with all its contacts, in the surface's frame."""
        self.samples += len(sample_starts(contacts))
        self.statuses += np.bincount(contacts.status, minlength=len(Status))
        felt = contacts.sample[contacts.located & contacts.answered]
        self.most = max(self.most, int(np.unique(felt, return_counts=True)[1].max(initial=0)))
        self.finder.add(contacts)
        self._even.add(contacts)
        self._peaks.add(contacts)

    @property
    def rows(self) -> int:
        """Number of rows of contacts that were added."""
        return int(self.statuses.sum())

    @property
    def stride(self) -> int:
        """Number of samples that each evenly kept one stands for."""
        return self._even.size

    @property
    def contacts(self) -> Contacts:
        """The kept `Contacts`, in the order of the stream."""
        even, peaks = self._even.contacts(), self._peaks.contacts()
        both = Contacts.joined([even, peaks[~np.isin(peaks.sample, even.sample)]])
        return both[np.argsort(both.sample, kind="stable")]

    @property
    def even(self) -> Bool[np.ndarray, " k"]:
        """Mask of the kept rows, (k,): False for those kept for their force alone."""
        return self.contacts.sample % self.stride == 0

    @property
    def rate(self) -> float:
        """Rate of all samples [Hz]; NaN if not known."""
        even = self._even.contacts()
        time: Float[np.ndarray, " m"] = even.time[sample_starts(even)]
        steps = np.diff(time[np.isfinite(time)])
        usual = float(np.median(steps)) if len(steps) else 0.0
        return self.stride / usual if usual > 0 else float("nan")


class _Thinned:
    """The contacts that `pick` takes from each bucket of `size` samples, which doubles if they are too many."""

    def __init__(self, limit: int, pick: Callable[[Contacts, int], Contacts]) -> None:
        self.limit, self.size, self._pick, self._held = limit, 1, pick, 0
        self.parts = [Contacts.single(np.empty(0), ContactEstimate.from_rows(np.empty((0, ROW.length))))]

    def add(self, contacts: Contacts) -> None:
        part = self._pick(contacts, self.size)
        self.parts.append(part)
        self._held += _samples(part)
        if self._held > 2 * self.limit:  # not at each block: joining costs as much as is held
            self.contacts()

    def contacts(self) -> Contacts:
        """Return all kept contacts."""
        kept = self._pick(Contacts.joined(self.parts), self.size)
        while _samples(kept) > self.limit:
            self.size *= 2
            kept = self._pick(kept, self.size)
        self.parts, self._held = [kept], _samples(kept)
        return kept


def _samples(contacts: Contacts) -> int:
    return len(sample_starts(contacts))


def _first(contacts: Contacts, size: int) -> Contacts:
    kept: np.ndarray = contacts.sample % size == 0
    return contacts[kept]


def _strongest(contacts: Contacts, size: int) -> Contacts:
    rows = replace(contacts, sample=contacts.sample // size).strongest()
    return contacts[np.isin(contacts.sample, contacts.sample[rows])]
