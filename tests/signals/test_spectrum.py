"""A spectrum holds the signal's variance where the signal is; the cut-off is where a known band ends."""

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from palpate.errors import InputError
from palpate.signals.filters import Kalman
from palpate.signals.spectrum import propose_cutoff, spectrum, steady_stretches


def _banded(rng: np.random.Generator, count: int, edge: float, rate: float) -> np.ndarray:
    """Unit noise of a steep band below `edge` [Hz], on three axes."""
    sections = butter(8, edge, fs=rate, output="sos")
    band = sosfilt(sections, rng.normal(size=(count, 3)), axis=0)
    return band / band.std(axis=0)


@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_the_integral_is_the_variance(rate: float) -> None:
    """Parseval. White noise of 60,000 samples: a variance within 3 %, four standard deviations and the ends' window."""
    values = np.random.default_rng(0).normal(0.0, [0.1, 1.0, 10.0], (60_000, 3))
    found = spectrum(np.arange(60_000) / rate, values)
    assert np.sum(found.density, axis=0) * found.frequency[0] == pytest.approx([0.01, 1.0, 100.0], rel=0.03)
    assert found.rate == pytest.approx(rate, rel=1e-12)
    assert rate / 2 - found.frequency[-1] == pytest.approx(found.frequency[0])


@pytest.mark.parametrize(("edge", "rate"), [(3.0, 200.0), (10.0, 200.0), (20.0, 1000.0), (80.0, 1000.0)])
@pytest.mark.parametrize("loudness", [3.0, 30.0])
def test_the_cut_off_is_where_signal_and_noise_are_alike(edge: float, rate: float, loudness: float) -> None:
    """Closed form: the 8th-order skirt meets the floor where the sum of the two is twice the floor.

    It is (tan(pi f/rate)/tan(pi edge/rate))^-16 of the level in the band. Smoothing over a third of an octave moves the
    crossing by half of that, 12 %.
    """
    rng = np.random.default_rng(1)
    values = 0.02 * (loudness * _banded(rng, 40_000, edge, rate) + rng.normal(size=(40_000, 3)))
    proposal = propose_cutoff(spectrum(np.arange(40_000) / rate, values))
    level = loudness**2 * (rate / 2) / edge  # of the signal over that of the noise, within the band
    meets = rate / np.pi * np.arctan(np.tan(np.pi * edge / rate) * level ** (1 / 16))
    assert proposal.frequency == pytest.approx(meets, rel=0.15)
    assert np.sqrt(proposal.floor * rate / 2) == pytest.approx(np.full(3, 0.02), rel=0.1)


def test_a_hum_is_no_signal() -> None:
    """A line at 50 Hz stands a thousandfold above the floor, and does not move the cut-off of a 5 Hz motion."""
    rng, time = np.random.default_rng(2), np.arange(40_000) / 500.0
    values = _banded(rng, 40_000, 5.0, 500.0) + 0.05 * rng.normal(size=(40_000, 3))
    humming = values + 0.2 * np.sin(2 * np.pi * 50 * time)[:, None]
    quiet, loud = (propose_cutoff(spectrum(time, some)).frequency for some in (values, humming))
    assert quiet is not None
    assert loud == pytest.approx(quiet, rel=0.3)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("count", [400, 5_000, 50_000])
def test_white_noise_has_no_cut_off(seed: int, count: int) -> None:
    values = np.random.default_rng(seed).normal(size=(count, 3))
    proposal = propose_cutoff(spectrum(np.arange(count) / 200.0, values))
    assert proposal.frequency is None
    assert "white" in proposal.sentence


def test_a_log_that_was_filtered_before_is_not_filtered_again() -> None:
    """A first-order low-pass at 40 Hz leaves no floor below a fifth of the rate."""
    white = np.random.default_rng(3).normal(size=(40_000, 3))
    values = sosfilt(butter(1, 40.0, fs=1000.0, output="sos"), white, axis=0)
    proposal = propose_cutoff(spectrum(np.arange(40_000) / 1000.0, values))
    assert proposal.frequency is None
    assert "filtered before" in proposal.sentence


def test_the_kalman_setting_has_the_cut_off_that_is_said() -> None:
    """The proposed q and r, read from the sentence, give a filter that is 3 dB down at the proposed frequency."""
    rng = np.random.default_rng(4)
    values = _banded(rng, 40_000, 10.0, 200.0) + 0.1 * rng.normal(size=(40_000, 3))
    proposal = propose_cutoff(spectrum(np.arange(40_000) / 200.0, values))
    assert proposal.frequency is not None
    words = proposal.settings[1].replace(",", " ").replace(":", " ").split()
    q, r = (float(words[words.index(name) + 1]) for name in ("q", "r"))
    assert Kalman(q, r).gain(proposal.frequency, 200.0) == pytest.approx(0.5**0.5, rel=0.01)  # printed to 3 digits
    assert r == pytest.approx(0.01, rel=0.1)


def test_stretches_end_at_gaps_and_holes() -> None:
    time = np.concatenate([np.arange(100), 500 + np.arange(100), 900 + np.arange(20)]) * 0.01
    values = np.ones((220, 1))
    values[40] = np.nan
    pieces = list(steady_stretches(time, values, 0.01))
    assert [(piece.start, piece.stop) for piece in pieces] == [(0, 40), (41, 100), (100, 200)]


def test_short_answered_stretches_are_enough() -> None:
    """Touches of 0.9 s at 200 Hz with nothing in between: the variance of what is there."""
    rng = np.random.default_rng(5)
    values = np.full((20_000, 3), np.nan)
    for start in range(0, 20_000, 400):
        values[start : start + 180] = rng.normal(size=(180, 3)) + 100 * rng.normal(size=3)
    found = spectrum(np.arange(20_000) / 200.0, values)
    assert found.stretches == 50
    density = np.median(found.density[len(found.density) // 2 :], axis=0)
    assert density == pytest.approx(np.full(3, 2 / 200.0), rel=0.15)  # a variance of 1 over the band of 100 Hz


@pytest.mark.parametrize(
    "time",
    [
        np.repeat(np.arange(200) * 0.02, 5),  # in bursts of five
        np.full(1000, 3.0),
        np.full(1000, np.nan),
        np.cumsum(np.random.default_rng(6).exponential(0.01, 1000)),
    ],
)
def test_a_rate_that_wanders_is_refused(time: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"steady rate|must increase"):
        spectrum(time, np.random.default_rng(7).normal(size=(1000, 3)))


def test_the_clock_may_tremble_and_a_constant_has_no_floor() -> None:
    rng = np.random.default_rng(8)
    time = np.arange(4_000) * 0.005 + rng.normal(0.0, 2e-4, 4_000)
    assert spectrum(time, rng.normal(size=(4_000, 3))).samples == 4_000
    assert propose_cutoff(spectrum(time, np.ones((4_000, 3)))).frequency is None
