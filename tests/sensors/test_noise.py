"""The noise of a log, from the log itself."""

from __future__ import annotations

import numpy as np

from palpate.sensors.noise import estimate_noise

DEVIATIONS = np.array([0.02, 0.03, 0.05, 1e-3, 2e-3, 5e-4])


def test_it_is_the_deviation_of_a_reading() -> None:
    readings = np.random.default_rng(3).normal(size=(40_000, 6)) * DEVIATIONS
    found = estimate_noise(readings)
    assert found is not None
    np.testing.assert_allclose(found, DEVIATIONS, rtol=0.03)  # the median of 40,000 steps is known to 1 %


def test_readings_that_repeat_the_one_before_do_not_count() -> None:
    readings = np.random.default_rng(4).normal(size=(500, 6)) * DEVIATIONS
    once, thrice = estimate_noise(readings), estimate_noise(np.repeat(readings, 3, axis=0))
    assert once is not None
    assert thrice is not None
    np.testing.assert_array_equal(once, thrice)
