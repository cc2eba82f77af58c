"""A bench log as the fit takes it: zeros from unloaded stretches, averages of short blocks of what is loaded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.sensors.correlation import correlation_time

__all__ = ["Blocks", "Rest", "blocks_of", "cut", "rest_noise", "rests"]

BLOCK = 0.01  # s: a touch moves 25 um meanwhile at 2.5 mm/s, and readings filtered at 100 Hz tell little more
SMOOTH = 0.05  # s over which a reference force is averaged before it is called none
UNLOADED, NOISES = 0.1, 5.0  # N, and times the noise of that average: below both nothing touches
MEDIAN_STEP = 0.954  # of |difference of two normals|, in their deviation
LEAST_REST = 0.2  # s
LATEST_REST = 1.0  # s into the log
SETTLING = 0.03  # s at the end of a rest where a touch begins that are left out too
LEAVES = 4.0  # standard deviations of the smoothed voltages
GAP = 5.0  # steps of the median length that separate two runs


@dataclass(frozen=True, eq=False)
class Rest:
    """A stretch in which nothing touches.

    Attributes:
        middle: [s]; rows: first and last + 1.
        voltage: (m,) [V] mean; force: (3,) [N] mean of the reference.
    """

    middle: float
    rows: tuple[int, int]
    voltage: Float[np.ndarray, " m"]
    force: Float[np.ndarray, "3"]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Averages over blocks of `size` samples.

    Attributes:
        time: (n,) [s]; run: (n,) which; voltages: (n, m) [V] without bias; forces: (n, 3) [N]; centres: (n, 3) [m].
        torques: (n,) [N m] about the normal, as the reference says it.
        size: samples of a block.
    """

    time: Float[np.ndarray, " n"]
    run: Int[np.ndarray, " n"]
    voltages: Float[np.ndarray, "n m"]
    forces: Float[np.ndarray, "n 3"]
    centres: Float[np.ndarray, "n 3"]
    torques: Float[np.ndarray, " n"]
    size: int


def cut(time: Float[np.ndarray, " n"]) -> tuple[float, list[int]]:
    """The step [s] of a log, and the rows at which a run begins: after a gap, or where time runs back."""
    steps = np.diff(time)
    forward = steps[steps > 0]
    if not len(forward):
        raise InputError("the times of the bench log never go forward.", where="time")
    step = float(np.median(forward))
    return step, [0, *(np.flatnonzero((steps > GAP * step) | (steps < 0)) + 1).tolist()]


def rests(
    time: Float[np.ndarray, " n"], voltages: Float[np.ndarray, "n m"], forces: Float[np.ndarray, "n 3"]
) -> list[Rest]:
    """The unloaded stretches of a log, in order.

    Raises:
        InputError: the log does not begin with one.
    """
    step, starts = cut(time)
    width = max(1, round(SMOOTH / step))
    found = list[Rest]()
    for begin, end in zip(starts, [*starts[1:], len(time)], strict=True):
        smooth = _smooth(forces[begin:end], width)
        light = np.linalg.norm(smooth, axis=1) < max(UNLOADED, NOISES * _noise_of(smooth, width))
        found += _stretches(light, begin, step, time, voltages, forces)
    if not found or (found[0].rows[0] - starts[0]) * step > LATEST_REST:
        begun = float(np.linalg.norm(forces[: max(1, round(LEAST_REST / step))].mean(axis=0)))
        raise InputError(
            f"the log does not begin unloaded (the reference force is {begun:.2g} N), so the bias of the cells is "
            "not known.",
            where="ref_fx, ref_fy, ref_fz",
            hint=f"Record at least {LEAST_REST:g} s before the first touch, with the reference tared.",
        )
    return found


def _stretches(
    light: Bool[np.ndarray, " n"],
    begin: int,
    step: float,
    time: np.ndarray,
    voltages: np.ndarray,
    forces: np.ndarray,
) -> list[Rest]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], light, [False]]).astype(np.int8)))
    found = list[Rest]()
    for first, last in edges.reshape(-1, 2):
        if (last - first) * step < LEAST_REST:
            continue
        rows = _still(voltages[begin + first : begin + last], step)
        if (rows.stop - rows.start) * step >= LEAST_REST:
            rows = slice(begin + first + rows.start, begin + first + rows.stop)
            mean = (voltages[rows].mean(axis=0), forces[rows].mean(axis=0))
            found.append(Rest(float(time[rows].mean()), (int(rows.start), int(rows.stop)), *mean))
    return found


def _noise_of(smooth: Float[np.ndarray, "n 3"], width: int) -> float:
    """Standard deviation [N] of smoothed forces, from how they usually differ a width apart."""
    steps = smooth[width:] - smooth[:-width]
    return float(np.median(np.abs(steps), axis=0).max()) / MEDIAN_STEP if len(steps) else 0.0


def _still(voltages: Float[np.ndarray, "n m"], step: float) -> slice:
    """The rows around the middle in which no channel leaves what it reads there: a touch begins before it weighs."""
    width, count = max(1, round(SMOOTH / step)), len(voltages)
    smooth = _smooth(voltages, width)
    middle = slice(count // 4, max(count // 4 + 2, 3 * count // 4))
    rows = np.arange(count, dtype=np.float64)
    line = np.polynomial.polynomial.polyfit(rows[middle], smooth[middle], 1)  # it may drift
    off = np.abs(smooth - line[0] - rows[:, None] * line[1])
    away = off > LEAVES * np.sqrt(np.mean(off[middle] ** 2, axis=0)) + 1e-12 * np.abs(line[0])
    left = np.flatnonzero(away.any(axis=1))
    before, after = left[left < count // 2], left[left >= count // 2]
    inset = width // 2 + round(SETTLING / step)
    first = int(before[-1]) + inset if len(before) else 0
    last = int(after[0]) - inset if len(after) else count
    return slice(first, max(first, last))


def _smooth(values: Float[np.ndarray, "n k"], width: int) -> Float[np.ndarray, "n k"]:
    """Moving means over `width` rows, shorter at the ends."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    rows = np.arange(len(values))
    low, high = np.maximum(rows - width // 2, 0), np.minimum(rows + width // 2 + 1, len(values))
    return (sums[high] - sums[low]) / (high - low)[:, None]


def rest_noise(
    found: list[Rest], voltages: Float[np.ndarray, "n m"], forces: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "m m"], float, float]:
    """Covariance of a reading's voltages, their correlation time [samples], and the reference's deviation [N]."""
    left, pushed, weights, times = list[np.ndarray](), list[np.ndarray](), list[int](), list[float]()
    for rest in found:
        rows = slice(*rest.rows)
        line = np.polynomial.polynomial.polyfit(np.linspace(-1, 1, rest.rows[1] - rest.rows[0]), voltages[rows], 1)
        fitted = line[0] + np.linspace(-1, 1, rest.rows[1] - rest.rows[0])[:, None] * line[1]
        left.append(voltages[rows] - fitted)
        pushed.append(forces[rows] - rest.force)
        weights.append(len(left[-1]))
        times.append(float(correlation_time(left[-1]).mean()))
    noise = np.cov(np.concatenate(left).T)
    return noise, float(np.average(times, weights=weights)), float(np.concatenate(pushed).std())


def blocks_of(
    found: list[Rest],
    time: Float[np.ndarray, " n"],
    voltages: Float[np.ndarray, "n m"],
    forces: Float[np.ndarray, "n 3"],
    centres: Float[np.ndarray, "n 3"],
    torques: Float[np.ndarray, " n"],
    least: float,
) -> Blocks:
    """Means of blocks in which every sample is loaded by `least` [N] and whole, without what the rests read.

    Within a run the zero goes straight from one rest to the next, and is held after the last: what was switched off in
    between has another.
    """
    step, starts = cut(time)
    size = max(1, round(BLOCK / step))
    zero = _zeros(found, time, starts)
    m = voltages.shape[1]
    zero_u, zero_f = zero[:, :m], zero[:, m:]
    rows = np.column_stack([time, voltages - zero_u, forces - zero_f, centres, torques])
    usable = np.isfinite(rows).all(axis=1) & (np.linalg.norm(rows[:, -7:-4], axis=1) >= least)
    pieces, runs = list[np.ndarray](), list[np.ndarray]()
    for begin, end in zip(starts, [*starts[1:], len(time)], strict=True):
        count = (end - begin) // size
        whole = rows[begin : begin + count * size].reshape(count, size, -1)
        kept = usable[begin : begin + count * size].reshape(count, size).all(axis=1)
        pieces.append(whole[kept].mean(axis=1))
        runs.append(np.full(len(pieces[-1]), len(runs)))
    mean, run = np.concatenate(pieces), np.concatenate(runs)
    return Blocks(
        mean[:, 0], run, mean[:, 1 : 1 + m], mean[:, 1 + m : 4 + m], mean[:, 4 + m : 7 + m], mean[:, -1], size
    )


def _zeros(found: list[Rest], time: Float[np.ndarray, " n"], starts: list[int]) -> Float[np.ndarray, "n k"]:
    """What voltages and reference read without a load; a run without a rest of its own takes the last before it."""
    values = np.array([np.concatenate([rest.voltage, rest.force]) for rest in found])
    first = np.array([rest.rows[0] for rest in found])
    zero = np.empty((len(time), values.shape[1]))
    for begin, end in zip(starts, [*starts[1:], len(time)], strict=True):
        own = np.flatnonzero((first >= begin) & (first < end))
        own = own if len(own) else np.flatnonzero(first < begin)[-1:]
        at = [found[k].middle for k in own]
        for column in range(values.shape[1]):
            zero[begin:end, column] = np.interp(time[begin:end], at, values[own, column])
    return zero
