"""Estimate how much the wrench of a moving arm vibrates, which is no contact, from the log itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view

from palpate.signals._delayed import HeldRows, with_columns
from palpate.signals.filters import Filter
from palpate.signals.recording import ORIENTATION, POSITION, VIBRATION, Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion

ENOUGH = 8192  # rows that are worked on at a time, or more
WINDOW = 0.2  # s: two periods of 10 Hz
POSES = 8  # of a window, from which it is seen whether the arm moves
AROUND = 2  # windows before and after one whose covariances are averaged, and in which an arm settles
TOUCHED = 3.0  # times the median variance: in such a window a touch begins or ends
BURST = 10.0  # times the variance around: what exceeds it is a touch, not a burst of vibration
TURNING, TRAVEL = np.radians(2.0), 0.01  # rad/s and m/s: a slower arm is at rest
EXCESS = 1.5  # times the largest variance that noise alone is expected to have in a window
_CUBIC = 4  # coefficients
NOWHERE = np.repeat([np.nan, 0.0], [4, 3])  # quaternion and position that are not recorded
_FORCE = [0, 7, 14]  # variances of the force in a covariance by rows
_Wrenches = Callable[[Recording], Float[np.ndarray, "n 6"]]


@takes_arrays
class Vibration:
    """The covariances by which a free wrench vibrates while the arm moves, from the wrenches around each sample.

    The log is cut into windows of 0.2 s. The covariance of a window is that of the wrench about its cubic polynomial:
    a tone of 10 Hz keeps 92 % of its amplitude, and a touch that begins within 50 ms has at most 11 % of its force. It
    is averaged over the windows within 0.5 s in which the arm moves, without those of more than 3 times their median
    variance. A window of more variance keeps its own, up to 10 times the mean. Where the noise explains the mean, and
    in directions in which it explains the covariance, nothing vibrates. An arm that turns by less than 2 degrees a
    second and travels less than 10 mm a second is at rest: nothing is added from 0.4 s after its motion on.

    Args:
        noise: (6, 6) covariance of one reading [N, N m], as it remains after the filter.
        filter: filter that the wrenches pass afterwards; None: none.
        rate: [Hz] of the samples, for the filter.

    Attributes:
        covariances: list of (6, 6) [N, N m] in the sensor's frame, by the numbers in VIBRATION; number 0 is zero.
    """

    def __init__(
        self, noise: Float[np.ndarray, "6 6"], filter: Filter | None = None, rate: float | None = None
    ) -> None:
        scale = np.sqrt(np.maximum(np.diag(noise), 1e-24))
        self._scale = np.outer(scale, scale)
        self._filter, self._rate = filter, rate
        self.covariances = [np.zeros((6, 6))]
        self.reset()

    def reset(self) -> None:
        """Forget the vibration that `notes` are about, but not `covariances`, whose numbers earlier blocks have."""
        self._first = len(self.covariances)

    def stream(self, blocks: Iterator[Recording], wrenches: _Wrenches) -> Iterator[Recording]:
        """Return an iterator over the blocks with VIBRATION (n, 1), numbers of `covariances`.

        Args:
            blocks: of the log, in order, with ORIENTATION.
            wrenches: returns a block's wrenches (n, 6) [N, N m] in the sensor's frame, with or without the payload; a
                cubic polynomial follows the weight of a turning one.
        """
        self.reset()
        return with_columns(blocks, partial(self._numbers, wrenches), _with_number, 1)

    def notes(self) -> tuple[str, ...]:
        """Return a note on the largest vibration so far, in a tuple; () if it is within the noise."""
        largest = max((float(np.trace(each[:3, :3])) for each in self.covariances[self._first :]), default=0.0) ** 0.5
        if largest <= np.trace(self._scale[:3, :3]) ** 0.5:
            return ()
        said = f"the wrench vibrates by up to {largest:.2g} N while the arm moves: covariances were widened by it"
        advice = "" if self._filter is not None else "; with a [filter] in the rig, lighter touches are found then"
        return (said + advice,)

    def _numbers(self, wrenches: _Wrenches, blocks: Iterator[Recording]) -> Iterator[Float[np.ndarray, "m 1"]]:
        """Yield the numbers of the rows; windows are counted from the first row, and known ones are forgotten."""
        held, step, length, done = HeldRows(), WINDOW, 0, 0
        path: Float[np.ndarray, "w 12"] = np.zeros((0, 12))  # of windows from `first` on
        covariance: Float[np.ndarray, "w 36"] = np.zeros((0, 36))
        first = answered = 0
        for block in chain(blocks, [None]):
            if block is not None:
                held.add(block)
                if held.count - done < ENOUGH:
                    continue
            if not length:
                step, length = _window(held.values(0, held.count, lambda block, rows: block.time[rows]))
            done, last = held.count, block is None
            end = held.count // length
            path = np.concatenate([path, _path(held, (first + len(path)) * length, end * length, length)])
            moving = _moving(path, step * length)
            seen = slice(len(covariance), len(path) if last else max(len(covariance), len(path) - 1))
            if moving[seen].any():
                span = (first + seen.start) * length, (first + seen.stop) * length
                read = held.values(*span, lambda block, rows: wrenches(block.picked(rows)))
                fresh = self._seen(read.reshape(-1, length, 6))
            else:
                fresh = np.full((seen.stop - seen.start, 36), np.nan)
            covariance = np.concatenate([covariance, fresh])
            ready = seen.stop if last else max(answered, seen.stop - AROUND)
            mean, own = _around(covariance, moving[: seen.stop])
            numbers = self._numbered(mean[answered:ready], own[answered:ready], length)
            yield np.repeat(numbers, length)[:, None]
            if last:  # the rest is shorter than a window
                yield np.repeat(numbers[-1:] if len(numbers) else np.zeros(1), held.count - end * length)[:, None]
            known = max(0, ready - AROUND - 1)
            first, answered = first + known, ready - known
            path, covariance = path[known:], covariance[known:]
            held.forget((first + len(covariance)) * length)

    def _seen(self, windows: Float[np.ndarray, "w l 6"]) -> Float[np.ndarray, "w 36"]:
        """Return the covariance of the wrench in each window, after the filter."""
        count, length, _ = windows.shape
        wrench = _without_cubic(windows)
        if self._filter is None or self._rate is None:
            return (wrench.swapaxes(1, 2) @ wrench).reshape(count, 36) / (length - _CUBIC)
        taper = np.hanning(length)
        wave = np.fft.rfft(wrench * taper[:, None], axis=1)
        wave *= self._filter.gain(np.fft.rfftfreq(length, 1.0 / self._rate), self._rate)[:, None]
        two_sides = 2.0 / (length * np.sum(taper**2))
        return two_sides * np.einsum("wfi,wfj->wij", wave, wave.conj()).real.reshape(count, 36)

    def _numbered(
        self, mean: Float[np.ndarray, "w 36"], own: Float[np.ndarray, "w 36"], length: int
    ) -> Float[np.ndarray, " w"]:
        """Return the number of what exceeds the noise in each window of `length` samples, 0 if `mean` does not.

        The largest variance of white noise of variance 1 is about (1 + sqrt(6 / length))^2 [Marchenko and Pastur 1967].
        """
        noise = EXCESS * (1.0 + (6.0 / (length - _CUBIC)) ** 0.5) ** 2
        numbers, some = np.zeros(len(mean)), np.flatnonzero(mean.any(axis=1))
        some = some[np.linalg.eigvalsh(mean[some].reshape(-1, 6, 6) / self._scale)[:, -1] > noise]
        size, axes = np.linalg.eigh(own[some].reshape(-1, 6, 6) / self._scale)
        for k in np.flatnonzero(size[:, -1] > noise):
            numbers[some[k]] = len(self.covariances)
            more = np.where(size[k] > noise, size[k] - 1.0, 0.0)
            self.covariances.append((axes[k] * more) @ axes[k].T * self._scale)
        return numbers


def _path(held: HeldRows, first: int, end: int, length: int) -> Float[np.ndarray, "w 12"]:
    """Return the mean rotation (9) and position (3) of the poses of each window; NaN where none is known."""
    every = length // POSES
    poses = held.values(first, end, _poses, every)
    rotations = rotation_from_quaternion(poses[:, :4]).reshape(-1, 9)
    rows = np.concatenate([rotations, poses[:, 4:]], axis=1).reshape(-1, POSES, 12)
    known = np.isfinite(rows)
    with np.errstate(invalid="ignore"):
        return np.sum(rows, axis=1, where=known) / known.sum(axis=1)


def _poses(block: Recording, rows: slice) -> Float[np.ndarray, "n 7"]:
    """Return quaternions and positions of rows, (n, 7); NaN and 0 where there are none."""
    taken = np.tile(NOWHERE, (len(block.time[rows]), 1))
    for name, columns in ((ORIENTATION, slice(4)), (POSITION, slice(4, 7))):
        if name in block.channels:
            taken[:, columns] = block.channels[name][rows]
    return taken


def _without_cubic(windows: Float[np.ndarray, "w l k"]) -> Float[np.ndarray, "w l k"]:
    """Subtract from each window its cubic polynomial."""
    basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, windows.shape[1]), _CUBIC))[0]
    return windows - basis @ (basis.T @ windows)


def _around(
    covariance: Float[np.ndarray, "w 36"], moving: Bool[np.ndarray, " w"]
) -> tuple[Float[np.ndarray, "w 36"], Float[np.ndarray, "w 36"]]:
    """Return the mean covariance of the windows around each in which the arm moves, and its own if that is larger."""
    if not len(covariance):
        return covariance, covariance
    pad = np.full((AROUND, 37), np.nan)
    size = np.where(moving, covariance[:, _FORCE].sum(axis=1), np.nan)
    padded = np.concatenate([pad, np.column_stack([size, covariance]), pad])
    near = sliding_window_view(padded, 2 * AROUND + 1, axis=0)  # (w, 37, 5)
    count = np.isfinite(near[:, 0]).sum(axis=1, keepdims=True)
    median = np.take_along_axis(np.sort(near[:, 0], axis=1), np.maximum(count - 1, 0) // 2, axis=1)  # NaN come last
    kept = near[:, 0] <= TOUCHED * median  # not NaN
    mean = np.sum(near[:, 1:], axis=2, where=kept[:, None]) / np.maximum(kept.sum(axis=1, keepdims=True), 1)
    usual, own = mean[:, _FORCE].sum(axis=1), mean.copy()
    burst = size > usual  # not NaN
    own[burst] = covariance[burst] * np.minimum(1.0, BURST * usual / np.where(burst, size, 1.0))[burst, None]
    return mean, own


def _moving(path: Float[np.ndarray, "w 12"], seconds: float) -> Bool[np.ndarray, " w"]:
    """Return in which windows the arm moves, by the mean rotations and positions of windows that follow each other."""
    steps = np.diff(path, axis=0)
    turned, moved = np.linalg.norm(steps[:, :9], axis=1) / 2**0.5, np.linalg.norm(steps[:, 9:], axis=1)
    quick = (turned > TURNING * seconds) | (moved > TRAVEL * seconds)  # not NaN
    return np.append(quick, False)[: len(path)] | np.append(False, quick)[: len(path)]


def _window(time: Float[np.ndarray, " n"]) -> tuple[float, int]:
    """Return the usual step [s] of times, and the number of samples of a window."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    step = float(np.median(steps)) if len(steps) else WINDOW
    return step, POSES * max(2, round(WINDOW / step / POSES))


def _with_number(block: Recording, number: Float[np.ndarray, "n 1"]) -> Recording:
    return replace(block, channels={**block.channels, VIBRATION: number})
