"""Touches against other instruments: lines of action, a tracked ball."""

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.evaluation.instruments import judge, perfect, touch_rows, touches_of, wand_points, wrench_points
from palpate_lab.simulation.shapes import icosphere
from palpate_lab.simulation.skin_bench import Rolled

SHEET = Rolled()
MESH = SHEET.layout().mesh()


def _lines(count: int = 20) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and normals of the cylinder, and wrenches of pure forces along the normals there."""
    rng = np.random.default_rng(1)
    point, normal = SHEET.at(rng.uniform(0, 5, count), rng.uniform(0, 21, count))
    force = -3.0 * normal
    return point, normal, np.concatenate([force, np.cross(point, force)], axis=1)


def test_a_pure_force_is_traced_back_to_its_point() -> None:
    """To 20 um: facets of a quarter of a cell lie e^2/8R = 22 um inside the cylinder at most."""
    point, normal, wrench = _lines()
    found = wrench_points(MESH, wrench, alone=np.ones(20, dtype=bool))
    assert not any(found.refused)
    assert np.linalg.norm(found.point - point, axis=1).max() < 25e-6
    np.testing.assert_allclose(found.direction, normal, atol=1e-12)


def test_the_foot_of_the_line_is_the_papers_formula() -> None:
    """E = F x N / |F|^2 is equation (9): the point of our line nearest to the origin."""
    _, _, wrench = _lines()
    force, torque = wrench[:, :3], wrench[:, 3:]
    foot = np.cross(force, torque) / (force**2).sum(axis=1, keepdims=True)
    across = torque - (torque * force).sum(axis=1, keepdims=True) / (force**2).sum(axis=1, keepdims=True) * force
    crossed = np.cross(force, torque)
    paper = np.linalg.norm(across, axis=1) / np.linalg.norm(force, axis=1)
    papers = paper[:, None] * crossed / np.maximum(np.linalg.norm(crossed, axis=1, keepdims=True), 1e-300)
    np.testing.assert_allclose(foot, papers, atol=1e-12)


def test_what_is_no_single_force_is_refused_with_the_reason() -> None:
    _, normal, wrench = _lines(4)
    wrench[0, 3:] += 0.02 * normal[0]  # torsion: 6.7 mm of pitch
    wrench[1] *= 0.1  # 0.3 N
    wrench[2, 3:] += np.cross([0.0, 0.0, 0.5], wrench[2, :3])  # pushed along the axis, off the sheet
    found = wrench_points(MESH, wrench, alone=np.array([True, True, True, False]))
    assert "F . N" in found.refused[0]
    assert "too light" in found.refused[1]
    assert "misses" in found.refused[2]
    assert "several touches" in found.refused[3]
    assert np.isnan(found.point).all()


def test_a_ball_that_touches_is_found_at_its_point() -> None:
    """To 0.3 mm: vertices of the ball are 0.3 mm apart."""
    point, normal, _ = _lines(10)
    ball = 0.004 * icosphere(16)[0]
    centre = point + (0.004 - 0.0002) * normal  # 0.2 mm deep
    found = wand_points(MESH, ball, np.tile(np.eye(3), (10, 1, 1)), centre)
    assert not any(found.refused)
    assert np.linalg.norm(found.point - point, axis=1).max() < 0.3e-3
    away = wand_points(MESH, ball, np.eye(3)[None], (point + 0.02 * normal)[:1])
    assert "do not meet: their distance is 16 mm" in away.refused[0]  # 20 mm from its middle to the link
    lost = wand_points(MESH, ball, np.full((1, 3, 3), np.nan), np.full((1, 3), np.nan))
    assert "lost" in lost.refused[0]


def _contacts(point: np.ndarray, normal: np.ndarray, identity: np.ndarray, sample: np.ndarray) -> Contacts:
    """At 100 Hz, with the row of a sheet that each is felt in: its identity."""
    count = len(point)
    estimate = ContactEstimate(
        point.copy(), normal.copy(), -normal, np.zeros(count), np.zeros((count, 3, 3)), np.zeros(count),
        np.ones(count, np.int64), np.full(count, Status.CONTACT, np.int8),
    )  # fmt: skip
    return Contacts(sample, sample / 100, identity, estimate, {"row": identity.astype(np.float64)})


def test_the_papers_measures_are_those_of_the_paper() -> None:
    point, normal, wrench = _lines()
    reference = wrench_points(MESH, wrench, alone=np.ones(20, dtype=bool))
    shifted = judge(_contacts(point + np.array([0.001, 0.0, 0.004]), normal, np.arange(20), np.arange(20)), reference)
    assert shifted.report.location.mean == pytest.approx((0.001**2 + 0.004**2) ** 0.5, abs=3e-5)
    assert shifted.paper_position.mean == pytest.approx(0.001, abs=3e-5)  # z set to zero
    assert shifted.along == pytest.approx([0.001, 0.0, 0.004], abs=3e-5)
    turned = judge(_contacts(point, np.roll(normal, 1, axis=0), np.arange(20), np.arange(20)), reference)
    exact = np.abs(np.roll(normal, 1, axis=0) - normal)[:, :2].mean()
    assert turned.paper_direction == pytest.approx(exact, rel=1e-9)


def test_what_is_refused_is_left_out_and_the_rest_keeps_its_place() -> None:
    point, normal, wrench = _lines(4)
    wrench[1] *= 0.1  # too light
    found = judge(
        _contacts(point, normal, np.arange(4), np.arange(4)), wrench_points(MESH, wrench, alone=np.ones(4, dtype=bool))
    )
    assert (found.report.samples, found.report.location.count) == (4, 3)
    assert np.isnan(found.report.errors).tolist() == [False, True, False, False]
    assert np.nanmax(found.report.errors) < 25e-6
    assert np.nanmax(found.report.turned) < 1e-9


def test_a_touch_is_the_median_of_its_rows_and_knows_whether_it_was_alone() -> None:
    """Identity 3 for 9 samples, the last of them far off, beside identity 4 for 3; 5 alone; 6 for two samples only."""
    identity = np.array([3] * 9 + [4] * 3 + [5] * 4 + [6] * 2)
    sample = np.array([*range(9), *range(3), *range(20, 24), *range(40, 42)])
    point = np.stack([identity * 0.01, np.zeros(18), np.zeros(18)], axis=1)
    point[8] = 1.0
    contacts = _contacts(point, np.tile([0.0, 0.0, 1.0], (18, 1)), identity, sample)[np.argsort(sample)]
    touches, alone = touches_of(contacts)
    assert sorted(touches.identity.tolist()) == [3, 4, 5]
    by_identity = dict(zip(touches.identity.tolist(), range(3), strict=True))
    assert touches.point[by_identity[3]] == pytest.approx([0.03, 0, 0])
    assert touches.time[by_identity[5]] == pytest.approx(0.215)
    assert touches.features["row"][by_identity[4]] == 4.0
    assert [bool(alone[by_identity[k]]) for k in (3, 4, 5)] == [False, False, True]


def test_touches_of_a_sensor_without_identities_are_told_apart_by_time() -> None:
    sample = np.array([*range(10), *range(100, 110)])
    point = np.repeat([[0.0, 0, 0], [0.01, 0, 0]], 10, axis=0)
    contacts = _contacts(point, np.tile([0.0, 0.0, 1.0], (20, 1)), np.zeros(20, np.int64), sample)
    touches, alone = touches_of(contacts)
    np.testing.assert_allclose(touches.point, [[0.0, 0, 0], [0.01, 0, 0]])
    assert alone.all()
    assert [rows.tolist() for rows in touch_rows(contacts)] == [list(range(10)), list(range(10, 20))]
    assert len(touches_of(contacts[:0])[0]) == 0


def test_a_perfect_map_errs_as_a_square_does() -> None:
    """A million points of a square; their mean deviates by 1.4e-4 of it."""
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (1_000_000, 2)) * 0.01
    distance, axis = perfect((0.01, 0.01))
    assert distance == pytest.approx(np.linalg.norm(points, axis=1).mean(), rel=2e-3)
    assert axis == pytest.approx(np.abs(points[:, 0]).mean(), rel=2e-3)
