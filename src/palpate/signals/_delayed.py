"""Add columns to the blocks of a log that are known some rows later."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from palpate.signals.recording import Recording

__all__ = ["gathered", "with_columns"]

ENOUGH = 1024  # rows


def with_columns(
    blocks: Iterator[Recording],
    taken: Callable[[Recording], Float[np.ndarray, "n k"]],
    columns: Callable[[Iterator[Float[np.ndarray, "n k"]]], Iterator[Float[np.ndarray, "m c"]]],
    added: Callable[[Recording, Float[np.ndarray, "n c"]], Recording],
    width: int,
) -> Iterator[Recording]:
    """Yield the blocks, each as soon as the columns of its rows are known.

    Args:
        blocks: of a log.
        taken: returns of a block what `columns` needs, row by row.
        columns: yields the new columns of the rows in pieces of any size, from the pieces of `taken`.
        added: returns a block with its columns.
        width: number of new columns.
    """
    waiting: deque[Recording] = deque()
    ready = np.zeros((0, width))

    def pieces() -> Iterator[Float[np.ndarray, "n k"]]:
        for block in blocks:
            waiting.append(block)
            yield taken(block)

    for found in columns(pieces()):
        ready = np.concatenate([ready, found])
        while waiting and len(ready) >= len(waiting[0]):
            block = waiting.popleft()
            yield added(block, ready[: len(block)])
            ready = ready[len(block) :]
    for block in waiting:  # without rows
        yield added(block, ready)


def gathered(pieces: Iterator[Float[np.ndarray, "n k"]], width: int) -> Iterator[tuple[Float[np.ndarray, "m k"], bool]]:
    """Yield pieces of `width` columns joined to 1,024 rows or more, and whether they are the last."""
    small, count = [np.zeros((0, width))], 0
    for piece in pieces:
        small.append(piece)
        count += len(piece)
        if count >= ENOUGH:
            yield np.concatenate(small), False
            small, count = [piece[:0]], 0
    yield np.concatenate(small), True
