"""Find the offset between the clocks of two loggers: one of a taxel's reading, one of the force on it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from palpate.calibration.clock import ClockOffset
from palpate.errors import InputError, NotIdentifiable
from palpate.spatial.arguments import takes_arrays

STEP = 0.02  # s of the search
LONGEST = 1 << 20  # steps of a log in it
OVERLAP = 0.5  # of the shorter log at least
FOLLOWS = 0.6  # correlation below which the reading does not follow the force
SINGLE = 0.85  # of the best correlation, which no other offset may reach
LOBE = 0.5  # of it, to which the correlation falls about the best offset
DEGREE = 4  # of the reading as a polynomial of the force
PARTS = 6  # of the log, each left out in turn
SURE = 0.02  # s that the offset must be known to
GAP = 0.5  # s between forces beyond which none is interpolated


@takes_arrays
def loggers_offset(
    time: Float[np.ndarray, " n"],
    reading: Float[np.ndarray, " n"],
    force_time: Float[np.ndarray, " m"],
    force: Float[np.ndarray, " m"],
) -> ClockOffset:
    """Return the `ClockOffset` that is added to the force's times to put them on the clock of the readings.

    The correlation of both is searched over all offsets at which half of the shorter log overlaps. It must have a
    single peak. There the offset is refined, at which a polynomial of the force explains the reading best, so that the
    curve may bend or fall. Its deviation is that of the answers with a sixth of the log left out.

    Args:
        time: (n,) [s] of the readings.
        reading: (n,) of the taxel.
        force_time: (m,) [s], on another clock.
        force: (m,) [N].

    Raises:
        NotIdentifiable: the reading follows the force at no offset, at several, or not clearly enough.
        InputError: a log is too short, or too long for its rate; or arrays of other shapes.
    """
    time, reading = _sorted(time, reading)
    force_time, force = _sorted(force_time, force)
    near = _searched(time, reading, force_time, force)
    offset = _refined(time, reading, force_time, force, near)
    part = np.arange(len(time)) * PARTS // len(time)
    rests = [part != k for k in range(PARTS)]
    others = [_refined(time[rest], reading[rest], force_time, force, offset) for rest in rests]
    deviation = float(np.sqrt((PARTS - 1) * np.var(others)))
    if not deviation < SURE:
        raise _refused(f"the offset between the clocks is known to {deviation:.3f} s only: press and release faster")
    _, left = _unexplained(time, reading, force_time, force, offset)
    return ClockOffset(offset, deviation, float(np.sqrt(np.mean(left**2))), len(left))


@takes_arrays
def joined(
    time: Float[np.ndarray, " n"], force_time: Float[np.ndarray, " m"], force: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " n"]:
    """Return the force (n,) [N] at other times [s] of its clock; NaN beyond its log and in its gaps.

    Raises:
        InputError: the log of the force is too short, or too long for its rate; or arrays of other shapes.
    """
    force_time, force = _sorted(force_time, force)
    after = np.clip(np.searchsorted(force_time, time), 1, len(force_time) - 1)
    there = (force_time[after] - force_time[after - 1] <= GAP) & (time >= force_time[0]) & (time <= force_time[-1])
    return np.where(there, np.interp(time, force_time, force), np.nan)


def _sorted(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the finite rows in the order of their times."""
    known = np.isfinite(time) & np.isfinite(values)
    order = np.argsort(time[known], kind="stable")
    time, values = time[known][order], values[known][order]
    if not (len(time) > PARTS and STEP < np.ptp(time) < LONGEST * STEP):
        what = f"a log of {len(time)} rows over {np.ptp(time) if len(time) else 0.0:.3g} s"
        raise InputError(
            f"{what} cannot be compared with another.", where="time", hint="Give times in seconds, for some presses."
        )
    return time, values


def _searched(time: np.ndarray, reading: np.ndarray, force_time: np.ndarray, force: np.ndarray) -> float:
    """Return the offset [s] at the single peak of the correlation."""
    offsets, score = _correlations(_even(time, reading), _even(force_time, force))
    best = int(np.argmax(score))
    if score[best] < FOLLOWS:
        raise _refused(
            f"the reading follows the force at no offset between the clocks (correlation {score[best]:.2f} at most): "
            "check that both are of the same presses"
        )
    outside = np.flatnonzero(score < LOBE * score[best])
    low, high = outside[outside < best].max(initial=-1), outside[outside > best].min(initial=len(score))
    other = np.concatenate([score[: low + 1], np.zeros(high - low - 1), score[high:]])
    second = int(np.argmax(other))
    if other[second] > SINGLE * score[best]:
        raise _refused(
            f"the offset between the clocks has two answers, {abs(second - best) * STEP:.1f} s from each other "
            f"(correlations {score[best]:.2f} and {other[second]:.2f}): press at irregular times, with different forces"
        )
    return float(time[0] - force_time[0] + offsets[best] * STEP)


def _even(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values at every `STEP` from the first time on, without their mean."""
    values = np.interp(np.arange(time[0], time[-1], STEP), time, values)
    return values - values.mean()


def _correlations(reading: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return shifts of the force in steps, and the correlation at each, times the share of the presses that overlap."""
    from scipy.signal import correlate

    def sums(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray(correlate(a, b, method="fft"))

    ones, others = np.ones(len(reading)), np.ones(len(force))
    shifts, count = np.arange(1 - len(force), len(reading)), np.maximum(np.rint(sums(ones, others)), 1.0)
    read, pushed = sums(reading, others), sums(ones, force)
    square = np.maximum(sums(reading**2, others) - read**2 / count, 1e-12 * float(reading @ reading))
    pressed = np.maximum(sums(ones, force**2) - pushed**2 / count, 1e-12 * float(force @ force))
    both = sums(reading, force) - read * pushed / count
    with np.errstate(invalid="ignore"):
        share = np.maximum(square / float(reading @ reading), pressed / float(force @ force))
        score = np.abs(both) / np.sqrt(square * pressed) * np.minimum(share, 1.0)
    usable = (count >= OVERLAP * min(len(reading), len(force))) & np.isfinite(score)
    return shifts, np.where(usable, score, 0.0)


def _refined(time: np.ndarray, reading: np.ndarray, force_time: np.ndarray, force: np.ndarray, near: float) -> float:
    """Return the offset [s] near another at which the force explains the reading best."""
    from scipy.optimize import minimize_scalar

    def cost(step: float) -> float:
        return _unexplained(time, reading, force_time, force, near + step)[0]

    found = minimize_scalar(cost, bounds=(-3.0 * STEP, 3.0 * STEP), method="bounded", options={"xatol": 1e-4})
    return near + float(found.x)


def _unexplained(
    time: np.ndarray, reading: np.ndarray, force_time: np.ndarray, force: np.ndarray, offset: float
) -> tuple[float, np.ndarray]:
    """Return the mean square of what a polynomial of the force does not explain of the reading, and all of that."""
    pushed = joined(time - offset, force_time, force)
    known: Bool[np.ndarray, " n"] = np.isfinite(pushed)
    matrix = np.vander(pushed[known] / max(float(np.abs(force).max()), 1e-12), DEGREE + 1)
    left = reading[known] - matrix @ np.linalg.lstsq(matrix, reading[known], rcond=None)[0]
    return float(np.mean(left**2)), left


def _refused(why: str) -> NotIdentifiable:
    return NotIdentifiable(f"{why}.", rank=0, missing=("clock",))
