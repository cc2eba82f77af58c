"""Evaluation: errors from closed forms, coverage from seeded normals, matching by time."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest

from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.ground_truth import Samples, Touches
from palpate.evaluation.errors import Spread, angles, coverage
from palpate.evaluation.evaluate import evaluate, nearest_in_time, status_shares


def _estimate(
    point: np.ndarray,
    *,
    covariance: np.ndarray | None = None,
    status: np.ndarray | None = None,
    force: np.ndarray | None = None,
) -> ContactEstimate:
    count = len(point)
    return ContactEstimate(
        point=point.copy(),
        normal=np.tile([0.0, 0.0, 1.0], (count, 1)),
        force=np.tile([0.0, 0.0, -1.0], (count, 1)) if force is None else force.copy(),
        torque=np.zeros(count),
        covariance=np.full((count, 3, 3), np.nan) if covariance is None else covariance.copy(),
        residual=np.zeros(count),
        candidates=np.ones(count, dtype=np.int64),
        status=np.zeros(count, dtype=np.int8) if status is None else status.astype(np.int8),
    )


def test_a_spread_is_of_the_finite_errors() -> None:
    spread = Spread.of(np.array([1.0, 2.0, np.nan, 6.0]))
    assert spread is not None
    assert (spread.count, spread.mean, spread.median, spread.worst) == (3, 3.0, 2.0, 6.0)
    assert Spread.of(np.array([np.nan])) is None


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, pi / 2, pi - 1e-9, pi])
def test_angles_are_exact_from_nothing_to_opposite(angle: float) -> None:
    one, other = np.array([[2.0, 0, 0]]), np.array([[3 * np.cos(angle), 3 * np.sin(angle), 0]])
    assert angles(one, other)[0] == pytest.approx(angle, abs=1e-15, rel=1e-6)
    assert np.isnan(angles(one, np.zeros((1, 3)))[0])


def test_the_right_covariance_covers_95_percent_and_its_mean_square_is_2() -> None:
    """20,000 trials: the share's standard deviation is 0.0015 and the mean's 0.014; five of each are allowed."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(20_000, 3, 2)) * 10.0 ** rng.uniform(-6, -2, size=(20_000, 1, 1))
    truth = rng.normal(size=(20_000, 3))
    point = truth + np.einsum("nij,nj->ni", root, rng.normal(size=(20_000, 2)))
    estimate = _estimate(point, covariance=root @ np.swapaxes(root, 1, 2))
    found = coverage(estimate, truth, np.ones(20_000, dtype=bool))
    assert found.count == 20_000
    assert found.inside == pytest.approx(0.95, abs=5 * 0.0015)
    assert found.mean_square == pytest.approx(2.0, abs=5 * 0.014)


def test_what_the_truth_has_along_the_normal_does_not_count() -> None:
    """It is the surface's curvature or its error of shape, not the error of location in the tangent plane."""
    covariance = np.diag([4e-6, 1e-6, 0.0])[None]
    found = coverage(
        _estimate(np.array([[2e-3, 1e-3, 5.0]]), covariance=covariance), np.zeros((1, 3)), np.array([True])
    )
    assert found.mean_square == pytest.approx(2.0)


def test_covariances_of_another_rank_are_left_out() -> None:
    covariance = np.stack([np.diag([1.0, 0, 0]), np.full((3, 3), np.nan), np.zeros((3, 3))])
    assert (
        coverage(_estimate(np.zeros((3, 3)), covariance=covariance), np.zeros((3, 3)), np.ones(3, dtype=bool)).count
        == 0
    )


def test_times_are_matched_to_the_nearest_within_the_tolerance_in_any_order() -> None:
    known = np.array([3.0, 1.0, np.nan, 2.0])
    match = nearest_in_time(np.array([0.9, 1.4, 2.6, 3.3, np.nan, 0.5]), known, 0.31)
    assert match.tolist() == [1, -1, -1, 0, -1, -1]
    assert nearest_in_time(np.array([1.4, 2.6]), known, 0.5).tolist() == [1, 0]
    assert nearest_in_time(np.array([1.0]), np.array([np.nan]), 1.0).tolist() == [-1]
    assert nearest_in_time(np.array([1.0, 9.0]), np.array([1.5]), 0.5).tolist() == [0, -1]


def test_nearest_is_what_trying_all_finds() -> None:
    rng = np.random.default_rng(2)
    time, known = rng.uniform(0, 10, 500), rng.uniform(0, 10, 60)
    apart = np.abs(time[:, None] - known)
    expected = np.where(apart.min(axis=1) <= 0.05, apart.argmin(axis=1), -1)
    assert nearest_in_time(time, known, 0.05 - 1e-6).tolist() == expected.tolist()


def test_only_answered_samples_with_a_truth_have_errors() -> None:
    status = np.array([Status.CONTACT, Status.AMBIGUOUS, Status.IMPLAUSIBLE, Status.NO_CONTACT, Status.CONTACT])
    point = np.array([[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0], [np.nan] * 3, [5.0, 0, 0]])
    truth = Samples(
        np.array([0.0, 1, 2, 3]),
        np.zeros((4, 3)),
        np.tile([0.0, 1.0, 0.0], (4, 1)),
        np.tile([0.0, 0.0, -3.0], (4, 1)),
    )
    report = evaluate(np.arange(5.0), _estimate(point, status=status), truth)
    assert (report.samples, report.matched, report.answered) == (5, 4, 2)
    assert report.location is not None
    assert (report.location.count, report.location.mean) == (2, 1.5)
    assert report.normal is not None
    assert report.normal.median == pytest.approx(pi / 2)
    assert report.force is not None
    assert report.force.worst == 2.0
    assert report.force_angle is not None
    assert report.force_angle.worst == 0.0
    assert report.statuses == {"contact": 0.25, "ambiguous": 0.25, "no_contact": 0.25, "implausible": 0.25}


def test_a_touch_is_the_median_of_its_answered_samples() -> None:
    point = np.array([[0.0, 0, 0], [1.0, 1, 0], [9.0, 1, 0], [1.0, 3, 0], [7.0, 7, 7]])
    status = np.array([0, 0, 0, 0, int(Status.IMPLAUSIBLE)])
    truth = Touches(np.array([1.0, 8.0]), np.array([4.0, 9.0]), np.array([[0.0, 0, 0], [0.0, 0, 0]]), ("tip", "missed"))
    report = evaluate(np.arange(5.0), _estimate(point, status=status), truth)
    tip, missed = report.touches
    assert (tip.label, tip.samples, tip.answered) == ("tip", 4, 3)
    assert tip.error == pytest.approx(sqrt(2))
    assert (missed.samples, missed.answered) == (0, 0)
    assert np.isnan(missed.error)
    assert report.location is not None
    assert report.location.count == 1
    assert report.normal is None


def test_shares_sum_to_one_and_keep_the_order_of_the_codes() -> None:
    shares = status_shares(np.array([8, 0, 0, 2], dtype=np.int8))
    assert shares == {"contact": 0.5, "no_contact": 0.25, "no_pose": 0.25}
    assert list(shares) == ["contact", "no_contact", "no_pose"]
