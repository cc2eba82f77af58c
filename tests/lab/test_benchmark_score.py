"""The figures of the benchmark on answers made by hand, whose score is known; peers where they must be right."""

import numpy as np
import pytest

from palpate.contact.ground_truth import TrueSamples
from palpate.surfaces import Mesh
from palpate_lab.benchmark.files import as_contacts
from palpate_lab.benchmark.scoring import score
from palpate_lab.peers import skin_peers
from palpate_lab.peers.image_peers import nearest_image, shrunk
from palpate_lab.peers.to_wrenches import contact_wrenches, linear_map, payload_and_bias
from palpate_lab.peers.wrench_peers import WRENCH_PEERS
from palpate_lab.simulation import EllipsoidBody, touch_wrenches

TRUTH = TrueSamples(np.arange(4.0), np.zeros((4, 3)), force=np.tile([0.0, 0.0, -5.0], (4, 1)))
QUIET = np.array([10, 11])


def _answers(samples: list[int], offsets: list[float], force: float = -5.0) -> np.ndarray:
    rows = np.zeros((len(samples), 6))
    rows[:, 0], rows[:, 5] = offsets, force
    return rows


def test_a_miss_is_infinitely_far_off() -> None:
    """0, 1 and 3 mm off and a miss: half of all are found within 1 mm, 95 % nowhere."""
    samples, offsets = [0, 1, 2], [0.0, 1e-3, 3e-3]
    got = score(as_contacts(np.array(samples), _answers(samples, offsets, -4.5)), TRUTH, QUIET)
    assert (got.contacts, got.answered, got.near, got.false) == (4, 0.75, 0.5, 0)
    assert got.median == pytest.approx(1e-3)
    assert got.p95 == np.inf
    assert got.force == pytest.approx(0.5)
    assert got.coverage.count == 0


def test_answers_where_nothing_touches_are_false_and_unjudged_samples_do_not_count() -> None:
    samples = [0, 1, 2, 3, 3, 11, 50]  # one too many at 3, one at rest, one in a ramp
    got = score(as_contacts(np.array(samples), _answers(samples, [0.0] * 3 + [0.0, 0.1] + [0.0] * 2)), TRUTH, QUIET)
    assert got.false == 2
    assert (got.answered, got.p95) == (1.0, 0.0)


def test_contacts_at_once_are_paired_by_the_least_sum() -> None:
    truth = TrueSamples(np.zeros(2), np.array([[0.0, 0, 0], [0.01, 0, 0]]))
    rows = np.array([[0.0105, 0, 0], [0.0005, 0, 0]])
    got = score(as_contacts(np.zeros(2, dtype=np.int64), rows), truth, QUIET)
    assert got.p95 == pytest.approx(5e-4)
    assert np.isnan(got.force)


def test_no_answer_at_all_is_a_score() -> None:
    got = score(as_contacts(np.zeros(0, dtype=np.int64), np.empty((0, 12))), TRUTH, QUIET)
    assert (got.answered, got.median, got.near, got.false) == (0.0, np.inf, 0.0, 0)


def test_ellipses_hold_the_truth_or_not() -> None:
    """Standard deviations of 1 mm along x and y: the 95 % ellipse ends at sqrt(5.99) = 2.45 mm."""
    rows = np.zeros((4, 12))
    rows[:, 0], rows[:, 6], rows[:, 9], rows[:, 11] = [0.0, 2.4e-3, 2.5e-3, 1e-3], 1e-6, 1e-6, 1e-9
    got = score(as_contacts(np.arange(4), rows), TRUTH, QUIET)
    assert (got.coverage.count, got.coverage.inside) == (4, 0.75)


@pytest.mark.parametrize("name", [name for name in WRENCH_PEERS if "minimum norm" not in name])
def test_without_torsion_every_peer_finds_the_place(name: str) -> None:
    """Up to the mesh: where its radius is 4.8 mm, facets of 2.5 mm are s^2 / 6r = 0.22 mm inside; forces lean."""
    rng, body = np.random.default_rng(3), EllipsoidBody((0.03, 0.02, 0.012))
    points = body.sample(12, rng)
    wrenches = touch_wrenches(points, body.normals(points), rng)
    answer = WRENCH_PEERS[name](Mesh.from_arrays(*body.mesh(2000)))
    found = np.stack([answer(wrench) for wrench in wrenches])
    assert np.linalg.norm(found - points, axis=1).max() < (2.5e-3 if "vertex" in name else 3.1e-4)


def test_the_shortest_lever_is_on_the_line_and_no_longer_than_the_truth() -> None:
    rng = np.random.default_rng(4)
    points = rng.normal(size=(20, 3))
    force = rng.normal(size=(20, 3))
    ball = Mesh.from_arrays(*EllipsoidBody((1.0, 1.0, 1.0)).mesh(20))
    answer = WRENCH_PEERS["minimum norm, pseudo-inverse of p x F = M"](ball)
    found = np.stack([answer(np.r_[f, np.cross(p, f)]) for p, f in zip(points, force, strict=True)])
    assert np.allclose(np.cross(found, force), np.cross(points, force), atol=1e-12)
    assert np.all(np.linalg.norm(found, axis=1) <= np.linalg.norm(points, axis=1) + 1e-12)


def test_plain_compensation_and_map_are_exact_without_noise() -> None:
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(5)
    rotations = Rotation.random(30, rng=rng).as_matrix()
    known = rng.normal(size=12)
    free = -contact_wrenches(np.zeros((30, 6)), rotations, known)
    assert np.allclose(payload_and_bias(free, rotations), known, atol=1e-9)
    matrix, points, forces = rng.normal(size=(6, 12)), rng.normal(size=(40, 3)), rng.normal(size=(40, 3))
    wrenches = np.concatenate([forces, np.cross(points, forces)], axis=1)
    assert np.allclose(wrenches @ matrix @ linear_map(wrenches @ matrix, points, forces), wrenches, atol=1e-9)


def test_patches_are_told_apart_and_share_a_wrench() -> None:
    """A flat sheet of 5 x 9 cells of 10 mm, pressed on two patches."""
    centres = np.array([[0.01 * row, 0.01 * column, 0.0] for row in range(5) for column in range(9)])
    sheet = skin_peers.CellPlaces(centres, np.tile([0.0, 0, 1], (45, 1)))
    forces = np.zeros(45)
    forces[[0, 1]], forces[[43, 44]] = 1.0, [1.0, 3.0]
    both = np.array([[0.0, 0.005, 0, 0, 0, -2], [0.04, 0.0775, 0, 0, 0, -4]])
    wrench = np.concatenate([both[:, 3:], np.cross(both[:, :3], both[:, 3:])], axis=1).sum(axis=0)
    assert np.allclose(skin_peers.patches(sheet)(forces, wrench), both)
    rows = skin_peers.patches_and_wrench(sheet)(forces, wrench)
    made = np.concatenate([rows[:, 3:], np.cross(rows[:, :3], rows[:, 3:])], axis=1).sum(axis=0)
    assert np.allclose(made, wrench)
    assert np.linalg.norm(rows[:, 3:]) <= np.linalg.norm(both[:, 3:]) + 1e-12
    assert np.allclose(skin_peers.all_taxels(sheet)(forces, wrench)[0, :3], [0.08 / 3, 0.16 / 3, 0])
    assert skin_peers.patches(sheet)(0 * forces, wrench).shape == (0, 6)


def test_an_image_of_the_calibration_finds_itself() -> None:
    rng = np.random.default_rng(6)
    images = rng.integers(0, 255, (3, 16, 24, 3), dtype=np.uint8)
    rows = np.vstack([np.full(6, np.nan), rng.normal(size=(2, 6))])
    answer = nearest_image(np.stack([shrunk(image) for image in images]), rows)
    assert np.array_equal(answer(images[2]), rows[2:])
    assert answer(images[0]).shape == (0, 6)
