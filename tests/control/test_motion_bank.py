"""Filters that foresee: against their matrices written out, exact motions, steps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.control.motion_bank import JERK, MEMORY, STEP, MotionBank
from palpate.errors import InputError

DT = 0.005


def twin(readings: np.ndarray, variance: float, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Means and covariance of the mixture by matrices: a Kalman filter each, weights by forgotten likelihood."""
    densities = [*(size**2 * np.array(JERK)), -(size**2) * STEP]
    move = np.array([[1, DT, DT * DT / 2], [0, 1, DT], [0, 0, 1.0]])
    noise = np.array(
        [[DT**5 / 20, DT**4 / 8, DT**3 / 6], [DT**4 / 8, DT**3 / 3, DT**2 / 2], [DT**3 / 6, DT**2 / 2, DT]]
    )
    states = [np.zeros(3) for _ in densities]
    spreads = [size**2 * np.diag([1.0, 1.0, 10.0]) for _ in densities]
    logs = np.full(len(densities), -np.log(len(densities)))
    for z in readings:
        for i, density in enumerate(densities):
            if density > 0:
                states[i], spreads[i] = move @ states[i], move @ spreads[i] @ move.T + density * noise
            else:
                states[i] = np.array([states[i][0], 0.0, 0.0])
                spreads[i] = np.diag([spreads[i][0, 0] - density * DT, 0.0, 0.0])
            total = spreads[i][0, 0] + variance
            gain, missed = spreads[i][:, 0] / total, z - states[i][0]
            states[i] = states[i] + gain * missed
            spreads[i] = spreads[i] - np.outer(gain, spreads[i][0])
            logs[i] = np.exp(-DT / MEMORY) * logs[i] - 0.5 * (missed**2 / total + np.log(total))
        logs -= logs.max()
        logs -= np.log(np.exp(logs).sum())
        weights = np.exp(logs)
        mean = weights @ np.array(states)
        spread = sum(w * (p + np.outer(x - mean, x - mean)) for w, x, p in zip(weights, states, spreads, strict=True))
        for i in np.flatnonzero(weights < 1e-3):
            states[i], spreads[i], logs[i] = mean, spread, np.log(1e-3)
    return mean, spread


def test_the_compiled_bank_is_its_matrices() -> None:
    """Some hundred steps in another order of additions: 1e-9 of the size."""
    rng, size, variance = np.random.default_rng(1), 0.17, 2e-4
    readings = (
        0.17 * np.sin(np.arange(150) * 0.02) + 0.014 * rng.standard_normal(150) + np.where(np.arange(150) > 90, 0.2, 0)
    )
    bank = MotionBank([size, 0.01])
    for z in readings:
        bank.update(DT, np.array([z, np.nan]), np.array([variance, 1e-8]))
    mean, spread = twin(readings, variance, size)
    value, rate = bank.predict(0.0)
    assert value[0] == pytest.approx(mean[0], abs=1e-9)
    assert rate[0] == pytest.approx(mean[1], abs=1e-7)
    assert bank.deviations[0] == pytest.approx(np.sqrt(spread[0, 0]), rel=1e-6)
    assert bank.predict(0.1)[0][0] == pytest.approx(mean @ [1.0, 0.1, 0.005], abs=1e-7)


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-2, 2))
def test_a_constant_second_derivative_is_foreseen(value: float, rate: float, pull: float) -> None:
    """Without noise, after a second, 70 ms ahead: to a hundredth of what moves in that time."""
    bank = MotionBank([1.0])
    time = np.arange(300) * DT
    for z in value + rate * time + 0.5 * pull * time**2:
        bank.update(DT, np.array([z]), np.array([1e-8]))
    ahead = time[-1] + 0.07
    assert bank.predict(0.07)[0][0] == pytest.approx(value + rate * ahead + 0.5 * pull * ahead**2, abs=2e-3)


def test_a_step_does_not_linger() -> None:
    """After ten standard deviations of a step the bank is there within 50 ms, and does not run on."""
    rng, bank = np.random.default_rng(2), MotionBank([1.0])
    away = []
    for k in range(800):
        bank.update(DT, np.array([(k >= 400) * 1.0 + 0.1 * rng.standard_normal()]), np.array([0.01]))
        away.append(abs(bank.predict(0.07)[0][0] - (k >= 400)))
    assert max(away[410:]) < 0.3  # three deviations of one reading
    assert np.mean(away[420:]) < 0.1


def test_weights_sum_to_one_and_nan_is_no_reading() -> None:
    bank = MotionBank([1.0, 1.0])
    bank.start([1.0, 2.0], [0.5, 0.0])
    bank.update(0.1, np.full(2, np.nan), np.ones(2))
    assert np.sum(bank.weights, axis=1) == pytest.approx(1.0)
    assert bank.predict(0.0)[0][0] == pytest.approx(1.0 + 0.05 * 0.8)  # four of five filters have a rate


@pytest.mark.parametrize("sizes", [[0.0], [np.nan], [-1.0], [np.inf]])
def test_sizes_must_be_sizes(sizes: list[float]) -> None:
    with pytest.raises(InputError, match="sizes"):
        MotionBank(sizes)
