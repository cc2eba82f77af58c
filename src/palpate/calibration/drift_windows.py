"""Average a log over short windows for `identify_drift`, and find the windows without touches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import InputError
from palpate.spatial._arrays import Value, shaped
from palpate.spatial.arguments import frozen_value, takes_arrays

SHORTEST = 60.0  # s of a log
GAP = 10.0  # s without a sample, after which the zero may be anywhere
LEAST = 4  # samples of a window
FULL = 0.5  # of the usual number of samples, or a window is left out
MOST = 6000  # windows: more say nothing that longer ones do not
SURE = 6.0  # deviations from what is expected: one of 10^9 by chance
LAGS = (2.0, 5.0, 10.0)  # s over which the walk is first guessed
LONGEST_TOUCH, MOST_TOUCHED = 20.0, 0.2  # s; of the log


@frozen_value
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
        """Return the `Windows` that a mask (w,) selects.

        Raises:
            InputError: the mask is not of w bools.
        """
        rows = shaped(rows, self.middle.shape, "rows", np.dtype(np.bool_))
        return replace(self, middle=self.middle[rows], mean=self.mean[rows], courses=self.courses[rows])

    def doubled(self) -> Windows:
        """Return the `Windows` of means over pairs of windows; a window without a partner is omitted."""
        index = np.floor(self.middle / (2.0 * self.length)).astype(np.int64)
        _, first, count = np.unique(index, return_index=True, return_counts=True)

        def halved(values: np.ndarray) -> np.ndarray:
            return np.add.reduceat(values, first, axis=0) / count.reshape(-1, *[1] * (values.ndim - 1))

        middle, mean, courses = (halved(each)[count == 2] for each in (self.middle, self.mean, self.courses))
        return Windows(middle, mean, courses, 2.0 * self.length)


@takes_arrays
def windows_of(
    time: Float[np.ndarray, " n"],
    values: Float[np.ndarray, "n m"],
    courses: Float[np.ndarray, "n q"],
    length: float,
) -> Windows:
    """Return the `Windows` of a log, at most 6000.

    Args:
        time: (n,) [s], rising.
        values: (n, m) finite.
        courses: (n, q); missing values are interpolated in time.
        length: least length of a window [s]; one of fewer than four samples is made longer.

    Raises:
        InputError: arrays of other shapes.
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
    followed = averaged(np.column_stack(whole)) if whole else np.zeros((int(np.count_nonzero(full)), 0))
    level = values.mean(axis=0)  # so that the sum of many loses no digits
    return Windows(averaged(time - time[0]), averaged(values - level), followed, length)


def first_guess(windows: Windows) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Return rough variances of the walk [unit^2/s] and of a window's mean, (m,) each."""
    mean, length = windows.mean, windows.length
    noise = np.maximum(_square(mean[1:] - mean[:-1]) / 2.0, 1e-300)
    lags = [max(1, round(lag / length)) for lag in LAGS]
    each = [(_square(mean[k:] - mean[:-k]) - 2.0 * noise) / (k * length) for k in lags]
    return np.maximum(np.median(each, axis=0), 1e-6 * noise / length), noise


@takes_arrays
def untouched(
    windows: Windows,
    walk: Float[np.ndarray, " m"],
    noise: Float[np.ndarray, " m"],
    course: Float[np.ndarray, "w m"] | None = None,
) -> Bool[np.ndarray, " w"]:
    """Return a mask (w,), True where a window and its neighbours agree with a random walk of the bias.

    A Kalman filter of each channel omits windows that are six standard deviations off. It runs forward and backward;
    the direction that omits less is used.

    Args:
        windows: means.
        walk: (m,) variance [unit^2/s].
        noise: (m,) variance of a mean.
        course: (w, m) known change of the bias; None: 0.

    Raises:
        InputError: arrays of other shapes.
    """
    mean = windows.mean if course is None else windows.mean - course
    forward = _gated(windows.middle, mean, walk, noise)
    backward = _gated(-windows.middle[::-1], mean[::-1], walk, noise)[::-1]
    free = forward if forward.sum() >= backward.sum() else backward
    padded = np.concatenate([[True], free, [True]])
    return free & padded[:-2] & padded[2:]


@takes_arrays
def require_free(windows: Windows, free: Bool[np.ndarray, " w"]) -> None:
    """Check that a log was touched little enough to show its bias.

    Args:
        windows: all windows of the log.
        free: (w,) True where untouched.

    Raises:
        InputError: a touch is longer than 20 s, or more than 20 % of the log is touched; or arrays of other shapes.
    """
    touched = 1.0 - float(np.mean(free))
    start, end = max(_runs(~free), key=lambda run: run[1] - run[0], default=(0, 1))
    first, last = float(windows.middle[start]), float(windows.middle[end - 1])
    if last - first > LONGEST_TOUCH:
        raise InputError(
            f"the readings from {first:.1f} to {last:.1f} s of the log differ from those before: something "
            "touched, the payload changed, or the zero jumped.",
            hint="Record the sensor at rest and untouched, for five minutes if possible.",
        )
    if touched > MOST_TOUCHED:
        raise InputError(
            f"in {touched:.0%} of the log the readings change as under touches or motion, not as with a drifting bias.",
            hint="Record the sensor at rest and untouched; if the arm moves, name the payload in the rig.",
        )


def _runs(mask: Bool[np.ndarray, " w"]) -> list[list[int]]:
    """Return first and end of each stretch of True."""
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2).tolist()


def _square(change: Float[np.ndarray, "k m"]) -> Float[np.ndarray, " m"]:
    """Return the variance about zero, from the median."""
    return (np.median(np.abs(change), axis=0) / 0.6745) ** 2


def _gated(
    time: Float[np.ndarray, " w"],
    mean: Float[np.ndarray, "w m"],
    walk: Float[np.ndarray, " m"],
    noise: Float[np.ndarray, " m"],
) -> Bool[np.ndarray, " w"]:
    """Return the windows that a filter expects; the first, and the first after a gap, are free."""
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


@takes_arrays
def stretches(windows: Windows, mask: Bool[np.ndarray, " w"]) -> list[tuple[float, float]]:
    """Return (beginning, end) [s] of each stretch of True in a mask (w,) of the windows.

    Raises:
        InputError: mask has another shape.
    """
    middle, half = windows.middle, windows.length / 2.0
    return [(float(middle[a] - half), float(middle[b - 1] + half)) for a, b in _runs(mask)]
