"""Damped Gauss-Newton steps against closed forms, known minima and scipy."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import least_squares

from palpate.errors import InputError
from palpate.spatial.gauss_newton import damped, gauss_newton, huber

Residual = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def _look(residual: Residual, limit: float = np.inf) -> Callable[[np.ndarray], tuple[float, Callable[[], tuple]]]:
    def look(x: np.ndarray) -> tuple[float, Callable[[], tuple[np.ndarray, np.ndarray]]]:
        off, slope = residual(x)
        weight, cost = huber(np.abs(off), limit)
        return cost, lambda: ((slope * weight[:, None]).T @ slope, -slope.T @ (weight * off))

    return look


def _line(y: np.ndarray) -> Residual:
    columns = np.stack([np.ones(len(y)), np.arange(len(y))], axis=1)
    return lambda x: (columns @ x - y, columns)


def _valley(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rosenbrock's, whose minimum is 0 at (1, 1): full steps from (-1.2, 1) go up a thousandfold."""
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]]), np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])


def test_a_linear_problem_takes_one_step_to_the_closed_form() -> None:
    y = np.random.default_rng(1).normal(size=30)
    found = gauss_newton(np.zeros(2), _look(_line(y)))
    assert found.place == pytest.approx(np.polyfit(np.arange(30), y, 1)[::-1], abs=1e-7)
    assert found.converged
    assert found.rounds <= 3


def test_a_curved_valley_is_followed_to_its_known_end_and_never_up() -> None:
    for rounds in (1, 3, 100):
        start = np.array([-1.2, 1.0])
        found = gauss_newton(start, _look(_valley), rounds=rounds)
        assert found.cost <= float(np.sum(_valley(start)[0] ** 2))
    assert found.place == pytest.approx([1.0, 1.0], abs=1e-6)
    assert not gauss_newton(np.array([-1.2, 1.0]), _look(_valley), rounds=1).converged


def test_outliers_count_as_hubers_of_scipy() -> None:
    """A fifth of the points lies 50 deviations off; scipy's cost is half of ours."""
    rng = np.random.default_rng(2)
    y = 2.0 + 0.5 * np.arange(40) + rng.normal(size=40) + 50.0 * (rng.random(40) < 0.2)
    residual = _line(y)
    found = gauss_newton(np.zeros(2), _look(residual, 1.5))
    other = least_squares(lambda x: residual(x)[0], np.zeros(2), loss="huber", f_scale=1.5, xtol=1e-12, ftol=1e-14)
    assert found.cost == pytest.approx(2.0 * other.cost, rel=1e-6)
    assert found.place == pytest.approx(other.x, abs=1e-3)


def test_what_changes_nothing_stays_where_it_is() -> None:
    """One unknown has no slope, two others only a sum: the end explains the data, and the first is not moved."""
    y = np.arange(5.0)
    columns = np.stack([0.0 * y, y, y], axis=1)
    found = gauss_newton(np.array([7.0, 0.0, 0.0]), _look(lambda x: (columns @ x - y, columns)))
    assert found.place[0] == 7.0
    assert found.place[1] + found.place[2] == pytest.approx(1.0)
    assert damped(np.zeros((2, 2)), np.zeros(2)) == pytest.approx([0.0, 0.0])


def test_nan_is_refused_at_the_start_and_stepped_around_later() -> None:
    with pytest.raises(InputError, match=r"not finite.*Look"):
        gauss_newton(np.array([np.nan]), _look(lambda x: (x, np.eye(1))))

    def logarithm(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # a full step from 10 lands at -13, which has none
        with np.errstate(invalid="ignore"):
            return np.log(x), 1.0 / x[:, None]

    assert gauss_newton(np.array([10.0]), _look(logarithm)).place == pytest.approx([1.0])
