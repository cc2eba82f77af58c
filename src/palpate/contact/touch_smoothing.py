"""Decide on a complete touch of a log: its last samples correct the first ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int8

from palpate.contact.estimate import ROW, Status
from palpate.contact.locate import Locator
from palpate.contact.surface_wrenches import Piece
from palpate.signals.recording import Recording

__all__ = ["LONGEST", "joined", "rejoined", "smooth_touches"]

LONGEST = 200_000  # samples that are kept waiting for the end of a touch
_APART = 0.05  # of the body's size between samples: the touch may have changed its branch


class Located(NamedTuple):
    """A block with its located samples.

    Attributes:
        block: of the log.
        wrench, covariance, status: (n, ...) input of the locator; covariance None: the locator's noise.
        rows: (n, 22) estimates.
    """

    block: Recording
    wrench: Float[np.ndarray, "n 6"]
    covariance: Float[np.ndarray, "n 6 6"] | None
    status: Int8[np.ndarray, " n"]
    rows: Float[np.ndarray, "n 22"]


def joined(block: Recording, pieces: list[Located]) -> Located:
    """Join the located pieces of a block."""
    if len(pieces) == 1:
        return pieces[0]._replace(block=block)
    wrench, status, rows = (
        np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("wrench", "status", "rows")
    )
    known = [piece.covariance for piece in pieces if piece.covariance is not None]
    return Located(block, wrench, np.concatenate(known) if known else None, status, rows)


def rejoined(parts: Iterable[tuple[Piece, Located]]) -> Iterator[Located]:
    """Yield a `Located` for each complete block, joined from its pieces."""
    pieces = list[Located]()
    for piece, part in parts:
        pieces.append(part)
        if piece.ends is not None:
            yield joined(piece.ends, pieces)
            pieces = []


def smooth_touches(parts: Iterable[Located], locator: Locator) -> Iterator[Located]:
    """Yield each `Located` block once its touches have ended.

    Rows of a touch that may have changed its branch are located again from its end (`Locator.follow_back`).
    """
    waiting: list[Located] = []
    done = count = 0  # samples of the blocks that wait: settled, and all
    for part in parts:
        waiting.append(part)
        count += len(part.rows)
        free = np.flatnonzero(part.rows[:, ROW.status] == Status.NO_CONTACT)
        if len(free):
            end = count - len(part.rows) + int(free[-1])
            _settle(waiting, done, end, locator)
            done = end
        while waiting and len(waiting[0].rows) <= done:
            done -= len(waiting[0].rows)
            count -= len(waiting[0].rows)
            yield waiting.pop(0)
        if count - done > LONGEST:
            _settle(waiting, done, count, locator)
            done = count
    _settle(waiting, done, count, locator)
    yield from waiting


def _settle(waiting: list[Located], begin: int, end: int, locator: Locator) -> None:
    """Correct the touches between two samples of the blocks that wait."""
    first = 0
    pieces: list[Located] = []
    for part in waiting:
        piece = slice(max(0, begin - first), max(0, end - first))
        first += len(part.rows)
        if len(part.rows[piece]):
            arrays = {name: getattr(part, name) for name in part._fields[1:]}
            pieces.append(part._replace(**{name: each[piece] for name, each in arrays.items() if each is not None}))
    if not pieces:
        return
    _, wrench, covariance, status, rows = pieces[0] if len(pieces) == 1 else joined(pieces[0].block, pieces)
    for span in _spans(rows):
        if _several(rows[span], locator.surface.size):
            known = None if covariance is None else covariance[span]
            locator.follow_back(wrench[span], known, status[span], rows[span])
    if len(pieces) > 1:
        cuts = np.cumsum([len(piece.rows) for piece in pieces])[:-1]
        for piece, settled in zip(pieces, np.split(rows, cuts), strict=True):
            piece.rows[:] = settled


def _spans(rows: Float[np.ndarray, "n 22"]) -> list[slice]:
    """Return slices of touches: from first to last located sample between two without contact."""
    touching = rows[:, ROW.status] != Status.NO_CONTACT
    edges = np.flatnonzero(np.diff(touching, prepend=False, append=False)).reshape(-1, 2)
    located = np.isfinite(rows[:, 0])
    spans: list[slice] = []
    for begin, end in edges[edges[:, 1] > edges[:, 0] + 1]:  # noise makes many of one sample
        inside = begin + np.flatnonzero(located[begin:end])
        if len(inside) > 1:
            spans.append(slice(int(inside[0]), int(inside[-1]) + 1))
    return spans


def _several(rows: Float[np.ndarray, "n 22"], size: float) -> bool:
    """Return whether these samples may belong to several branches."""
    points: Float[np.ndarray, "k 3"] = rows[np.isfinite(rows[:, 0]), ROW.point]
    moved: Bool[np.ndarray, " k"] = np.linalg.norm(np.diff(points, axis=0), axis=1) > _APART * size
    return bool((rows[:, ROW.candidates] > 1).any() or moved.any())
