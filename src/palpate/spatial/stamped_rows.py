"""Rows of numbers with stamps that come in pieces, as far as answers still need them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

SLACK = 1e-6  # s: seconds since 1970 are only good to a quarter of this in float64, and must not open a gap


class StampedRows:
    """Base class of what answers at times between rows, which are added in pieces, their stamps rising.

    Args:
        width: numbers of a row, the stamp [s] first.
        max_gap: [s] between neighbours, beyond which there is no answer between them.

    Attributes:
        late: number of rows left out because their stamp was not newer than an earlier one.
    """

    def __init__(self, width: int, max_gap: float) -> None:
        self.max_gap, self.late = max_gap, 0
        self._rows = np.zeros((0, width))
        self._fresh: list[np.ndarray] = []  # pieces not yet in _rows: they may come row by row
        self._newest = -np.inf
        self._complete = False

    def complete(self) -> None:
        """Declare that no more rows will come: `answerable` then counts all times."""
        self._complete = True

    def _append(self, rows: Float[np.ndarray, "n w"]) -> None:
        """Add rows; one whose stamp is not newer than all before is only counted."""
        reached = np.maximum.accumulate(np.append(self._newest, rows[:, 0]))
        newer = rows[:, 0] > reached[:-1]
        self.late += int(np.count_nonzero(~newer))
        self._newest = float(reached[-1])
        self._fresh.append(rows[newer])

    def _before_waiting(self, waits: Bool[np.ndarray, " n"]) -> int:
        """Return how many come before the first that waits for later rows; all, once complete."""
        return len(waits) if self._complete or not waits.any() else int(waits.argmax())

    def _drop(self, first: int) -> None:
        """Drop the rows before this one."""
        if first > 0:
            self._rows = self._rows[first:].copy()

    def _gathered(self) -> Float[np.ndarray, "k w"]:
        """Return all rows that are kept."""
        if self._fresh:
            self._rows = np.concatenate([self._rows, *self._fresh])
            self._fresh = []
        return self._rows
