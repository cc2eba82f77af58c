"""What to draw of a stream without end: an even share of its samples, and the peaks of force between them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, ContactEstimate, Status

__all__ = ["Downsample"]

_INDEX, _SAMPLE, _TIME, _IDENTITY, _ROW = 0, 1, 2, 3, 4  # columns of what is kept; the estimate, then features
_FEATURES = _ROW + ROW.length


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
        self._features: tuple[str, ...] = ()
        self.count = 0
        self.statuses: Int[np.ndarray, "9"] = np.zeros(len(Status), dtype=np.int64)

    def add(self, contacts: Contacts) -> None:
        """The next samples, each with all of its contacts; features are those of the first block."""
        if not len(contacts):
            return
        if not self.count:
            self._features = tuple(contacts.features)
        sample = np.cumsum(np.diff(contacts.sample, prepend=contacts.sample[0]) != 0)
        rows = _rows(contacts, self.count + sample, self._features)
        force = np.linalg.norm(contacts.force, axis=-1)
        force = np.where(np.isfinite(force), force, -1.0)
        starts: Int[np.ndarray, " m"] = np.flatnonzero(np.diff(sample, prepend=-1))
        self._even.add(rows, -rows[:, _INDEX])  # the first of its bucket
        self._peaks.add(rows, np.maximum.reduceat(force, starts)[sample])
        self.count += int(sample[-1]) + 1
        self.statuses += np.bincount(contacts.status, minlength=len(Status))

    @property
    def stride(self) -> int:
        """How many samples each of the even ones stands for."""
        return self._even.size

    @property
    def contacts(self) -> Contacts:
        """What is kept, in the order of the stream."""
        kept = self._kept()
        return Contacts(
            kept[:, _SAMPLE].astype(np.int64),
            kept[:, _TIME],
            kept[:, _IDENTITY].astype(np.int64),
            ContactEstimate.from_rows(kept[:, _ROW:_FEATURES]),
            {name: kept[:, _FEATURES + k] for k, name in enumerate(self._features)},
        )

    @property
    def even(self) -> Bool[np.ndarray, " k"]:
        """(k,) False for rows that were kept for their force alone, which would bias a statistic."""
        return self._kept()[:, _INDEX] % self.stride == 0

    @property
    def rate(self) -> float:
        """Samples a second, all of them; NaN where it is not known."""
        kept = self._kept()
        first = np.diff(kept[:, _INDEX], prepend=-1.0) != 0
        time = kept[first & (kept[:, _INDEX] % self.stride == 0), _TIME]
        steps = np.diff(time[np.isfinite(time)])
        usual = float(np.median(steps)) if len(steps) else 0.0
        return self.stride / usual if usual > 0 else float("nan")

    def _kept(self) -> Float[np.ndarray, "k _"]:
        width = _FEATURES + len(self._features)
        even, peaks = self._even.rows(width), self._peaks.rows(width)
        both = np.concatenate([even, peaks[~np.isin(peaks[:, _INDEX], even[:, _INDEX])]])
        return both[np.argsort(both[:, _INDEX], kind="stable")]


class _Buckets:
    """Of each bucket of `size` consecutive samples the one with the largest key; buckets double when there are many."""

    def __init__(self, limit: int) -> None:
        self.limit, self.size = limit, 1
        self._parts: list[Float[np.ndarray, "k _"]] = []  # the key stands in the last column
        self._held = 0

    def add(self, rows: Float[np.ndarray, "n _"], key: Float[np.ndarray, " n"]) -> None:
        """Rows of samples, and the key of each row's sample."""
        part = self._best(np.column_stack([rows, key]))
        self._parts.append(part)
        self._held += _samples(part)
        if self._held > 2 * self.limit:  # not at each block: joining costs as much as is held
            self._join()

    def rows(self, width: int) -> Float[np.ndarray, "k _"]:
        if not self._parts:
            return np.empty((0, width))
        self._join()
        return self._parts[0][:, :-1]

    def _join(self) -> None:
        kept = self._best(np.concatenate(self._parts))
        while _samples(kept) > self.limit:
            self.size *= 2
            kept = self._best(kept)
        self._parts, self._held = [kept], _samples(kept)

    def _best(self, rows: Float[np.ndarray, "n _"]) -> Float[np.ndarray, "k _"]:
        """The first sample of the largest key within each bucket; rows are in the order of their index."""
        bucket = rows[:, _INDEX] // self.size
        starts: Int[np.ndarray, " k"] = np.flatnonzero(np.diff(bucket, prepend=-1.0))
        sizes = np.diff(starts, append=len(rows))
        best = np.flatnonzero(rows[:, -1] == np.repeat(np.maximum.reduceat(rows[:, -1], starts), sizes))
        first = best[np.searchsorted(best, starts)]
        return rows[rows[:, _INDEX] == np.repeat(rows[first, _INDEX], sizes)]


def _samples(rows: Float[np.ndarray, "n _"]) -> int:
    return int(np.count_nonzero(np.diff(rows[:, _INDEX], prepend=-1.0)))


def _rows(contacts: Contacts, index: Int[np.ndarray, " n"], features: tuple[str, ...]) -> Float[np.ndarray, "n _"]:
    """Columns as they are kept; those of the estimate as `ContactEstimate.from_rows` reads them."""
    estimate = contacts.estimate
    known = [contacts.features.get(name, np.full(len(index), np.nan)) for name in features]
    columns = (
        *(index, contacts.sample, contacts.time, contacts.identity),
        *(estimate.point, estimate.normal, estimate.force, estimate.torque, estimate.covariance.reshape(-1, 9)),
        *(estimate.residual, estimate.candidates, estimate.status),
    )
    return np.column_stack([*columns, *known])
