"""Estimate the spectrum of a signal, and the frequency above which it is noise only."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, pi

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.signals.filters import Butterworth, Kalman
from palpate.signals.recording import LARGEST
from palpate.spatial.arguments import frozen_value, takes_arrays

EVEN = 0.5  # of the usual step: what a step may differ by in a stretch that counts as evenly sampled
SHORTEST, LONGEST = 32, 8192  # samples of one of Welch's segments
RESOLUTION = 0.25  # Hz that a log of an arm deserves, where it is long enough
ABOVE = 2.0  # times the floor: below it, a band holds more noise than signal
TOP = (0.6, 0.95)  # of the Nyquist frequency: the band whose median is the floor
NARROW: float = 2 ** (1 / 3)  # the ratio of the ends of the band that each figure is the median of: a hum is no signal
HIGHEST = 0.2  # of the rate: above it a filter takes off too little to be worth its lag


@frozen_value(eq=True)
class Spectrum:
    """Welch's estimate of power spectral densities, one-sided.

    Attributes:
        frequency: (k,) [Hz].
        density: (k, c) [unit^2/Hz] of each channel; its integral is the variance.
        rate: [Hz] of the samples.
        samples: number of samples used.
        segments: number of periodograms averaged.
        stretches: number of stretches, of even steps and without NaN, that were used.
    """

    frequency: Float[np.ndarray, " k"]
    density: Float[np.ndarray, "k c"]
    rate: float
    samples: int
    segments: int
    stretches: int


@frozen_value(eq=True)
class Cutoff:
    """A cut-off frequency proposed from a spectrum.

    Attributes:
        frequency: [Hz]; None: no filter is proposed.
        floor: (c,) [unit^2/Hz] of the noise in each channel.
        sentence: the finding in words.
        settings: a sentence on each filter with this cut-off, where the channels are forces; else ().
    """

    frequency: float | None
    floor: Float[np.ndarray, " c"]
    sentence: str
    settings: tuple[str, ...] = ()


@takes_arrays
def spectrum(time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n c"]) -> Spectrum:
    """Compute the `Spectrum` of all channels, from stretches with even steps and without NaN [welch].

    Nothing is resampled, as interpolation would colour the floor of the noise.

    Args:
        time: (n,) [s].
        values: (n, c); values beyond `LARGEST` count as NaN.

    Raises:
        InputError: no stretch has 32 samples, or no time step is positive; or arrays of other shapes.
    """
    from scipy.signal import welch

    values = np.where(np.abs(values) <= LARGEST, values, np.nan)
    step = _usual_step(time)
    pieces = list(steady_stretches(time, values, step))
    lengths = np.array([piece.stop - piece.start for piece in pieces], dtype=np.int64)
    segment = _segment(lengths, 1 / step, len(time))
    used = [piece for piece, length in zip(pieces, lengths, strict=True) if length >= segment]
    samples = sum(piece.stop - piece.start for piece in used)
    lasting = float(sum(time[piece.stop - 1] - time[piece.start] for piece in used))
    rate = (samples - len(used)) / lasting  # a median step is as coarse as the clock that stamped it
    total: Float[np.ndarray, "k c"] = np.zeros((segment // 2 + 1, values.shape[1]))
    frequency, weight = np.empty(0), 0
    for piece in used:
        frequency, density = map(np.asarray, welch(values[piece], fs=rate, nperseg=segment, axis=0))
        count = 1 + (piece.stop - piece.start - segment) // (segment - segment // 2)
        total, weight = total + count * density, weight + count
    inner = slice(1, -1)  # the mean is taken off at 0, and at half the rate two sides are one
    return Spectrum(frequency[inner], total[inner] / weight, rate, samples, weight, len(used))


@takes_arrays
def steady_stretches(time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n c"], step: float) -> Iterator[slice]:
    """Yield slices of 32 or more times (n,) [s] with finite values (n, c), in steps within 50 % of `step` [s].

    Raises:
        InputError: arrays of other shapes.
    """
    good = np.isfinite(time) & np.isfinite(values).all(axis=1)
    joined = good[1:] & good[:-1] & (np.abs(np.diff(time) - step) <= EVEN * step)
    for start, end in np.flatnonzero(np.diff(joined, prepend=False, append=False)).reshape(-1, 2).tolist():
        if end + 1 - start >= SHORTEST:
            yield slice(start, end + 1)


def propose_cutoff(found: Spectrum, unit: str = "N") -> Cutoff:
    """Propose the frequency above which the signal stays within the noise, as a `Cutoff`.

    Each channel is divided by its floor, the median of its top band; the mean over the channels is smoothed over a
    third of an octave. The cut-off is where that stays below twice the floor, if that is below a fifth of the rate.

    Args:
        found: from `spectrum`.
        unit: of the channels; settings of filters are given for "N".
    """
    nyquist = found.rate / 2
    top = (found.frequency >= TOP[0] * nyquist) & (found.frequency <= TOP[1] * nyquist)
    floor = np.median(found.density[top], axis=0)
    alive = floor > 0
    if not alive.any():
        return Cutoff(None, floor, "No cut-off: the top of the spectrum is empty, so there is no noise to remove.")
    ratio = _smoothed(found.frequency, np.mean(found.density[:, alive] / floor[alive], axis=1))
    loud = np.flatnonzero(ratio > ABOVE)
    if not len(loud):
        return Cutoff(None, floor, "No cut-off: the spectrum is white, no frequency stands out of the noise.")
    edge = float(found.frequency[min(loud[-1] + 1, len(ratio) - 1)])
    if edge > HIGHEST * found.rate:
        said = (
            f"No cut-off: the signal stands above the noise up to {edge:.3g} Hz, more than a fifth of the rate "
            f"({found.rate:.4g} Hz); or the log has been filtered before and shows no floor."
        )
        return Cutoff(None, floor, said)
    noise = float(floor[alive].mean()) * nyquist
    said = f"Above {edge:.3g} Hz there is noise only, {noise**0.5:.3g} {unit} in each reading."
    return Cutoff(edge, floor, said, _settings(edge, found.rate, noise) if unit == "N" else ())


def _settings(cutoff: float, rate: float, noise: float) -> tuple[str, ...]:
    """Describe the filters with this cut-off [Hz], for readings of variance `noise`; q / r = 2 (1 - cos w)."""
    q = noise * 2 * (1 - cos(2 * pi * cutoff / rate))
    return Butterworth(cutoff, 2).describe(rate), Kalman(q, noise).describe(rate)


def _usual_step(time: Float[np.ndarray, " n"]) -> float:
    steps = np.diff(time[np.isfinite(time)])
    if not np.any(steps > 0):
        raise InputError("must increase for a spectrum.", where="time")
    return float(np.median(steps[steps > 0]))


def _segment(lengths: Int[np.ndarray, " k"], rate: float, count: int) -> int:
    """Return the samples of a segment, a power of two, so that longer stretches contain half of all samples."""
    if not len(lengths):
        raise InputError(
            f"a spectrum needs a steady rate, and no {SHORTEST} samples in a row (of {count}) have one.",
            hint="Stamp samples when they are measured, not when they arrive in bursts; or use a longer log.",
        )
    ordered = np.sort(lengths)[::-1]
    half = int(ordered[np.searchsorted(np.cumsum(ordered), ordered.sum() / 2)])
    finest = min(LONGEST, 2 ** int(np.ceil(np.log2(rate / RESOLUTION))), max(SHORTEST, int(ordered.sum()) // 8))
    return max(SHORTEST, 2 ** int(np.log2(min(half, finest))))


def _smoothed(frequency: Float[np.ndarray, " k"], values: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return the median over a band around each frequency, at least three values."""
    here = np.arange(len(values))
    below: Float[np.ndarray, " k"] = frequency / NARROW**0.5
    above: Float[np.ndarray, " k"] = frequency * NARROW**0.5
    low, high = np.searchsorted(frequency, below), np.searchsorted(frequency, above, side="right")
    first, end = np.minimum(low, (here - 1).clip(min=0)), np.maximum(high, here + 2)
    return np.array([np.median(values[a:b]) for a, b in zip(first, end, strict=True)])
