"""Estimate how much the wrench of a moving arm vibrates, which is no contact, from the log itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from palpate.signals._delayed import gathered, with_columns
from palpate.signals.filters import Filter
from palpate.signals.noise import straightened
from palpate.signals.recording import ORIENTATION, POSITION, VIBRATION, Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion

WINDOW = 0.2  # s: two periods of 10 Hz, and shorter than most touches
FEWEST = 12  # samples of a window
AROUND = 5  # windows before and after one that are averaged with it
SETTLING = 2  # windows around those in motion in which the arm still vibrates
TOUCHED = 3.0  # times the median variance around: in such a window a touch begins or ends
TURNING, TRAVEL = np.radians(2.0), 0.01  # rad/s and m/s: a slower arm is at rest
EXCESS = 2.0  # times the noise's variance: up to it, the noise explains the scatter


@takes_arrays
class Vibration:
    """The covariance by which a free wrench vibrates while the arm moves, learned from the wrenches around each sample.

    The log is cut into windows of 0.2 s. In each, the covariance of the wrench about its straight line is computed: a
    steady touch is not in it. It is averaged over the windows within a second in which the arm moves; those of more
    than 3 times the median variance are left out, as a touch begins or ends in them. What exceeds twice the noise's
    variance in some direction is vibration. An arm that turns by less than 2 degrees a second and travels less than
    10 mm a second is at rest, and 0.4 s after its motion nothing is added.

    Args:
        noise: (6, 6) covariance of one reading [N, N m], as it remains after the filter.
        filter: filter that the wrenches pass afterwards; None: none.
        rate: [Hz] of the samples, for the filter.
    """

    def __init__(
        self, noise: Float[np.ndarray, "6 6"], filter: Filter | None = None, rate: float | None = None
    ) -> None:
        self._scale = np.sqrt(np.maximum(np.diag(noise), 1e-24))
        self._filter, self._rate = filter, rate
        self._largest = 0.0

    def stream(
        self, blocks: Iterator[Recording], wrenches: Callable[[Recording], Float[np.ndarray, "n 6"]]
    ) -> Iterator[Recording]:
        """Return an iterator over the blocks with VIBRATION (n, 36), the covariance in the sensor's frame by rows.

        Args:
            blocks: of the log, in order, with ORIENTATION.
            wrenches: returns a block's wrenches (n, 6) [N, N m] without the payload, in the sensor's frame; NaN in
                unusable samples.
        """
        self._largest = 0.0

        def taken(block: Recording) -> Float[np.ndarray, "n 19"]:
            place = block.channels.get(POSITION, np.zeros((len(block), 3)))
            turn = rotation_from_quaternion(block.channels[ORIENTATION]).reshape(-1, 9)
            return np.column_stack([block.time, wrenches(block), turn, place])

        return with_columns(blocks, taken, self._by_row, _with_vibration, 36)

    def notes(self) -> tuple[str, ...]:
        """Return a note on the largest vibration so far; () if there was none."""
        if not self._largest:
            return ()
        said = f"the wrench vibrates by up to {self._largest:.2g} N while the arm moves: covariances were widened by it"
        advice = "" if self._filter is not None else "; with a [filter] in the rig, lighter touches are found then"
        return (said + advice,)

    def _by_row(self, pieces: Iterator[Float[np.ndarray, "n 19"]]) -> Iterator[Float[np.ndarray, "m 36"]]:
        """Yield the covariances of the rows, from their `taken` columns."""
        rows, seen, answered, step, length = np.zeros((0, 19)), np.zeros((0, 48)), 0, 0.0, 0
        for piece, last in gathered(pieces, 19):
            rows = np.concatenate([rows, piece])
            if not length:
                step, length = _window(rows[:, 0])
            count = len(rows) // length
            windows = rows[: count * length, 1:].reshape(count, length, 18)
            seen, rows = np.concatenate([seen, self._seen(windows)]), rows[count * length :]
            ready = len(seen) if last else max(answered, len(seen) - AROUND - 1)
            found = self._vibration(_around(seen, step * length)[answered:ready])
            yield np.repeat(found, length, axis=0)
            if last:  # the rest is shorter than a window
                yield np.repeat(found[-1:] if len(found) else np.zeros((1, 36)), len(rows), axis=0)
            known = max(0, ready - AROUND - 1)
            seen, answered = seen[known:], ready - known

    def _seen(self, windows: Float[np.ndarray, "w l 18"]) -> Float[np.ndarray, "w 48"]:
        """Return the mean rotation and position (12) of each window, and the covariance (36) of its wrench."""
        count, length = windows.shape[:2]
        wrench = straightened(windows[:, :, :6])
        if self._filter is None or self._rate is None:
            covariance = np.einsum("wli,wlj->wij", wrench, wrench) / (length - 2)
        else:
            wave = np.fft.rfft(wrench * np.hanning(length)[:, None], axis=1)
            wave *= self._filter.gain(np.fft.rfftfreq(length, 1.0 / self._rate), self._rate)[:, None]
            power = length * np.sum(np.hanning(length) ** 2) / 2.0  # two sides are one
            covariance = np.einsum("wfi,wfj->wij", wave, wave.conj()).real / power
        return np.concatenate([windows[:, :, 6:].mean(axis=1), covariance.reshape(count, 36)], axis=1)

    def _vibration(self, covariance: Float[np.ndarray, "w 36"]) -> Float[np.ndarray, "w 36"]:
        """Return what exceeds the noise in each covariance."""
        some = covariance.any(axis=1)
        both = np.outer(self._scale, self._scale)
        size, axes = np.linalg.eigh(covariance[some].reshape(-1, 6, 6) / both)
        more = np.where(size > EXCESS, size - 1.0, 0.0)
        made = np.zeros_like(covariance)
        left = np.einsum("wik,wk,wjk->wij", axes, more, axes) * both
        made[some] = left.reshape(-1, 36)
        strength = np.sqrt(np.trace(left[:, :3, :3], axis1=1, axis2=2))
        self._largest = max(self._largest, float(strength.max(initial=0.0)))
        return made


def _around(seen: Float[np.ndarray, "w 48"], seconds: float) -> Float[np.ndarray, "w 36"]:
    """Return for each window the mean covariance of the windows around it in which the arm moves; 0 at rest."""
    covariance, moving = seen[:, 12:], _moving(seen[:, :12], seconds)
    size = np.where(moving, covariance[:, 0] + covariance[:, 7] + covariance[:, 14], np.nan)
    mean = np.zeros_like(covariance)
    for k in np.flatnonzero(np.convolve(moving, np.ones(2 * SETTLING + 1), "same")[: len(seen)]):
        near = slice(max(0, k - AROUND), k + AROUND + 1)
        known = size[near][np.isfinite(size[near])]
        if len(known):
            mean[k] = covariance[near][size[near] <= TOUCHED * np.median(known)].mean(axis=0)
    return mean


def _moving(path: Float[np.ndarray, "w 12"], seconds: float) -> Bool[np.ndarray, " w"]:
    """Return in which windows the arm moves, by the mean rotations and positions of windows that follow each other."""
    steps = np.diff(path, axis=0)
    turned, moved = np.linalg.norm(steps[:, :9], axis=1) / 2**0.5, np.linalg.norm(steps[:, 9:], axis=1)
    quick = (turned > TURNING * seconds) | (moved > TRAVEL * seconds)  # not NaN
    return np.append(quick, False)[: len(path)] | np.append(False, quick)[: len(path)]


def _window(time: Float[np.ndarray, " n"]) -> tuple[float, int]:
    """Return the usual step [s] of times, and the rows of a window."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    step = float(np.median(steps)) if len(steps) else WINDOW
    return step, max(FEWEST, round(WINDOW / step))


def _with_vibration(block: Recording, covariance: Float[np.ndarray, "n 36"]) -> Recording:
    return replace(block, channels={**block.channels, VIBRATION: covariance})
