"""Locate the samples of a log in several threads."""

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
    """Consecutive samples that one thread locates.

    Args:
        start: the memory to begin with, or the run that this one continues.
        locator, pool: the locator, and the threads in which it runs.

    Attributes:
        parts: the samples; none are added once a thread has begun.
        done: the memory to come; None until a thread has begun.
    """

    def __init__(self, start: _Memory | _Run, locator: Locator, pool: ThreadPoolExecutor) -> None:
        self._start, self._locator, self._pool = start, locator, pool
        self.parts = list[_Part]()
        self.done: Future[_Memory] | None = None

    def begin(self) -> Future[_Memory]:
        """Start a thread, after that of the run which this one continues: no thread waits for a later one."""
        if self.done is None:
            self.done = self._pool.submit(self._located)
        return self.done

    def memory(self) -> _Memory:
        """Return the memory after the last sample; wait until it is located."""
        return self.begin().result()

    def _located(self) -> _Memory:
        memory = self._start.memory() if isinstance(self._start, _Run) else self._start
        for part in self.parts:
            self._locator.run_into(*part, memory=memory)
        self.parts, self._start = [], memory  # a chain of runs keeps no samples
        return memory


class Pending(NamedTuple):
    """Samples that are being located, with the runs that contain them."""

    located: Located
    runs: tuple[_Run, ...]

    def result(self) -> Located:
        """Wait until the samples are located, and return them as `Located`."""
        for run in self.runs:
            run.memory()
        return self.located


class LocatingThreads:
    """Threads that run `Locator.run_into` on the pieces of a log in order, with results identical to the last bit.

    A thread takes the samples between two without contact, which may depend on each other; fewer of a long touch, and
    if their result is requested earlier.

    Args:
        locator: its memory is continued, and is that of the last sample after `finish`.
        threads: number of threads at a time.
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
        """Begin to locate the next n samples, given as to `Locator.run_into`; return a `Pending` to wait for.

        Raises:
            InputError: other shapes.
        """
        located = Located(piece, wrenches, covariances, statuses, self._locator.empty(len(wrenches)))
        cut = self._locator.first_free(wrenches, covariances, statuses) + 1
        if self._run.done is not None:
            self._run = self._run_from(self._run)
        runs = [self._run]
        self._run.parts.append(_part(located, slice(0, cut or None)))
        if cut:
            self._run.begin()
            self._run = self._run_from(self._locator.no_contact())
            self._run.parts.append(_part(located, slice(cut, None)))
            runs.append(self._run)
        elif sum(len(rows) for *_, rows in self._run.parts) >= LONG:
            self._run.begin()
        return Pending(located, tuple(runs))

    def finish(self) -> None:
        """Wait until the last sample is located, and write its memory into the locator's `memory`."""
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
    """Yield (`Piece`, `Located`) in order, located by threads while the next pieces are measured."""
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
