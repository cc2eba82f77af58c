"""Find wrenches that no sensor measured: stretches that do not change, exact zeros, and channels that stand still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from palpate.spatial.arguments import takes_arrays

FIRST = 1000  # rows that differ from the one before, which decide what is usual in a log,
LATEST = 1 << 13  # unless they are not among so many rows
FEWEST = 100  # rows without which nothing is noted; and rows for which a dead channel stands while others change
SHORTEST = 10  # rows of a stretch that does not change,
LONGER = 20.0  # and how many times the usual number of rows between two changes it must last
TURNS = 0.4  # share of second differences that change their sign: 2/3 of white noise, few of a signal without noise
FINE = 3.0  # quanta of a channel in its usual step
NOISY = 3  # channels with noise, without which a log is made up and may stand still
KNOWN = 10  # changes of a channel that show its quanta
SHOWN = 3  # stretches with a note of their own
_EDGE = np.array([True])


@dataclass
class _Stretch:
    """Rows that do not change: first and last time [s], number, the channel (None: all six) and its value."""

    start: float
    end: float
    rows: int
    channel: int | None
    value: float
    whole: bool  # from the log's first row to the last so far

    @property
    def called(self) -> str:
        """Words for what does not change."""
        if self.channel is None:
            return "the wrench"
        return f"{'xyz'[self.channel % 3]} of the {'torque' if self.channel > 2 else 'force'}"

    def note(self) -> str:
        rows = f"from {self.start:.3f} s to {self.end:.3f} s ({self.rows:,} rows)"
        if self.channel is None:
            return (
                f"the wrench {'does not change' if self.value else 'is exactly zero'} {rows}: these samples are invalid"
            )
        named = f"{self.called} is {self.value:g}"
        where, which = ("in all rows", "the") if self.whole else (rows, "these")
        return f"{named} {where} while others change: it is dead or not measured, so {which} samples are invalid"


@dataclass
class _Run:
    """The latest rows in which a channel (None: all six) did not change.

    Attributes:
        least: rows, of those that count, from which on it is stuck.
        once: whether it is never stuck again after a change.
        open: whether it is stuck at the last row that has an answer.
        stretch: the note on it.
    """

    channel: int | None
    least: float
    once: bool = False
    open: bool = False
    stretch: _Stretch | None = None

    def spans(self, same: Bool[np.ndarray, " n"], counted: Bool[np.ndarray, " n"]) -> tuple[list[list[int]], int]:
        """Return [start, end) of each stretch that is stuck, and the row from which on later rows decide."""
        if not (self.open and same[0]):
            self.close()
        edges = np.flatnonzero(np.concatenate([_EDGE, ~same[1:], _EDGE]))
        if not self.open and np.diff(edges).max() < self.least:
            return [], int(edges[-2])
        starts, ends, total = edges[:-1], edges[1:], np.append(0, np.cumsum(counted))
        stuck = total[ends] - total[starts] >= self.least
        stuck[0] |= self.open
        return np.stack([starts, ends], axis=1)[stuck].tolist(), len(same) if stuck[-1] else int(starts[-1])

    @property
    def columns(self) -> slice:
        return slice(0, 6) if self.channel is None else slice(self.channel, self.channel + 1)

    def close(self) -> None:
        self.open = False
        if self.stretch is not None:
            self.stretch.whole, self.stretch = False, None


@takes_arrays
class StuckWrenches:
    """Finder of wrenches that do not change, in a log whose other wrenches have noise.

    Blocks of any size give the same answers. A log without noise, such as of a simulation, may stand still: nothing is
    found in it.

    Args:
        limits: (6,) as recorded, at which a channel is saturated and may stand; None: unknown.
    """

    def __init__(self, limits: Float[np.ndarray, "6"] | None = None) -> None:
        self._limits = np.full(6, np.inf) if limits is None else limits
        self._time: np.ndarray = np.zeros(0)  # of rows without an answer
        self._wrench: np.ndarray = np.zeros((0, 6))  # in these rows,
        self._last: np.ndarray = np.full((1, 6), np.nan)  # in the row before,
        self._known: np.ndarray = self._last  # and the last number of each channel before
        self._begun = False
        self._runs: list[_Run] | None = None  # not known yet
        self._found: list[_Stretch] = []

    def find(
        self, time: Float[np.ndarray, " n"], wrench: Float[np.ndarray, "n 6"], *, complete: bool = False
    ) -> Bool[np.ndarray, " m"]:
        """Add the next rows; return a mask of all rows without an answer so far that later rows cannot change.

        Args:
            time: (n,) [s].
            wrench: (n, 6) as recorded.
            complete: whether no more rows follow.

        Returns:
            (m,) True where no sensor measured the row.

        Raises:
            InputError: arrays of other shapes.
        """
        self._time, self._wrench = np.concatenate([self._time, time]), np.concatenate([self._wrench, wrench])
        wrench = self._wrench
        same = (wrench == np.concatenate([self._last, wrench[:-1]])).all(axis=1)
        if self._runs is None:
            decisive = np.flatnonzero(~same)[FIRST - 1 : FIRST]
            enough = min(LATEST, int(decisive[0]) + 1 if len(decisive) else LATEST)
            if len(wrench) < enough and not complete:
                return np.zeros(0, dtype=bool)
            self._runs = _runs(wrench[:enough], same[:enough])
        if not len(wrench):
            return np.zeros(0, dtype=bool)
        finite = np.isfinite(wrench)
        numbers, stuck = _filled(self._known, wrench, finite), np.zeros(len(wrench), dtype=bool)
        counted = ~same & finite.all(axis=1)
        ready, spans = len(wrench), list[list[list[int]]]()
        for run in self._runs:
            whole = run.channel is None
            repeated = same if whole else self._repeated(run, numbers, stuck)
            found, decided = run.spans(repeated, ~stuck if whole else counted)
            spans.append(found)
            ready = ready if complete else min(ready, decided)
            for start, end in found if run.channel is None else ():
                stuck[start:end] = True
        stuck[:] = False
        for run, found in zip(self._runs, spans, strict=True) if ready else ():
            for start, end in found:
                stuck[self._noted(run, start, end, ready) : min(end, ready)] = True
            run.open = any(start < ready <= end for start, end in found)
        if ready:
            self._runs = [run for run in self._runs if not (run.once and _changed(run, numbers[: ready + 1]).any())]
            self._last, self._known, self._begun = (
                wrench[ready - 1 : ready].copy(),
                numbers[ready : ready + 1].copy(),
                True,
            )
        self._time, self._wrench = self._time[ready:].copy(), wrench[ready:].copy()
        return stuck[:ready]

    @property
    def stuck(self) -> str:
        """Words for what does not change at the last row with an answer; "" if all do."""
        called = [run.stretch.called for run in self._runs or () if run.open and run.stretch is not None]
        return " and ".join(called)

    def notes(self) -> tuple[str, ...]:
        """Return notes on what was found so far, one sentence each."""
        found = sorted(self._found, key=lambda each: (each.channel is None, each.start, each.channel or 0))
        more = found[SHOWN:]
        said = [f"{len(more)} more such stretches, of {sum(each.rows for each in more):,} rows, are invalid"]
        return (*(each.note() for each in found[:SHOWN]), *(said if more else []))

    def _repeated(
        self, run: _Run, numbers: Float[np.ndarray, "m 6"], stuck: Bool[np.ndarray, " n"]
    ) -> Bool[np.ndarray, " n"]:
        """Return which rows repeat the value of the run's channel."""
        now, before = (rows[:, run.columns][:, 0] for rows in (numbers[1:], numbers[:-1]))
        repeated = (now == before) & ~stuck & ~(np.abs(now) >= self._limits[run.columns])
        return repeated & ~np.logical_or.accumulate(_changed(run, numbers)) if run.once else repeated

    def _noted(self, run: _Run, start: int, end: int, ready: int) -> int:
        """Note a stretch that is stuck, as far as it has an answer, and return its first row that was not measured."""
        begins = start == 0 and not self._begun and run.channel is not None
        value: np.ndarray = self._wrench[start, run.columns]
        goes_on = start == 0 and run.open
        first, last = start + int(not goes_on and not begins and bool(value.any())), min(end, ready)
        if first >= last:
            return last
        if not goes_on:
            run.close()
        if run.stretch is None:
            shown = float(value[np.argmax(np.abs(value))])
            run.stretch = _Stretch(float(self._time[first]), 0.0, 0, run.channel, shown, begins)
            self._found.append(run.stretch)
        run.stretch.end, run.stretch.rows = float(self._time[last - 1]), run.stretch.rows + last - first
        run.stretch.whole &= last == len(self._time) or last < end
        return first


def _changed(run: _Run, numbers: Float[np.ndarray, "m 6"]) -> Bool[np.ndarray, " n"]:
    """Return which rows have another value in the run's channel than the row before."""
    now, before = (rows[:, run.columns][:, 0] for rows in (numbers[1:], numbers[:-1]))
    return (now != before) & np.isfinite(before) & np.isfinite(now)


def _filled(
    known: Float[np.ndarray, "1 6"], wrench: Float[np.ndarray, "n 6"], finite: Bool[np.ndarray, "n 6"]
) -> Float[np.ndarray, "m 6"]:
    """Return the known numbers, then each row with the last number of a channel where it has none."""
    values = np.concatenate([known, wrench])
    if finite.all():
        return values
    rows = np.where(np.isfinite(values), np.arange(len(values))[:, None], 0)
    return np.take_along_axis(values, np.maximum.accumulate(rows, axis=0), axis=0)


def _runs(wrench: Float[np.ndarray, "n 6"], same: Bool[np.ndarray, " n"]) -> list[_Run]:
    """Return the runs in which a log that begins with these rows may be stuck, that of the wrench first."""
    usual = _usual(wrench, same)
    if not np.isfinite(usual):
        return []
    known = wrench[~same & np.isfinite(wrench).all(axis=1)]
    with np.errstate(over="ignore"):
        steps = [each[each > 0] for each in np.abs(np.diff(known, axis=0)).T]
    alive, fine = np.array([len(each) > 0 for each in steps]), np.array([_fine(each) for each in steps])
    found = [_Run(None, max(SHORTEST, LONGER * usual))]
    for kind in (slice(0, 3), slice(3, 6)):
        others = fine[kind][alive[kind]] if alive[kind].any() else fine[alive]
        for channel in np.arange(6)[kind]:
            if fine[channel] if alive[channel] else others.all():
                found.append(_Run(int(channel), float(FEWEST), once=not alive[channel]))
    return found


def _usual(wrench: Float[np.ndarray, "n 6"], same: Bool[np.ndarray, " n"]) -> float:
    """Return the usual number of rows between two changes; inf of a log that is short or without noise."""
    changed = np.flatnonzero(~same)
    if len(wrench) < FEWEST or len(changed) < FEWEST // 2:
        return np.inf
    with np.errstate(over="ignore", invalid="ignore"):
        bends = np.sign(np.diff(wrench[changed], 2, axis=0))
    bends = bends[np.isfinite(bends).all(axis=1)]
    turns = (bends[1:] * bends[:-1] < 0).mean(axis=0) if len(bends) > 1 else np.zeros(6)
    return float(np.median(np.diff(changed))) if np.count_nonzero(turns > TURNS) >= NOISY else np.inf


def _fine(steps: Float[np.ndarray, " k"]) -> bool:
    """Return whether the usual step of a channel is several of its quanta: a coarse channel may rest by chance."""
    return len(steps) >= KNOWN and bool(np.median(steps) > FINE * steps.min())
