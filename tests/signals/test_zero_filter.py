"""The filter of a zero and its smoother, against the posterior of all windows at once by plain conditioning."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate.signals.zero_filter import FilterStep, ZeroFilter, ZeroWindow, smoothed
from tests.support.dice import mixed, rolled

CHANNELS = 3
START, ZERO, KNOWN = 10.0, np.array([0.3, -0.1, 0.2]), mixed(np.array([0.02, 0.01, 0.03]), 1)


def _drift(warm: bool, settling: float = np.inf) -> Drift:
    return Drift([3e-3, 5e-3, 0.0], [2e-3, 0.0, 4e-3] if warm else None, settling, weight=0.05)


def _windows(drift: Drift, rng: np.random.Generator) -> list[ZeroWindow]:
    """At uneven times, some at the same; each hangs the payload otherwise."""
    made: list[ZeroWindow] = []
    for time in START + np.cumsum(rng.choice([0.0, 0.1, 0.1, 0.4, 5.0], 30)):
        root = 0.01 * rng.standard_normal((CHANNELS, CHANNELS))
        noise = root @ root.T + 1e-5 * np.eye(CHANNELS)
        value, regressor = rng.standard_normal(CHANNELS), rng.standard_normal((CHANNELS, int(drift.weight > 0)))
        made.append(ZeroWindow(float(time), 0.05 * value, regressor, noise, 1e-5 * np.eye(CHANNELS)))
    return made


def _posterior(drift: Drift, windows: list[ZeroWindow], used: list[int], at: float) -> tuple[np.ndarray, np.ndarray]:
    """Of zero and coefficient at a time, by conditioning one normal law of everything; rates are integrated out."""
    coefficients = int(drift.weight > 0)

    def ran(time: float) -> float:
        passed = time - START
        return passed if np.isinf(drift.settling) else drift.settling * (1 - np.exp(-passed / drift.settling))

    def both(one: float, other: float) -> np.ndarray:
        shared = min(one, other) - START
        zero = KNOWN + np.diag(drift.walk**2 * shared + drift.warm_up**2 * ran(one) * ran(other))
        return np.block(
            [[zero, np.zeros((CHANNELS, coefficients))],
             [np.zeros((coefficients, CHANNELS)), drift.weight**2 * np.eye(coefficients)]]
        )  # fmt: skip

    seen = [np.hstack([np.eye(CHANNELS), windows[k].regressor]) for k in used]
    times = [windows[k].time for k in used]
    cross = np.hstack([both(at, time) @ h.T for time, h in zip(times, seen, strict=True)])
    joint = np.block(
        [[h @ both(s, t) @ g.T + (windows[used[i]].noise + windows[used[i]].stays) * (i == j)
          for j, (t, g) in enumerate(zip(times, seen, strict=True))]
         for i, (s, h) in enumerate(zip(times, seen, strict=True))]
    )  # fmt: skip
    mean = np.concatenate([ZERO, np.zeros(coefficients)])
    left = np.concatenate([windows[k].value - h @ mean for k, h in zip(used, seen, strict=True)])
    gain = np.linalg.solve(joint, cross.T).T
    return mean + gain @ left, both(at, at) - gain @ cross.T


def _run(drift: Drift, windows: list[ZeroWindow], used: list[int]) -> tuple[ZeroFilter, list[FilterStep]]:
    made = ZeroFilter(drift, np.full(int(drift.weight > 0), drift.weight))
    made.start(START, ZERO, KNOWN)
    return made, [
        made.update(window, k) if k in used else made.advance(window.time, k) for k, window in enumerate(windows)
    ]


@pytest.mark.parametrize("drift", [_drift(True), _drift(True, 20.0), _drift(False), Drift([3e-3] * 3)])
def test_filter_and_smoother_are_the_posterior_of_all_windows_at_once(drift: Drift) -> None:
    rng = np.random.default_rng(3)
    windows = _windows(drift, rng)
    used = [k for k in range(len(windows)) if not 8 <= k < 20]
    made, nodes = _run(drift, windows, used)
    later = windows[-1].time + 7.0
    ahead = made.at(later)
    mean, covariance = _posterior(drift, windows, used, later)
    np.testing.assert_allclose(np.concatenate([ahead.zero, ahead.coefficient]), mean, atol=1e-9)
    np.testing.assert_allclose(ahead.covariance, covariance, atol=1e-11)
    found = list(smoothed(nodes))[::-1]
    for k in (0, 5, 8, 13, 19, 25, 29):
        mean, covariance = _posterior(drift, windows, used, windows[k].time)
        state = made.known_of(*found[k])
        np.testing.assert_allclose(np.concatenate([state.zero, state.coefficient]), mean, atol=1e-9)
        np.testing.assert_allclose(state.covariance, covariance, atol=1e-11)


def test_from_both_sides_of_a_gap_a_walk_is_a_bridge() -> None:
    """Half way between two known ends its variance is walk^2 T / 4, against walk^2 T / 2 from one: 1/sqrt 2."""
    drift, sure = Drift([2e-3]), 1e-9 * np.eye(1)
    windows = [ZeroWindow(float(t), np.zeros(1), np.zeros((1, 0)), sure**2, 0 * sure) for t in range(61)]
    made = ZeroFilter(drift, np.zeros(0))
    made.start(0.0, np.zeros(1), sure**2)
    nodes = [made.update(one, k) if k in (0, 60) else made.advance(one.time, k) for k, one in enumerate(windows)]
    found = list(smoothed(nodes))[::-1]
    variance = np.array([float(covariance[0, 0]) for _, covariance in found])
    times = np.arange(61.0)
    np.testing.assert_allclose(variance, 4e-6 * times * (60 - times) / 60, atol=1e-15)
    assert variance[30] / float(nodes[30].covariance[0, 0]) == pytest.approx(0.5, rel=1e-9)
    assert [len(state) for state, _ in smoothed(nodes, 5)] == [1] * 5


def test_a_tare_tells_the_sum_of_zero_and_payload_in_its_pose() -> None:
    """The same as a window at the start, before which nothing was known of the zero; the payload stays unknown."""
    drift, h = Drift([1e-3] * 3, weight=0.1), np.array([[0.0], [0.6], [0.8]])
    made, other = (ZeroFilter(drift, np.array([0.1])) for _ in range(2))
    made.start(0.0, ZERO, KNOWN, h)
    other.start(0.0, np.zeros(3), 1e6 * np.eye(3))
    other.update(ZeroWindow(0.0, ZERO, h, KNOWN, np.zeros((3, 3))))
    np.testing.assert_allclose(made.state, other.state, atol=1e-8)
    np.testing.assert_allclose(made.covariance, other.covariance, atol=1e-7)
    seen, covariance = made.expected(0.0, h)
    np.testing.assert_allclose(seen, ZERO)
    np.testing.assert_allclose(covariance, KNOWN, atol=1e-15)


def test_regressors_act_as_the_coefficients_are_known() -> None:
    """Of two coefficients that windows have made to belong together."""
    drift = Drift([1e-3] * 3)
    made, act = ZeroFilter(drift, np.array([0.1, 0.3])), np.random.default_rng(1).normal(size=(2, 3, 2))
    made.start(0.0, ZERO, KNOWN)
    made.update(ZeroWindow(1.0, ZERO, act[0], 1e-6 * np.eye(3), np.zeros((3, 3))))
    own = made.at(1.0).covariance[3:, 3:]
    assert abs(own[0, 1]) > 0.01 * np.sqrt(own[0, 0] * own[1, 1])
    np.testing.assert_allclose(made.spread_by(act[1]), rolled(lambda off: act[1] @ off, own), atol=1e-12 * own.max())


def test_regressors_must_fit() -> None:
    made = ZeroFilter(Drift([1.0]), np.zeros(0))
    made.start(0.0, np.zeros(1), np.eye(1))
    with pytest.raises(InputError, match="regressors"):
        made.update(ZeroWindow(1.0, np.zeros(1), np.zeros((1, 1)), np.eye(1), np.zeros((1, 1))))
