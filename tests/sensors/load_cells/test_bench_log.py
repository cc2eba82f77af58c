"""Rests of a bench log, of any length, and the noise that they show."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.sensors.load_cells._log import BenchLog, rest_noise, rests

STEP, CHANNELS = 0.005, 12


def _log(seconds: float, rng: np.random.Generator, factor: np.ndarray | None = None) -> BenchLog:
    """A rest, then a press that grows for 2 s; noise of the voltages by a factor of its covariance."""
    count = round(seconds / STEP)
    time = np.arange(count + round(2.0 / STEP)) * STEP
    pressed = np.clip(time - seconds, 0.0, 1.0)
    spread = 1e-4 * (np.eye(CHANNELS) if factor is None else factor)
    voltages = rng.normal(size=(len(time), CHANNELS)) @ spread.T + 0.1 * pressed[:, None]
    forces = np.zeros((len(time), 3))
    forces[:, 2] = -3.0 * pressed
    forces += 0.01 * rng.normal(size=forces.shape)
    return BenchLog(time, voltages, forces, np.zeros_like(forces), np.zeros(len(time)))


@pytest.mark.parametrize("seconds", [0.5, 5.0, 20.0, 60.0])
def test_a_log_begins_unloaded_however_long_it_rests(seconds: float) -> None:
    for seed in range(5):
        (rest, *_) = rests(_log(seconds, np.random.default_rng(seed)))
        assert rest.rows.start == 0
        assert rest.rows.stop * STEP == pytest.approx(seconds, abs=0.15)


def test_a_log_that_begins_pressed_is_refused() -> None:
    log = _log(0.0, np.random.default_rng(0))
    with pytest.raises(InputError, match=r"does not begin unloaded.*Record"):
        rests(BenchLog(log.time, log.voltages, log.forces - 1.0, log.centres, log.torques))


@pytest.mark.parametrize("seconds", [0.4, 1.0, 10.0])
@pytest.mark.parametrize("alike", [False, True])
def test_six_numbers_fitted_by_the_noise_of_a_rest_are_as_uncertain_as_it_says(seconds: float, alike: bool) -> None:
    """Weights that followed chance would promise more: a quarter of the variance after 0.4 s."""
    rng = np.random.default_rng(7)
    factor = np.eye(CHANNELS) + (0.2 if alike else 0.0)  # or all channels share a noise
    true = 1e-8 * factor @ factor.T
    matrix, ratios = rng.normal(size=(CHANNELS, 6)), list[float]()
    for _ in range(60):
        log = _log(seconds, rng, factor)
        noise = rest_noise(log, rests(log)[:1])[0]
        weighed = np.linalg.solve(noise, matrix)
        stated = np.linalg.inv(matrix.T @ weighed)
        estimate = stated @ weighed.T
        ratios.append(float(np.trace(np.linalg.solve(stated, estimate @ true @ estimate.T))) / 6)
    assert 0.8 <= np.mean(ratios) <= 1.2
