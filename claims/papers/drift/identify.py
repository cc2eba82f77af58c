"""How well `identify_drift` finds the walk from a free log, and whether it foretells the minute after the log.

Logs of 300 s at 200 Hz with 40 mN of noise, three channels that are alike. The prediction is a Kalman filter of this
file, over windows of 0.1 s, and the closed form of `Drift`.
"""

from collections.abc import Iterator

import numpy as np

from claims.papers.drift.study import Line
from palpate.calibration.drift import DriftFit, identify_drift
from palpate.signals.drift import Drift
from palpate_lab.simulation.drift import simulate_drift

RATE, NOISE, SECONDS, CHANNELS, WINDOW = 200, 0.04, 300, 3, 0.1
WALKS, WARM_UPS = (1e-3, 3e-3, 6e-3), ((0.0, np.inf), (1.0 / 60.0, 200.0))  # N/sqrt(s); N/s and s
AHEAD = (5, 10, 20, 30, 40, 50, 60)  # s


def run(seed: int, walk: float, warm_up: float, settling: float) -> tuple[DriftFit, np.ndarray]:
    """The fit, and errors of the prediction over its deviation (7, 3)."""
    rng = np.random.default_rng(seed)
    time = np.arange((SECONDS + 61) * RATE) / RATE
    zero = simulate_drift(time, Drift([walk] * CHANNELS, [warm_up] * CHANNELS, settling), rng)
    seen = (zero + rng.normal(0.0, NOISE, zero.shape))[: SECONDS * RATE]
    fit = identify_drift(time[: SECONDS * RATE], seen)
    last, rate, covariance = _filtered(fit, seen)
    return fit, np.array([_missed(fit.drift, zero, last, rate, covariance, ahead) for ahead in AHEAD])


def _course(drift: Drift, passed: float) -> float:
    return passed if np.isinf(drift.settling) else -drift.settling * np.expm1(-passed / drift.settling)


def _filtered(fit: DriftFit, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
    """Zero and rate in the last window, with the variance of the zero, their covariance and the rate's variance."""
    drift, size = fit.drift, round(WINDOW * RATE)
    means, noise = seen.reshape(-1, size, CHANNELS).mean(axis=1), fit.noise**2 * fit.window / WINDOW
    step, fades = _course(drift, WINDOW), np.exp(-WINDOW / drift.settling)
    zero, rate = means[0], np.zeros(CHANNELS)
    own, both, its = noise, np.zeros(CHANNELS), drift.warm_up**2
    for mean in means[1:]:
        zero, rate = zero + step * rate, fades * rate
        own = own + 2 * step * both + step**2 * its + drift.walk**2 * WINDOW
        both, its = fades * (both + step * its), fades**2 * its
        gain, other, off = own / (own + noise), both / (own + noise), mean - zero
        zero, rate, its = zero + gain * off, rate + other * off, its - other * both
        both, own = (1 - gain) * both, (1 - gain) * own
    return zero, rate, (own, both, its)


def _missed(
    drift: Drift, zero: np.ndarray, last: np.ndarray, rate: np.ndarray, covariance: tuple[np.ndarray, ...], ahead: int
) -> np.ndarray:
    own, both, its = covariance
    step = _course(drift, ahead)
    spread = np.sqrt(own + 2 * step * both + step**2 * its + drift.walk**2 * ahead)
    return (zero[round((SECONDS - WINDOW / 2 + ahead) * RATE)] - last - step * rate) / spread


def identified(seeds: range) -> Iterator[Line]:
    for walk in WALKS:
        for warm_up, settling in WARM_UPS:
            made = [run(seed, walk, warm_up, settling) for seed in seeds]
            error = np.abs([fit.drift.walk[0] / walk - 1.0 for fit, _ in made])
            warm = f"warm-up {60 * warm_up:.2g} N/min, {settling:.0f} s" if warm_up else "no warm-up"
            figures = {"median": np.median(error), "95 %": np.quantile(error, 0.95)}
            figures["within 15 %"] = np.mean(error < 0.15)
            figures["warm-up seen"] = np.mean([fit.warm for fit, _ in made])
            figures["held"] = np.mean(np.abs([scores for _, scores in made]) < 1.96)
            yield Line(f"walk {1e3 * walk:g} mN/sqrt(s), {warm}, {len(made)} logs: error of the walk found", figures)
