"""Watch a stream of wrenches for a sensor that hangs, or a channel that stands still."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.files.logs.stuck import StuckWrenches

__all__: list[str] = []  # for this package alone: arrays are checked where they come in

EVERY = 0.1  # s between two looks, each of which takes as long as many samples
MOST = 1000  # samples that wait for one


class StuckWatch:
    """Watch of the wrenches of a stream, which looks at them ten times a second.

    Args:
        limits: (6,) as recorded, at which a channel is saturated and may stand; None: unknown.

    Attributes:
        stuck: what does not change, in words; "" while all do.
    """

    def __init__(self, limits: Float[np.ndarray, "6"] | None = None) -> None:
        self.stuck = ""
        self._finder = StuckWrenches(limits)
        self._time, self._wrenches, self._count = np.empty(MOST), np.empty((MOST, 6)), 0

    def add(self, time: Float[np.ndarray, " n"], wrenches: Float[np.ndarray, "n 6"]) -> str:
        """Add wrenches (n, 6) as recorded at times (n,) [s], and return an event, a sentence, or ""."""
        first, self._count = self._count, self._count + len(time)
        if self._count < MOST:
            self._time[first : self._count], self._wrenches[first : self._count] = time, wrenches
            if abs(time[-1] - self._time[0]) < EVERY:
                return ""
            time, wrenches, first = self._time[: self._count], self._wrenches[: self._count], 0
        self._finder.find(
            np.concatenate([self._time[:first], time]), np.concatenate([self._wrenches[:first], wrenches])
        )
        self._count = 0
        before, self.stuck = self.stuck, self._finder.stuck
        if self.stuck and self.stuck != before:
            return f"{self.stuck} does not change: contacts are invalid until it does"
        return f"{before} changes again" if before and not self.stuck else ""
