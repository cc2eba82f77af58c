"""The noise of a log, from the log itself."""

import numpy as np
import pytest
from scipy.signal import lfilter

from palpate.errors import InputError
from palpate.sensors.force_torque.model import ForceTorque
from palpate.signals.correlation import correlation_time
from palpate.signals.filters import Butterworth
from palpate.signals.noise import Noise, NoiseSpectrum, estimate_noise, log_noise, rest_noise, wrong_noise
from palpate.signals.repeats import hung
from palpate.signals.rest import at_rest

DEVIATIONS = np.array([0.02, 0.03, 0.05, 1e-3, 2e-3, 5e-4])
RATE = 500.0  # Hz


def assert_deviation(found: Noise | None, expected: np.ndarray, rtol: float) -> None:
    assert found is not None
    np.testing.assert_allclose(found.deviation, expected, rtol=rtol)


def touched(readings: np.ndarray) -> np.ndarray:
    """The same with a press of 2 s in every 4 s, up and down like a sine, in every channel."""
    time = np.arange(len(readings)) / RATE % 4.0
    press = np.where(time < 2.0, np.sin(np.pi * time / 2.0), 0.0)
    return readings + press[:, None] * 200.0 * DEVIATIONS


def shaped(count: int, corner: float) -> np.ndarray:
    """White noise and noise as 1/f below the corner [Hz]."""
    frequency = np.fft.rfftfreq(count, 1 / RATE)
    frequency[0] = np.inf
    white = np.fft.rfft(np.random.default_rng(5).normal(size=(count, 6)), axis=0)
    return np.fft.irfft(white * np.sqrt(1 + corner / frequency)[:, None], count, axis=0) * DEVIATIONS


def test_it_is_the_deviation_of_a_reading() -> None:
    readings = np.random.default_rng(3).normal(size=(40_000, 6)) * DEVIATIONS
    assert_deviation(estimate_noise(readings), DEVIATIONS, 0.03)  # 40,000 readings tell it to 0.4 %


def test_readings_that_repeat_the_one_before_do_not_count() -> None:
    readings = np.random.default_rng(4).normal(size=(500, 6)) * DEVIATIONS
    once = estimate_noise(readings)
    assert once is not None
    assert_deviation(estimate_noise(np.repeat(readings, 3, axis=0)), once.deviation, 0.0)


@pytest.mark.parametrize("step", [0.0, 1.0, 4.0])  # of the resolution, in deviations
def test_touches_do_not_count_for_half_of_the_time(step: float) -> None:
    readings = touched(np.random.default_rng(6).normal(size=(20_000, 6)) * DEVIATIONS)
    if step:
        readings = np.round(readings / (step * DEVIATIONS)) * step * DEVIATIONS
    # the error of a quantised reading adds q^2/12; four deviations a step hardly show the noise below it
    assert_deviation(estimate_noise(readings), DEVIATIONS * (1 + step**2 / 12) ** 0.5, 0.2)


def test_a_hand_that_trembles_does_not_count() -> None:
    """Half of the time ten times as much as the noise, in seconds that are steady otherwise."""
    rng = np.random.default_rng(7)
    trembling = np.repeat(np.arange(40) % 2 == 1, 500)
    readings = rng.normal(size=(20_000, 6)) * DEVIATIONS * np.where(trembling, 10.0, 1.0)[:, None]
    assert_deviation(estimate_noise(readings), DEVIATIONS, 0.05)  # 10,000 readings tell it to 0.7 %


@pytest.mark.parametrize(("pressed", "free"), [(5, 10), (8, 16), (10, 10), (16, 16), (20, 20), (32, 32), (60, 60)])
@pytest.mark.parametrize("held", [False, True])
def test_presses_that_follow_each_other_quickly_do_not_count(pressed: int, free: int, held: bool) -> None:
    """Sines or steps of 75 to 250 deviations in a direction of their own each, in place of a window at rest."""
    rng = np.random.default_rng(pressed)
    phase = (np.arange(6000) + rng.integers(100)) % (pressed + free)
    shape = np.ones(6000) if held else np.sin(np.pi * (phase + 0.5) / pressed)
    size = rng.uniform(75.0, 250.0, (6000, 6)) * rng.choice([-1.0, 1.0], (6000, 6))
    presses = np.where(phase < pressed, shape, 0.0)[:, None] * size[np.arange(6000) // (pressed + free)]
    assert_deviation(estimate_noise((rng.normal(size=(6000, 6)) + presses) * DEVIATIONS), DEVIATIONS, 0.25)


def _turned(angle: np.ndarray) -> np.ndarray:
    """Quaternions of turns [rad] about x, in which the weight acts along y and z."""
    return np.stack([np.sin(angle / 2), *np.zeros((2, len(angle))), np.cos(angle / 2)], axis=1)


def test_differences_between_poses_are_no_noise() -> None:
    rng, time = np.random.default_rng(9), np.arange(200) / 10.0
    angle = rng.uniform(-3.0, 3.0, 200)
    weight = np.zeros((200, 6))
    weight[:, 1], weight[:, 2] = 30.0 * np.sin(angle), 30.0 * np.cos(angle)
    found, why = log_noise(time, weight + rng.normal(size=(200, 6)) * DEVIATIONS, _turned(angle))
    assert found is None
    assert "another orientation" in why


@pytest.mark.parametrize("rate", [100.0, 500.0])
@pytest.mark.parametrize("rests", [False, True])
def test_an_arm_that_moves_with_its_load_has_the_noise_of_its_sensor(rate: float, rests: bool) -> None:
    """A weight of 10 N that is compensated to 5 %, turned by up to 60 degrees a second."""
    rng, time = np.random.default_rng(10), np.arange(8000) / rate
    angle = np.sin(np.where(rests & (time < 1000 / rate), 0.0, time))
    wrenches = rng.normal(size=(8000, 6)) * DEVIATIONS
    wrenches[:, 1] += 0.5 * np.sin(angle)
    wrenches[:, 2] += 0.5 * np.cos(angle)
    found, where = log_noise(time, wrenches, _turned(angle))
    assert_deviation(found, DEVIATIONS, 0.25)
    assert ("rests" in where) == rests


@pytest.mark.parametrize("channels", [[2], [0, 1, 2, 3, 4, 5]])
def test_a_channel_that_never_changes_has_no_noise(channels: list[int]) -> None:
    readings = np.random.default_rng(11).normal(size=(500, 6)) * DEVIATIONS
    readings[:, channels] = 0.0
    assert log_noise(np.arange(500) / RATE, readings) == (None, f"{len(channels)} of 6 channels never change")


def test_noise_as_one_over_f_passes_a_filter_as_its_spectrum_says() -> None:
    noise, made = shaped(40_000, 5.0), Butterworth(10.0)
    found = rest_noise(touched(noise))
    assert found is not None
    assert found.spectrum is not None
    power = np.abs(np.fft.rfft(noise, axis=0)) ** 2
    left = made.gain(np.fft.rfftfreq(len(noise), 1 / RATE), RATE) ** 2 @ power / power.sum(axis=0)
    # what wanders over 80 s is seen in half of it, in a handful of independent swings: 30 % of a variance
    np.testing.assert_allclose(found.deviation, noise.std(axis=0), rtol=0.1)
    np.testing.assert_allclose(found.spectrum.kept(made, RATE).mean(), left.mean(), rtol=0.3)
    assert found.spectrum.kept(made, RATE).mean() > 2.0 * made.recursion(RATE).share[-1]
    np.testing.assert_allclose(found.spectrum.power.sum(axis=0), 1.0)


def test_a_press_that_is_held_is_no_rest() -> None:
    readings = np.random.default_rng(7).normal(size=(20_000, 6)) * DEVIATIONS
    held = readings + (np.arange(20_000) % 4000 < 1800)[:, None] * 50.0 * DEVIATIONS
    assert_deviation(rest_noise(held), DEVIATIONS, 0.05)


def test_what_hardly_rests_has_no_spectrum() -> None:
    assert rest_noise(np.zeros((50, 6))) is None
    assert rest_noise(np.full((500, 6), np.nan)) is None


def test_the_mean_of_white_noise_shrinks_by_its_number_and_wander_does_not() -> None:
    white = NoiseSpectrum((np.arange(500) + 0.5) / 1000, np.full((500, 6), 1 / 500))
    np.testing.assert_allclose(white.of_mean(40), 1 / 40, rtol=0.02)  # bins of 1/1000 under a kernel 1/40 wide
    np.testing.assert_allclose(NoiseSpectrum(np.zeros(1), np.ones((1, 6))).of_mean(40), 1.0)
    slow, fast = (NoiseSpectrum.of_corner(corner, RATE).of_mean(500).mean() for corner in (5.0, 0.01))
    assert slow > 10 * fast
    with pytest.raises(InputError, match="positive"):
        NoiseSpectrum.of_corner(0.0, RATE)


@pytest.mark.parametrize(("share", "said"), [(0.4, "2.5 times less"), (1.0, ""), (1.6, ""), (2.5, "2.5 times more")])
def test_noise_that_is_stated_wrong_by_two_is_said(share: float, said: str) -> None:
    sentence = wrong_noise(share * DEVIATIONS, DEVIATIONS)
    assert said in sentence
    assert bool(sentence) == bool(said)


def test_a_tare_is_the_mean_of_readings_that_neither_scatter_nor_drift() -> None:
    """A step of 4 deviations halfway makes their scatter sqrt(1 + 2^2) of them, which alone may be a motor's."""
    white = np.random.default_rng(6).normal(size=(400, 6)) * DEVIATIONS
    white[7] = np.nan
    known, step = np.diag(DEVIATIONS**2), 4.0 * DEVIATIONS
    np.testing.assert_allclose(at_rest(white + step, known, "a log").mean, np.nanmean(white, axis=0) + step)
    with pytest.raises(InputError, match=r"changes between the two halves by.*Keep"):
        at_rest(white + (np.arange(400) >= 200)[:, None] * step, known, "a log")
    with pytest.raises(InputError, match=r"scatters by.*Keep"):
        at_rest(4.0 * white, known, "a log")


def test_a_gain_error_is_a_share() -> None:
    with pytest.raises(InputError, match=r"force_torque: gain_error"):
        ForceTorque(gain_error=-0.1)
    assert ForceTorque([0.02] * 3 + [0.001] * 3).lever == pytest.approx(0.05)
    assert ForceTorque(limits=[200.0] * 3 + [4.0] * 3).lever == pytest.approx(0.02)


def test_a_zero_that_wanders_is_noise_unless_it_is_followed() -> None:
    """A ramp of 50 deviations over the log, 5 of them in a segment of 2000 readings."""
    readings = np.random.default_rng(8).normal(size=(20_000, 6)) * DEVIATIONS
    readings += np.linspace(0.0, 50.0, 20_000)[:, None] * DEVIATIONS
    whole, without = rest_noise(readings), rest_noise(readings, wander=False)
    assert whole is not None
    assert np.all(whole.deviation > 5.0 * DEVIATIONS)
    assert_deviation(without, DEVIATIONS, 0.1)


def test_a_correlation_time_is_that_of_its_process() -> None:
    """(1 + a)/(1 - a) of x(t + 1) = a x(t) + noise, within 10 % of 2e5 samples; 1 of noise, a constant, three rows."""
    noise = np.random.default_rng(3).normal(size=(200_000, 3)) * [1.0, 1.0, 0.0]
    values = np.column_stack([lfilter([1.0], [1.0, -0.8], noise[:, 0]), noise[:, 1:]])
    np.testing.assert_allclose(correlation_time(values), [9.0, 1.0, 1.0], rtol=0.1)
    np.testing.assert_array_equal(correlation_time(values[:3]), np.ones(3))
    np.testing.assert_allclose(correlation_time(np.array([[0.0], [1.0], [0.0], [-1.0]])), 1.0)


@pytest.mark.parametrize(
    ("runs", "usual", "said"),
    [
        ([(300, 321)], 1, "from 3.00 to 3.20 s: the sensor or its reader hung"),
        ([(300, 320)], 1, None),  # not longer than 20 times the usual
        ([(300, 345), (500, 560)], 1, "from 3.00 s on, 2 times: "),
        ([(300, 345), (500, 560)], 2, None),
        ([(600, 1000)], 1, "from 6.00 to 9.99 s: "),
        ([(60, 1000)], 1, "from 0.60 to 9.99 s: "),
        ([(12, 1000)], 1, None),  # at the start most repeat: readings are coarse
        ([(5, 1000)], 1, None),  # fewer than ten readings
        ([(100, 800)], 1, None),  # they go on, and most repeated
    ],
)
def test_a_hang_is_a_run_far_longer_than_usual(runs: list[tuple[int, int]], usual: int, said: str | None) -> None:
    same = np.arange(1000) % usual != 0
    for first, end in runs:
        same[first:end] = np.arange(first, end) > first
    found = hung(np.arange(1000) / 100.0, same)
    assert found == [] if said is None else said in found[0]
