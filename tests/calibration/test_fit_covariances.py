"""Covariances of calibrations: means of touches, a drift that they share, courses in noise, where a surface is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.calibration.mounting import Mounting, mean_touches
from palpate.calibration.random_walk import Steps, courses_of
from palpate.calibration.touch_error import TouchError
from palpate.calibration.validation import Validation, pseudo_inverse
from tests.support.dice import agree, mixed, rolled
from tests.support.payloads import MOUNT, MOUNTED


@pytest.mark.parametrize("touches", [0, 1, 3])
@pytest.mark.parametrize("known", [False, True])
def test_means_of_touches_are_as_sure_as_noise_over_their_samples_and_what_these_share(
    touches: int, known: bool
) -> None:
    """Of 4, 6 and 0 samples that are numbers."""
    rng, own = np.random.default_rng(1), mixed(np.repeat([0.05, 2e-3], 3), 1)
    shared = np.stack([mixed(np.repeat([0.1, 5e-3], 3), k) for k in range(14)])
    wrenches, first, last = rng.normal(size=(14, 6)), np.array([0.0, 5.0, 12.0]), np.array([4.0, 10.0, 13.0])
    bad = [1, *range(11, 14)]
    wrenches[bad] = np.nan
    means, spreads = mean_touches(
        np.arange(14.0), wrenches, first[:touches], last[:touches], own, shared if known else None
    )
    assert means.shape == (touches, 6)
    assert spreads.shape == (touches, 6, 6)
    for k, rows in enumerate([[0, 2, 3, 4], [5, 6, 7, 8, 9, 10]][:touches]):
        np.testing.assert_allclose(means[k], wrenches[rows].mean(axis=0))
        agree(spreads[k], own / len(rows) + known * shared[rows].mean(axis=0))
    assert np.isnan(means[2:]).all()


@pytest.mark.parametrize("count", [0, 1, 6])
def test_a_drift_is_carried_by_touches_that_follow_each_other(count: int) -> None:
    """A shift of each touch along three axes, alike by exp(-1/lasting) from one touch to the next."""
    gains, alike = np.random.default_rng(2).normal(size=(count, 4, 3)), np.zeros((count, count))
    for k in range(count):
        for j in range(count):
            alike[k, j] = 0.3**2 * np.exp(-abs(k - j) / 2.5)
    stated = TouchError(0.1, 0.3, 2.5).carried(gains)
    assert stated.shape == (4, 4)
    if count:
        shifts = np.kron(alike, np.eye(3))
        agree(stated, rolled(lambda off: np.einsum("kpi,ki->p", gains, off.reshape(-1, 3)), shifts))
    assert TouchError(0.1, 0.3, 1.0).placement(0.1) == pytest.approx(0.3)
    assert TouchError(0.5, 0.0, 1.0).placement(0.3) == pytest.approx(0.4)


def test_a_surface_s_origin_is_as_sure_as_its_turn_and_shift() -> None:
    none = np.zeros(0, dtype=np.int64)
    mounting = Mounting(MOUNT, MOUNTED, 1.0, (), (), none, Validation(), TouchError(), ())

    def place(off: np.ndarray) -> np.ndarray:
        return Rotation.from_rotvec(off[:3]).as_matrix() @ MOUNT.translation + off[3:]

    agree(mounting.position_covariance, rolled(place, MOUNTED))


@pytest.mark.parametrize("courses", [0, 1, 3])
def test_courses_are_as_sure_as_steps_that_share_their_windows(courses: int) -> None:
    """A walk q and noise r of means over a window w: q^2 (D - w/3) + 2 r^2, and q^2 w/6 - r^2 beside."""
    rng, count, window = np.random.default_rng(3), 12, 0.1
    interval, joined = rng.uniform(0.1, 2.0, count), rng.uniform(size=count - 1) < 0.7
    steps = Steps(rng.normal(size=(count, 2)), interval, joined, rng.normal(size=(count, courses)), window)
    walk, noise = np.array([0.3, 0.05]), np.array([0.02, 0.4])
    course, covariance, _ = courses_of(steps, walk, noise)
    assert course.shape == (courses, 2)
    assert covariance.shape == (2, courses, courses)
    for k in range(2 if courses else 0):
        own = np.diag(walk[k] ** 2 * (interval - window / 3.0) + 2.0 * noise[k] ** 2)
        for j in np.flatnonzero(joined):
            own[j, j + 1] = own[j + 1, j] = walk[k] ** 2 * window / 6.0 - noise[k] ** 2

        def found(off: np.ndarray, k: int = k) -> np.ndarray:
            moved = steps.change + off[:, None] * np.eye(2)[k]
            return courses_of(replace(steps, change=moved), walk, noise)[0][:, k]

        agree(covariance[k], rolled(found, own))


@pytest.mark.parametrize("rank", [0, 1, 3, 5])
def test_an_information_is_inverted_whatever_its_units_and_its_rank(rank: int) -> None:
    size = np.array([1e4, 1.0, 1e-3, 1e-5, 10.0])
    factor = np.random.default_rng(rank).normal(size=(rank, 5)) * size
    matrix = factor.T @ factor
    inverse = pseudo_inverse(matrix)
    scaled, back = matrix / np.outer(size, size), inverse * np.outer(size, size)
    np.testing.assert_allclose(scaled @ back @ scaled, scaled, atol=1e-9)
    np.testing.assert_allclose(back, back.T, atol=1e-6)
    assert np.trace(scaled @ back) == pytest.approx(rank, abs=1e-6)
