"""Statuses and the ways of calling: nothing lost, nothing changed behind the caller's back."""

import functools
import pickle
import weakref
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from palpate.contact import ContactEstimate, Locator, Status
from palpate.contact.locate import in_space, locate
from palpate.errors import InputError
from palpate.spatial.pose import Pose
from palpate.spatial.wrench import Wrench
from palpate.surfaces import Mesh, plane
from palpate.surfaces._jit import ENTRIES
from palpate_lab.simulation.contacts import touch_wrenches
from tests.support.bodies import BODIES, PLACE, R, box, on_mesh, pressing
from tests.support.state import remembered

NOISE = np.array([0.02] * 3 + [5e-4] * 3)
UP = np.array([0.0, 0, 1])
TOP = PLACE + np.array([0.3 * R, 0.1 * R, 0.5 * R])  # on the box's lid


@functools.cache
def lid() -> Mesh:
    vertices, faces = box()
    return Mesh.from_arrays(vertices + PLACE, faces)


def press(size: float, tangent: float = 0.0, pitch: float = 0.0) -> np.ndarray:
    return pressing(TOP, UP, size * np.array([tangent, 0, -1.0]) / np.hypot(1, tangent), pitch)


def status_of(locator: Locator, *wrenches: np.ndarray) -> list[Status]:
    return [Status(s) for s in locator.run(np.array(wrenches)).status]


def test_nothing_is_compiled_after_construction(monkeypatch: pytest.MonkeyPatch) -> None:
    def used() -> set[tuple[str, int]]:
        return {(name, way) for name, each in ENTRIES.items() for way in each._compiled}

    mesh = lid()
    mesh.prepared()
    for each in ENTRIES.values():
        monkeypatch.setattr(each, "_compiled", {})
        monkeypatch.setattr(each, "_fitting", {})
    locator = Locator(mesh, noise=NOISE)
    before = used()
    locator(press(5.0), locator.empty())
    locator.run(np.tile(press(5.0), (10, 1)), np.tile(np.eye(6) * 1e-4, (10, 1, 1)))
    assert len(locator.candidates(press(5.0)).point)
    assert used() == before


def same(one: ContactEstimate, two: ContactEstimate) -> None:
    """Bit for bit, NaN for NaN."""
    for name, value in vars(one).items():
        assert np.array_equal(value, getattr(two, name), equal_nan=True), name


def a_log(mesh: Mesh, count: int = 5000, seed: int = 0) -> np.ndarray:
    """Touches, gaps of rest, NaN and light ones, as a log has them."""
    rng = np.random.default_rng(seed)
    points, normals, _ = on_mesh(mesh, count, rng)
    wrenches = touch_wrenches(points, normals, rng, force=(0.0, 3.0), tan_theta=1.3, pitch=0.3 * R)
    wrenches[rng.random(count) < 0.1] = 0
    wrenches[rng.random(count) < 0.05, 3] = np.nan
    return wrenches + 0.5 * NOISE * rng.normal(size=wrenches.shape)


# ------------------------------------------------------------------------------------------------------------- statuses


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("channel", range(6))
def test_nan_and_infinite_channels_are_invalid_and_answered_by_nothing(bad: float, channel: int) -> None:
    wrench = press(5.0)
    wrench[channel] = bad
    answer = Locator(lid(), noise=NOISE).run(wrench[None])
    assert answer.status[0] == Status.INVALID
    assert np.isnan(answer.point).all()
    assert np.isnan(answer.covariance).all()
    assert answer.candidates[0] == 0


def test_infinities_that_cancel_and_huge_finite_numbers() -> None:
    """Beyond 1e9 N or N m nothing is a reading, and at 1e200 its square is no number."""
    wrench, couple, locator = press(5.0), press(5.0), Locator(lid())
    wrench[0], wrench[1] = np.inf, -np.inf
    couple[5] = -1e200
    huge = 1e200 * press(1.0)
    assert status_of(locator, wrench, huge, couple, press(1e8)) == [Status.INVALID] * 3 + [Status.CONTACT]
    assert len(locator.candidates(huge).point) == 0


def test_zero_force_is_no_contact_with_and_without_thresholds() -> None:
    couple = np.array([0, 0, 0, 0.1, 0, 0])
    for locator in (Locator(lid()), Locator(lid(), noise=NOISE), Locator(lid(), on=0.0, off=0.0)):
        assert status_of(locator, np.zeros(6), couple) == [Status.NO_CONTACT] * 2


def test_thresholds_have_hysteresis() -> None:
    """Up through `off` is too light until `on` is reached; down to `off` it stays a contact."""
    locator = Locator(lid(), on=1.0, off=0.5)
    sizes = [0.4, 0.6, 0.99, 1.01, 0.7, 0.51, 0.49, 0.7, 1.0, 0.5]
    none, light, touch = Status.NO_CONTACT, Status.TOO_LIGHT, Status.CONTACT
    expected = [none, light, light, touch, touch, touch, none, light, touch, touch]
    assert status_of(locator, *(press(size) for size in sizes)) == expected
    locator.reset()
    assert not remembered(locator, Locator(lid(), on=1.0, off=0.5))
    assert status_of(locator, press(0.7)) == [light]


def test_thresholds_come_from_the_noise() -> None:
    """5.5 and 3 times the largest deviation of force, where the noise is all that is uncertain."""
    locator = Locator(lid(), noise=[0.01, 0.02, 0.03, 1, 1, 1])
    assert (locator.on, locator.off) == (pytest.approx(0.165), pytest.approx(0.09))
    assert (Locator(lid()).on, Locator(lid()).off) == (0, 0)
    given = Locator(lid(), noise=NOISE, on=0.05)
    assert given.on == 0.05
    assert given.off <= 0.05
    given = Locator(lid(), noise=NOISE, off=0.7)
    assert given.off == 0.7
    assert given.on >= 0.7
    known = np.stack([np.diag(np.square([0.01, 0.02, each, 1.0, 1.0, 1.0])) for each in (0.02, 0.06)])
    np.testing.assert_allclose(locator.least_forces(known), [0.165, 0.33])
    assert [*locator.least_forces(None), *given.least_forces(known)] == [locator.on, given.on]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"on": 0.3, "off": 0.5}, "0 <= off <= on"),
        ({"on": -1.0}, "0 <= off <= on"),
        ({"friction": 0.0}, "friction"),
        ({"friction": np.nan}, "friction"),
        ({"torsion": -1e-3}, "torsion"),
        ({"method": "guess"}, "unknown method 'guess'. Use one of soft_finger, wrench_axis"),
    ],
)
def test_settings_that_make_no_sense_are_refused(options: dict[str, float], word: str) -> None:
    with pytest.raises(InputError, match=word):
        Locator(lid(), **options)


@pytest.mark.parametrize(
    "noise", [np.ones(5), -np.ones(6), np.full(6, np.nan), np.ones((6, 5)), np.triu(np.ones((6, 6)))]
)
def test_bad_noise_is_refused(noise: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"noise.*Write"):
        Locator(lid(), noise=noise)
    with pytest.raises(InputError, match=r"noise.*Write"):
        locate(Wrench.from_vector(press(1.0)), lid(), noise=noise)


def test_friction_beyond_its_bound_is_implausible_and_located() -> None:
    """0.51 of 5 N is 45 mN beyond the cone: implausible by noise that is less than a third of it, or not known."""
    for noise in (None, 0.1 * NOISE):
        locator = Locator(lid(), friction=0.5, noise=noise)
        assert status_of(locator, press(5.0, 0.49), press(5.0, 0.51)) == [Status.CONTACT, Status.IMPLAUSIBLE]
    assert status_of(Locator(lid(), friction=0.5, noise=NOISE), press(5.0, 0.51)) == [Status.CONTACT]
    answer = locator.run(press(5.0, 0.51)[None])
    assert np.allclose(answer.point[0], TOP, rtol=0, atol=1e-12)
    assert answer.candidates[0] == 0
    assert answer.residual[0] > 0
    assert np.isfinite(answer.covariance).all()


def test_torsion_beyond_its_bound_is_implausible_and_located() -> None:
    """On the normal the torsion is h |F|: the bound is on h itself."""
    locator = Locator(lid(), torsion=2e-3, noise=NOISE)
    assert status_of(locator, press(5.0, 0, 2.2e-3), press(5.0, 0, 2.4e-3)) == [Status.CONTACT, Status.IMPLAUSIBLE]
    strict = Locator(lid(), torsion=2e-3)
    assert status_of(strict, press(5.0, 0, 1.99e-3), press(5.0, 0, 2.01e-3)) == [Status.CONTACT, Status.IMPLAUSIBLE]
    answer = locator.run(press(5.0, 0, -2.5e-3)[None])
    assert answer.status[0] == Status.IMPLAUSIBLE
    assert answer.torque[0] == pytest.approx(2.5e-3 * 5.0, rel=1e-9)  # tau = h |F|^2/(F . n), and F . n = -|F|
    # 0.5 mm too much of 5 N: 2.5 mN m, five deviations, a little less as a larger force may carry more
    assert 4.5 < answer.residual[0] <= 5.0 + 1e-9


@pytest.mark.parametrize("tangent", [0.5, 1.0, 2.0])
def test_torsion_is_bounded_by_the_force_across_the_surface(tangent: float) -> None:
    """Not by all of it: tau = h |F|/cos(theta) and |F . n| = |F| cos(theta), so h is bounded by t cos^2(theta)."""
    locator = Locator(lid(), friction=3.0, torsion=2e-3, noise=1e-3 * NOISE, on=0.0)
    most = 2e-3 / (1.0 + tangent**2)
    within, beyond = press(5.0, tangent, 0.99 * most), press(5.0, tangent, 1.01 * most)
    assert status_of(locator, within, beyond) == [Status.CONTACT, Status.IMPLAUSIBLE]
    assert locator.candidates(within).plausible[0]
    assert not locator.candidates(beyond).plausible.any()
    assert locator.run(beyond).residual > 0


def two_ways() -> tuple[Mesh, np.ndarray, np.ndarray, np.ndarray]:
    """A force into the end of the L's lower arm (x = R), out of its top (y = 0), into the wall of the upper (x = 0)."""
    mesh = BODIES["L"].mesh
    first, second = np.array([R, -0.3 * R, 0.0]), np.array([0.0, 0.4 * R, 0.0])
    force = 5.0 * (second - first) / np.linalg.norm(second - first)
    return mesh, first + PLACE, second + PLACE, np.concatenate([force, np.cross(first + PLACE, force)])


def test_two_candidates_are_ambiguous_and_the_one_met_first_is_given() -> None:
    mesh, first, second, wrench = two_ways()
    locator = Locator(mesh, noise=NOISE)
    answer = locator.run(wrench[None])
    assert answer.status[0] == Status.AMBIGUOUS
    assert answer.answered.all()
    assert answer.candidates[0] == 2
    assert np.allclose(answer.point[0], first, rtol=0, atol=1e-10)
    found = locator.candidates(wrench)
    assert found.plausible.sum() == 2
    assert np.allclose(found.point[:2], [first, second], rtol=0, atol=1e-10)


def test_previous_decides_between_candidates_and_so_does_the_sequence() -> None:
    mesh, first, second, wrench = two_ways()
    for point in (first, second):
        beside = point + 1e-3
        assert np.allclose(locate(Wrench.from_vector(wrench), mesh, previous=beside).point, point, rtol=0, atol=1e-10)
    alone = pressing(second, np.array([1.0, 0, 0]), np.array([-5.0, 0, 0]), 0.0)
    before = locate(Wrench.from_vector(alone), mesh)
    assert np.allclose(locate(Wrench.from_vector(wrench), mesh, previous=before).point, second, rtol=0, atol=1e-10)
    locator = Locator(mesh, noise=NOISE)
    for each in (Locator(mesh), locator):  # by the last contact alone; with noise, by the touch so far
        in_sequence = each.run(np.array([alone, wrench, np.zeros(6), wrench]))
        assert np.allclose(in_sequence.point[1], second, rtol=0, atol=1e-10)
        assert np.allclose(in_sequence.point[3], first, rtol=0, atol=1e-10)  # let go in between: nothing to go on from
    locator.reset()
    apart = locator.run(np.array([alone, wrench]), sequential=False)
    assert np.allclose(apart.point[1], first, rtol=0, atol=1e-10)  # each on its own


def test_a_candidate_within_the_ellipse_is_no_ambiguity() -> None:
    mesh, _, _, wrench = two_ways()
    vague = np.array([0.02] * 3 + [0.5] * 3)  # a decimetre
    assert locate(Wrench.from_vector(wrench), mesh, noise=vague).status == Status.CONTACT


@pytest.mark.parametrize(("x", "early"), [(-1.5e-3, Status.AMBIGUOUS), (-5e-3, Status.CONTACT)])
def test_while_a_touch_begins_a_place_that_noise_leads_to_past_an_edge_is_in_doubt(x: float, early: Status) -> None:
    """On the upper tread of a stair, 1.5 and 5 deviations of 1 mm beside its edge: 2.5 of them may lead to the lower.

    From the second sample of the touch, where the first was no accident, to the eighth.
    """
    tread = np.array([[-0.01, -0.01, 0.0], [0.0, -0.01, 0.0], [0.0, 0.01, 0.0], [-0.01, 0.01, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    lower = tread + np.array([0.01, 0.0, -0.01])
    stair = Mesh.from_arrays(np.concatenate([tread, lower]), np.concatenate([faces, faces + 4]))
    wrench = pressing(np.array([x, 0.0, 0.0]), UP, np.array([0.0, 0.0, -5.0]), 0.0)
    locator = Locator(stair, noise=[0.02] * 3 + [5e-3] * 3)
    assert status_of(locator, *[wrench] * 12) == [Status.CONTACT] + [early] * 7 + [Status.CONTACT] * 4


def ambiguous_scale(answer: ContactEstimate, other: np.ndarray) -> float:
    """The factor on all deviations at which another candidate lies on the 95 % ellipse of the one given.

    In the tangent plane its squared distance is off' C^-1 off, chi-square of two degrees of freedom; along the normal,
    where C is zero, the trace of C stands for the variance.
    """
    off = other - answer.point
    square = off @ np.linalg.pinv(answer.covariance, rcond=1e-9, hermitian=True) @ off
    square = max(square, (off @ answer.normal) ** 2 / np.trace(answer.covariance))
    return float(np.sqrt(square / chi2.ppf(0.95, 2)))


def assert_ambiguous_beyond(
    mesh: Mesh, wrench: np.ndarray, noise: np.ndarray, at: np.ndarray, other: np.ndarray
) -> None:
    answer = locate(Wrench.from_vector(wrench, noise), mesh, previous=at)
    assert np.allclose(answer.point, at, rtol=0, atol=1e-9)
    scale = ambiguous_scale(answer, other)
    for factor, status in ((0.999, Status.AMBIGUOUS), (1.001, Status.CONTACT)):
        found = locate(Wrench.from_vector(wrench, noise * (factor * scale) ** 2), mesh, previous=at)
        assert found.candidates == 2
        assert found.status == status


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("tilt", [0.3, 0.9])  # the other one lies more along the normal, or more in the tangent plane
def test_ambiguous_is_another_candidate_beyond_the_95_percent_ellipse(seed: int, tilt: float) -> None:
    """To 0.1 % of the deviations, with noises that correlate and a body that lies across all axes."""
    rng = np.random.default_rng(seed)
    mesh, first, second = plates({0.01: tilt, -0.01: -0.2}), np.array([0.0, 0.0, 0.01]), np.array([0.0, 0.0, -0.01])
    wrench = np.array([0.0, 0.0, -5.0, 0.0, 0.0, 0.0])
    pose = Pose.from_rotation_vector(rng.normal(size=3), 0.02 * rng.normal(size=3))
    root = rng.normal(size=(6, 6)) * NOISE
    wrench, (first, second) = pose.wrench_matrix() @ wrench, pose.apply(np.array([first, second]))
    for at, other in ((first, second), (second, first)):
        assert_ambiguous_beyond(mesh.transformed(pose), wrench, root.T @ root, at, other)


def plates(tilts: dict[float, float]) -> Mesh:
    """Square plates over each other, in a drawn order: height -> tan of the tilt about y."""
    corners, faces = list[np.ndarray](), list[np.ndarray]()
    for height in np.random.default_rng(0).permutation(list(tilts)):
        tilt = tilts[height]
        square = np.array([[-1, -1, -tilt], [1, -1, tilt], [1, 1, tilt], [-1, 1, -tilt]]) * 1e-3 + [0, 0, height]
        faces.append(np.array([[0, 1, 2], [0, 2, 3]]) + 4 * len(corners))
        corners.append(square)
    return Mesh.from_arrays(np.concatenate(corners), np.concatenate(faces))


@pytest.mark.parametrize("noise", [NOISE, np.array([0.3, 0.01, 0.02, 1e-4, 2e-3, 1e-3])])
def test_a_candidate_right_behind_is_ambiguous_too(noise: np.ndarray) -> None:
    """Straight along the normal no ellipse reaches: the plate behind must not be taken for the same place."""
    mesh, wrench = plates({0.0: 0.0, -0.01: 0.0}), np.array([0.0, 0, -5, 0, 0, 0])
    assert locate(wrench, mesh, noise=0.1 * noise).status == Status.AMBIGUOUS
    for at, other in ((0.0, -0.01), (-0.01, 0.0)):
        assert_ambiguous_beyond(mesh, wrench, np.diag(noise**2), np.array([0, 0, at]), np.array([0, 0, other]))


def test_candidates_come_plausible_first_and_then_as_the_force_meets_them() -> None:
    """A force that runs down through seven plates of any tilt, of which every other is too steep for its friction."""
    flat, steep = {0.0: 0.5, -0.02: 0.0, -0.04: 0.9, -0.06: 0.1}, {-0.01: 3.0, -0.03: 2.0, -0.05: 1.5}
    locator = Locator(plates(flat | steep), friction=1.0)
    wrench = pressing(np.zeros(3), UP, np.array([0, 0, -5.0]), 0.0)
    found = locator.candidates(wrench)
    assert found.plausible.tolist() == [True] * 4 + [False] * 3
    assert np.allclose(found.point[:, 2], [*flat, *steep], rtol=0, atol=1e-12)
    assert np.allclose(found.friction, [*flat.values(), *steep.values()], rtol=0, atol=1e-9)
    upward = locator.candidates(-wrench)
    assert len(upward.point) == 0  # plates are pressed from above only
    answer = locator.run(wrench)
    assert answer.candidates == 4
    assert np.allclose(answer.point, 0.0, rtol=0, atol=1e-12)  # the one met first


def test_forced_statuses_are_kept_and_break_nothing() -> None:
    locator = Locator(lid(), noise=NOISE)
    wrenches = np.array([press(5.0)] * 4)
    forced = np.array([-1, Status.SATURATED, Status.NO_POSE, -1], dtype=np.int8)
    answer = locator.run(wrenches, statuses=forced)
    assert answer.status.tolist() == [Status.CONTACT, Status.SATURATED, Status.NO_POSE, Status.CONTACT]
    assert np.isnan(answer.point[1:3]).all()
    assert (answer.candidates[1:3] == 0).all()
    assert np.allclose(answer.point[[0, 3]], TOP, rtol=0, atol=1e-12)


def test_every_answer_is_consistent_with_its_status() -> None:
    """Rows in = rows out; a point where there is a contact, and nowhere else; counts and residuals that agree."""
    mesh = BODIES["open patch"].mesh
    wrenches = a_log(mesh)
    answer = Locator(mesh, noise=NOISE).run(wrenches)
    assert len(answer.status) == len(wrenches)
    rare = {Status.AMBIGUOUS, Status.SATURATED, Status.NO_POSE}
    assert set(answer.status.tolist()) >= set(Status) - rare
    located = np.isin(answer.status, [Status.CONTACT, Status.AMBIGUOUS, Status.IMPLAUSIBLE])
    assert np.isfinite(answer.point[located]).all()
    assert np.isfinite(answer.covariance[located]).all()
    assert (answer.candidates[answer.answered] >= 1).all()
    assert (answer.candidates[~answer.answered] == 0).all()
    assert (answer.residual[answer.answered] <= 3.0).all()
    assert (answer.residual[answer.status == Status.IMPLAUSIBLE] > 3.0).all()
    silent = np.isin(answer.status, [Status.NO_CONTACT, Status.TOO_LIGHT, Status.INVALID])
    assert np.isnan(answer.point[silent]).all()
    kept = answer.status != Status.INVALID
    assert np.array_equal(answer.force[kept], wrenches[kept, :3])


# -------------------------------------------------------------------------------------------------------------- calling


def test_locate_takes_six_numbers_rows_of_them_and_a_wrench() -> None:
    rows = np.array([press(5.0), press(3.0, 0.2)])
    expected = locate(Wrench.from_vector(rows), lid(), noise=NOISE)
    same(locate(rows, lid(), noise=NOISE), expected)
    same(locate(rows.tolist(), lid(), noise=NOISE), expected)
    same(locate(rows[None], lid(), noise=NOISE)[0], expected)
    same(locate(tuple(rows[1]), lid(), noise=NOISE), expected[1])


def test_six_numbers_are_answered_as_a_batch_of_one_and_are_not_written_into() -> None:
    mesh = BODIES["L"].mesh
    expected = found = locate([0, 0, -2, 0, 0, 0], mesh)
    for vector in (*np.nan_to_num(a_log(mesh, 20)), np.full(6, np.nan), np.array([0.0, 0, -2, 0, 0, 0])):
        expected = locate(vector[None], mesh)[0]
        given = vector.copy()
        given.flags.writeable = False
        for form in (vector.tolist(), tuple(vector), given, np.repeat(vector, 2)[::2], vector.astype(">f8")):
            found = locate(form, mesh)
            same(found, expected)
            assert list(vars(found)) == list(vars(expected))
            for name, value in vars(expected).items():
                assert np.asarray(value).dtype == np.asarray(getattr(found, name)).dtype, name
                assert type(value) is type(getattr(found, name)), name
    same(locate([0, 0, -2, 0, 0, 0], mesh), expected)  # the last one, of whole numbers
    with pytest.raises(ValueError, match="read-only"):
        found.point[0] = 1.0
    with pytest.raises(ValueError, match="WRITEABLE"):
        found.torque.flags.writeable = True
    same(pickle.loads(pickle.dumps(found)), found)
    wrongs: tuple[Any, ...] = ([0.0] * 5, ["a"] * 6, [[0.0], [1.0, 2.0], 3.0, 4.0, 5.0, 6.0], [None] * 6)
    for wrong in wrongs:
        with pytest.raises(InputError, match=r"wrench must.*Write"):
            locate(wrong, mesh)


def test_a_surface_that_locate_has_met_can_be_forgotten() -> None:
    mesh = replace(lid())
    for friction in np.arange(1, 13) / 10:
        locate(press(5.0), mesh, friction=friction)
    gone = weakref.ref(mesh)
    del mesh
    assert gone() is None


def test_many_wrenches_may_be_answered_in_any_order(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = BODIES["L"].mesh
    wrenches = a_log(mesh, 230)
    covariances = np.linspace(1, 2, 230)[:, None, None] * np.diag(NOISE**2)
    statuses = np.where(np.arange(230) % 7, -1, Status.SATURATED)
    one = Locator(mesh, noise=NOISE)
    given = [(None, None), (covariances, statuses), (covariances[0], None)]
    expected = [one.run(wrenches, *each, sequential=False, previous=(0, 0, 1)) for each in given]
    for name, value in (("_MANY", 10), ("_BLOCK", 100), ("_LARGE", 0)):
        monkeypatch.setattr(import_module("palpate.contact.locate"), name, value)
    for each, answer in zip(given, expected, strict=True):
        same(one.run(wrenches, *each, sequential=False, previous=(0, 0, 1)), answer)
    order = in_space(wrenches, mesh.centre, 0.5 * mesh.size)
    assert np.array_equal(np.sort(order), np.arange(230))
    places = expected[0].point[order]
    steps = np.linalg.norm(np.diff(places[np.isfinite(places[:, 0])], axis=0), axis=1)
    before = expected[0].point[np.isfinite(expected[0].point[:, 0])]
    assert steps.mean() < 0.7 * np.linalg.norm(np.diff(before, axis=0), axis=1).mean()  # they lie closer together


def test_run_answers_one_wrench_as_a_log_of_one() -> None:
    one, two = Locator(lid(), noise=NOISE), Locator(lid(), noise=NOISE)
    for wrench in (press(5.0, 0.1), np.zeros(6), press(0.15), press(5.0, 0.7, 1e-3)):
        single = one.run(wrench, np.diag(NOISE**2), Status.SATURATED if wrench[2] == -0.15 else None)
        assert single.point.shape == (3,)
        assert single.covariance.shape == (3, 3)
        assert isinstance(single.status, Status)
        assert isinstance(single.answered, bool)
        same(single, two.run(wrench[None], statuses=[6] if wrench[2] == -0.15 else None)[0])


def test_run_takes_any_leading_axes_in_the_order_of_memory() -> None:
    wrenches = np.nan_to_num(a_log(lid(), 12))
    flat = Locator(lid(), noise=NOISE).run(wrenches)
    same(Locator(lid(), noise=NOISE).run(wrenches.reshape(3, 4, 6)), flat.reshaped((3, 4)))


def test_a_status_prints_its_name() -> None:
    assert [str(status) for status in (Status.CONTACT, Status.NO_POSE)] == ["contact", "no_pose"]
    assert f"{locate(press(5.0), lid()).status}" == "contact"
    assert f"{Status.OFF_SURFACE:>12}" == " off_surface"


def test_an_estimate_says_what_it_is() -> None:
    single = locate(press(5.0), lid())
    x, y, z = 1e3 * TOP
    assert (
        repr(single)
        == f"ContactEstimate(contact, point ({x:.3f}, {y:.3f}, {z:.3f}) mm, force (0.000, 0.000, -5.000) N)"
    )
    log = Locator(lid()).run(np.array([press(5.0), np.zeros(6), np.zeros(6)]))
    assert repr(log) == "ContactEstimate((3,): 1 contact, 2 no_contact)"
    assert repr(log[:0]) == "ContactEstimate((0,): empty)"


def test_a_number_picks_one_and_the_loop_gives_each() -> None:
    log = Locator(lid(), noise=NOISE).run(np.array([press(5.0), np.zeros(6), press(4.0, 0.1)]))
    assert [one.status for one in log] == [Status.CONTACT, Status.NO_CONTACT, Status.CONTACT]
    for number, one in enumerate(log):
        same(one, log[number])
        same(one, log[np.int64(number - 3)])
        same(one.reshaped((1,)), log[number : number + 1])
    same(ContactEstimate.joined([one.reshaped((1,)) for one in log]), log)
    assert log.reshaped((3, 1))[2].status.tolist() == [Status.CONTACT]
    with pytest.raises(IndexError):
        log[3]
    with pytest.raises(TypeError, match="single"):
        log[0][0]


def test_an_estimate_has_statuses_of_its_own_shape() -> None:
    fields = vars(Locator(lid()).run(np.zeros((3, 6))))
    for wrong in (fields["status"][:2], fields["status"].astype(np.int64)):
        with pytest.raises(InputError, match=r"status must be int8 of shape \(3,\).*Write"):
            ContactEstimate(**{**fields, "status": wrong})


def test_locate_does_not_remember_between_calls_or_samples() -> None:
    mesh, first, second, wrench = two_ways()
    locate(Wrench.from_vector(wrench), mesh, previous=second)
    assert np.allclose(locate(Wrench.from_vector(wrench), mesh).point, first, rtol=0, atol=1e-10)


def test_without_noise_covariances_and_residuals_outside_are_nan() -> None:
    answer = Locator(lid(), friction=0.5).run(np.array([press(5.0), press(5.0, 0.7)]))
    assert answer.status.tolist() == [Status.CONTACT, Status.IMPLAUSIBLE]
    assert np.isnan(answer.covariance).all()
    assert answer.residual[0] == 0
    assert np.isnan(answer.residual[1])
    assert np.allclose(answer.point, TOP, rtol=0, atol=1e-12)


def test_noise_may_come_with_the_locator_the_call_or_the_wrench() -> None:
    covariance = np.diag(NOISE**2)
    wrench = press(5.0, 0.3, 1e-3)
    by_locator = Locator(lid(), noise=NOISE, on=0.0).run(wrench[None]).covariance[0]
    by_run = Locator(lid()).run(wrench[None], covariance).covariance[0]
    by_run_each = Locator(lid()).run(np.array([wrench, wrench]), np.array([covariance, 4 * covariance])).covariance
    by_wrench = locate(Wrench.from_vector(wrench, covariance), lid()).covariance
    by_call = locate(Wrench.from_vector(wrench, 9 * covariance), lid(), noise=NOISE).covariance
    for found in (by_run, by_run_each[0], by_run_each[1] / 4, by_wrench, by_call):
        assert np.allclose(found, by_locator, rtol=1e-12, atol=0)
    each = Wrench.from_vector(np.array([[wrench] * 3] * 2), np.broadcast_to(covariance, (2, 3, 6, 6)))
    assert np.allclose(locate(each, lid()).covariance, by_locator, rtol=1e-12, atol=0)
    with pytest.raises(Exception, match="covariances"):
        Locator(lid()).run(np.array([wrench] * 3), np.array([covariance] * 2))


def test_results_are_read_only_and_apart_from_what_was_given() -> None:
    wrenches = np.array([press(5.0)] * 2)
    given = wrenches.copy()
    answer = Locator(lid(), noise=NOISE).run(wrenches)
    assert np.array_equal(wrenches, given)
    for part in (answer, answer[:1], answer.reshaped((2, 1))):
        for value in vars(part).values():
            with pytest.raises(ValueError, match="read-only"):
                value[...] = 0
    wrenches[:] = 0
    assert np.all(answer.force[:, 2] == -5.0)


def test_torque_is_what_is_left_about_the_normal_for_both_methods() -> None:
    """(M - p x F) . n, with the point that the method gives."""
    mesh = BODIES["ellipsoid"].mesh
    wrenches = np.nan_to_num(a_log(mesh, 300))
    for method in ("soft_finger", "wrench_axis"):
        answer = Locator(mesh, method=method, friction=3.0, torsion=1.0).run(wrenches)
        ok = answer.answered
        assert ok.sum() > 200
        left = wrenches[ok, 3:] - np.cross(answer.point[ok], wrenches[ok, :3])
        assert np.allclose(answer.torque[ok], np.sum(left * answer.normal[ok], axis=1), rtol=0, atol=1e-12)


def test_one_facet_is_surface_enough() -> None:
    mesh = Mesh.from_arrays([[0, 0, 0], [R, 0, 0], [0, R, 0]], [[0, 1, 2]])
    inside, beside = np.array([0.2 * R, 0.3 * R, 0]), np.array([0.8 * R, 0.7 * R, 0])
    down = np.array([0, 0, -5.0])
    answer = Locator(mesh, noise=NOISE).run(np.array([pressing(point, UP, down, 0.0) for point in (inside, beside)]))
    assert answer.status.tolist() == [Status.CONTACT, Status.OFF_SURFACE]
    assert np.allclose(answer.point, [inside, [0.55 * R, 0.45 * R, 0]], rtol=0, atol=1e-15)  # the foot on the long side


@pytest.mark.parametrize("tilt", [(-0.8, -0.6), (-0.6, -0.8)])
def test_of_two_facets_at_one_edge_the_one_faced_more_squarely_comes_first(tilt: tuple[float, float]) -> None:
    """Both contacts of the axis are the same point, so height does not decide."""
    mesh = Mesh.from_arrays(*box())
    point, force = np.array([R, 0.2 * R, R / 2]), np.array([tilt[0], 0.0, tilt[1]])
    row = Locator.empty()
    Locator(mesh, "wrench_axis", friction=2.0)(np.concatenate([force, np.cross(point, force)]), row)
    found = ContactEstimate.from_rows(row)
    np.testing.assert_allclose(found.point, point, atol=1e-9)
    np.testing.assert_allclose(found.normal, [1, 0, 0] if tilt[0] < tilt[1] else [0, 0, 1], atol=1e-9)


@pytest.mark.parametrize("count", [0, 1, 2, 16, 17, 40])
def test_of_more_places_than_are_kept_the_nearest_to_the_force_stay(count: int) -> None:
    """A tower of small plates, each tilted otherwise, so that none covers another, on the axis of the force."""
    rng, tilts = np.random.default_rng(count), np.linspace(0.2, 1.1, max(count, 1))
    rng.shuffle(tilts)
    ways, heights = rng.uniform(0, 2 * np.pi, len(tilts)), 10.0 * R * np.arange(len(tilts))
    normals = np.stack([np.sin(tilts) * np.cos(ways), np.sin(tilts) * np.sin(ways), np.cos(tilts)], axis=1)
    plates = [plane((0.0, 0.0, z), normal, R) for z, normal in zip(heights, normals, strict=True)]
    faces = [plate.faces + 4 * k for k, plate in enumerate(plates)]
    body = Mesh.from_arrays(np.concatenate([plate.vertices for plate in plates]), np.concatenate(faces), smooth=False)
    away = np.array([0.0, 0.0, 0.0] if count else [3.0 * R, 0.0, 0.0])  # m: of the axis from the tower
    force = np.array([0.0, 0.0, -5.0])
    wrench, kept = np.concatenate([force, np.cross(away, force)]), np.sort(tilts)[: min(count, 16)]
    locator = Locator(body, "wrench_axis", friction=0.8, noise=[1e-6] * 3 + [1e-9] * 3)
    found = locator.candidates(wrench)
    np.testing.assert_allclose(np.sort(found.friction), np.tan(kept), atol=1e-9)
    assert found.plausible.tolist() == sorted(np.tan(kept) <= 0.8, reverse=True)
    for plausible in (True, False):  # in order along the force, which presses from above
        along = -found.point[found.plausible == plausible, 2]
        assert (np.diff(along) > 0.0).all()
    answer = locator.run(wrench)
    within = int(np.sum(np.tan(kept) <= 0.8))
    assert int(answer.candidates) == within
    status = Status.OFF_SURFACE if not count else Status.CONTACT if within == 1 else Status.AMBIGUOUS
    assert answer.status == status
