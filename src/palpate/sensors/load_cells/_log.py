"""Prepare a bench log for the fit: zeros from unloaded stretches, averages of short blocks of loaded samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.signals.correlation import correlation_time

BLOCK = 0.01  # s: a touch moves 25 um meanwhile at 2.5 mm/s, and readings filtered at 100 Hz contain little more
SMOOTH = 0.05  # s over which a reference force is averaged before it is compared with `UNLOADED`
UNLOADED, NOISES = 0.1, 5.0  # N, and times the noise of that average: below the larger one nothing touches
MEDIAN_STEP = 0.954  # median of |difference of two normals|, in their standard deviation
LEAST_REST = 0.2  # s
LATEST_REST = 1.0  # s into the log: latest start of the first rest
SETTLING = 0.03  # s at the end of a rest where a touch begins that are omitted too
MARGIN = 1.0  # standard deviations of the smoothed voltages by which a touch leaves what as many may reach
FEWEST = 200  # blocks
GAP = 5.0  # steps of the median length that separate two runs


@dataclass(frozen=True, eq=False)
class BenchLog:
    """Complete rows of a bench log.

    Attributes:
        time: (n,) [s].
        voltages: (n, m) [V].
        forces: (n, 3) [N] of the reference.
        centres: (n, 3) [m] of the ball.
        torques: (n,) [N m] of the reference about the normal.
    """

    time: Float[np.ndarray, " n"]
    voltages: Float[np.ndarray, "n m"]
    forces: Float[np.ndarray, "n 3"]
    centres: Float[np.ndarray, "n 3"]
    torques: Float[np.ndarray, " n"]

    @cached_property
    def step(self) -> float:
        """Median time between two rows [s].

        Raises:
            InputError: the times never increase.
        """
        steps = np.diff(self.time)
        if not (steps > 0).any():
            raise InputError("the times of the bench log never increase.", where="time")
        return float(np.median(steps[steps > 0]))

    @cached_property
    def runs(self) -> list[slice]:
        """Rows of each run, a list of slices: a run ends at a gap, or where time runs back."""
        steps = np.diff(self.time)
        starts = [0, *(np.flatnonzero((steps > GAP * self.step) | (steps < 0)) + 1).tolist()]
        return [slice(*ends) for ends in pairwise([*starts, len(self.time)])]

    def rows(self, duration: float) -> int:
        """Return the number of rows in a duration [s], at least 1."""
        return max(1, round(duration / self.step))


@dataclass(frozen=True, eq=False)
class UnloadedStretch:
    """A stretch of a log in which nothing touches.

    Attributes:
        rows: rows of the log.
        middle: [s] mean time.
        voltage: (m,) [V] mean.
        force: (3,) [N] mean of the reference.
    """

    rows: slice
    middle: float
    voltage: Float[np.ndarray, " m"]
    force: Float[np.ndarray, "3"]


@dataclass(frozen=True, eq=False)
class Blocks(BenchLog):
    """Averages of a bench log, without biases of voltages and forces, over blocks of `size` samples.

    Attributes:
        run: (n,) number of the block's run.
        size: samples of a block.
    """

    run: Int[np.ndarray, " n"]
    size: int


def rests(log: BenchLog) -> list[UnloadedStretch]:
    """Return the unloaded stretches of a log, in order.

    Raises:
        InputError: the log does not begin with an unloaded stretch, or its times never increase.
    """
    found = [rest for run in log.runs for rest in _rests_of(log, run)]
    if not found or found[0].rows.start * log.step > LATEST_REST:
        begun = float(np.linalg.norm(log.forces[: log.rows(LEAST_REST)].mean(axis=0)))
        raise InputError(
            f"the log does not begin unloaded (the reference force is {begun:.2g} N), so the bias of the cells is "
            "not known.",
            where="ref_fx, ref_fy, ref_fz",
            hint=f"Record at least {LEAST_REST:g} s before the first touch, with the reference tared.",
        )
    return found


def _rests_of(log: BenchLog, run: slice) -> Iterator[UnloadedStretch]:
    width = log.rows(SMOOTH)
    smooth = _smooth(log.forces[run], width)
    light = np.linalg.norm(smooth, axis=1) < max(UNLOADED, NOISES * _noise_of(smooth, width))
    edges = run.start + np.flatnonzero(np.diff(np.r_[False, light, False]))
    for first, last in edges.reshape(-1, 2).tolist():
        if (last - first) * log.step < LEAST_REST:
            continue
        begin, end = _still(log.voltages[first:last], log)
        begin = 0 if first == run.start else begin  # nothing touched before
        if (end - begin) * log.step >= LEAST_REST:
            rows = slice(first + begin, first + end)
            yield UnloadedStretch(
                rows, float(log.time[rows].mean()), log.voltages[rows].mean(axis=0), log.forces[rows].mean(axis=0)
            )


def _noise_of(smooth: Float[np.ndarray, "n 3"], width: int) -> float:
    """Return the standard deviation of smoothed forces, from the median difference at a lag of `width` rows."""
    steps = smooth[width:] - smooth[:-width]
    return float(np.median(np.abs(steps), axis=0).max()) / MEDIAN_STEP if len(steps) else 0.0


def _still(voltages: Float[np.ndarray, "n m"], log: BenchLog) -> tuple[int, int]:
    """Return first and last of the rows around the middle that stay on its line: a touch moves voltages early."""
    width, count = log.rows(SMOOTH), len(voltages)
    smooth = _smooth(voltages, width)
    middle = slice(count // 4, max(count // 4 + 2, 3 * count // 4))
    rows = np.arange(count, dtype=np.float64)
    line = np.polynomial.polynomial.polyfit(rows[middle], smooth[middle], 1)  # it may drift
    off = np.abs(smooth - line[0] - rows[:, None] * line[1])
    leaves = MARGIN + np.sqrt(2.0 * np.log(max(1.0, smooth.size / width)))
    away = off > leaves * np.sqrt(np.mean(off[middle] ** 2, axis=0)) + 1e-12 * np.abs(line[0])
    left = np.flatnonzero(away.any(axis=1))
    before, after = left[left < count // 2], left[left >= count // 2]
    inset = width // 2 + round(SETTLING / log.step)
    first = int(before[-1]) + inset if len(before) else 0
    last = int(after[0]) - inset if len(after) else count
    return first, max(first, last)


def _smooth(values: Float[np.ndarray, "n k"], width: int) -> Float[np.ndarray, "n k"]:
    """Return moving means over `width` rows, over fewer at the ends."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    rows = np.arange(len(values))
    low, high = np.maximum(rows - width // 2, 0), np.minimum(rows + width // 2 + 1, len(values))
    return (sums[high] - sums[low]) / (high - low)[:, None]


def rest_noise(log: BenchLog, found: list[UnloadedStretch]) -> tuple[Float[np.ndarray, "m m"], float, float]:
    """Return a reading's covariance (m, m) [V^2], its correlation time [samples], and the reference's deviation [N].

    Correlations that a few readings may show by chance are shrunk [Chen 2010, (23)], and the covariance is wider by its
    own uncertainty: weights that follow chance would promise more than the readings hold.
    """
    left = list[np.ndarray]()
    for rest in found:
        voltages = log.voltages[rest.rows]
        at = np.linspace(-1, 1, len(voltages))
        line = np.polynomial.polynomial.polyfit(at, voltages, 1)
        left.append(voltages - (line[0] + at[:, None] * line[1]))
    pushed = np.concatenate([log.forces[rest.rows] - rest.force for rest in found])
    times = [float(correlation_time(each).mean()) for each in left]
    usual = float(np.average(times, weights=[len(each) for each in left]))
    every, count = np.concatenate(left), sum(map(len, left)) / max(usual, 1.0)
    covariance = np.atleast_2d(np.cov(every.T))
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))  # a dead channel has none
    product = np.outer(scale, scale)
    return _shrunk(covariance / product, count) * product, usual, float(pushed.std())


def _shrunk(correlations: Float[np.ndarray, "m m"], count: float) -> Float[np.ndarray, "m m"]:
    """Return correlations of `count` independent samples, shrunk towards none and widened."""
    m, square = len(correlations), float(np.sum(correlations**2))
    chance = (1.0 - 2.0 / m) * square + m**2
    share = min(1.0, chance / ((count + 1.0 - 2.0 / m) * max(square - m, 1e-12)))
    return ((1.0 - share) * correlations + share * np.eye(m)) * count / max(count - 2.0, 1.0)


def blocks_of(log: BenchLog, found: list[UnloadedStretch], least: float) -> Blocks:
    """Return the means of blocks in which every sample is loaded by `least` [N] or more, without zeros.

    Within a run the zero is interpolated linearly between rests, and constant after the last.

    Raises:
        InputError: the log has fewer than 200 such blocks.
    """
    size, m = log.rows(BLOCK), log.voltages.shape[1]
    rows = np.column_stack([log.time, log.voltages, log.forces, log.centres, log.torques])
    rows[:, 1 : m + 4] -= zeros(log, found)
    loaded = np.linalg.norm(rows[:, m + 1 : m + 4], axis=1) >= least
    pieces = list[np.ndarray]()
    for run in log.runs:
        whole = slice(run.start, run.stop - (run.stop - run.start) % size)
        kept = loaded[whole].reshape(-1, size).all(axis=1)
        pieces.append(rows[whole].reshape(-1, size, m + 8)[kept].mean(axis=1))
    number = np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces])
    if len(number) < FEWEST:
        raise InputError(
            f"only {len(number)} blocks of 10 ms are loaded by {least:g} N or more, and {FEWEST} are needed.",
            hint="Slide the ball over the complete surface, with 1 N or more.",
        )
    time, voltages, forces, centres, torques = np.split(np.concatenate(pieces), [1, m + 1, m + 4, m + 7], axis=1)
    return Blocks(time[:, 0], voltages, forces, centres, torques[:, 0], number, size)


def zeros(log: BenchLog, found: list[UnloadedStretch]) -> Float[np.ndarray, "n k"]:
    """Return unloaded voltages and reference forces, (n, m + 3); a run without a rest uses the one before."""
    zero = np.empty((len(log.time), log.voltages.shape[1] + 3))
    for run in log.runs:
        before = [rest for rest in found if rest.rows.start < run.stop]
        own = [rest for rest in before if rest.rows.start >= run.start] or before[-1:]
        values = np.array([np.concatenate([rest.voltage, rest.force]) for rest in own])
        for column, each in enumerate(values.T):
            zero[run, column] = np.interp(log.time[run], [rest.middle for rest in own], each)
    return zero
