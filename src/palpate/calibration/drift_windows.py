"""Average a log over short windows for `identify_drift`, and find the windows without touches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import InputError
from palpate.spatial._arrays import Value, shaped
from palpate.spatial.arguments import takes_arrays

__all__ = [
    "GAP",
    "SHORTEST",
    "Windows",
    "described",
    "first_guess",
    "require_free",
    "stretches",
    "untouched",
    "windows_of",
]

SHORTEST = 60.0  # s of a log
GAP = 10.0  # s without a sample, after which the zero may be anywhere
LEAST = 4  # samples of a window
FULL = 0.5  # of the usual number of samples, or a window is left out
MOST = 6000  # windows: more say nothing that longer ones do not
SURE = 6.0  # deviations from what is expected: one of 10^9 by chance
LAGS = (2.0, 5.0, 10.0)  # s over which the walk is first guessed


@takes_arrays
@dataclass(frozen=True, eq=False)
class Windows(Value):
    """Means of a log over windows of time.

    Attributes:
        middle: (w,) [s] mean time of the samples, from the first sample on.
        mean: (w, m) of the channels.
        courses: (w, q) of quantities that the bias may follow: a temperature, the direction of gravity.
        length: [s] of a window.
    """

    middle: Float[np.ndarray, " w"]
    mean: Float[np.ndarray, "w m"]
    courses: Float[np.ndarray, "w q"]
    length: float

    def picked(self, rows: Bool[np.ndarray, " w"]) -> Windows:
        """Return the `Windows` that a mask (w,) selects."""
        rows = shaped(rows, self.middle.shape, "rows", np.dtype(np.bool_))
        return Windows(self.middle[rows], self.mean[rows], self.courses[rows], self.length)

    def doubled(self) -> Windows:
        """Return `Windows` of means over pairs of windows, twice as long; a window without a partner is dropped."""
        index = np.floor(self.middle / (2.0 * self.length)).astype(np.int64)
        _, first, count = np.unique(index, return_index=True, return_counts=True)

        def halved(values: np.ndarray) -> np.ndarray:
            return np.add.reduceat(values, first, axis=0) / count.reshape(-1, *[1] * (values.ndim - 1))

        two = count == 2
        courses = halved(self.courses)[two]
        return Windows(halved(self.middle)[two], halved(self.mean)[two], courses, 2.0 * self.length)


@takes_arrays
def windows_of(
    time: Float[np.ndarray, " n"],
    values: Float[np.ndarray, "n m"],
    courses: Float[np.ndarray, "n q"],
    length: float,
) -> Windows:
    """Return `Windows`, means over `length` [s] or longer, of four samples or more, and at most 6000 of them.

    Args:
        time: (n,) [s], rising.
        values: (n, m) finite.
        courses: (n, q); missing values are interpolated in time.
        length: [s].
    """
    span = float(time[-1] - time[0])
    step = float(np.median(np.diff(time)))
    length = max(length, LEAST * step, span / MOST)
    index = np.floor((time - time[0]) / length + 1e-6).astype(np.int64)
    _, first, count = np.unique(index, return_index=True, return_counts=True)
    full = count >= max(1.0, FULL * length / step)

    def averaged(column: np.ndarray) -> np.ndarray:
        return (np.add.reduceat(column, first, axis=0).T / count).T[full]

    whole: list[np.ndarray] = [
        np.interp(time, time[known := np.isfinite(course)], course[known]) for course in courses.T
    ]
    beside = averaged(np.column_stack(whole)) if whole else np.zeros((int(np.count_nonzero(full)), 0))
    level = values.mean(axis=0)  # so that the sum of many loses no digits
    return Windows(averaged(time - time[0]), averaged(values - level), beside, length)


def first_guess(windows: Windows) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Return variances of the walk [unit^2/s] and of a window's mean, (m,) each; medians resist a few touches."""
    mean, length = windows.mean, windows.length
    noise = np.maximum(_square(mean[1:] - mean[:-1]) / 2.0, 1e-300)
    each: list[np.ndarray] = []
    for lag in LAGS:
        k = max(1, round(lag / length))
        each.append((_square(mean[k:] - mean[:-k]) - 2.0 * noise) / (k * length))
    walk = np.maximum(np.median(each, axis=0), 1e-6 * noise / length)
    return walk, noise


@takes_arrays
def untouched(
    windows: Windows,
    walk: Float[np.ndarray, " m"],
    noise: Float[np.ndarray, " m"],
    course: Float[np.ndarray, "w m"] | None = None,
) -> Bool[np.ndarray, " w"]:
    """Return (w,) bool, True where a window agrees with a random walk of the bias, within six standard deviations.

    A Kalman filter of each channel tracks the bias; a window that one channel does not expect is omitted and does not
    move it, nor do its neighbours. So a touch is omitted until it ends. A touch that begins slowly is seen when it
    ends, by the filter that runs backwards: of both, the one that omits less is used.

    Args:
        windows: means.
        walk: (m,) variance [unit^2/s].
        noise: (m,) variance of a mean.
        course: (w, m) known change of the bias.
    """
    mean = windows.mean if course is None else windows.mean - course
    forward = _gated(windows.middle, mean, walk, noise)
    backward = _gated(-windows.middle[::-1], mean[::-1], walk, noise)[::-1]
    free = forward if forward.sum() >= backward.sum() else backward
    padded = np.concatenate([[True], free, [True]])
    return free & padded[:-2] & padded[2:]


@takes_arrays
def require_free(windows: Windows, free: Bool[np.ndarray, " w"], longest: float, share: float) -> None:
    """Check that a log was touched little enough to show its bias.

    Args:
        windows: all windows of the log.
        free: (w,) True where untouched.
        longest: [s] that one touch may last.
        share: largest share of touched windows.

    Raises:
        InputError: a touch is longer, or the share is larger.
    """
    touched = 1.0 - float(np.mean(free))
    start, end = _longest(~free)
    if start < end:
        first, last = float(windows.middle[start]), float(windows.middle[end - 1])
        if last - first > longest:
            raise InputError(
                f"the readings from {first:.1f} to {last:.1f} s of the log differ from those before: something "
                "touched, the payload changed, or the zero jumped.",
                hint="Record the sensor at rest and untouched, for five minutes if possible.",
            )
    if touched > share:
        raise InputError(
            f"in {touched:.0%} of the log the readings change as under touches or motion, not as with a drifting bias.",
            hint="Record the sensor at rest and untouched; if the arm moves, name the payload in the rig.",
        )


def _longest(mask: Bool[np.ndarray, " w"]) -> tuple[int, int]:
    """Return first and end of the longest stretch."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if not len(starts):
        return 0, 0
    k = int(np.argmax(ends - starts))
    return int(starts[k]), int(ends[k])


def _square(change: Float[np.ndarray, "k m"]) -> Float[np.ndarray, " m"]:
    """Return the variance about zero, from the median."""
    return (np.median(np.abs(change), axis=0) / 0.6745) ** 2


def _gated(
    time: Float[np.ndarray, " w"],
    mean: Float[np.ndarray, "w m"],
    walk: Float[np.ndarray, " m"],
    noise: Float[np.ndarray, " m"],
) -> Bool[np.ndarray, " w"]:
    """Filter forward in time; the first window, and the first after a gap, are taken as untouched."""
    zero, variance, last = mean[0].copy(), noise.copy(), float(time[0])
    free = np.ones(len(time), dtype=np.bool_)
    for k in range(1, len(time)):
        passed, last = time[k] - last, float(time[k])
        if passed > GAP:
            zero, variance = mean[k], noise
            continue
        variance = variance + walk * passed
        change, total = mean[k] - zero, variance + noise
        if np.any(change * change > SURE**2 * total):
            free[k] = False
            continue
        gain = variance / total
        zero = zero + gain * change
        variance = (1.0 - gain) * variance
    return free


def described(runs: Sequence[tuple[float, float]], most: int = 3) -> str:
    """Return stretches of time in words: '3.1 to 4.0 s, 7.2 to 7.9 s and 4 more'."""
    said = [f"{start:.1f} to {end:.1f} s" for start, end in runs[:most]]
    more = f" and {len(runs) - most} more" if len(runs) > most else ""
    return ", ".join(said) + more


@takes_arrays
def stretches(windows: Windows, mask: Bool[np.ndarray, " w"]) -> list[tuple[float, float]]:
    """Return a list of (beginning, end) [s] of each stretch of True in a mask (w,) of the windows."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    middle, half = windows.middle, windows.length / 2.0
    return [(float(middle[a] - half), float(middle[b] + half)) for a, b in zip(starts, ends - 1, strict=True)]
