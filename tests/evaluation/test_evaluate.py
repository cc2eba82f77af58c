"""Evaluation: errors from closed forms, coverage from seeded normals, matching by time."""

from dataclasses import replace
from itertools import permutations
from math import pi, sqrt

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.contact.origins import Origins
from palpate.errors import InputError
from palpate.evaluation.errors import ErrorSummary, angles, coverage
from palpate.evaluation.evaluate import evaluate, evaluate_robot
from palpate.evaluation.matching import nearest_in_time
from palpate.evaluation.other_truth import other_truth
from palpate.spatial.pose import Pose


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


def test_a_summary_is_of_the_finite_errors() -> None:
    summary = ErrorSummary.of(np.array([1.0, 2.0, np.nan, 6.0]))
    assert (summary.count, summary.mean, summary.median, summary.worst) == (3, 3.0, 2.0, 6.0)
    assert ErrorSummary.of(np.array([np.nan])) is None


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


def test_contacts_are_moved_by_one_pose_or_by_one_for_each_row() -> None:
    known = Contacts.single(np.zeros(3), _estimate(np.zeros((3, 3))))
    poses = Pose(np.tile(np.eye(3), (2, 3, 1, 1)), np.ones((2, 3, 3)))
    assert np.all(known.in_frame(Pose(poses.rotation[0], poses.translation[0])).point == 1.0)
    with pytest.raises(InputError, match="one value for each of 3 rows"):
        known.in_frame(poses)
    with pytest.raises(InputError, match="tolerance"):
        evaluate(known, TrueSamples(np.zeros(1), np.zeros((1, 3))), tolerance=-1.0)


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
    truth = TrueSamples(
        np.array([0.0, 1, 2, 3]), np.zeros((4, 3)), np.tile([0.0, 1.0, 0.0], (4, 1)), np.tile([0.0, 0.0, -3.0], (4, 1))
    )
    report = evaluate(Contacts.single(np.arange(5.0), _estimate(point, status=status)), truth)
    assert (report.samples, report.matched, report.answered) == (5, 4, 2)
    assert (report.location.count, report.location.mean) == (2, 1.5)
    assert report.normal.median == pytest.approx(pi / 2)
    assert report.force.worst == 2.0
    assert report.force_angle.worst == 0.0
    assert report.statuses.tolist() == [1, 1, 1, 0, 0, 1, 0, 0, 0]


def test_a_touch_is_the_median_of_its_answered_samples() -> None:
    point = np.array([[0.0, 0, 0], [1.0, 1, 0], [9.0, 1, 0], [1.0, 3, 0], [7.0, 7, 7]])
    status = np.array([0, 0, 0, 0, int(Status.IMPLAUSIBLE)])
    start, end, force = np.array([1.0, 8.0]), np.array([4.0, 9.0]), np.array([[0.0, 3.0, 0.0], [9.0, 9.0, 9.0]])
    truth = TrueTouches(start, end, np.zeros((2, 3)), ("tip", "missed"), force=force)
    report = evaluate(Contacts.single(np.arange(5.0), _estimate(point, status=status)), truth)
    assert report.force.worst == pytest.approx(sqrt(10))
    tip, missed = report.touches
    assert (tip.label, tip.samples, tip.answered) == ("tip", 4, 3)
    assert tip.error == pytest.approx(sqrt(2))
    assert (missed.samples, missed.answered) == (0, 0)
    assert np.isnan(missed.error)
    assert report.location.count == 1
    assert report.normal is None


def _several(rows: list[tuple[int, int, list[float]]], status: list[int] | None = None) -> Contacts:
    """Contacts of (sample, identity, point), one sample a second."""
    sample, identity, point = (np.array(column) for column in zip(*rows, strict=True))
    estimate = _estimate(point.astype(np.float64), status=None if status is None else np.array(status))
    return Contacts(sample, sample.astype(np.float64), identity, estimate)


def test_the_pairs_of_an_instant_are_those_whose_distances_are_least_together() -> None:
    """Against trying all ways to pair."""
    rng = np.random.default_rng(6)
    for contacts, truths in ((3, 3), (4, 3), (2, 4), (1, 3), (3, 1)):
        point, known = rng.normal(size=(contacts, 3)), rng.normal(size=(truths, 3))
        found = evaluate(
            _several([(0, k, row.tolist()) for k, row in enumerate(point)]), TrueSamples(np.zeros(truths), known)
        )
        apart = np.linalg.norm(point[:, None] - known, axis=-1)
        apart = apart if contacts <= truths else apart.T
        least = min(
            sum(apart[k, other] for k, other in enumerate(chosen))
            for chosen in permutations(range(apart.shape[1]), apart.shape[0])
        )
        assert found.location.count == min(contacts, truths)
        assert found.location.mean * found.location.count == pytest.approx(least)
        assert (found.unmatched, found.missed) == (max(contacts - truths, 0), max(truths - contacts, 0))


def test_a_contact_that_is_not_answered_takes_no_truth_from_one_that_is() -> None:
    contacts = _several([(0, 1, [0.0, 0, 0]), (0, 2, [0.01, 0, 0])], [int(Status.IMPLAUSIBLE), int(Status.CONTACT)])
    report = evaluate(contacts, TrueSamples(np.zeros(1), np.zeros((1, 3))))
    assert (report.matched, report.answered, report.unmatched) == (1, 1, 0)
    assert report.location.mean == pytest.approx(0.01)


def test_touches_at_once_are_each_compared_with_the_identity_that_is_nearest() -> None:
    rows = [(k, identity, [0.04 * identity, 1e-3 * identity, 0.0]) for k in range(10) for identity in (0, 1)]
    truth = TrueTouches(
        np.array([0.0, 0.0, 20.0]), np.array([9.0, 9.0, 21.0]), np.array([[0.04, 0, 0], [0.0, 0, 0], [0.0, 0, 0]]),
        ("far", "near", "never"),
    )  # fmt: skip
    report = evaluate(_several(rows), truth)
    far, near, never = report.touches
    assert far.error == pytest.approx(1e-3)
    assert near.error == pytest.approx(0.0)
    assert (far.samples, far.answered, near.samples, never.samples) == (10, 10, 10, 0)
    assert (report.matched, report.unmatched) == (20, 0)


def test_another_contact_during_a_touch_is_counted_and_not_pooled() -> None:
    rows = [(k, identity, [0.03 * identity, 0.0, 0.0]) for k in range(10) for identity in (0, 1)]
    report = evaluate(_several(rows), TrueTouches(np.zeros(1), np.full(1, 9.0), np.zeros((1, 3)), ("tip",)))
    assert report.touches[0].error == pytest.approx(0.0)
    assert (report.matched, report.answered, report.unmatched) == (10, 10, 10)


def test_one_contact_after_the_other_is_one_identity_for_many_touches() -> None:
    """Also where one ends in the instant in which the next begins."""
    point = np.repeat([[0.0, 0, 0], [0.02, 0, 0]], 5, axis=0)
    truth = TrueTouches(np.array([0.0, 4.5]), np.array([4.5, 9.0]), np.array([[0.0, 0, 0], [0.021, 0, 0]]), ("a", "b"))
    report = evaluate(Contacts.single(np.arange(10.0), _estimate(point)), truth)
    assert [touch.error for touch in report.touches] == pytest.approx([0.0, 1e-3])
    assert report.unmatched == 0


@pytest.mark.parametrize(
    ("factor", "by", "lag", "said"),
    [(1, 0, 0, ""), (1e3, 0, 0, "in mm"), (1, 1, 0, "up by a row"), (1, 0, 1, "earlier")],
)
def test_a_truth_that_fits_in_another_unit_row_or_clock_is_named(factor: float, by: int, lag: float, said: str) -> None:
    rng = np.random.default_rng(6)
    point, start, time = rng.uniform(-0.03, 0.03, (9, 3)), np.cumsum(rng.uniform(0.8, 1.6, 9)), np.arange(0, 12, 0.02)
    where = point[np.clip(np.searchsorted(start, time) - 1, 0, 8)]
    contacts = Contacts.single(time, _estimate(where + rng.normal(size=where.shape) * 2e-4))
    given = factor * np.roll(point, by, axis=0)
    for truth in (
        TrueTouches(start + 0.1 + lag, start + 0.6 + lag, given, tuple("abcdefghi")),
        *([] if by else [TrueSamples(start + 0.3 + lag, given)]),
    ):
        found = other_truth(contacts, truth, evaluate(contacts, truth))
        assert said in found
        assert bool(found) == bool(said)


def test_samples_beyond_the_ends_of_the_truth_have_none_and_are_counted() -> None:
    """Of a press, the truth is known while it lasts; within 20 ms before and after it the answer is 0 N, rightly."""
    time = np.arange(3000) * 1e-3
    pressed = (time >= 1.0) & (time < 2.0)
    force = np.stack([np.zeros(3000), np.zeros(3000), np.where(pressed, -2.0, -0.01)], axis=1)
    contacts = Contacts.single(time, _estimate(np.zeros((3000, 3)), force=force))
    known = TrueSamples(time[pressed] + 2e-4, np.zeros((1000, 3)), force=force[pressed])
    report = evaluate(contacts, known)
    assert (report.matched, report.force.worst) == (1000, 0.0)
    assert report.outside == 39  # the truth is 0.2 ms late: 19 before, 20 after
    alone = evaluate(contacts, TrueSamples(np.array([0.5, 1.5]), np.zeros((2, 3))))
    assert (alone.matched, alone.outside) == (82, 0)  # single instants: within the tolerance of each


def test_a_gap_in_the_truth_is_outside_of_it_too() -> None:
    time = np.arange(1000) * 1e-3
    known = time[(time < 0.3) | (time >= 0.6)]
    report = evaluate(Contacts.single(time, _estimate(np.zeros((1000, 3)))), TrueSamples(known, np.zeros((700, 3))))
    assert (report.matched, report.outside) == (700, 40)


def test_each_sensor_is_compared_with_its_own_truth() -> None:
    """Two sensors at the same times; a contact of one at the other's true place is an error of that one."""
    names = ("a", "b") * 50
    rng = np.random.default_rng(2)
    point = np.where(np.array(names)[:, None] == "a", [0.1, 0.0, 0.0], [0.0, 0.2, 0.0]) + 1e-3 * rng.normal(
        size=(100, 3)
    )
    truth = TrueSamples(np.arange(100) // 2 / 100.0, np.tile([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]], (50, 1)), sensor=names)
    found = Contacts.single(truth.time, _estimate(point, covariance=np.tile(1e-6 * np.eye(3), (100, 1, 1))))
    found = replace(found, origins=Origins.of_names(names, names))
    every, each = evaluate_robot(found, truth)
    for k, name in enumerate("ab"):
        alone = evaluate(replace(found[k::2], origins=None), TrueSamples(truth.time[k::2], truth.point[k::2]))
        assert each[name].location == alone.location
    assert (every.matched, every.missed, every.unmatched) == (100, 0, 0)
    assert every.location.worst == pytest.approx(np.linalg.norm(point - truth.point, axis=1).max())
    swapped, _ = evaluate_robot(found, replace(truth, point=truth.point[::-1].copy()))
    assert swapped.location.median > 0.2
    touches = TrueTouches(np.zeros(2), np.ones(2), np.array([[0.1, 0, 0], [0, 0.2, 0]]), ("1", "2"), ("a", "b"))
    every, each = evaluate_robot(found, touches)
    assert [touch.samples for touch in every.touches] == [50, 50]
    assert max(touch.error for touch in every.touches) < 1e-3
    with pytest.raises(InputError, match="must both name the sensor"):
        evaluate_robot(replace(found, origins=None), truth)
