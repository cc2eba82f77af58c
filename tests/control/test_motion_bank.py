"""Filters that foresee: against their matrices written out, exact motions, steps, silence."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from palpate.control import _motion_bank
from palpate.control.motion_bank import JERK, JUMP, RATES, MotionBank
from palpate.errors import InputError

DT = 0.005


def chances(rates: tuple[float, float, float], smooth: int, dt: float) -> np.ndarray:
    """Of one kind of motion becoming another, (k, k), by the matrix exponential of its rates."""
    changes, begins, ends = rates
    flow = np.zeros((smooth + 1, smooth + 1))
    flow[:-1, :-1] = changes / smooth  # drawn anew, itself among them
    flow[:-1, -1], flow[-1, :-1] = begins, ends / smooth
    np.fill_diagonal(flow, 0.0)
    np.fill_diagonal(flow, -flow.sum(axis=1))
    return expm(flow * dt)


def twin(readings: np.ndarray, variance: float, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of interacting multiple models, by matrices."""
    change = chances(RATES, len(JERK), DT)
    move = np.array([[1, DT, DT * DT / 2], [0, 1, DT], [0, 0, 1.0]])
    third = np.array(
        [[DT**5 / 20, DT**4 / 8, DT**3 / 6], [DT**4 / 8, DT**3 / 3, DT**2 / 2], [DT**3 / 6, DT**2 / 2, DT]]
    )
    noises = [size**2 * each * third for each in (*JERK, JERK[0])]
    noises[-1][0, 0] += size**2 * JUMP * DT
    states = np.zeros((len(noises), 3))
    spreads = np.tile(size**2 * np.diag([1.0, 1.0, 10.0]), (len(noises), 1, 1))
    weights = np.full(len(noises), 1.0 / len(noises))

    def together(shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mean = shares @ states
        apart = states - mean
        return mean, np.einsum("i,ijk->jk", shares, spreads + apart[:, :, None] * apart[:, None, :])

    for z in readings:
        foreseen = weights @ change
        begun = [together(change[:, j] * weights / foreseen[j]) for j in range(len(noises))]
        likely = np.zeros(len(noises))
        for j, (mean, spread) in enumerate(begun):
            state, wide = move @ mean, move @ spread @ move.T + noises[j]
            total, missed = wide[0, 0] + variance, z - state[0]
            gain = wide[:, 0] / total
            states[j], spreads[j] = state + gain * missed, wide - np.outer(gain, wide[0])
            likely[j] = np.exp(-0.5 * missed**2 / total) / np.sqrt(total)
        weights = foreseen * likely / (foreseen @ likely)
    return together(weights)


@given(st.floats(0, 20), st.floats(0.001, 20), st.floats(0.001, 20), st.floats(0, 10), st.integers(1, 5))
def test_chances_are_those_of_the_rates(changes: float, begins: float, ends: float, dt: float, smooth: int) -> None:
    """The closed form against the matrix exponential, 1e-12."""
    out, rates = np.zeros((smooth + 1, smooth + 1)), (changes, begins, ends)
    _motion_bank.changed(dt, np.array(rates), out)
    np.testing.assert_allclose(out, chances(rates, smooth, dt), atol=1e-12)


def test_the_compiled_bank_is_its_matrices() -> None:
    """Some hundred steps in another order of additions: 1e-9 of the size."""
    rng, size, variance = np.random.default_rng(1), 0.17, 2e-4
    step = np.arange(150)
    readings = 0.17 * np.sin(0.02 * step) + 0.014 * rng.standard_normal(150) + 0.2 * (step > 90)
    bank = MotionBank([size, 0.01])
    for z in readings:
        bank.update(DT, np.array([z, np.nan]), np.array([variance, 1e-8]))
    mean, spread = twin(readings, variance, size)
    value, rate = bank.predict(0.0)
    assert value[0] == pytest.approx(mean[0], abs=1e-9)
    assert rate[0] == pytest.approx(mean[1], abs=1e-7)
    assert np.sqrt(bank._mixed[0, 3]) == pytest.approx(np.sqrt(spread[0, 0]), rel=1e-6)
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


def test_a_jump_is_believed_at_once() -> None:
    """A jump of forty deviations is met within three readings; the slope before it is known again 0.1 s after."""
    rng, bank, slope, noise = np.random.default_rng(3), MotionBank([1.0]), 0.5, 0.01
    away = []
    for k in range(500):
        true = slope * k * DT + (k >= 400) * 0.4
        bank.update(DT, np.array([true + noise * rng.standard_normal()]), np.array([noise**2]))
        away.append([bank.predict(0.0)[0][0] - true, bank.predict(0.0)[1][0] - slope])
    off = np.abs(away)
    assert off[403:, 0].max() < 3.0 * noise
    assert off[420:, 1].max() < 0.5 * slope


def test_silence_widens_what_is_known_and_the_motion_goes_on() -> None:
    """Without readings: the mean along its slope, and a deviation that only grows."""
    bank, wide = MotionBank([1.0]), list[float]()
    for k in range(200):
        bank.update(DT, np.array([0.3 * k * DT]), np.array([1e-6]))
    for _ in range(40):
        bank.update(DT, np.array([np.nan]), np.array([1e-6]))
        wide.append(float(np.sqrt(bank._mixed[0, 3])))
    assert np.all(np.diff(wide) > 0)
    assert bank.predict(0.0)[0][0] == pytest.approx(0.3 * 239 * DT, abs=2e-3)


def test_what_was_kept_is_known_again() -> None:
    """As if the readings since had never been."""
    rng, banks = np.random.default_rng(5), [MotionBank([1.0]) for _ in range(2)]
    for k in range(60):
        for bank in banks:
            bank.update(DT, np.array([0.01 * k]), np.array([1e-4]))
    banks[0].keep()
    for _ in range(5):
        banks[0].update(DT, rng.standard_normal(1), np.array([1e-4]))
    banks[0].recall()
    assert banks[0].predict(0.1)[0][0] == banks[1].predict(0.1)[0][0]
    assert np.array_equal(banks[0]._filters, banks[1]._filters)


def test_a_scaled_bank_is_one_of_readings_in_the_other_unit() -> None:
    """Twice the numbers with twice the size; and a series that begins anew leaves the others alone."""
    one, two = MotionBank([1.0, 1.0]), MotionBank([2.0, 1.0])
    for k in range(60):
        z = np.array([np.sin(0.1 * k), 0.01 * k])
        one.update(DT, z, np.array([1e-4, 1e-4]))
        two.update(DT, z * [2.0, 1.0], np.array([4e-4, 1e-4]))
    one.scale(np.array([2.0, 1.0]))
    for ahead in (0.0, 0.1):
        assert one.predict(ahead)[0] == pytest.approx(two.predict(ahead)[0].copy(), rel=1e-9)
    assert one._mixed[:, 3] == pytest.approx(two._mixed[:, 3], rel=2e-9)
    before = one.predict(0.1)[0].copy()
    one.start([7.0], series=slice(1, 2))
    assert one.predict(0.1)[0] == pytest.approx([before[0], 7.0])


def test_probabilities_sum_to_one_and_nan_is_no_reading() -> None:
    bank = MotionBank([1.0, 1.0])
    bank.start([1.0, 2.0])
    bank.update(0.1, np.full(2, np.nan), np.ones(2))
    assert bank._filters[..., 9].sum(axis=1) == pytest.approx(1.0)
    assert bank.predict(0.0)[0] == pytest.approx([1.0, 2.0])
    for step in (DT, 0.0, DT):  # so unlikely that probabilities underflow, and no time to come back
        bank.update(step, np.array([1e6, -1e6]), np.full(2, 1e-9))
        assert bank._filters[..., 9].sum(axis=1) == pytest.approx(1.0)
    assert bank.predict(0.0)[0] == pytest.approx([1e6, -1e6])


@pytest.mark.parametrize("sizes", [[0.0], [np.nan], [-1.0], [np.inf]])
def test_sizes_must_be_sizes(sizes: list[float]) -> None:
    with pytest.raises(InputError, match="sizes"):
        MotionBank(sizes)
