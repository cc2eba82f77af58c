"""What to draw of a stream without end: an even share of its samples, and the peaks of force between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, ContactEstimate, Status

__all__ = ["Downsample"]


class _Part(NamedTuple):
    """n contacts: the number of each one's sample in the stream, that sample's key, and the contacts themselves."""

    serial: Int[np.ndarray, " n"]
    key: Float[np.ndarray, " n"]
    contacts: Contacts

    def picked(self, which: np.ndarray) -> _Part:
        return _Part(self.serial[which], self.key[which], self.contacts[which])

    @property
    def samples(self) -> int:
        return int(np.count_nonzero(np.diff(self.serial, prepend=-1)))


class Downsample:
    """Takes contacts block by block and keeps at most `limit` samples; counts and the peak are those of all.

    Every `stride`-th sample is kept, and `stride` doubles when there are too many. What lies between may hold a short
    touch, so the strongest sample of each of a few longer buckets is kept too: plots show all, statistics use `even`.
    A sample is kept with all of its contacts.

    Args:
        limit: samples to keep; an eighth of them are peaks.

    Attributes:
        count: how many samples were added.
        statuses: (9,) how many contacts (rows) of each `Status`.
    """

    def __init__(self, limit: int = 20_000) -> None:
        if limit < 8:
            raise ValueError(f"limit must be at least 8, not {limit}")
        peaks = limit // 8
        self._even, self._peaks = _Buckets(limit - peaks), _Buckets(peaks)
        self.count = 0
        self.statuses: Int[np.ndarray, "9"] = np.zeros(len(Status), dtype=np.int64)

    def add(self, contacts: Contacts) -> None:
        """The next samples, each with all of its contacts."""
        if not len(contacts):
            return
        new = np.diff(contacts.sample, prepend=contacts.sample[0] - 1) != 0
        sample = np.cumsum(new) - 1
        serial = self.count + sample
        force = np.nan_to_num(np.linalg.norm(contacts.force, axis=-1), nan=-1.0, posinf=-1.0)
        strongest: Float[np.ndarray, " m"] = np.maximum.reduceat(force, np.flatnonzero(new))
        self._even.add(_Part(serial, -serial.astype(np.float64), contacts))  # the first of its bucket
        self._peaks.add(_Part(serial, strongest[sample], contacts))
        self.count += len(strongest)
        self.statuses += np.bincount(contacts.status, minlength=len(Status))

    @property
    def stride(self) -> int:
        """How many samples each of the even ones stands for."""
        return self._even.size

    @property
    def contacts(self) -> Contacts:
        """What is kept, in the order of the stream."""
        return self._kept().contacts

    @property
    def even(self) -> Bool[np.ndarray, " k"]:
        """(k,) False for rows that were kept for their force alone, which would bias a statistic."""
        return self._kept().serial % self.stride == 0

    @property
    def rate(self) -> float:
        """Samples a second, all of them; NaN where it is not known."""
        even = self._even.part()
        time = even.contacts.time[np.diff(even.serial, prepend=-1) != 0]
        steps = np.diff(time[np.isfinite(time)])
        usual = float(np.median(steps)) if len(steps) else 0.0
        return self.stride / usual if usual > 0 else float("nan")

    def _kept(self) -> _Part:
        even, peaks = self._even.part(), self._peaks.part()
        both = _joined([even, peaks.picked(~np.isin(peaks.serial, even.serial))])
        return both.picked(np.argsort(both.serial, kind="stable"))


class _Buckets:
    """Of each bucket of `size` consecutive samples the one with the largest key; buckets double when there are many."""

    def __init__(self, limit: int) -> None:
        self.limit, self.size = limit, 1
        self._parts: list[_Part] = []
        self._held = 0

    def add(self, part: _Part) -> None:
        self._parts.append(self._best(part))
        self._held += self._parts[-1].samples
        if self._held > 2 * self.limit:  # not at each block: joining costs as much as is held
            self.part()

    def part(self) -> _Part:
        """All that is kept."""
        kept = self._best(_joined(self._parts))
        while kept.samples > self.limit:
            self.size *= 2
            kept = self._best(kept)
        self._parts, self._held = [kept], kept.samples
        return kept

    def _best(self, part: _Part) -> _Part:
        """The first sample of the largest key within each bucket; rows are in the order of the stream."""
        bucket = part.serial // self.size
        starts: Int[np.ndarray, " k"] = np.flatnonzero(np.diff(bucket, prepend=-1))
        if len(starts) == len(bucket):
            return part
        sizes = np.diff(starts, append=len(bucket))
        best = np.flatnonzero(part.key == np.repeat(np.maximum.reduceat(part.key, starts), sizes))
        first = best[np.searchsorted(best, starts)]
        return part.picked(part.serial == np.repeat(part.serial[first], sizes))


def _joined(parts: list[_Part]) -> _Part:
    if not parts:
        nothing = ContactEstimate.from_rows(np.empty((0, ROW.length)))
        return _Part(np.empty(0, np.int64), np.empty(0), Contacts.single(np.empty(0), nothing))
    serial, key, contacts = zip(*parts, strict=True)
    return _Part(np.concatenate(serial), np.concatenate(key), Contacts.joined(contacts))
