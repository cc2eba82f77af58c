"""Walk, warm-up and temperature of a zero come back from simulated logs; what is no free log is refused or said."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from palpate.calibration.drift import DriftFit, identify_drift
from palpate.calibration.random_walk import Steps, WalkFit, courses_of, innovations, steps_of
from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate_lab.simulation.drift import simulate_drift

identify = partial(identify_drift, window=0.4)  # s: longer than usual, and quicker
RATE, NOISE, WALK = 100.0, 0.03, 3e-3  # Hz, N, N/sqrt(s)


def a_log(
    seed: int,
    *,
    seconds: float = 120.0,
    walk: float = WALK,
    warm_up: float = 0.0,
    settling: float = np.inf,
    channels: int = 3,
) -> tuple[np.ndarray, np.ndarray]:
    """Times, and readings of channels that are alike."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    drift = Drift([walk] * channels, [warm_up] * channels, settling)
    return time, simulate_drift(time, drift, rng) + rng.normal(0.0, NOISE, (len(time), channels)) + 5.0


@pytest.fixture(scope="module")
def free() -> tuple[np.ndarray, np.ndarray]:
    return a_log(0)


@pytest.fixture(scope="module")
def found(free: tuple[np.ndarray, np.ndarray]) -> DriftFit:
    return identify(*free)


WINDOW, STARTS = 0.4, np.array([0.0, 0.4, 0.8, 2.0, 2.4, 2.8, 9.0, 9.4, 9.8, 10.2])  # s: windows with two gaps


def of_means(walk: float, noise: float) -> np.ndarray:
    """Covariance of the windows' means of a Wiener process that begins at 0, by its definition min(s, t)."""
    fine = (np.arange(400) + 0.5) / 400 * WINDOW
    every = (STARTS[:, None] + fine).ravel()
    both = np.minimum(every[:, None], every).reshape(len(STARTS), 400, len(STARTS), 400).mean(axis=(1, 3))
    return walk**2 * both + noise**2 * np.eye(len(STARTS))


def as_fit(walk: float, noise: float) -> WalkFit:
    one = np.ones(1)
    nothing = np.zeros((0, 1)), np.zeros((1, 0, 0))
    return WalkFit(walk * one, one, noise * one, *nothing, 0.0, np.ones(1, dtype=np.bool_))


def likelihood_of(steps: Steps, walk: float, noise: float) -> float:
    return courses_of(steps, np.array([walk]), np.array([noise]))[2]


@pytest.fixture(scope="module")
def few() -> Steps:
    means = np.random.default_rng(1).normal(size=(len(STARTS), 1))
    return steps_of(STARTS + WINDOW / 2, means, WINDOW)


@pytest.mark.parametrize(("walk", "noise"), [(1.0, 0.3), (0.2, 0.5), (2.0, 1e-3)])
def test_the_likelihood_is_that_of_the_whole_covariance(few: Steps, walk: float, noise: float) -> None:
    """Dense, from min(s, t) averaged over 400 points a window: each diagonal block is right to 1 in 400^2."""
    differ = np.diff(np.eye(len(STARTS)), axis=0)
    dense = multivariate_normal(np.zeros(len(differ)), differ @ of_means(walk, noise) @ differ.T)
    constant = -0.5 * len(differ) * np.log(2 * np.pi)
    assert likelihood_of(few, walk, noise) == pytest.approx(dense.logpdf(few.change[:, 0]) - constant, rel=1e-4)


def test_innovations_are_the_steps_whitened(few: Steps) -> None:
    differ = np.diff(np.eye(len(STARTS)), axis=0)
    covariance = differ @ of_means(1.0, 0.3) @ differ.T
    white = np.linalg.solve(np.linalg.cholesky(covariance), few.change[:, 0])
    assert innovations(few, as_fit(1.0, 0.3))[:, 0] == pytest.approx(white, abs=1e-3)


def test_a_known_course_is_fitted_as_by_generalised_least_squares(few: Steps) -> None:
    """Of a fit without a course, the likelihood with one is that of the best multiple of it."""
    course = np.diff(STARTS**2)
    differ = np.diff(np.eye(len(STARTS)), axis=0)
    inverse = np.linalg.inv(differ @ of_means(1.0, 0.3) @ differ.T)
    best = course @ inverse @ few.change[:, 0] / (course @ inverse @ course)
    gained = likelihood_of(few.with_shape(course), 1.0, 0.3) - likelihood_of(few, 1.0, 0.3)
    assert gained == pytest.approx(0.5 * best**2 * (course @ inverse @ course), rel=1e-3)


def test_the_walk_is_found_with_an_honest_deviation() -> None:
    """Six logs: the rms of six normal numbers lies within 1 +- 3 / sqrt 12, but for the curvature's own error."""
    scores = list[float]()
    for seed in range(6):
        fit = identify(*a_log(seed))
        assert not fit.warm
        assert fit.seen.all()
        scores.append(float((fit.drift.walk[0] - WALK) / fit.walk_deviation[0]))
        assert fit.walk_deviation[0] < 0.25 * WALK  # 0.1; twice that where the halves differ by chance
        assert fit.noise == pytest.approx(NOISE / np.sqrt(RATE * fit.window), rel=0.25)  # 300 windows: 4 sd
    assert np.sqrt(np.mean(np.square(scores))) < 1.9


@pytest.mark.parametrize("walk", [1e-3, 6e-3])
def test_a_warm_up_is_found_beside_the_walk(walk: float) -> None:
    time, values = a_log(1, walk=walk, seconds=200.0)
    rate = np.array([1.0, -0.6, 0.8]) / 60.0
    values += 60.0 * -np.expm1(-time / 60.0)[:, None] * rate
    fit = identify(time, values)
    assert fit.warm
    assert fit.drift.settling == pytest.approx(60.0, rel=0.2)
    assert np.all(np.abs(fit.rate - rate) < 4.0 * fit.warm_up_deviation)
    assert fit.drift.warm_up == pytest.approx(np.sqrt(np.mean(rate**2)), rel=0.15)
    assert np.all(np.abs(fit.drift.walk - walk) < 4.0 * fit.walk_deviation)


def test_without_a_warm_up_the_rate_is_what_the_log_leaves_open(found: DriftFit) -> None:
    """A rate of a walk's own chance is walk / sqrt(T): that, and not 0, which no log can show."""
    assert not found.warm
    assert np.isinf(found.drift.settling)
    share = found.drift.warm_up / (WALK / np.sqrt(120.0))
    assert np.all((share > 0.5) & (share < 4.0))
    assert any("no warm-up is seen" in note for note in found.notes)


def test_temperature_is_told_from_the_walk() -> None:
    time, values = a_log(2)
    celsius = 25.0 + np.sin(time / 10.0)
    slope = np.array([0.05, 0.0, -0.02])
    fit = identify(time, values + celsius[:, None] * slope, temperature=np.where(time % 1 < 0.5, celsius, np.nan))
    assert np.all(np.abs(fit.drift.thermal - slope) < 4.0 * fit.drift.thermal_deviation)
    assert fit.drift.thermal_deviation.max() < 0.01
    assert fit.drift.walk[0] == pytest.approx(WALK, rel=0.3)


def test_a_temperature_that_stays_says_nothing(free: tuple[np.ndarray, np.ndarray]) -> None:
    fit = identify(*free, temperature=np.full(len(free[0]), 21.0))
    assert not fit.drift.thermal.any()
    assert any("temperature changes by" in note for note in fit.notes)


def test_it_foretells_the_next_half_minute() -> None:
    """Closed form, of the walk alone: b(t) given the log has the variance P + walk^2 t, with P of a filter at rest.

    Of 3 x 8 zeros, some 23 lie within 1.96 deviations; fewer than 20 have a chance of 1 in 160.
    """
    inside = 0
    for seed in range(8):
        rng = np.random.default_rng(100 + seed)
        time = np.arange(round(120.0 * RATE)) / RATE
        zero = simulate_drift(time, Drift([WALK] * 3), rng)
        count = round(90.0 * RATE)
        fit = identify(time[:count], (zero + rng.normal(0.0, NOISE, zero.shape))[:count])
        error = zero[-1] - _last_zero((zero + 0.0)[:count], fit, rng)
        inside += int(np.count_nonzero(np.abs(error) < 1.96 * fit.unsure(30.0)))
    assert inside >= 20


def _last_zero(zero: np.ndarray, fit: DriftFit, rng: np.random.Generator) -> np.ndarray:
    """What a steady filter, of gain k with k^2 / (1 - k) = q^2 w / R, makes of readings of that zero."""
    step = round(fit.window * RATE)
    means: np.ndarray = zero[: len(zero) // step * step].reshape(-1, step, 3).mean(axis=1)
    means = means + rng.normal(0.0, 1.0, means.shape) * fit.noise
    ratio = fit.drift.walk**2 * fit.window / fit.noise**2
    gain = (np.sqrt(ratio**2 + 4 * ratio) - ratio) / 2
    last: np.ndarray = means[0]
    for row in means:
        last = last + gain * (row - last)
    return last


def test_channels_that_differ_get_walks_of_their_own(free: tuple[np.ndarray, np.ndarray]) -> None:
    time, values = free
    fit = identify(time, np.column_stack([values[:, :2], 3.0 * values[:, 2]]))
    assert len(set(fit.drift.walk)) == 3
    assert fit.drift.walk[2] > 2.0 * fit.drift.walk[:2].max()


def test_no_walk_at_all_is_bounded_not_invented() -> None:
    time, values = a_log(3, walk=0.0)
    fit = identify(time, values)
    assert not fit.seen.any()
    assert 0.0 < fit.drift.walk[0] < 1e-3
    assert any("its upper bound" in note for note in fit.notes)


def touched(time: np.ndarray, values: np.ndarray, every: float, lasting: float, slow: float) -> np.ndarray:
    """Presses of 1 N that begin within `slow` [s] and end at once."""
    phase = time % every
    press = np.clip(phase / slow, 0.0, 1.0) * (phase < lasting) * (time > 20.0)
    return values + press[:, None] * np.array([0.6, 0.0, -0.8])


@pytest.mark.parametrize("slow", [0.01, 1.5])
def test_touches_are_left_out_and_said(free: tuple[np.ndarray, np.ndarray], slow: float) -> None:
    time, values = free
    fit = identify(time, touched(time, values, 30.0, 3.0, slow))
    assert any("left out as touched" in note and "29." in note for note in fit.notes)
    assert 0.05 < fit.touched < 0.15
    assert fit.drift.walk[0] == pytest.approx(WALK, rel=0.35)


def test_gaps_and_missing_values_are_left_out_and_said(free: tuple[np.ndarray, np.ndarray]) -> None:
    """The zero may have gone anywhere meanwhile."""
    time, values = free[0].copy(), free[1].copy()
    values[::50, 1] = np.nan
    time[6000:] += 300.0
    values[6000:] += 2.0
    fit = identify(time, values)
    assert any("240 of 12,000 samples" in note for note in fit.notes)
    assert any("1 gaps of up to 300" in note for note in fit.notes)
    assert fit.drift.walk[0] == pytest.approx(WALK, rel=0.3)


def test_coloured_noise_makes_windows_longer(free: tuple[np.ndarray, np.ndarray]) -> None:
    """A driver's low-pass of 0.3 s leaves the walk what it is."""
    time, values = free
    rng = np.random.default_rng(7)
    smooth = np.convolve(rng.normal(0.0, 0.01, len(time) + 99), np.exp(-np.arange(100) / 30.0) / 4.0, mode="valid")
    fit = identify(time, values + smooth[:, None])
    assert fit.window > 0.45
    assert any("have coloured noise" in note for note in fit.notes)
    assert fit.drift.walk[0] == pytest.approx(WALK, rel=0.5)


def test_noise_beyond_what_is_stated_is_said(free: tuple[np.ndarray, np.ndarray]) -> None:
    fit = identify(*free, noise=np.full(3, NOISE / 10.0), names=("a", "b", "c"))
    assert any("noisier than the stated" in note and "b (" in note for note in fit.notes)


SPOILT: list[tuple[Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]], str]] = [
    (lambda t, v: (t[:3000], v[:3000]), "lasts 30 s.*Record"),
    (lambda t, v: (t, v * np.nan), "no time"),
    (lambda t, v: (t * np.nan, v), "no time"),
    (lambda t, v: (t[::-1].copy(), v), "lasts 0 s.*Record"),
    (lambda t, v: (t - 20.0 * (t >= 100.0), v), "run backwards.*Split"),
    (lambda t, v: (t, np.where([False, True, False], 3.0, v)), "b never changes.*Connect"),
    (lambda t, v: (t, v + 2.0 * (t >= 60.0)[:, None]), "something touched, the payload changed, or the zero jumped"),
    (lambda t, v: (t, touched(t, v, 4.0, 2.0, 0.01)), "as under touches or motion|swing"),
    (lambda t, v: (t, v + np.sin(2.0 * t)[:, None]), "swing.*Record"),
]


@pytest.mark.parametrize(("spoilt", "said"), SPOILT)
def test_what_is_no_free_log_is_refused_in_a_sentence(
    free: tuple[np.ndarray, np.ndarray], spoilt: Callable[..., tuple[np.ndarray, np.ndarray]], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        identify(*spoilt(*free), names=("a", "b", "c"))


def test_readings_that_mostly_repeat_are_said(free: tuple[np.ndarray, np.ndarray]) -> None:
    """Steps ten times the noise: a level is mostly held, and the walk is not made of the steps."""
    time, values = free
    fit = identify(time, np.column_stack([values[:, :2], np.round(values[:, 2] / 0.3) * 0.3]), names=("a", "b", "c"))
    assert any("readings of c are so coarse" in note for note in fit.notes)


def test_a_payload_that_weighs_something_else_is_no_walk() -> None:
    """The sensor turns slowly about two axes; the weight that is taken off is 0.2 N too small."""
    time, values = a_log(3, seconds=180.0)
    a, b = 0.5 * np.sin(time / 3.0), 0.4 * np.sin(time / 5.0)
    down = np.column_stack([np.sin(a), np.cos(a) * np.sin(b), np.cos(a) * np.cos(b)])
    found = identify(time, values + 0.2 * down, None, None, down)
    assert found.drift.walk.mean() == pytest.approx(WALK, rel=0.15)
    with pytest.raises(InputError, match=r"the arm moves.*Record"):
        identify(time, values + 0.2 * down)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_temperature_that_rises_steadily_leaves_the_sum_of_both(noise: float) -> None:
    """B = k s t + r t where the temperature is s t: k s + r is known as well as a rate alone, neither of them is.

    The rates of 3 channels lie within 4 deviations of what is found (one of 5,000 would not).
    """
    time, values = a_log(3)
    celsius, slope = 25.0 + 0.02 * time, np.array([1.0, 0.5, -0.8])
    read = celsius + np.random.default_rng(3).normal(0.0, noise, len(time))
    fit = identify(time, values + (celsius[:, None] - 25.0) * slope + 1e-3 * time[:, None], temperature=read)
    assert not fit.drift.thermal.any()
    assert any("rises and falls" in note for note in fit.notes)
    assert np.all(np.abs(fit.rate - 0.02 * slope - 1e-3) < 4.0 * fit.warm_up_deviation)
    assert np.all(fit.drift.warm_up**2 >= np.mean(fit.rate**2))  # of alike channels, their mean square


def test_a_temperature_that_rises_and_settles_is_told_from_a_steady_rate() -> None:
    time, values = a_log(4)
    celsius = 25.0 + 4.0 * np.minimum(time / 40.0, 1.0)
    fit = identify(time, values + 0.05 * celsius[:, None] + 1e-3 * time[:, None], temperature=celsius)
    assert np.all(np.abs(fit.drift.thermal - 0.05) < 4.0 * fit.drift.thermal_deviation)


def test_a_zero_that_walks_more_in_one_half_has_the_larger_walk() -> None:
    time, values = a_log(3)
    rng, late = np.random.default_rng(4), len(time) // 2
    restless = values.copy()
    restless[late:] += np.cumsum(4.0 * WALK / np.sqrt(RATE) * rng.normal(size=restless[late:].shape), axis=0)
    calm, fit = identify(time, values), identify(time, restless)
    assert calm.validation.parts == 2
    assert any("walks more in one half" in note for note in fit.notes)
    assert fit.drift.walk[0] == pytest.approx(17.0**0.5 * WALK, rel=0.3)
