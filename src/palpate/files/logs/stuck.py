"""Find wrenches that no sensor measured: stretches that do not change, exact zeros, and channels that never change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from palpate.spatial.arguments import takes_arrays

FEWEST = 100  # rows without which nothing is said
SHORTEST = 10  # rows of a stretch that does not change,
LONGER = 20.0  # and how many times the usual number of rows between two changes it must last
TURNS = 0.4  # share of second differences that change their sign: 2/3 of white noise, few of a signal without noise
FINE = 3.0  # quanta of a channel in its usual step
NOISY = 3  # channels with noise, without which a log is made up and may stand still


@dataclass
class _Stretch:
    """A stretch of rows that do not change: first and last time [s], rows, and whether it is all zeros."""

    start: float
    end: float
    rows: int
    zero: bool


@takes_arrays
class StuckWrenches:
    """Finder of wrenches that do not change, block by block, in a log whose other wrenches have noise.

    A log without noise, such as of a simulation, may stand still: nothing is found in it.
    """

    def __init__(self) -> None:
        self._last = np.full((1, 6), np.nan)
        self._run = 0  # rows before this block that equal the last one
        self._usual: float | None = None  # rows between two changes; None: not known yet, inf: a log without noise
        self._dead: dict[int, float] = {}  # channel that never changes -> its value
        self._revived: dict[int, tuple[float, float]] = {}  # one that changed later -> its value, and since when [s]
        self._found: list[_Stretch] = []

    def find(self, time: Float[np.ndarray, " n"], wrench: Float[np.ndarray, "n 6"]) -> Bool[np.ndarray, " n"]:
        """Return a mask (n,) of the next rows that no sensor measured.

        Args:
            time: (n,) [s].
            wrench: (n, 6) as recorded.

        Raises:
            InputError: arrays of other shapes.
        """
        stuck = np.zeros(len(wrench), dtype=bool)
        if not len(wrench):
            return stuck
        same = (wrench == np.concatenate([self._last, wrench[:-1]])).all(axis=1)
        if self._usual is None:
            self._usual = _usual(wrench, same)
            self._dead = _dead(wrench) if np.isfinite(self._usual) else {}
        starts = np.flatnonzero(~same | (np.arange(len(same)) == 0))
        for start, end in zip(starts, np.append(starts[1:], len(same)), strict=True):
            before = self._run + 1 if start == 0 and same[0] else 0
            if before + end - start >= max(SHORTEST, LONGER * self._usual):
                zero = not wrench[start].any()
                first = start + (before == 0 and not zero)  # the first row of a stretch was measured
                stuck[first:end] = True
                self._note(time[first:end], zero=zero, goes_on=before > 0)
        self._run = int(len(same) - 1 - starts[-1]) + (self._run + 1 if len(starts) == 1 and same[0] else 0)
        self._last = wrench[-1:].copy()
        for channel, value in list(self._dead.items()):
            other = (wrench[:, channel] != value) & np.isfinite(wrench[:, channel])
            if other.any():
                self._revived[channel] = self._dead.pop(channel), float(time[0])
        return stuck | bool(self._dead)

    def notes(self) -> tuple[str, ...]:
        """Return notes on what was found so far, one sentence each."""
        said = [
            f"{_named(channel)} is {value:g} in all rows while others "
            "change: it is dead or not measured, so the samples are invalid"
            for channel, value in self._dead.items()
        ]
        said += [
            f"{_named(channel)} is {value:g} in all rows before {since:.3f} s while others change: it is dead or not "
            "measured there, so these samples are invalid"
            for channel, (value, since) in self._revived.items()
        ]
        said += [
            f"the wrench {'is exactly zero' if each.zero else 'does not change'} from {each.start:.3f} s to "
            f"{each.end:.3f} s ({each.rows:,} rows): these samples are invalid"
            for each in self._found[:3]
        ]
        more = self._found[3:]
        rows = sum(each.rows for each in more)
        return (*said, *([f"{len(more)} more such stretches, of {rows:,} rows, are invalid"] if more else []))

    def _note(self, time: np.ndarray, *, zero: bool, goes_on: bool) -> None:
        if not len(time):
            return
        if goes_on and self._found:
            self._found[-1].end, self._found[-1].rows = float(time[-1]), self._found[-1].rows + len(time)
        else:
            self._found.append(_Stretch(float(time[0]), float(time[-1]), len(time), zero))


def _named(channel: int) -> str:
    return f"{'xyz'[channel % 3]} of the {'torque' if channel > 2 else 'force'}"


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


def _dead(wrench: Float[np.ndarray, "n 6"]) -> dict[int, float]:
    """Return the channels that never change, and their values, where others resolve their noise."""
    known = wrench[np.isfinite(wrench).all(axis=1)]
    constant = (known == known[:1]).all(axis=0)
    found: dict[int, float] = {}
    for kind in (slice(0, 3), slice(3, 6)):
        alike = known[:, kind][:, ~constant[kind]]
        if _resolved(alike if alike.shape[1] else known[:, ~constant]):
            channels = np.arange(6)[kind][constant[kind]]
            found |= {int(channel): float(known[0, channel]) for channel in channels}
    return found


def _resolved(values: Float[np.ndarray, "n k"]) -> bool:
    """Return whether the usual step of each channel is several of its quanta: a coarse channel may rest by chance."""
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.abs(np.diff(values, axis=0))
    return all(np.median(each) > FINE * each[each > 0].min(initial=np.inf) for each in steps.T)
