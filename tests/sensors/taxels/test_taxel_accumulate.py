"""Compiled normal equations of taxels against the same sums by NumPy."""

import numpy as np

from claims.timings.taxels import by_bincount, drawn
from palpate.sensors.taxels.poking._accumulate import accumulate

TAXELS = 40


PARTS = slice(0, 6), slice(6, 9), slice(9, 12)  # of a row: matrix, vector, pressing


def _empty(taxels: int = TAXELS) -> np.ndarray:
    return np.zeros((taxels, 12))


def _close(one: np.ndarray, other: np.ndarray) -> None:
    """To rounding: sums of a hundred terms of either sign, relative to the largest."""
    for part in PARTS:
        np.testing.assert_allclose(one[:, part], other[:, part], rtol=0.0, atol=1e-12 * np.abs(other[:, part]).max())


def test_the_kernel_adds_what_numpy_adds() -> None:
    given = drawn(1_000, TAXELS, np.random.default_rng(0))
    ours, theirs = _empty(), _empty()
    accumulate(*given, ours)
    by_bincount(*given, theirs)
    _close(ours, theirs)
    accumulate(*given, ours)  # it adds, and does not set
    _close(ours, 2 * theirs)


def test_a_poke_without_force_tells_nothing() -> None:
    force, torque, starts, taxel, weights = drawn(200, TAXELS, np.random.default_rng(1))
    force[::3] = 0.0
    ours, theirs = _empty(), _empty()
    accumulate(force, torque, starts, taxel, weights, ours)
    by_bincount(force, torque, starts, taxel, weights, theirs)
    _close(ours, theirs)
    kept = np.repeat(force.any(axis=1), np.diff(starts))
    np.testing.assert_allclose(
        2 * np.bincount(taxel[kept], weights[kept], TAXELS), ours[:, [0, 3, 5]].sum(axis=1), rtol=1e-12
    )  # the trace of I - u u' is 2


def test_the_sum_is_solved_by_the_point_on_all_lines() -> None:
    """A p = b for torques that forces at p make, whatever the forces."""
    force, _, starts, taxel, weights = drawn(300, 1, np.random.default_rng(2))
    point = np.array([0.03, -0.02, 0.1])
    sums = _empty(1)
    accumulate(force, np.cross(point, force), starts, taxel, weights, sums)
    full = sums[0, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)
    np.testing.assert_allclose(np.linalg.solve(full, sums[0, 6:9]), point, rtol=1e-12)
