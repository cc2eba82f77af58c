"""Base class of sources whose samples wait for something of the same time from another device."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Float
from numpy.typing import DTypeLike

from palpate.files.logs.decoding import seconds
from palpate.live.source import SILENT, Batch, CountingSource, Source, drained

WAITS = 0.1  # s that a sample waits, at most


class WaitingSource(ABC):
    """A source of samples that are given once another device has answered for their times.

    After 0.1 s without such an answer they are given with NaN.

    Args:
        samples: source of the samples.
        what: what they wait for, with "no", and what to check if it never comes, for two sentences.
    """

    poses = False  # of ROS 2 come beside any source

    def __init__(self, samples: Source, what: tuple[str, str, str]) -> None:
        self._samples, self._what = samples, what
        self._counting = samples if isinstance(samples, CountingSource) else None
        self._before = 0  # samples that waited in an earlier process, and are lost before the next one
        self.shape: tuple[int, ...] = tuple(samples.shape)
        self.dtype: DTypeLike = samples.dtype
        self._batch = Batch(samples.shape, dtype=samples.dtype)
        self._stamp, self._lost = np.zeros((2, 0), dtype=np.int64)
        self._values = self._batch.values[:0]
        self._since, self._heard, self._quiet = 0.0, 0.0, False
        self._said: list[str] = []

    @abstractmethod
    def _listen(self) -> None:
        """Take what has come from the other device."""

    @abstractmethod
    def _answerable(self, time: Float[np.ndarray, " n"]) -> int:
        """Return how many of the samples at times (n,) [s], from the first on, have answers that will not change."""

    @abstractmethod
    def _join(self, batch: Batch, time: Float[np.ndarray, " n"], values: np.ndarray) -> bool:
        """Fill a batch with the values of the next samples and the answers for them; return whether one has any."""

    def open(self) -> None:
        """Connect to the device of the samples.

        Raises:
            InputError: it cannot be opened.
        """
        self._samples.open()
        self._heard = time.monotonic()

    def receive(self, batch: Batch, timeout: float) -> int:
        """Fill a batch with samples that are answered for, and return how many; wait up to `timeout` [s].

        Raises:
            OSError: a device cannot be read.
        """
        self._take(self._samples.receive(self._batch, 0.0 if len(self._stamp) else timeout))
        end = time.monotonic() + min(timeout, WAITS)
        while True:
            self._listen()
            ready = self._answerable(seconds(self._stamp)) if len(self._stamp) else 0
            if ready or time.monotonic() >= end or not len(self._stamp):
                break
            time.sleep(5e-4)
        if not ready and len(self._stamp) and time.monotonic() - self._since > WAITS:
            ready = len(self._stamp)
        return self._given(batch, min(ready, len(batch)))

    def events(self) -> list[str]:
        """Return the events since the last call, and of samples without answers, one sentence each."""
        return [*drained(self._said), *self._samples.events()]

    @property
    def late(self) -> int:
        """Number of samples that were counted as lost and arrived later."""
        return 0 if self._counting is None else self._counting.late

    @property
    def unknown(self) -> int:
        """Number of times that samples were missing whose number no counter tells."""
        return 0 if self._counting is None else self._counting.unknown

    def position(self) -> tuple[int, ...]:
        """Return the number of samples that wait, and the counters of the last one; () if nobody counts."""
        found = () if self._counting is None else self._counting.position()
        return (len(self._stamp), *found) if found else ()

    def resume(self, position: tuple[int, ...]) -> None:
        """Count the samples missing since an earlier source's position as lost before the next one."""
        if self._counting is not None:
            self._before = position[0]
            self._counting.resume(position[1:])

    def close(self) -> None:
        """Disconnect from the device of the samples; may be called again."""
        self._samples.close()

    def _take(self, count: int) -> None:
        if not count:
            return
        if not len(self._stamp):
            self._since = time.monotonic()
        self._stamp = np.concatenate([self._stamp, self._batch.stamp[:count]])
        self._batch.lost[0] += self._before
        self._before = 0
        self._lost = np.concatenate([self._lost, self._batch.lost[:count]])
        self._values = np.concatenate([self._values, self._batch.values[:count]])

    def _given(self, batch: Batch, count: int) -> int:
        """Fill a batch with the first `count` waiting samples and the answers for them."""
        if not count:
            return 0
        batch.stamp[:count], batch.lost[:count] = self._stamp[:count], self._lost[:count]
        batch.arrive(count, time.time_ns())
        found = self._join(batch, seconds(self._stamp[:count]), self._values[:count])
        self._stamp, self._lost, self._values = self._stamp[count:], self._lost[count:], self._values[count:]
        self._since = time.monotonic()
        self._watch(found)
        return count

    def _watch(self, found: bool) -> None:
        """Report once that samples stay without answers, or have some again."""
        (lacking, check, again), now = self._what, time.monotonic()
        if found:
            if self._quiet:
                self._said.append(f"{again} again, after {now - self._heard:.1f} s")
            self._heard, self._quiet = now, False
        elif now - self._heard > SILENT and not self._quiet:
            self._quiet = True
            self._said.append(f"no {lacking} for {SILENT:g} s: {check}")
