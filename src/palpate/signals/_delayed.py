"""Add columns to the blocks of a log that are known some rows later."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from palpate.signals.recording import Recording


class HeldRows:
    """The latest blocks of a log, whose rows are counted from the first of the log.

    Attributes:
        count: number of rows so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._blocks: deque[tuple[int, Recording]] = deque()

    def add(self, block: Recording) -> None:
        """Add the next block."""
        self._blocks.append((self.count, block))
        self.count += len(block)

    def values(
        self, first: int, end: int, of: Callable[[Recording, slice], np.ndarray], every: int = 1
    ) -> Float[np.ndarray, "n ..."]:
        """Return what `of` returns of each block and its rows, every `every`-th one from `first` to before `end`."""
        parts: list[np.ndarray] = []
        for start, block in self._blocks:
            skipped = max(first - start, -(start - first) % every)
            if skipped < min(end - start, len(block)) or not parts:
                parts.append(of(block, slice(skipped, max(end - start, 0), every)))
        return np.concatenate(parts)

    def forget(self, first: int) -> None:
        """Forget the blocks that end before the row `first`, but for the last one."""
        while len(self._blocks) > 1 and self._blocks[1][0] <= first:
            self._blocks.popleft()


def with_columns(
    blocks: Iterator[Recording],
    columns: Callable[[Iterator[Recording]], Iterator[Float[np.ndarray, "m c"]]],
    added: Callable[[Recording, Float[np.ndarray, "n c"]], Recording],
    width: int,
) -> Iterator[Recording]:
    """Yield the blocks, each as soon as the columns of its rows are known.

    Args:
        blocks: of a log.
        columns: yields the new columns of the rows of blocks, in pieces of any size.
        added: returns a block with its columns.
        width: number of new columns.
    """
    waiting: deque[Recording] = deque()
    ready = np.zeros((0, width))

    def taken() -> Iterator[Recording]:
        for block in blocks:
            waiting.append(block)
            yield block

    for found in columns(taken()):
        ready = np.concatenate([ready, found])
        while waiting and len(ready) >= len(waiting[0]):
            block = waiting.popleft()
            yield added(block, ready[: len(block)])
            ready = ready[len(block) :]
    for block in waiting:  # without rows
        yield added(block, ready)
