"""What to draw of a stream without end: an even share of its samples, and the peaks of force between them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.estimate import ROW, ContactEstimate, Status

__all__ = ["Thinned"]

_INDEX, _TIME, _ROW = 0, 1, 2  # columns of what is kept: number of the sample, time, the estimate from here on


class Thinned:
    """Takes estimates block by block and keeps at most `limit` of them; counts and the peak are those of all.

    Every `stride`-th sample is kept, and `stride` doubles when there are too many. What lies between may hold a short
    touch, so the strongest sample of each of a few longer buckets is kept too: plots show all, statistics use `even`.

    Args:
        limit: how many to keep; an eighth of them are peaks.

    Attributes:
        count: how many samples were added.
        statuses: (9,) how many of each `Status`.
    """

    def __init__(self, limit: int = 20_000) -> None:
        if limit < 8:
            raise ValueError(f"limit must be at least 8, not {limit}")
        peaks = limit // 8
        self._even, self._peaks = _Buckets(limit - peaks), _Buckets(peaks)
        self.count = 0
        self.statuses: Int[np.ndarray, "9"] = np.zeros(len(Status), dtype=np.int64)

    def add(self, time: Float[np.ndarray, " n"], estimate: ContactEstimate) -> None:
        """The next n samples, one contact each."""
        if not len(time):
            return
        index = np.arange(self.count, self.count + len(time), dtype=np.float64)
        rows = np.column_stack([index, time, _rows(estimate)])
        force = np.linalg.norm(estimate.force, axis=-1)
        self._even.add(rows, -index)  # the first of its bucket
        self._peaks.add(rows, np.where(np.isfinite(force), force, -1.0))
        self.count += len(time)
        self.statuses += np.bincount(estimate.status, minlength=len(Status))

    @property
    def stride(self) -> int:
        """How many samples each of the even ones stands for."""
        return self._even.size

    @property
    def time(self) -> Float[np.ndarray, " k"]:
        """(k,) [s] of what is kept, in the order of the stream."""
        return self._kept()[:, _TIME].copy()

    @property
    def estimate(self) -> ContactEstimate:
        """Batch of k."""
        return ContactEstimate.from_rows(self._kept()[:, _ROW:])

    @property
    def even(self) -> Bool[np.ndarray, " k"]:
        """(k,) False for those that were kept for their force alone, which would bias a statistic."""
        return self._kept()[:, _INDEX] % self.stride == 0

    def _kept(self) -> Float[np.ndarray, "k _"]:
        both = np.concatenate([self._even.rows(), self._peaks.rows()])
        _, first = np.unique(both[:, _INDEX], return_index=True)
        return both[first]


class _Buckets:
    """Of each bucket of `size` consecutive samples the one with the largest key; buckets double when there are many."""

    def __init__(self, limit: int) -> None:
        self.limit, self.size = limit, 1
        self._parts: list[Float[np.ndarray, "k _"]] = []  # the key stands in the last column
        self._held = 0

    def add(self, rows: Float[np.ndarray, "n _"], key: Float[np.ndarray, " n"]) -> None:
        part = self._best(np.column_stack([rows, key]))
        self._parts.append(part)
        self._held += len(part)
        if self._held > 2 * self.limit:  # not at each block: joining costs as much as is held
            self._join()

    def rows(self) -> Float[np.ndarray, "k _"]:
        if not self._parts:
            return np.empty((0, _ROW + ROW.length))
        self._join()
        return self._parts[0][:, :-1]

    def _join(self) -> None:
        kept = self._best(np.concatenate(self._parts))
        while len(kept) > self.limit:
            self.size *= 2
            kept = self._best(kept)
        self._parts, self._held = [kept], len(kept)

    def _best(self, rows: Float[np.ndarray, "n _"]) -> Float[np.ndarray, "k _"]:
        """The first of the largest key within each bucket; rows are in the order of their index."""
        bucket = rows[:, _INDEX] // self.size
        starts: Int[np.ndarray, " k"] = np.flatnonzero(np.diff(bucket, prepend=-1.0))
        sizes = np.diff(starts, append=len(rows))
        best = np.flatnonzero(rows[:, -1] == np.repeat(np.maximum.reduceat(rows[:, -1], starts), sizes))
        _, first = np.unique(bucket[best], return_index=True)
        return rows[best[first]]


def _rows(estimate: ContactEstimate) -> Float[np.ndarray, "n 22"]:
    """As the compiled loops write them; the inverse of `ContactEstimate.from_rows`."""
    rows = np.empty((len(estimate.status), ROW.length))
    rows[:, ROW.point], rows[:, ROW.normal], rows[:, ROW.force] = estimate.point, estimate.normal, estimate.force
    rows[:, ROW.covariance] = estimate.covariance.reshape(-1, 9)
    rows[:, ROW.torque], rows[:, ROW.residual] = estimate.torque, estimate.residual
    rows[:, ROW.candidates], rows[:, ROW.status] = estimate.candidates, estimate.status
    return rows
