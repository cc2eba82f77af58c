"""Samples of a log located by several threads: after one without contact nothing of what came before is left."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int8

from palpate.contact.locate import Locator
from palpate.contact.whole_touches import Located
from palpate.sensors.recording import Recording

__all__ = ["LocatingThreads", "Pending"]

_Memory = Float[np.ndarray, " s"]
_Part = tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None, Int8[np.ndarray, " n"], np.ndarray]


class _Run:
    """Samples that one thread locates, one after the other.

    Args:
        start: the memory that they begin with, or the run in whose memory they go on.
    """

    def __init__(self, start: _Memory | _Run) -> None:
        self._start, self._parts = start, list[_Part]()
        self._done: Future[_Memory] | None = None

    def add(self, part: _Part) -> None:
        """The next samples, before the run is handed out."""
        self._parts.append(part)

    def hand_out(self, pool: ThreadPoolExecutor, locator: Locator) -> None:
        """Let a thread begin: the runs before were handed out before, so that none waits for one behind it."""
        self._done = pool.submit(self._located, locator)

    def memory(self) -> _Memory:
        """What the last sample leaves to the next, when it is located."""
        if self._done is None:
            raise RuntimeError("this run was not handed out.")
        return self._done.result()

    def _located(self, locator: Locator) -> _Memory:
        memory = self._start.memory() if isinstance(self._start, _Run) else self._start
        for part in self._parts:
            locator.run_into(*part, memory=memory)
        self._parts, self._start = [], memory  # a chain of runs keeps no samples
        return memory


class Pending(NamedTuple):
    """Samples that are being located, by the runs that they lie in."""

    located: Located
    runs: tuple[_Run, ...]

    def result(self) -> Located:
        """The samples with their rows, once `LocatingThreads` took the samples behind them or was told of the end."""
        for run in self.runs:
            run.memory()
        return self.located


class LocatingThreads:
    """`Locator.run_into` of the pieces of a log in their order, the same bits, by several threads.

    A piece is cut behind its first sample without contact. What is behind it can begin at once, in another thread.

    Args:
        locator: goes on from its memory, and has that of the last sample after `finish`.
        threads: at a time.
    """

    def __init__(self, locator: Locator, threads: int) -> None:
        self._locator, self._pool = locator, ThreadPoolExecutor(threads)
        self._run = _Run(locator.memory.copy())  # that is not handed out yet: the next piece may have its end

    def put(
        self,
        piece: Recording,
        wrenches: Float[np.ndarray, "n 6"],
        covariances: Float[np.ndarray, "n 6 6"] | None,
        statuses: Int8[np.ndarray, " n"],
    ) -> Pending:
        """The next samples, as `Locator.run_into` takes them."""
        rows = self._locator.empty(len(wrenches))
        cut = self._locator.first_free(wrenches, covariances, statuses) + 1
        before, self._run = self._run, _Run(self._locator.no_contact() if cut else self._run)
        for run, span in ((before, slice(0, cut)), (self._run, slice(cut, None))):
            known = None if covariances is None else covariances[span]
            run.add((wrenches[span], known, statuses[span], rows[span]))
        before.hand_out(self._pool, self._locator)
        return Pending(Located(piece, wrenches, covariances, statuses, rows), (before, self._run))

    def finish(self) -> None:
        """There are no more samples."""
        self._run.hand_out(self._pool, self._locator)
        self._locator.memory[:] = self._run.memory()

    def __enter__(self) -> LocatingThreads:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, raised: BaseException | None, at: TracebackType | None
    ) -> None:
        self._pool.shutdown(cancel_futures=raised is not None)
