"""Average the wrenches of one topic about the times of the rows of another."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays
from palpate.spatial.stamped_rows import SLACK, StampedRows


@takes_arrays
class WrenchMeans(StampedRows):
    """Wrenches that are added in pieces, and averaged about the times of rows, in order.

    A row's mean is over the readings within half a step to either side, each used once; without any, the wrench is
    interpolated linearly.

    Args:
        max_gap: [s] largest gap between neighbours that is interpolated, and the longest step between rows.
        limits: (6,) as recorded, at which a reading is saturated: it replaces a mean that includes it.
    """

    def __init__(self, max_gap: float = 0.25, limits: Float[np.ndarray, "6"] | None = None) -> None:
        super().__init__(7, max_gap)
        self.unanswered = self.rows = 0
        self._limits = np.full(6, np.inf) if limits is None else limits
        self._last = np.nan  # the row before
        self._step = 0.0  # between rows, the last that was no gap

    def add(self, time: Float[np.ndarray, " n"], wrenches: Float[np.ndarray, "n 6"]) -> None:
        """Add readings (n, 6) at times (n,) [s]; one that is not finite, or not newer than all before, is dropped.

        Raises:
            InputError: arrays of other shapes.
        """
        stamped = np.column_stack([time, wrenches])
        self._append(stamped[np.isfinite(stamped).all(axis=1)])

    def answerable(self, time: Float[np.ndarray, " n"]) -> int:
        """Return how many of the next rows, at times (n,) [s], have means that later readings cannot change.

        Raises:
            InputError: time has another shape.
        """
        return self._before_waiting(time + self._halves(time)[0] > self._newest)

    def means(self, time: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 1"]]:
        """Return the wrenches of the next rows, at times (n,) [s], and the numbers of readings averaged, (n, 1).

        Wrenches are (n, 6) as recorded, NaN if unknown; the number is 0 if one was interpolated or is unknown.

        Raises:
            InputError: time has another shape.
        """
        halves, self._step = self._halves(time)
        known = time[np.isfinite(time)]
        self._last = float(known[-1]) if len(known) else self._last
        kept = self._gathered()
        stamps, values = kept[:, 0], kept[:, 1:]
        first = np.searchsorted(stamps, time - halves, side="right")
        end = np.searchsorted(stamps, time + halves, side="right")
        counts = np.where(np.isfinite(time), end - first, 0)
        made = self._between(time, stamps, values)
        made[counts > 0] = self._mean(values, first[counts > 0], counts[counts > 0])
        self.rows += len(time)
        self.unanswered += int(np.count_nonzero(np.isnan(made[:, 0])))
        return made, counts[:, None].astype(np.float64)

    def forget(self, before: float) -> None:
        """Drop the readings that rows at `before` [s] and later do not need."""
        self._drop(int(np.searchsorted(self._gathered()[:, 0], before - self.max_gap - SLACK)) - 1)

    def notes(self) -> tuple[str, ...]:
        """Return notes on late wrenches and on rows without one, one sentence each."""
        said = (
            (self.late, f"{self.late} wrenches have times that are not later than the one before, and were left out"),
            (self.unanswered, f"{self.unanswered} of {self.rows} rows have no wrench within {self.max_gap:g} s"),
        )
        return tuple(sentence for count, sentence in said if count)

    def _halves(self, time: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], float]:
        """Return half the step to each row [s], after a gap that before it; and the last step."""
        halves, step, last = np.zeros(len(time)), self._step, self._last
        for k, now in enumerate(time.tolist()):
            passed = now - last
            if 0 < passed <= self.max_gap + SLACK:
                step = passed
            last = last if np.isnan(now) else now
            halves[k] = step / 2
        return halves, step

    def _mean(
        self, values: Float[np.ndarray, "k 6"], first: Int[np.ndarray, " n"], counts: Int[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n 6"]:
        """Return the means of `counts` readings from `first` on; or the first saturated one."""
        made = np.zeros((len(first), 6))
        for k in range(int(counts.max(initial=0))):
            more = counts > k
            made[more] += values[first[more] + k]
        made /= counts[:, None]
        saturated = np.append(np.flatnonzero((np.abs(values) >= self._limits).any(axis=1)), len(values))
        at = saturated[np.searchsorted(saturated, first)]
        within = at < first + counts
        made[within] = values[at[within]]
        return made

    def _between(
        self, time: Float[np.ndarray, " n"], stamps: Float[np.ndarray, " k"], values: Float[np.ndarray, "k 6"]
    ) -> Float[np.ndarray, "n 6"]:
        """Interpolate linearly between the neighbours of each row; NaN over longer gaps."""
        if len(stamps) < 2:
            return np.full((len(time), 6), np.nan)
        after = np.clip(np.searchsorted(stamps, time, side="left"), 1, len(stamps) - 1)
        gap = stamps[after] - stamps[after - 1]
        share = (time - stamps[after - 1]) / gap
        near = (share >= 0) & (share <= 1) & (gap <= self.max_gap + SLACK)
        line = values[after - 1] + share[:, None] * (values[after] - values[after - 1])
        return np.where(near[:, None], line, np.nan)
