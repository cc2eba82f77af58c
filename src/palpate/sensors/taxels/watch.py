"""Keep what a log of taxels shows from its first frame to its last: lost and frozen frames, and frames of touches."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.plausibility import endless
from palpate.sensors.taxels._kernels import AREA
from palpate.sensors.taxels.model import TaxelBody
from palpate.signals.repeats import hung

KEPT = 512  # frames, evenly spread, that show which cells answer together: those of one touch are alike
SOME = 4  # cells that are compared first
LOST = 0.01  # of the frames missing
REGULAR = 0.9  # of the steps that are whole multiples of the usual one, within
NEAR = 0.25  # of it, where no frame is missing in steps of more than
FEWEST = 10  # steps that show the usual one
GAP = 5  # of it, which are gaps
CORNERS = 4  # touches of a frame from which one may be a ghost
ALIGNED = 0.7  # cells by which corners of a rectangle are off
WEAKER = 0.9  # of the weakest of the other corners


class TaxelWatch:
    """Watch of a log's frames, block after block.

    Args:
        body: the body that is recorded.
    """

    def __init__(self, body: TaxelBody) -> None:
        self._body = body
        self.reset()

    def reset(self) -> None:
        """Forget all frames."""
        self._times, self._same, self._free = list[np.ndarray](), list[np.ndarray](), list[np.ndarray]()
        self._last: np.ndarray = np.full(len(self._body), np.nan)
        self._kept, self._empty, self._stride, self._count = list[np.ndarray](), list[np.ndarray](), 1, 0
        self._ghosts: dict[str, float] = {}
        self._full = np.zeros(len(self._body), dtype=np.int64)

    def add(
        self, time: np.ndarray, readings: np.ndarray, raw: np.ndarray, rows: np.ndarray, counts: np.ndarray
    ) -> None:
        """Add the next frames at times (n,) [s], with the rows of their contacts and each one's number of rows.

        Of taxels with three axes, `raw` (n, k) are the loads into the body by the readings; else both are the same.
        The estimator has checked them: to check again would take as long as the rest, for a block of 100 frames.
        """
        if not len(time):
            return
        if (response := self._body.response) is not None and np.isfinite(response.limits).any():
            self._full += response.full(readings).any(axis=2).sum(axis=0)
        self._times.append(time.copy())
        self._same.append(np.append((raw[0] == self._last).all(), _repeats(raw)))
        first: Int[np.ndarray, " n"] = np.cumsum(counts) - counts
        self._free.append(np.isnan(rows[first, 0]))
        self._last = raw[-1].copy()
        self._keep(raw, self._free[-1])
        if self._body.rows:
            for frame in np.flatnonzero(counts >= CORNERS)[:KEPT].tolist():
                self._look_for_ghosts(float(time[frame]), rows[first[frame] : first[frame] + counts[frame]])

    def _ended(self) -> list[str]:
        """Return a sentence on taxels with three axes that had a reading at the end of its range."""
        full = np.flatnonzero(self._full).tolist()
        if not full:
            return []
        names = f"{', '.join(self._body.name(cell) for cell in full[:5])}{', ...' if len(full) > 5 else ''}"
        return [
            f"{len(full)} taxels ({names}) read the end of their range, in up to {self._full.max()} frames, in which "
            "they have no weight: less of a hard touch is measured"
        ]

    def _keep(self, raw: Float[np.ndarray, "n k"], free: Bool[np.ndarray, " n"]) -> None:
        """Keep every few frames; in a longer log every second one of them stays."""
        self._count += len(raw)
        while self._count > 2 * KEPT * self._stride:
            self._kept, self._empty = _halved(self._kept), _halved(self._empty)
            self._stride *= 2
        even = slice((len(raw) - self._count) % self._stride, None, self._stride)
        self._kept.append(raw[even].copy())
        self._empty.append(free[even])

    @property
    def loads(self) -> Float[np.ndarray, "n k"]:
        """Return frames with contacts, evenly spread over the log, (n, k), each less the last one without a contact."""
        frames = np.concatenate([np.zeros((0, len(self._body))), *self._kept])
        free = np.concatenate([np.zeros(0, dtype=bool), *self._empty])
        before = np.maximum.accumulate(np.where(free, np.arange(len(free)), -1))
        loaded = ~free & (before >= 0)
        return frames[loaded] - frames[before[loaded]]

    @property
    def free(self) -> Bool[np.ndarray, " n"]:
        """Return bools (n,), whether each frame has no contact."""
        return np.concatenate([np.zeros(0, dtype=bool), *self._free])

    def warnings(self) -> list[str]:
        """Return a list of sentences on full taxels, lost or frozen frames, ghosts, and a contact without end."""
        if not self._times:
            return []
        time = np.concatenate(self._times)
        known = [*self._ended(), *_lost(time), *hung(time, np.concatenate(self._same))]
        return [*known, *self._ghost(), *self._endless(time)]

    def _endless(self, time: Float[np.ndarray, " n"]) -> list[str]:
        free = np.flatnonzero(self.free)
        since = float(time[free[-1] + 1]) if len(free) and free[-1] + 1 < len(time) else np.nan
        return endless(float(time[0]), since, float(time[-1]), "the zero has moved")

    def _look_for_ghosts(self, time: float, rows: Float[np.ndarray, "c width"]) -> None:
        """Note the weakest of four touches at the corners of a rectangle of rows and columns."""
        place, load = rows[:, AREA : AREA + 2], rows[:, AREA + 3]
        for k in np.flatnonzero(load < np.sort(load)[-3]).tolist():
            beside, above = (np.abs(place[:, axis] - place[k, axis]) < ALIGNED for axis in (0, 1))
            for i in np.flatnonzero(beside & ~above).tolist():
                for j in np.flatnonzero(above & ~beside).tolist():
                    opposite = (np.abs(place - [place[j, 0], place[i, 1]]) < ALIGNED).all(axis=1)
                    if opposite.any() and load[k] < WEAKER * min(load[i], load[j], load[opposite].max()):
                        self._ghosts.setdefault(self._named(place[k]), time)

    def _named(self, place: Float[np.ndarray, "2"]) -> str:
        row, column = np.rint(place).astype(int).tolist()
        return f"({row}, {column})"

    def _ghost(self) -> list[str]:
        if not self._ghosts:
            return []
        cell, time = next(iter(self._ghosts.items()))
        more = f" and {len(self._ghosts) - 1} more" if len(self._ghosts) > 1 else ""
        return [
            f"the touch at cell {cell} from {time:.2f} s on{more} may be a ghost: the three other corners of its "
            "rectangle of rows and columns are pressed harder, and a resistive matrix without diodes shows the fourth"
        ]


def _halved(parts: list[np.ndarray]) -> list[np.ndarray]:
    """Return every second row of blocks that follow each other."""
    return [np.concatenate(parts)[::2]] if parts else []


def _repeats(raw: Float[np.ndarray, "n k"]) -> Bool[np.ndarray, " m"]:
    """Return whether each frame but the first equals the one before."""
    some = raw[:, :: -(-raw.shape[1] // SOME)]
    same = (some[1:] == some[:-1]).all(axis=1)
    which = np.flatnonzero(same)
    same[which] = (raw[which + 1] == raw[which]).all(axis=1)
    return same


def _lost(time: Float[np.ndarray, " n"]) -> list[str]:
    """Return a sentence if steps of several times the usual one show that frames are missing."""
    steps = np.diff(time[np.isfinite(time)])
    steps = steps[steps > 0]
    usual = float(np.median(steps)) if len(steps) > FEWEST else np.inf
    steps = steps[steps < (GAP + 0.5) * usual] / usual
    missing = np.rint(steps) - 1
    if not len(steps) or np.mean(np.abs(steps - np.rint(steps)) < NEAR) < REGULAR:
        return []
    lost = int(missing.sum())
    share = lost / (len(time) + lost)
    return [f"{lost:,} of {len(time) + lost:,} frames are missing ({share:.0%})"] if share > LOST else []
