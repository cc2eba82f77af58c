"""Find the answers in frames of taxels: readings above a baseline by a threshold."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.sensors.taxels.rest import resting
from palpate.spatial.arguments import frozen_value, takes_arrays

HEAD = 2048  # frames from which rest and noise are taken
FEWEST = 16  # frames of a log
TOLD = 1 << 21  # readings from which the baseline is found: for many taxels every few frames are enough
ABOVE = 6.0  # deviations of noise that an answer stands above rest
PIECE = 64  # frames in which the baseline is constant
KEPT, OF_KEPT = 0.9, 0.789  # share of steps that is used, and a unit Gaussian's standard deviation within it
SPARSE = 8  # frames of a piece from which its rest is followed
DRIFT = 3.0  # s in which the rest of a taxel that does not answer is followed
STUCK = 0.9  # share of all frames in which a taxel answers that cannot be pokes
NEVER_BACK = 0.2  # of the log, at its end, through which a taxel answers without a pause
FELL = 0.5  # of a threshold below the first baseline: pressed at the start

Block = tuple[Float[np.ndarray, "..."], np.ndarray]


@frozen_value
class Activations:
    """The m answers in n frames of k taxels.

    Attributes:
        time: (n,) [s] rising.
        frame, taxel: (m,) indices of each answer, frame by frame; above: (m,) reading minus baseline.
        highest: (m,) true where the reading is at the end of its range.
        stuck: (k,) true for a taxel that answers nearly always or never returns: its answers are excluded.
        threshold: median of the taxels' thresholds.
        notes: for the user, a sentence each.
    """

    time: Float[np.ndarray, " n"]
    frame: Int[np.ndarray, " m"]
    taxel: Int[np.ndarray, " m"]
    above: Float[np.ndarray, " m"]
    highest: Bool[np.ndarray, " m"]
    stuck: Bool[np.ndarray, " k"]
    threshold: float
    notes: tuple[str, ...] = ()


def later(time: Float[np.ndarray, " n"], than: float = -np.inf) -> Bool[np.ndarray, " n"]:
    """Return a bool for each time (n,), True if it is later than all before it and than `than`; NaN is not."""
    latest = np.maximum.accumulate(np.concatenate([[than], np.nan_to_num(time, nan=-np.inf)]))
    return time > latest[:-1]


@takes_arrays
class AnswerReader:
    """A reader that finds answers above a baseline, which follows a taxel while it does not answer.

    Args:
        threshold: above the baseline; None: six standard deviations of the noise of each taxel, at least of the median
            one.
        top: the largest reading.
        falling: readings fall under load.
    """

    def __init__(self, threshold: float | None = None, *, top: float = np.inf, falling: bool = False) -> None:
        self._given, self._top, self._sign = threshold, top, -1.0 if falling else 1.0
        self._head = list[tuple[np.ndarray, np.ndarray]]()
        self._rest: Float[np.ndarray, " k"] = np.zeros(0)
        self._first: Float[np.ndarray, " k"] = np.zeros(0)
        self._delta: Float[np.ndarray, " k"] = np.zeros(0)
        self._times, self._parts = list[np.ndarray](), list[tuple[np.ndarray, ...]]()
        self._count = self._back = 0
        self._latest, self._started = -np.inf, False

    def take(self, time: Float[np.ndarray, " n"], values: np.ndarray) -> None:
        """Add a block of frames: times (n,) [s] and readings (n, k) of any number type.

        Raises:
            InputError: another number of taxels, or fewer than 16 of the first 2,048 frames are finite.
        """
        values = values.reshape(len(time), -1)
        taxels = self._head[0][1].shape[1] if self._head else len(self._rest)
        if taxels and values.shape[1] != taxels:
            what = f"a frame has {values.shape[1]} taxels, but the first frames have {taxels}."
            raise InputError(what, where="frames")
        good = later(time, self._latest)
        if not good.all():
            self._back += int(np.count_nonzero(~good))
            time, values = time[good], values[good]
        if not len(time):
            return
        self._latest = float(time[-1])
        if not self._started:
            self._head.append((time, values))
            if sum(len(each) for each, _ in self._head) >= HEAD:
                self._start()
        else:
            self._read(time, values)

    def finish(self) -> Activations:
        """Return all answers of the frames taken, as `Activations`.

        Raises:
            InputError: fewer than 16 of the first 2,048 frames are finite, or more than half of the taxels answer
                nearly always or never return to rest.
        """
        if not self._started:
            self._start()
        time = np.concatenate(self._times)
        frame, taxel, above, highest = (np.concatenate(each) for each in zip(*self._parts, strict=True))
        stuck = _stuck(frame, taxel, len(time), len(self._rest))
        if 2 * np.count_nonzero(stuck) > len(stuck):
            raise InputError(
                f"{np.count_nonzero(stuck)} of {len(stuck)} taxels answer nearly always, or never return to rest.",
                where="frames",
                hint="Raise threshold in the rig's [pokes]; if readings fall under load, name an intensity with "
                "falling curves in [skin].",
            )
        kept = ~stuck[taxel]
        fell = self._first - self._rest > FELL * self._delta
        return Activations(
            time,
            frame[kept],
            taxel[kept],
            above[kept],
            highest[kept],
            stuck,
            float(np.quantile(self._delta, 0.5)),
            tuple(self._notes(stuck, fell)),
        )

    def _start(self) -> None:
        count = sum(len(each) for each, _ in self._head)
        if count < FEWEST:
            raise InputError(f"has {count} frames of taxels, and at least {FEWEST} are needed.", where="frames")
        values = np.concatenate([each for _, each in self._head])[:HEAD]
        whole = values.dtype.kind in "iu" or bool((values == np.rint(values)).all())
        cells = self._sign * values.astype(np.float64)
        known = np.asarray(np.isfinite(cells).all(axis=1), dtype=bool)
        if np.count_nonzero(known) < FEWEST:
            raise InputError(
                f"only {np.count_nonzero(known)} of the first {len(known)} frames of taxels have all their readings.",
                where="frames",
                hint="Check the columns or the topic of the taxels in the rig's [skin].",
            )
        cells = cells[known]
        self._rest, _ = resting(cells[:: 1 + cells.size // TOLD], counts=whole)
        self._first, noise = self._rest, _noise(cells, whole=whole)
        found = ABOVE * np.maximum(noise, float(np.median(noise)))
        self._delta = found if self._given is None else np.full(len(noise), self._given)
        head, self._head, self._started = self._head, [], True
        for time, each in head:
            self._read(time, each)

    def _read(self, time: Float[np.ndarray, " n"], values: np.ndarray) -> None:
        for start in range(0, len(time), PIECE):
            self._piece(time[start : start + PIECE], values[start : start + PIECE])

    def _piece(self, time: Float[np.ndarray, " n"], values: np.ndarray) -> None:
        """Find the answers of some frames above a constant baseline, then update that of silent taxels."""
        limit = self._rest + self._delta
        rising, kind = self._sign > 0, values.dtype
        hit = values > _as(np.floor(limit), kind) if rising else values < _as(np.ceil(-limit), kind)
        row, taxel = np.divmod(np.flatnonzero(hit), hit.shape[1])
        reading = values[row, taxel].astype(np.float64)
        highest = reading >= self._top if rising else reading <= 0
        above = self._sign * reading - self._rest[taxel]
        self._parts.append((row + self._count, taxel, above, highest & np.isfinite(self._top)))
        self._times.append(time)
        self._count += len(time)
        sparse = slice(None, None, max(1, len(values) // SPARSE))
        quiet, few = ~hit[sparse], values[sparse]
        quiet &= np.isfinite(few) if kind.kind == "f" else True
        sums = np.where(quiet, few, 0).sum(axis=0, dtype=np.float64)
        count = quiet.sum(axis=0)
        share = 1.0 - np.exp(-(time[-1] - time[0]) / DRIFT)
        self._rest = self._rest + share * (self._sign * sums - count * self._rest) / np.maximum(count, 1)

    def _notes(self, stuck: Bool[np.ndarray, " k"], fell: Bool[np.ndarray, " k"]) -> list[str]:
        said = list[str]()
        if stuck.any():
            who = _listed(np.flatnonzero(stuck).tolist())
            said.append(f"taxel {who} answers nearly all the time, or never returns to rest, and is left out")
        if fell.any():
            who = _listed(np.flatnonzero(fell).tolist())
            said.append(
                f"the reading at rest of taxel {who} falls after the log begins: make sure that nothing touched it then"
            )
        if self._back:
            said.append(f"{self._back} frames of taxels are not later than those before them, and are left out")
        return said


def _as(limit: Float[np.ndarray, " k"], kind: np.dtype) -> np.ndarray:
    """Return a bound in the type of the readings."""
    if kind.kind in "iu":
        ends = np.iinfo(kind)
        return np.clip(limit, ends.min, ends.max).astype(kind)
    return limit.astype(kind)


def _noise(cells: Float[np.ndarray, "n k"], *, whole: bool) -> Float[np.ndarray, " k"]:
    """Return each taxel's standard deviation by its steps between frames, without the largest tenth: touches."""
    steps = np.sort(np.abs(np.diff(cells, axis=0)), axis=0)[: max(1, int(KEPT * (len(cells) - 1)))]
    spread = np.sqrt((steps**2).mean(axis=0) / 2.0) / OF_KEPT
    least = 12**-0.5 if whole else 1e-9 + 1e-3 * float(spread.max())  # of what is rounded steps tell too little
    return np.hypot(spread, least)


def _stuck(
    frame: Int[np.ndarray, " m"], taxel: Int[np.ndarray, " m"], frames: int, taxels: int
) -> Bool[np.ndarray, " k"]:
    """Return which taxels answer in nearly all frames, or without a pause to the end of the log."""
    last = max(int(NEVER_BACK * frames), 1)
    at_end = np.bincount(taxel[frame >= frames - last], minlength=taxels)
    return (np.bincount(taxel, minlength=taxels) > STUCK * frames) | (at_end >= last)


def _listed(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers[:8])) + (", ..." if len(numbers) > 8 else "")
