"""The reproduction of `marker ring` on a coarse barrel with few presses, and the page that a run writes."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("cv2")
pytest.importorskip("skfem")

from claims.papers.marker_ring.bench import Answer, errors
from claims.papers.marker_ring.rows import FOLDER, SMALL, Measured, degrees, figures_of, measured, newtons, parts
from claims.papers.marker_ring.study import TROUBLE
from claims.papers.marker_ring.theirs import sorted_markers
from claims.row import expected
from tests.support.templates import places

NONE = np.zeros((0, 2))


@pytest.fixture(scope="module")
def small() -> Measured:
    """All parts, a few presses each."""
    return measured(SMALL)


def test_markers_are_numbered_anticlockwise_from_the_cut() -> None:
    turn = 2.0 * np.pi * np.arange(24) / 24
    places = 300.0 + 100.0 * np.stack([np.cos(turn), -np.sin(turn)], axis=1)  # rows count down
    mixed = places[np.random.default_rng(0).permutation(24)]
    np.testing.assert_allclose(sorted_markers(mixed, 24, -np.pi / 24), places)
    assert np.isnan(sorted_markers(mixed[:23], 24)).all()


def test_a_single_contact_is_the_strongest_and_several_are_the_nearest() -> None:
    ours = np.array([[0.1, 1.0, 0.01, 0.1], [2.0, 3.0, 0.01, 0.1]])
    one = Answer(np.array([0.0]), np.array([2.5]), np.array([0.004]), ours, NONE)
    assert [(each.angle, each.force) for each in errors([one], "ours")] == [(2.0, 0.5)]
    two = replace(one, angle=np.array([2.0, 0.0]), force=np.ones(2), depth=np.full(2, 0.004))
    assert sorted(each.angle for each in errors([two], "ours")) == pytest.approx([0.0, 0.1])
    assert errors([two], "theirs") == []


def test_a_few_presses_of_a_coarse_barrel_come_near(small: Measured) -> None:
    """Bounds are wide: of a dozen presses one that is off, at 1 mm or at a plate's 10, weighs ten times as much."""
    got = figures_of(small)
    plate = errors([each for each in small.plate if each.depth[0] < 0.009], "ours")  # deeper it may look like two
    assert degrees(plate) < 1.2
    assert got["third_angle"] < 1.6
    assert newtons(plate) < 0.15
    assert got["third_force"] < 0.3
    assert got["plate_angle_theirs"] < 2.0
    assert got["third_force_theirs"] > 3.0 * got["third_force"]  # their cubic knows the plate's width only
    assert got["moving_fast"] < 0.15
    assert degrees(small.transfer["few touches, from the first unit"]) < 2.4


def test_labels_stay_right_in_trouble_where_sorting_fails(small: Measured) -> None:
    assert [each.name for each in small.trouble] == list(TROUBLE)
    assert small.trouble[0].right == {"ours": 1.0, "theirs": 1.0}
    assert all(each.right["ours"] > 0.9 and each.seen > 0.9 for each in small.trouble)
    assert all(each.right["theirs"] < 0.5 for each in small.trouble if "hidden" in each.name)


def test_several_contacts_far_apart_are_counted(small: Measured) -> None:
    found = {each.name: each for each in small.several}
    assert found["one"].right["ours"] == 1.0
    assert found["two, 60 deg"].right["ours"] == 1.0


def test_a_run_fills_the_page(small: Measured) -> None:
    assert len(expected(FOLDER, figures_of(small))) == 21
    made = parts(small)
    assert {*made, "took"} == places(FOLDER)
    assert all(part in str(made.values()) for part in ("two, 60 deg", "light x2", "third body, ours", "in full"))
