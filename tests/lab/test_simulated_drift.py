"""Simulated zeros: the moments of the law that `Drift` states, whatever the times."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate_lab.simulation.drift import simulate_drift

TIME = np.array([5.0, 5.0, 5.5, 9.0, 30.0, 65.0])  # uneven, one repeated
MANY = 4000  # channels: deviations of a variance 1/sqrt(2000) = 2.2 %, four of them 9 %


def _of_many(
    walk: float,
    warm_up: float = 0.0,
    settling: float = np.inf,
    thermal: tuple[float, float] = (0.0, 0.0),
    temperature: np.ndarray | None = None,
) -> np.ndarray:
    walks, rates, mean, deviation = (np.full(MANY, value) for value in (walk, warm_up, *thermal))
    drift = Drift(walks, rates, settling, thermal=mean, thermal_deviation=deviation)
    return simulate_drift(TIME, drift, np.random.default_rng(1), temperature)


def test_a_walk_grows_with_the_root_of_the_time() -> None:
    zeros, elapsed = _of_many(walk=3e-3), TIME - TIME[0]
    assert not zeros[:2].any()
    np.testing.assert_allclose(zeros[2:].var(axis=1), 9e-6 * elapsed[2:], rtol=0.09)
    steps = np.diff(zeros[1:], axis=0)
    assert np.abs(np.corrcoef(steps) - np.eye(4)).max() < 4 / np.sqrt(MANY)  # steps know nothing of one another


def test_a_warm_up_dies_away_and_a_kelvin_moves_the_zero() -> None:
    zeros = _of_many(walk=0.0, warm_up=0.01, settling=20.0)
    share = np.expm1(-(TIME - 5) / 20) / np.expm1(-3.0)
    np.testing.assert_allclose(zeros / zeros[-1], np.tile(share, (MANY, 1)).T, atol=1e-12)
    assert zeros[-1].std() == pytest.approx(0.01 * 20 * -np.expm1(-3.0), rel=0.05)
    straight = _of_many(walk=0.0, warm_up=0.01)
    np.testing.assert_allclose(straight, np.outer(TIME - 5, straight[-1] / 60), atol=1e-12)
    warmer = _of_many(0.0, thermal=(0.5, 0.1), temperature=np.array([20.0, 20.0, 21.0, 22.0, 22.0, 20.0]))
    assert not warmer[-1].any()
    assert warmer[3].mean() == pytest.approx(1.0, abs=4 * 0.2 / np.sqrt(MANY))
    assert warmer[3].std() == pytest.approx(0.2, rel=0.05)


def test_time_may_not_run_back() -> None:
    with pytest.raises(InputError, match="decrease"):
        simulate_drift([1.0, 0.5], Drift([1.0]), np.random.default_rng(0))
