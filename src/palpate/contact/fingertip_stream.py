"""A log of voltages, block by block: the zero at every start, contacts, and what the cells had wrong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.estimate import ContactEstimate
from palpate.contact.fingertip import Fingertip
from palpate.errors import InputError
from palpate.sensors.load_cell_faults import Fault, find_faults
from palpate.sensors.load_cells import VOLTAGE
from palpate.sensors.recording import Recording

__all__ = ["START", "FingertipStream"]

START = 0.5  # s at a start in which nothing is touched, if nothing else is said
RESTART = 5.0  # s without a sample: what was switched off in between has another zero
PIECE = 4096  # samples at a time: what lies between two steps stays in the cache
KEPT = 20_000  # readings, evenly spread, that faults are looked for in


class FingertipStream:
    """Answers a log of voltages; what it meets on the way is in its attributes.

    The zero is taken in the first seconds of the log, and again wherever it begins anew: after a gap of 5 s, or where
    time runs back. A later start that is not at rest keeps the zero before it, and is doubted.

    Args:
        fingertip: prepared.
        seconds: at a start in which nothing is touched.

    Attributes:
        said, doubted: sentences on the zeros.
        subsets: (2 + k,) samples answered by none, by all cells, and without each.
    """

    def __init__(self, fingertip: Fingertip, seconds: float = START) -> None:
        self.fingertip, self.seconds = fingertip, seconds
        self.said, self.doubted = list[str](), list[str]()
        self.subsets: Int[np.ndarray, " s"] = np.zeros(2 + fingertip.cells.cells, dtype=np.int64)
        self._kept, self._stride, self._seen = list[np.ndarray](), 1, 0
        self._starts = 0

    def stream(self, blocks: Iterable[Recording]) -> Iterator[tuple[Recording, ContactEstimate]]:
        """Each block with its contacts; blocks are cut where the log begins anew.

        Raises:
            InputError: the log has no voltages, or does not begin at rest.
        """
        waiting, begun, last = list[Recording](), np.nan, np.nan
        for block in blocks:
            for part, fresh in _parts(block, last):
                last = _last(part.time, last)
                if fresh:
                    yield from self._flushed(waiting, begun)
                    begun = _first(part.time)
                if np.isnan(begun):  # the zero of this start is known
                    yield part, self._answer(part)
                    continue
                waiting.append(part)
                if last > begun + self.seconds:
                    yield from self._flushed(waiting, begun)
                    begun = np.nan
        yield from self._flushed(waiting, begun)

    def faults(self, names: tuple[str, ...] = ()) -> list[Fault]:
        """What is wrong with the cells, judged by some of the readings so far."""
        if not self._kept:
            return []
        return find_faults(self.fingertip.cells, np.concatenate(self._kept), self.fingertip.sound, names)

    def _flushed(self, waiting: list[Recording], begun: float) -> Iterator[tuple[Recording, ContactEstimate]]:
        """Those that waited for the zero of their start."""
        if not waiting:
            return
        rest = [
            part.channels[VOLTAGE][part.time <= begun + self.seconds] for part in waiting if VOLTAGE in part.channels
        ]
        if not rest:
            raise InputError("the log has no voltages.", where=waiting[0].source, mend="Name them in [load_cells].")
        self._starts += 1
        try:
            zero = self.fingertip.tare(np.concatenate(rest), waiting[0].source)
        except InputError as problem:
            if self._starts == 1:
                raise
            self.doubted.append(
                f"the start at {begun:.3f} s is not at rest, so the zero before it is kept ({problem.what})"
            )
        else:
            self.said += [zero.said] if self._starts == 1 else []
            self.doubted += [zero.doubt] if zero.doubt else []
        for part in waiting:
            yield part, self._answer(part)
        waiting.clear()

    def _answer(self, part: Recording) -> ContactEstimate:
        voltages = np.require(part.channels[VOLTAGE], np.float64, ["C"]).copy()
        rows, which = self.fingertip.empty(len(part)), np.empty(len(part), np.int64)
        for start in range(0, len(part), PIECE):
            piece = slice(start, start + PIECE)
            _, which[piece] = self.fingertip.run_into(rows[piece], voltages[piece])
        self.subsets += np.bincount(np.maximum(which, -1) + 1, minlength=len(self.subsets))
        self._keep(voltages - self.fingertip.zero.voltage)
        return ContactEstimate.from_rows(rows)

    def _keep(self, readings: Float[np.ndarray, "n m"]) -> None:
        self._kept.append(readings[-self._seen % self._stride :: self._stride])
        self._seen += len(readings)
        while sum(map(len, self._kept)) > 2 * KEPT:  # every second one of those kept stays
            self._kept = [np.concatenate(self._kept)[::2]]
            self._stride *= 2


def _parts(block: Recording, last: float) -> Iterator[tuple[Recording, bool]]:
    """A block cut where the log begins anew, and whether a part does."""
    steps = np.diff(block.time, prepend=last)
    fresh = np.flatnonzero((steps > RESTART) | (steps < 0))
    edges = np.unique(np.concatenate([[0], fresh, [len(block)]]))
    for begin, end in pairwise(edges.tolist()):
        yield block.picked(slice(begin, end)), begin > 0 or begin in fresh or bool(np.isnan(last))


def _first(time: Float[np.ndarray, " n"]) -> float:
    known = time[np.isfinite(time)]
    return float(known[0]) if len(known) else -np.inf


def _last(time: Float[np.ndarray, " n"], before: float) -> float:
    known = time[np.isfinite(time)]
    return float(known[-1]) if len(known) else before
