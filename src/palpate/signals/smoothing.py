"""Run a filter over a stream of samples: forward as they come, or forward and backward a little later."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int8

from palpate.errors import InputError
from palpate.signals.filters import Filter, Recursion
from palpate.spatial.arguments import takes_arrays

GAP_PERIODS, LEAST_GAP = 5, 0.05  # samples and s: clocks that stamp on arrival make smaller gaps of their own
SEGMENT = 4096  # wrenches that are filtered backward at a time, at least; of wider samples as many values

Values = Float[np.ndarray, "_ _"]
Numbers = Float[np.ndarray, " _"]
Status = Int8[np.ndarray, " _"]
T = TypeVar("T")


def known_rate(rate: float | None, of: str) -> float:
    """Return a rate [Hz] that is known; `of` names the samples in the message.

    Raises:
        InputError: the rate is None.
    """
    if rate is None:
        raise InputError(f"a filter needs the rate of the {of}.", hint="State rate in Hz.")
    return rate


def require_forward(filter: Filter | None) -> None:
    """Check that a filter, if there is one, needs no later samples.

    Raises:
        InputError: it is of zero phase.
    """
    if filter is not None and filter.zero_phase:
        raise InputError(
            "a filter of zero phase needs later samples, so it cannot answer sample by sample.",
            hint="Give the log to the estimator's stream, or use a Butterworth filter without zero_phase.",
        )


class Forward:
    """A filter that runs forward over samples as they come.

    It starts afresh where time steps back, or forward by more than 5 periods and 0.05 s; other samples count as evenly
    spaced. Samples with a status of 0 or more are skipped.

    Args:
        recursion: filter at this rate.
        rate: [Hz] of the samples.
        width: number of values in a sample.
    """

    def __init__(self, recursion: Recursion, rate: float, width: int = 6) -> None:
        from palpate.signals import _filters  # compiled: loaded when first needed

        self._smooth, self.shares = _filters.smooth, recursion.share.copy()
        self._made = tuple(part.copy() for part in (recursion.sections, recursion.start, recursion.gains))  # writable
        self._gap = max(GAP_PERIODS / rate, LEAST_GAP)
        self._state = np.zeros((max(1, 2 * len(recursion.sections)), width))
        self._clock = np.zeros(2)
        self.reset()

    @property
    def parts(self) -> tuple[object, ...]:
        """Tuple of the arguments of `_filters.smooth` between the samples and the ages."""
        return (*self._made, self._gap, self._clock, self._state)

    @property
    def constants(self) -> tuple[np.ndarray, ...]:
        """Arrays that stay: sections, start, gains, gap and shares."""
        return (*self._made, np.array([self._gap]), self.shares)

    @property
    def memory(self) -> tuple[np.ndarray, np.ndarray]:
        """Arrays that samples change: clock (2,) and state (a, width)."""
        return self._clock, self._state

    def reset(self) -> None:
        """Forget all samples."""
        self._clock[:], self._state[:] = (-1.0, np.nan), 0.0

    def __call__(self, time: Float[np.ndarray, " n"], status: Int8[np.ndarray, " n"], values: Values) -> np.ndarray:
        """Filter samples (n, width) whose status is below 0, in place.

        Return their ages (n,), int64: the number of samples since the filter started, -1 for the others.
        """
        age = np.empty(len(values), dtype=np.int64)
        self._smooth(time, status, values, *self.parts, age)
        return age

    @takes_arrays
    def starts(self, time: Float[np.ndarray, " n"], status: Int8[np.ndarray, " n"]) -> np.ndarray:
        """Return the ages (n,), int64, that samples would get, without filtering them.

        Raises:
            InputError: time has another shape.
        """
        clock, state = self._clock.copy(), self._state.copy()
        age = self(time, status, np.zeros((len(time), self._state.shape[1])))
        self._clock[:], self._state[:] = clock, state
        return age

    @takes_arrays
    def share(self, age: np.ndarray) -> Float[np.ndarray, " n"]:
        """Return the share (n,) of white noise's variance that remains at each age; meaningless for age -1."""
        return self.shares[np.minimum(age, len(self.shares) - 1)]

    @takes_arrays
    def gapless(self, values: Values) -> Values:
        """Filter samples (n, width) that all count as evenly spaced, in place, and return them."""
        self(np.full(len(values), np.nan), np.full(len(values), -1, np.int8), values)
        return values


class BothWays:
    """A filter that runs forward and backward, as if the first and last sample of a run had been there for ever.

    A run ends where `Forward` starts afresh. Results do not depend on how the stream is cut.

    With r the autocorrelation of the forward response, sample k of a run 0 ... e is the sum of r_{k-i} x_i, the first
    and last x carrying all of the weight beyond them: a share of sum r^2 + edge(k) + edge(e - k) of the noise remains,
    edge(m) = (sum of r_j, j >= m)^2 - (sum of r_j^2, j >= m).

    Args:
        recursion: filter at this rate.
        rate: [Hz] of the samples.
        width: number of values in a sample.
    """

    def __init__(self, recursion: Recursion, rate: float, width: int = 6) -> None:
        from scipy.signal import correlate

        self._forward, self._backward = (Forward(recursion, rate, width) for _ in range(2))
        response = recursion.response
        self._settled = len(response)
        self._segment = max(SEGMENT * 6 // width, self._settled)
        both = correlate(response, response)[self._settled - 1 :]
        squares = both**2
        self._inside = float(2.0 * squares.sum() - squares[0])
        self._edge = np.append(both[::-1].cumsum()[::-1] ** 2 - squares[::-1].cumsum()[::-1], 0.0)
        self._last = np.zeros(width)
        self._parts: list[Values] = []  # of the run, filtered forward
        self._emitted = 0  # samples of the run that are done
        self._done = [np.zeros((0, width + 1))]  # values, and share of the noise

    @property
    def least(self) -> float:
        """Least share of white noise's variance that remains in any sample of a run."""
        return self._inside + 2.0 * min(float(self._edge.min()), 0.0)

    def through(self, items: Iterable[tuple[T, Numbers, Status, Values]]) -> Iterator[tuple[T, Values, Numbers]]:
        """Filter items in their order, and yield each once all of its samples are filtered.

        Args:
            items: anything, with the times (n,) [s], statuses (n,) and values (n, width) of its samples; those whose
                status is below 0 are filtered in place.

        Yields:
            the same item, its values (n, width), and the share (n,) of white noise's variance that remains.
        """
        waiting = deque[tuple[T, Status, Values]]()
        for what, time, status, values in items:
            self._push(time, status, values)
            waiting.append((what, status, values))
            yield from self._served(waiting)
        self._finish()
        yield from self._served(waiting)

    def _served(self, waiting: deque[tuple[T, Status, Values]]) -> Iterator[tuple[T, Values, Numbers]]:
        while waiting and sum(map(len, self._done)) >= np.count_nonzero(waiting[0][1] < 0):
            what, status, values = waiting.popleft()
            good, share = status < 0, np.ones(len(status))
            count, done = int(np.count_nonzero(good)), np.concatenate(self._done)
            values[good], share[good] = done[:count, :-1], done[:count, -1]
            self._done = [done[count:]]
            yield what, values, share

    def _push(self, time: np.ndarray, status: np.ndarray, values: Values) -> None:
        """Add samples to those to filter, without changing them."""
        good = status < 0
        time, status, values = time[good], status[good], values[good]
        for part in np.split(np.arange(len(time)), np.flatnonzero(self._forward.starts(time, status) == 0)):
            if len(part):
                self._extend(time[part], status[part], values[part])

    def _finish(self) -> None:
        """End the run, as no more samples of it come."""
        if not self._parts:
            return
        rows = np.concatenate(self._parts)
        after = self._forward.gapless(np.repeat(self._last[None], self._settled, axis=0))
        done = self._reversed(np.concatenate([rows, after]))[: len(rows)]
        left = np.arange(len(rows))[::-1]
        share = np.ones(1) if self._emitted + len(rows) == 1 else self._share(len(rows)) + self._edges(left)
        self._done.append(np.column_stack([done, share]))
        self._parts, self._emitted = [], 0

    def _extend(self, time: np.ndarray, status: np.ndarray, values: Values) -> None:
        """Add samples of one run."""
        if self._forward.starts(time[:1], status[:1])[0] == 0:
            self._finish()
        self._last = values[-1].copy()
        self._forward(time, status, values)
        self._parts.append(values)
        needed = self._segment + self._settled
        if sum(map(len, self._parts)) >= needed:
            rows = np.concatenate(self._parts)
            while len(rows) >= needed:
                done = self._reversed(rows[:needed])[: self._segment]
                self._done.append(np.column_stack([done, self._share(self._segment)]))
                rows = rows[self._segment :]
                self._emitted += self._segment
            self._parts = [rows]

    def _reversed(self, rows: Values) -> Values:
        """Return rows filtered from the last to the first."""
        self._backward.reset()
        return self._backward.gapless(rows[::-1].copy())[::-1]

    def _share(self, count: int) -> Float[np.ndarray, " n"]:
        """Return the noise's share in the next `count` samples, far from the run's end."""
        return self._inside + self._edges(self._emitted + np.arange(count))

    def _edges(self, steps: np.ndarray) -> Float[np.ndarray, " n"]:
        return self._edge[np.minimum(steps, self._settled)]
