"""Filters: what they say against scipy's transfer functions, what they do against the weights that they give."""

import numpy as np
import pytest
from scipy import signal

from palpate.errors import InputError
from palpate.signals.filters import Butterworth, Filter, Kalman
from palpate.signals.smoothing import BothWays, Forward

RATE = 200.0
FILTERS = [
    Kalman(),
    Kalman(1.0, 0.01),
    Butterworth(8.0),
    Butterworth(30.0, 1),
    Butterworth(20.0, 5),
    Butterworth(90.0, 8),
]
TWICE = [Butterworth(20.0, 2, zero_phase=True), Butterworth(25.0, 3, zero_phase=True)]
FREQUENCIES = np.array([0.01, 1.0, 5.0, 20.0, 60.0, 95.0])


def name(made: Filter) -> str:
    return made.describe(RATE)


def response(made: Filter, frequencies: np.ndarray) -> np.ndarray:
    """Of one pass, from scipy's own design and freqz; the Kalman gain from its Riccati equation, iterated."""
    if isinstance(made, Kalman):
        spread = made.r
        for _ in range(10_000):
            spread = 1.0 / (1.0 / (spread + made.q) + 1.0 / made.r)
        k = spread / made.r
        return signal.freqz([k], [1.0, k - 1.0], worN=frequencies, fs=RATE)[1]
    return signal.freqz_sos(signal.butter(made.order, made.cutoff, fs=RATE, output="sos"), frequencies, fs=RATE)[1]


def weights(made: Filter, count: int) -> np.ndarray:
    """Row k: what of each sample is in the k-th that comes out, found by filtering one sample of 1 after the other."""
    time, status, rows = np.arange(count) / RATE, np.full(count, -1, np.int8), []
    for pulse in np.eye(count):
        rows.append(filtered(made, time, status, np.repeat(pulse[:, None], 6, axis=1))[0][:, 0])
    return np.array(rows).T


def filtered(made: Filter, time: np.ndarray, status: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples and the share of the noise in them; those with a status are left out."""
    recursion, good = made.recursion(RATE), status < 0
    if made.zero_phase:
        ((_, out, share),) = BothWays(recursion, RATE).through([(None, time, status, values.copy())])
        return out[good], share[good]
    forward, out = Forward(recursion, RATE), values.copy()
    share = forward.share(forward(time, status, out))
    return out[good], share[good]


@pytest.mark.parametrize("made", FILTERS, ids=name)
def test_gain_and_delay_are_those_of_the_transfer_function(made: Filter) -> None:
    """To 1e-9 in gain; the delay to the 1e-6 of a sample to which a phase can be differenced."""
    found = response(made, FREQUENCIES)
    assert np.abs(made.gain(FREQUENCIES, RATE) - np.abs(found)).max() < 1e-9
    h = 1e-4 * RATE / 2
    turn = np.angle(response(made, FREQUENCIES + h) / response(made, FREQUENCIES - h))
    slope = -turn / (2 * np.pi * 2 * h) * RATE
    sharp = 1e-5 * np.max(np.abs(made.delay(FREQUENCIES, RATE)) * RATE) ** 3  # the phase's third derivative, times h^2
    assert np.abs(made.delay(FREQUENCIES, RATE) * RATE - slope).max() < 1e-6 + sharp


@pytest.mark.parametrize("made", FILTERS + TWICE, ids=name)
def test_the_bandwidth_is_where_half_of_the_power_is_left(made: Filter) -> None:
    edge = made.bandwidth(RATE)
    if edge == RATE / 2:
        assert made.gain(edge, RATE) > 0.5**0.5
    else:
        assert made.gain(edge, RATE) == pytest.approx(0.5**0.5, rel=1e-9)


@pytest.mark.parametrize("made", TWICE, ids=name)
def test_twice_is_the_gain_squared_without_delay(made: Butterworth) -> None:
    assert np.abs(made.gain(FREQUENCIES, RATE) - np.abs(response(made, FREQUENCIES)) ** 2).max() < 1e-9
    assert not made.delay(FREQUENCIES, RATE).any()
    assert made.describe(RATE).endswith("with no lag")


@pytest.mark.parametrize("made", [made for made in FILTERS if isinstance(made, Butterworth)], ids=name)
def test_butterworth_forward_is_sosfilt(made: Butterworth) -> None:
    values = np.random.default_rng(0).normal(size=(500, 6)) + 7.0
    sections = signal.butter(made.order, made.cutoff, fs=RATE, output="sos")
    start = signal.sosfilt_zi(sections)[:, :, None] * values[0]
    expected, _ = signal.sosfilt(sections, values, axis=0, zi=start)
    found, _ = filtered(made, np.arange(500) / RATE, np.full(500, -1, np.int8), values)
    assert np.abs(found - expected).max() < 1e-10  # rounding, which resonant sections of order 8 amplify


@pytest.mark.parametrize("made", TWICE, ids=name)
@pytest.mark.parametrize("count", [1, 2, 40, 10_000])
def test_forward_and_backward_is_sosfiltfilt(made: Butterworth, count: int) -> None:
    """With a constant end, long enough to settle to the 1e-12 at which our segments overlap."""
    values = np.random.default_rng(0).normal(size=(count, 6)) + 7.0
    sections = signal.butter(made.order, made.cutoff, fs=RATE, output="sos")
    long = np.concatenate([np.repeat(values[:1], 1000, 0), values, np.repeat(values[-1:], 1000, 0)])
    expected = signal.sosfiltfilt(sections, long, axis=0)[1000 : 1000 + count]
    found, _ = filtered(made, np.arange(count) / RATE, np.full(count, -1, np.int8), values)
    assert np.abs(found / expected - 1).max() < 1e-9


@pytest.mark.parametrize("made", [*FILTERS, *TWICE], ids=name)
def test_the_share_of_the_noise_is_that_of_the_weights(made: Filter) -> None:
    """White noise of variance 1 comes out with the sum of the squares of the weights.

    For the Kalman filter the contact walks too, by q/r a step: a step of the walk at sample j is in all samples since,
    and in the contact itself.
    """
    for count in (1, 2, 7, 150):
        found = weights(made, count)
        expected = np.sum(found**2, axis=1)
        if isinstance(made, Kalman):
            followed = np.cumsum(found[:, ::-1], axis=1)[:, ::-1]  # of a step at sample j, what is in sample k
            walked = np.tril(np.ones((count, count)))
            walked[:, 0] = followed[:, 0] = 0.0  # where it began is not known
            expected = expected + made.q / made.r * np.sum((followed - walked) ** 2, axis=1)
        _, share = filtered(made, np.arange(count) / RATE, np.full(count, -1, np.int8), np.zeros((count, 6)))
        assert np.abs(share - expected).max() < 1e-10  # tables end where 1e-12 is left


@pytest.mark.parametrize("made", [Kalman(), Butterworth(20.0, 3), TWICE[0]], ids=name)
def test_a_gap_and_time_running_back_start_afresh(made: Filter) -> None:
    """What is filtered by itself is what comes out of the whole."""
    values, status = np.random.default_rng(1).normal(size=(90, 6)), np.full(90, -1, np.int8)
    time = np.arange(90) / RATE
    time[30:] += 0.06
    time[60:] -= 10.0
    whole = filtered(made, time, status, values)
    parts = [filtered(made, time[k : k + 30], status[:30], values[k : k + 30]) for k in (0, 30, 60)]
    for k in range(2):
        assert np.array_equal(whole[k], np.concatenate([part[k] for part in parts]))


def test_samples_that_are_none_pass_the_filter_by() -> None:
    values, status = np.random.default_rng(2).normal(size=(60, 6)), np.full(60, -1, np.int8)
    status[[0, 20, 21]] = 6
    values[20] = np.nan
    found, _ = filtered(Butterworth(20.0), np.arange(60) / RATE, status, values)
    good = status < 0
    alone, _ = filtered(Butterworth(20.0), np.arange(57) / RATE, status[good], values[good])
    assert np.array_equal(found, alone)


@pytest.mark.parametrize("cutoff", [100.0, 500.0, 1e-4])
def test_a_cutoff_that_the_rate_cannot_have_is_refused(cutoff: float) -> None:
    with pytest.raises(InputError, match=r"cut-off of .* Hz.*200 Hz.*Choose"):
        Butterworth(cutoff).recursion(RATE)


def test_settings_that_are_none_are_refused() -> None:
    for wrong in (lambda: Kalman(0.0, 1.0), lambda: Kalman(1.0, np.nan), lambda: Butterworth(-1.0)):
        with pytest.raises(InputError, match="positive"):
            wrong()
    with pytest.raises(InputError, match="order"):
        Butterworth(10.0, 9)
    with pytest.raises(InputError, match=r"rate.*State"):
        Kalman().describe(0.0)


def test_a_sample_that_is_none_has_no_age_and_stays_as_it_is() -> None:
    forward = Forward(Butterworth(8.0).recursion(200.0), 200.0)
    status = np.array([-1, -1, 7, -1], dtype=np.int8)
    values = np.ones((4, 6))
    values[2] = 50.0
    assert forward(np.arange(4) / 200.0, status, values).tolist() == [0, 1, -1, 2]
    np.testing.assert_array_equal(values[2], 50.0)
    np.testing.assert_allclose(values[3], 1.0, atol=1e-12)
