"""Samples of a log located by several threads: after one without contact nothing of what came before is left."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int8

from palpate.contact.locate import Locator
from palpate.contact.surface_wrenches import Piece, Wrenches
from palpate.contact.touch_smoothing import Located
from palpate.signals.recording import Recording

__all__ = ["Pending", "located_in_threads"]

AHEAD = 4  # blocks that may wait for the threads
LONG = 8192  # samples without a rest that wait for one: others are measured meanwhile
_Memory = Float[np.ndarray, " s"]
_Part = tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None, Int8[np.ndarray, " n"], np.ndarray]


class _Run:
    """Samples that one thread locates, one after the other.

    Args:
        start: the memory that they begin with, or the run in whose memory they go on.
        locator, pool: by what, in the threads of which.
    """

    def __init__(self, start: _Memory | _Run, locator: Locator, pool: ThreadPoolExecutor) -> None:
        self._start, self._locator, self._pool = start, locator, pool
        self._parts = list[_Part]()
        self._done: Future[_Memory] | None = None

    def add(self, part: _Part) -> None:
        """The next samples, before a thread begins."""
        self._parts.append(part)

    @property
    def begun(self) -> bool:
        """No more samples are added."""
        return self._done is not None

    @property
    def samples(self) -> int:
        """So far."""
        return sum(len(statuses) for _, _, statuses, _ in self._parts)

    def begin(self) -> Future[_Memory]:
        """Let a thread begin; one that it goes on from began before, so that it does not wait for one behind it."""
        if self._done is None:
            self._done = self._pool.submit(self._located)
        return self._done

    def memory(self) -> _Memory:
        """What the last sample leaves to the next, when it is located."""
        return self.begin().result()

    def _located(self) -> _Memory:
        memory = self._start.memory() if isinstance(self._start, _Run) else self._start
        for part in self._parts:
            self._locator.run_into(*part, memory=memory)
        self._parts, self._start = [], memory  # a chain of runs keeps no samples
        return memory


class Pending(NamedTuple):
    """Samples that are being located, by the runs that they lie in."""

    located: Located
    runs: tuple[_Run, ...]

    def result(self) -> Located:
        """The samples with their rows."""
        for run in self.runs:
            run.memory()
        return self.located


class LocatingThreads:
    """`Locator.run_into` of the pieces of a log in their order, the same bits, by several threads.

    A thread takes the samples from one without contact to the next such one in another piece: no more than that is
    known to depend on each other. It takes fewer of a long touch, and where their result is asked for before.

    Args:
        locator: goes on from its memory, and has that of the last sample after `finish`.
        threads: at a time.
    """

    def __init__(self, locator: Locator, threads: int) -> None:
        self._locator, self._pool = locator, ThreadPoolExecutor(threads)
        self._run = self._run_from(locator.memory.copy())  # to which samples are added

    def _run_from(self, start: _Memory | _Run) -> _Run:
        return _Run(start, self._locator, self._pool)

    def put(
        self,
        piece: Recording,
        wrenches: Float[np.ndarray, "n 6"],
        covariances: Float[np.ndarray, "n 6 6"] | None,
        statuses: Int8[np.ndarray, " n"],
    ) -> Pending:
        """The next samples, as `Locator.run_into` takes them."""
        located = Located(piece, wrenches, covariances, statuses, self._locator.empty(len(wrenches)))
        cut = self._locator.first_free(wrenches, covariances, statuses) + 1
        if self._run.begun:
            self._run = self._run_from(self._run)
        runs = [self._run]
        self._run.add(_part(located, slice(0, cut or None)))
        if cut:
            self._run.begin()
            self._run = self._run_from(self._locator.no_contact())
            self._run.add(_part(located, slice(cut, None)))
            runs.append(self._run)
        elif self._run.samples >= LONG:
            self._run.begin()
        return Pending(located, tuple(runs))

    def finish(self) -> None:
        """There are no more samples."""
        self._locator.memory[:] = self._run.memory()

    def __enter__(self) -> LocatingThreads:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, raised: BaseException | None, at: TracebackType | None
    ) -> None:
        self._pool.shutdown(cancel_futures=raised is not None)


def located_in_threads(
    pieces: Iterable[tuple[Piece, Wrenches]], locator: Locator, threads: int
) -> Iterator[tuple[Piece, Located]]:
    """Yield each piece of a log located, by threads that work while the next ones are read, compensated and placed."""
    waiting, blocks = deque[tuple[Piece, Pending]](), 0  # that wait from their first piece to their last
    with LocatingThreads(locator, threads) as pool:
        for piece, wrenches in pieces:
            waiting.append((piece, pool.put(piece.samples, *wrenches)))
            blocks += piece.ends is not None
            while blocks > AHEAD:
                first, part = waiting.popleft()
                blocks -= first.ends is not None
                yield first, part.result()
        pool.finish()
        for piece, part in waiting:
            yield piece, part.result()


def _part(located: Located, span: slice) -> _Part:
    known = None if located.covariance is None else located.covariance[span]
    return located.wrench[span], known, located.status[span], located.rows[span]
