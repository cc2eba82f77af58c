"""Handle the time of a log for scrubbing, and downsample curves over it to what a screen can show."""

from __future__ import annotations

from datetime import UTC, datetime
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.touch_finder import GAP, SHORTEST
from palpate.spatial.arguments import frozen_value, takes_arrays

LATE = 1e6  # s: a log that begins later does not begin near 0
_EPOCH = 1e9, 1e10  # s since 1970 that are a log's: 2001 to 2286


@frozen_value(eq=True)
class Timeline:
    """Seconds since the start of a log, one per sample, never running backwards.

    Attributes:
        clock: (n,) [s], from 0. A time that is missing or runs backwards is replaced by the latest before it; without
            any time the step is one second.
        touched: (n,) samples with a contact.
    """

    clock: Float[np.ndarray, " n"]
    touched: Bool[np.ndarray, " n"]

    @classmethod
    def of(cls, time: Float[np.ndarray, " n"], touched: Bool[np.ndarray, " n"]) -> Timeline:
        """Return the `Timeline` of recorded times (n,) [s] and touched samples (n,).

        Raises:
            InputError: arrays of other shapes.
        """
        known = np.isfinite(time)
        if not known.any():
            return cls(np.arange(float(len(time))), touched)
        reached = np.maximum.accumulate(np.where(known, time, -np.inf))
        start = float(time[known][0])
        return cls(np.maximum(reached, start) - start, touched)

    @property
    def duration(self) -> float:
        """Time of the last sample since the start [s]; 0 without samples."""
        return float(self.clock[-1]) if len(self.clock) else 0.0

    @cached_property
    def step(self) -> float:
        """Median time between samples [s]; 0 if there is none."""
        steps = np.diff(self.clock)
        steps = steps[steps > 0]
        return float(np.median(steps)) if len(steps) else 0.0

    @cached_property
    def seconds(self) -> Float[np.ndarray, " n"]:
        """Duration of each sample, (n,) [s]: until the next one, at most ten usual steps."""
        return np.minimum(np.diff(self.clock, append=self.duration + self.step), 10.0 * self.step)

    @cached_property
    def _spans(self) -> Int[np.ndarray, "m 2"]:
        """First and last sample of each touch, (m, 2), over gaps of `GAP`, at least `SHORTEST` long."""
        touched = np.flatnonzero(self.touched)
        if not len(touched):
            return np.zeros((0, 2), dtype=np.int64)
        clock = self.clock[touched]
        apart = np.flatnonzero(np.diff(clock) >= max(GAP, 1.5 * self.step))
        first, last = np.append(0, apart + 1), np.append(apart, len(touched) - 1)
        long = clock[last] - clock[first] + self.step >= SHORTEST
        spans: Int[np.ndarray, "m 2"] = np.stack([touched[first[long]], touched[last[long]]], axis=1)
        return spans

    @cached_property
    def touches(self) -> Int[np.ndarray, " m"]:
        """Number of the sample in the middle of each touch of at least 0.02 s, (m,)."""
        ends: Float[np.ndarray, "m 2"] = self.clock[self._spans]
        return np.searchsorted(self.clock, (ends[:, 0] + ends[:, 1]) / 2)

    @cached_property
    def in_touch(self) -> Int[np.ndarray, " k"]:
        """Numbers of the touched samples that belong to such a touch, (k,)."""
        touched = np.flatnonzero(self.touched)
        which = np.searchsorted(self._spans[:, 0], touched, side="right") - 1
        last = np.append(self._spans[:, 1], -1)[which]  # before the first touch: none
        inside: Int[np.ndarray, " k"] = touched[touched <= last]
        return inside

    def at(self, seconds: float) -> int:
        """Return the number of the last sample not later than a time [s] since the start; 0 before the first."""
        return max(0, int(np.searchsorted(self.clock, seconds + 1e-9, side="right")) - 1)

    def span(self, begin: float, end: float) -> slice:
        """Return the slice of the samples from one time to another, both included [s since the start]."""
        return slice(int(np.searchsorted(self.clock, begin)), int(np.searchsorted(self.clock, end, side="right")))


@takes_arrays
def next_of(among: Int[np.ndarray, " m"], index: int, step: int) -> int:
    """Return the next (step 1) or previous (-1) of sorted numbers (m,) after `index`; `index` if there is none.

    Raises:
        InputError: among has another shape.
    """
    which = np.searchsorted(among, index, side="right" if step > 0 else "left") + (0 if step > 0 else -1)
    return int(among[which]) if 0 <= which < len(among) else index


@takes_arrays
def since(time: Float[np.ndarray, " n"]) -> tuple[float, str]:
    """Return the time [s] from which a person counts times (n,) [s], and the words for it.

    These are 0 and "" for logs that start near 0, else the start and "after ...", with seconds since 1970 as a date in
    UTC.

    Raises:
        InputError: time has another shape.
    """
    start = float(np.floor(np.min(time, initial=np.inf, where=np.isfinite(time))))
    if not LATE < start < np.inf:
        return 0.0, ""
    if not _EPOCH[0] < start < _EPOCH[1]:
        return start, f"after {start:.0f}"
    return start, f"after {datetime.fromtimestamp(start, UTC):%Y-%m-%d %H:%M:%S} UTC"


@takes_arrays
def downsampled(
    clock: Float[np.ndarray, " n"], values: Float[np.ndarray, "n k"], most: int
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m k"]]:
    """Return times (m,) and values (m, k), at most `most` rows: the least and the largest of each run of samples.

    Args:
        clock: (n,) [s], not falling.
        values: (n, k); NaN where there is none.
        most: rows to keep; at least 2.

    Raises:
        InputError: arrays of other shapes.
    """
    if len(clock) <= most:
        return clock.copy(), values.copy()
    starts = np.unique(np.linspace(0, len(clock), max(1, most // 2), endpoint=False).astype(np.int64))
    ends = np.append(starts[1:], len(clock)) - 1
    least, largest = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    rising = values[ends] >= values[starts]  # or what comes first would be drawn last
    rows = np.stack([np.where(rising, least, largest), np.where(rising, largest, least)], axis=1)
    return np.stack([clock[starts], clock[ends]], axis=1).reshape(-1), rows.reshape(-1, values.shape[1])
