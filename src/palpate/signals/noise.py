"""Estimate the noise of a log: standard deviation of a reading, and its spectrum."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view

from palpate.errors import InputError
from palpate.signals.filters import Filter
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value, takes_arrays

WINDOW = 32  # samples in which a log is steady or is not
SHORT, STRIDE = 8, 2  # samples of a window between quick presses, and from one to the next
SHORT_SPREAD = 6.3  # `SPREAD` of as few samples, times their median, which edges of presses hardly move
SHORT_MEDIAN = 0.891  # median over mean of the variance in them
PRESSED = 1.5  # times the deviation of short windows: longer ones hold presses or motion
FEW, MANY = 0.05, 0.9  # of the short windows are quiet between presses; of a slow hum all are
AROUND, FREE, HOME = 250, 1.5, 0.3  # quiet windows about one, deviations from its level, their share: the free level
FEWEST = 10  # samples for an estimate
QUIET = 0.1  # of the windows are taken as quiet, to begin with
SPREAD = 2.5  # times the variance of the quiet ones: of noise alone, one window in 100,000 has more
MOST_HELD = 10  # readings that repeat one another
NEAR = 5.0  # standard deviations: a contact begins at ten
SEGMENTS = 8  # that a spectrum is averaged over, at least
LONGEST = 2048  # samples of a segment
HARMONICS = 3  # of the error of a quantised reading; the next is below 1 % of its variance
STILL, POSES = 2.0, 10.0  # degrees a second of a sensor at rest, degrees a sample of a log of poses
WRONG = 2.0  # times too large or too small: reported


@frozen_value
class NoiseSpectrum(Value):
    """Distribution of the variance of a reading over frequencies.

    Args:
        frequency: (k,) [cycles per sample]; 0 stands for changes slower than the segments.
        power: (k, c) shares of the variance of each channel, which sum to 1.
    """

    frequency: Float[np.ndarray, " k"]
    power: Float[np.ndarray, "k c"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency", frozen(self.frequency))
        object.__setattr__(self, "power", frozen(self.power))

    @classmethod
    def of_corner(cls, corner: float, rate: float) -> NoiseSpectrum:
        """Return the `NoiseSpectrum` of white plus 1/f noise of density 1 + corner/f, the same in six channels.

        Its frequencies are from 10^-6 to 1/2 cycles per sample.

        Args:
            corner: [Hz] where white and 1/f noise are equal.
            rate: [Hz] of the samples.

        Raises:
            InputError: the corner or the rate is not positive.
        """
        if not (corner > 0 and rate > 0):
            raise InputError(f"the corner ({corner:g} Hz) of the noise and the rate ({rate:g} Hz) must be positive.")
        edges = np.geomspace(1e-6, 0.5, 400)
        middle: np.ndarray = np.sqrt(edges[1:] * edges[:-1])
        power = np.diff(edges) + corner / rate * np.diff(np.log(edges))
        return cls(middle, np.repeat(power[:, None] / power.sum(), 6, axis=1))

    def kept(self, made: Filter, rate: float) -> Float[np.ndarray, " c"]:
        """Return the share (c,) of each channel's variance that a settled filter keeps for samples at `rate` [Hz].

        It is the sum of power |H|^2, H the filter's gain.

        Raises:
            InputError: the rate is not positive, or the filter's cut-off does not fit it.
        """
        return made.gain(self.frequency * rate, rate) ** 2 @ self.power

    def of_mean(self, count: int) -> Float[np.ndarray, " c"]:
        """Return the share (c,) of each channel's variance in the mean of `count` samples (Dirichlet's kernel)."""
        angle = np.pi * np.maximum(self.frequency, 1e-12)
        return (np.sin(count * angle) / (count * np.sin(angle))) ** 2 @ self.power


@frozen_value
class Noise(Value):
    """Noise of a log.

    Args:
        deviation: (c,) standard deviation of one reading [unit of the channel].
        samples: number of samples that it comes from.
        spectrum: of the noise; None: taken as white.
    """

    deviation: Float[np.ndarray, " c"]
    samples: int
    spectrum: NoiseSpectrum | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "deviation", frozen(self.deviation))


@takes_arrays
def estimate_noise(readings: Float[np.ndarray, "n k"], *, moving: bool = False) -> Noise | None:
    """Return the `Noise` of one reading in the quiet parts of a log, as white; None for under ten finite samples.

    The log is cut into windows of 32 samples, each less its own straight line. Quiet are the quietest tenth of them,
    and those of at most 2.5 times the mean variance of the quiet ones. If windows of 8 samples have a deviation 1.5
    times smaller and many lie at one level, presses follow each other within 32 samples, and the short windows count.
    With a resolution q, the deviation is q / sqrt(12) or more.

    Args:
        readings: (n, k) of k channels, as logged.
        moving: the sensor moves with a load, so short windows count at any level.

    Raises:
        InputError: readings has another shape.
    """
    usable = _unheld(readings[np.isfinite(readings).all(axis=1)])
    if len(usable) < FEWEST:
        return None
    windows, variance, quiet = _judged(usable)
    deviation, samples = _deviation(variance, quiet, resolution_of(usable)), quiet.all(axis=1).sum() * windows.shape[1]
    return _between_presses(usable, deviation, moving=moving) or Noise(deviation, int(samples))


@takes_arrays
def rest_noise(readings: Float[np.ndarray, "n k"], *, wander: bool = True) -> Noise | None:
    """Return the `Noise` of a log where it rests at one level, drift included; None where it hardly does.

    Rest is where every channel is quiet (`estimate_noise`) and within 5 standard deviations of the level before.
    Periodograms [welch] of the parts at rest give the noise within a segment; the variance of the segments' means is
    drift, and stands at frequency 0.

    The error of a reading of resolution q that hardly moves is the same in every sample; of its variance q^2/12, sum
    over k of q^2/(2 pi^2 k^2) exp(-4 pi^2 k^2 s^2/q^2) stays so under noise of standard deviation s, and stands at 0,
    too [Widrow 1996].

    Args:
        readings: (n, k) of k channels, evenly spaced, as logged.
        wander: count drift of the zero. False: each segment is taken less its straight line.

    Raises:
        InputError: readings has another shape.
    """
    usable = readings[np.isfinite(readings).all(axis=1)]
    if len(usable) < 2 * WINDOW:
        return None
    resolution = resolution_of(usable)
    resting, window = _resting(usable, resolution)
    segments = _segments(usable, resting, window)
    if segments is None:
        return None
    count, length = segments.shape[:2]
    taper = np.hanning(length)
    middle = segments.mean(axis=1, keepdims=True)
    left = segments - middle if wander else _straightened(segments)
    waves = np.fft.rfft(left * taper[:, None], axis=1)[:, 1:]
    density = 2.0 * np.mean(np.abs(waves) ** 2, axis=0) / (length * np.sum(taper**2))
    density[-1] /= 2.0  # at half the rate two sides are one
    within, between = density.sum(axis=0), density[0] / 2.0  # at least, by 1/f noise below the lowest bin
    if wander:
        between = np.maximum(middle[:, 0].var(axis=0, ddof=1), between)
    stays = _stuck(within, resolution)
    total = np.maximum(within + between, resolution**2 / 12.0)
    moves = np.where(within > 0, np.maximum(total - between - stays, 0.0) / np.where(within > 0, within, 1.0), 0.0)
    power = np.concatenate([(total - moves * within)[None], density * moves])
    power[0, total <= 0] = 1.0
    frequency = np.fft.rfftfreq(length)
    spectrum = NoiseSpectrum(frequency, power / np.where(total > 0, total, 1.0))
    return Noise(np.sqrt(total), count * length, spectrum)


@takes_arrays
def log_noise(
    time: Float[np.ndarray, " n"],
    wrenches: Float[np.ndarray, "n 6"],
    quaternions: Float[np.ndarray, "n 4"] | None = None,
    *,
    wander: bool = True,
) -> tuple[Noise | None, str]:
    """Return the `Noise` of a log of wrenches and where it comes from, or None and why it cannot be known.

    Where orientations are known, only samples count in which the sensor turns by less than 2 degrees a second; if there
    are hardly any, the windows of `estimate_noise` count while it moves. The noise cannot be known if the sensor turns
    by more than 10 degrees from one sample to the next, or if a channel never changes.

    Args:
        time: (n,) [s].
        wrenches: (n, 6) [N, N m], without the payload if that is known; NaN in unusable samples.
        quaternions: (n, 4) sensor in base, x, y, z, w; None: not known.
        wander: count drift of the zero, as in `rest_noise`.

    Raises:
        InputError: arrays of other shapes.
    """
    usable = np.isfinite(wrenches).all(axis=1)
    where, moving = "where it rests", False
    if quaternions is not None and np.isfinite(angles := _angles(quaternions, 1)).any() and len(time) > SHORT:
        still = _still(time, quaternions)
        moving = bool(np.count_nonzero(still & usable) < min(20 * WINDOW, np.count_nonzero(usable)))
        if moving and np.nanmedian(angles) > POSES:
            return None, "each sample has another orientation, so differences between poses hide it"
        usable = usable if moving else usable & still
    readings = wrenches[usable]
    found = None if moving else rest_noise(readings, wander=wander)
    if found is None:
        where = "while the sensor moves, taken as white" if moving else "in its quiet parts, taken as white"
        found = estimate_noise(readings, moving=moving)
    if found is None:
        return None, f"{len(readings)} samples are usable, and it needs {FEWEST}"
    if not found.deviation.all():
        return None, f"{np.count_nonzero(found.deviation == 0)} of 6 channels never change"
    return found, where


def _still(time: Float[np.ndarray, " n"], quaternions: Float[np.ndarray, "n 4"]) -> Bool[np.ndarray, " n"]:
    """Return the samples in which the sensor hardly turns, in complete windows of 32, or all where it never turns."""
    over: Float[np.ndarray, " m"] = np.abs(time[SHORT:] - time[:-SHORT])
    slow = _angles(quaternions, SHORT) < np.minimum(STILL * over, STILL)
    if slow.all():
        return np.ones(len(time), dtype=np.bool_)
    still = np.zeros(len(time), dtype=np.bool_)
    for start, end in np.flatnonzero(np.diff(slow, prepend=False, append=False)).reshape(-1, 2).tolist():
        still[start : end - (end - start) % WINDOW] = True
    return still


def _angles(quaternions: Float[np.ndarray, "n 4"], step: int) -> Float[np.ndarray, " m"]:
    """Return the angles [degrees] between orientations that are `step` samples apart."""
    cosine = np.abs(np.sum(quaternions[step:] * quaternions[:-step], axis=1))
    return np.rad2deg(2.0 * np.arccos(np.minimum(cosine, 1.0)))


@takes_arrays
def wrong_noise(stated: Float[np.ndarray, "6"], seen: Float[np.ndarray, "6"]) -> str:
    """Return a sentence if stated standard deviations (6,) of a wrench differ twofold from those of a log, else "".

    Raises:
        InputError: arrays of other shapes.
    """
    wrong: list[str] = []
    for part, unit in ((slice(0, 3), "N"), (slice(3, 6), "N m")):
        said, found = (float(np.sqrt(np.mean(values[part] ** 2))) for values in (stated, seen))
        if found > 0 and not 1 / WRONG < found / said < WRONG:
            ratio = f"{found / said:.2g} times less" if found > said else f"{said / found:.2g} times more"
            wrong.append(f"{said:.2g} {unit} is {ratio} than the {found:.2g} {unit}")
    if not wrong:
        return ""
    found = " and ".join(wrong)
    return f"the stated noise is not that of the log: {found} in it; the ellipses are wrong in the same ratio"


def _unheld(readings: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "m k"]:
    """Keep every n-th row of a driver that repeats each reading n times."""
    changes = np.flatnonzero((np.diff(readings, axis=0) != 0).any(axis=1))
    held = int(np.median(np.diff(changes))) if len(changes) > FEWEST else 1
    return readings[:: min(max(held, 1), MOST_HELD)]


def _straightened(windows: Float[np.ndarray, "w l k"]) -> Float[np.ndarray, "w l k"]:
    """Subtract from each window its straight line."""
    length = windows.shape[1]
    line: Float[np.ndarray, "l 1"] = np.arange(1.0, length + 1.0)[:, None] - (length + 1) / 2
    slope: Float[np.ndarray, "w k"] = np.einsum("lz,wlk->wk", line, windows) / float(np.einsum("lz,lz->", line, line))
    return windows - windows.mean(axis=1, keepdims=True) - slope[:, None] * line


def _judged(
    readings: Float[np.ndarray, "n k"],
) -> tuple[Float[np.ndarray, "w l k"], Float[np.ndarray, "w k"], Bool[np.ndarray, "w k"]]:
    """Return complete windows, their variances, and where they are noise alone."""
    length = int(np.clip(len(readings) // 20, min(FEWEST, len(readings)), WINDOW))  # shorter in a short log
    count = len(readings) // length
    windows = readings[: count * length].reshape(count, length, readings.shape[1])
    variance = np.sum(_straightened(windows) ** 2, axis=1) / (length - 2)
    least = np.maximum(resolution_of(readings) ** 2 / 12.0, 1e-30)
    quiet = np.stack([_quiet(column, SPREAD) for column in (variance + least).T], axis=1)
    whole = np.all(quiet, axis=1, keepdims=True)
    return windows, variance, np.repeat(whole, quiet.shape[1], axis=1) if whole.mean() >= QUIET else quiet


def _between_presses(
    readings: Float[np.ndarray, "n k"], deviation: Float[np.ndarray, " k"], *, moving: bool = False
) -> Noise | None:
    """Return the noise of short windows where presses or motion fill the long ones; None where they do not.

    It is so if the short windows have much less noise than `deviation`, some of them do not, and many of those that do
    lie at one level, where the sensor is free; windows of a `moving` sensor may lie anywhere.
    """
    if len(readings) < 4 * SHORT:
        return None
    windows: Float[np.ndarray, "w l k"] = np.moveaxis(sliding_window_view(readings, SHORT, axis=0)[::STRIDE], 2, 1)
    variance, resolution = np.sum(_straightened(windows) ** 2, axis=1) / (SHORT - 2), resolution_of(readings)
    least = np.maximum(resolution**2 / 12.0, 1e-30)
    quiet = np.all([_quiet(column, SHORT_SPREAD, np.median) for column in (variance + least).T], axis=0)
    if not quiet.any():
        return None
    short = np.sqrt(np.maximum(np.median(variance[quiet], axis=0) / SHORT_MEDIAN, resolution**2 / 12.0))
    if np.all(PRESSED * short > deviation) or not (moving or FEW <= quiet.mean() <= MANY):
        return None
    level = windows.mean(axis=1)[quiet] / np.maximum(short, 1e-30)
    some = np.linspace(0, len(level) - 1, 100).astype(np.int64)
    near = [np.abs(level[max(k - AROUND, 0) : k + AROUND] - level[k]).max(axis=1) < FREE for k in some]
    if moving or np.quantile([each.mean() for each in near], 0.9) > HOME:
        return Noise(short, STRIDE * int(np.count_nonzero(quiet)))
    return None


def _quiet(
    variance: Float[np.ndarray, " w"], spread: float, middle: Callable[[np.ndarray], np.floating] = np.mean
) -> Bool[np.ndarray, " w"]:
    """Return the windows of at most `spread` times the mean variance of the quietest ones, or another `middle`."""
    quiet = variance <= np.quantile(variance, QUIET)
    while True:
        more = variance <= spread * middle(variance[quiet])
        if np.count_nonzero(more) <= np.count_nonzero(quiet):
            return quiet
        quiet = more


def _deviation(
    variance: Float[np.ndarray, "w k"], quiet: Bool[np.ndarray, "w k"], resolution: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Return the standard deviation in the quiet windows."""
    mean = np.mean(variance, axis=0, where=quiet)
    return np.sqrt(np.maximum(mean, resolution**2 / 12.0))


@takes_arrays
def resolution_of(readings: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " k"]:
    """Return the step (k,) of which all differences in a column are multiples; 0 where there is none.

    Raises:
        InputError: readings has another shape.
    """
    return np.array([_step(np.unique(column)) for column in readings.T])


def _step(levels: Float[np.ndarray, " m"]) -> float:
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * np.abs(levels).max()]  # else rounding of the same reading
    if not len(gaps):
        return 0.0
    step = float(gaps.min())
    multiples = gaps / step
    whole = np.abs(multiples - np.round(multiples)) < 0.05
    return float(np.sum(gaps) / np.sum(np.round(multiples))) if whole.mean() > 0.95 else 0.0


def _resting(
    readings: Float[np.ndarray, "n k"], resolution: Float[np.ndarray, " k"]
) -> tuple[Bool[np.ndarray, " w"], int]:
    """Return which windows are at rest, and the samples of a window."""
    windows, variance, quiet = _judged(readings)
    resting: Bool[np.ndarray, " w"] = np.asarray(np.all(quiet, axis=1))
    deviation = np.maximum(_deviation(variance, quiet, resolution), 1e-15)
    if _between_presses(readings, deviation) is not None:
        resting[:] = False
    level = windows.mean(axis=1) / (NEAR * deviation)
    among = np.flatnonzero(resting)
    if not len(among):
        return resting, windows.shape[1]
    some = np.arange(0, len(among), max(1, len(among) // 400))
    near = [np.count_nonzero(np.abs(level[among[some]] - level[among[k]]).max(axis=1) <= 1.0) for k in some]
    start = int(some[np.argmax(near)])
    for order in (among[start:], among[start::-1]):  # a wander is followed, step by step
        last = level[among[start]]
        for k in order:
            if np.abs(level[k] - last).max() <= 1.0:
                last = level[k]
            else:
                resting[k] = False
    return resting, windows.shape[1]


def _segments(
    readings: Float[np.ndarray, "n k"], resting: Bool[np.ndarray, " w"], window: int
) -> Float[np.ndarray, "s l k"] | None:
    """Return stretches of rest of one length; None if there are too few."""
    rests = window * np.flatnonzero(np.diff(resting, prepend=False, append=False)).reshape(-1, 2)  # start, end
    length = LONGEST
    while length > window // 2 and np.sum(np.diff(rests) // length) < SEGMENTS:
        length //= 2
    first = [k for start, end in rests.tolist() for k in range(start, end - length + 1, length)]
    if len(first) < 2 or length < FEWEST:
        return None
    return np.stack([readings[k : k + length] for k in first])


def _stuck(within: Float[np.ndarray, " k"], resolution: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return the variance of a quantised reading that is the same in every sample."""
    step = np.where(resolution > 0, resolution, 1.0)
    moving = np.maximum(within / step**2 - 1.0 / 12.0, 0.0)
    order = np.arange(1, HARMONICS + 1)[:, None]
    share = np.sum(np.exp(-4 * np.pi**2 * order**2 * moving) / (2 * np.pi**2 * order**2), axis=0)
    return np.where(resolution > 0, share * step**2, 0.0)
