"""Touches are the stretches in which a contact was answered, whatever the blocks in which it comes."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.events import Events
from palpate.contact.touch_finder import TouchFinder
from palpate.contact.touch_finder import find_touches as find

RATE = 1000.0


def find_touches(time: np.ndarray, estimate: ContactEstimate, **settings: float) -> Events:
    """Of a sensor with one contact at a time."""
    return find(Contacts.single(time, estimate), **settings)


def _estimate(status: np.ndarray, point: np.ndarray, force: np.ndarray, sigma: float = 1e-3) -> ContactEstimate:
    """Touches of a horizontal plane from above, with the same noise along x and y."""
    n = len(status)
    answered = status <= Status.AMBIGUOUS
    covariance = np.where(answered[:, None, None], sigma**2 * np.diag([1.0, 1.0, 0.0]), np.nan)
    return ContactEstimate(
        np.where(answered[:, None], point, np.nan),
        np.where(answered[:, None], [0.0, 0.0, 1.0], np.nan),
        force[:, None] * np.array([0.0, 0.0, -1.0]),
        np.zeros(n),
        covariance,
        np.zeros(n),
        np.ones(n, dtype=np.int64),
        status.astype(np.int8),
    )


def _session() -> tuple[np.ndarray, ContactEstimate]:
    """Two touches: 0.1-0.5 s at rest, interrupted for 30 ms; 1.0-2.0 s slides by 20 mm along x; and a flicker."""
    time = np.arange(2500) / RATE
    status = np.full(2500, Status.NO_CONTACT)
    status[100:501] = Status.CONTACT
    status[300:330] = Status.IMPLAUSIBLE
    status[700:710] = Status.CONTACT
    status[1000:2001] = Status.CONTACT
    status[1000:1100] = Status.AMBIGUOUS
    point = np.zeros((2500, 3))
    point[100:501] = [0.01, 0.02, 0.03]
    point[1000:2001, 0] = np.linspace(0, 0.02, 1001)
    force = np.zeros(2500)
    force[100:501] = 2.0
    force[1000:2001] = 1.0
    force[1500] = 7.0
    return time, _estimate(status, point, force)


def _assert_close(found: Events, known: Events) -> None:
    single = vars(known).keys() - {"features", "paths", "origins"}
    pairs = [(name, getattr(found, name), getattr(known, name)) for name in single]
    pairs += [(name, found.features[name], value) for name, value in known.features.items()]
    pairs += [("paths", one, other) for one, other in zip(found.paths, known.paths, strict=True)]
    for name, one, other in pairs:
        # sums in another order
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-15, err_msg=name)


def test_what_the_touches_were() -> None:
    found = find_touches(*_session())
    assert len(found) == 2
    np.testing.assert_allclose(found.start, [0.1, 1.0])
    np.testing.assert_allclose(found.end, [0.5, 2.0])
    # in the middle of the 0.1 s in which it peaks, to a step of 0.02 mm
    np.testing.assert_allclose(found.point, [[0.01, 0.02, 0.03], [0.011, 0, 0]], atol=2.1e-5)
    assert [len(path) for path in found.paths] == [5, 11]  # 0.1 to 0.5 s, 1.0 to 2.0 s
    np.testing.assert_allclose(found.paths[1][5], [1.55, 0.011, 0.0, 0.0], atol=1.1e-3)
    np.testing.assert_allclose(found[1].path[10], [2.0, 0.02, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(found.normal, [[0, 0, 1], [0, 0, 1]])
    assert found.peak_force.tolist() == [2.0, 7.0]
    assert found.peak_time[1] == 1.5
    np.testing.assert_allclose(found.mean_force, [2.0, (1000 + 7) / 1001])
    assert found.samples.tolist() == [371, 1001]
    np.testing.assert_allclose(found.ambiguous, [0, 100 / 1001])
    # between the middles of the first and the last window of 0.1 s (the one sample after it weighs too little), which
    # rounding may move by a sample of 0.02 mm
    np.testing.assert_allclose(found.slid, [0, 0.018], atol=2e-5)


def test_the_place_is_as_sure_as_its_sample() -> None:
    found = find_touches(*_session())
    np.testing.assert_allclose(found.deviation, 1e-3)
    np.testing.assert_allclose(found.covariance[0], 1e-6 * np.diag([1, 1, 0]), atol=1e-20)


def test_gap_and_shortest() -> None:
    session = _session()
    assert find_touches(*session, gap=0.02).start == pytest.approx([0.1, 0.33, 1.0])
    assert find_touches(*session, shortest=0.0).start == pytest.approx([0.1, 0.7, 1.0])
    assert find_touches(*session, gap=0.25).end == pytest.approx([0.709, 2.0])
    assert len(find_touches(*session, shortest=5.0)) == 0


def test_samples_that_are_further_apart_than_the_gap_are_one_touch_where_none_is_missing() -> None:
    time = np.arange(40) / 10  # 10 Hz
    status = np.full(40, Status.CONTACT)
    status[20] = Status.NO_CONTACT
    found = find_touches(time, _estimate(status, np.zeros((40, 3)), np.ones(40)))
    assert found.start == pytest.approx([0, 2.1])
    assert found.end == pytest.approx([1.9, 3.9])


def test_a_gap_in_the_log_ends_a_touch_and_times_that_are_missing_do_not() -> None:
    time = np.arange(2000) / RATE
    time[1000:] += 60
    time[500:520] = np.nan
    found = find_touches(time, _estimate(np.full(2000, Status.CONTACT), np.zeros((2000, 3)), np.ones(2000)))
    assert found.start == pytest.approx([0, 61])
    assert found.samples.tolist() == [980, 1000]


@pytest.mark.parametrize("free", [1, 2])
def test_presses_with_a_free_frame_between_them_are_touches_of_their_own(free: int) -> None:
    """48 presses at one place, of six frames each at 30 Hz."""
    frames = np.arange(48 * (6 + free))
    pressed = frames % (6 + free) < 6
    status = np.where(pressed, Status.CONTACT, Status.NO_CONTACT)
    assert len(find_touches(frames / 30.0, _estimate(status, np.zeros((len(frames), 3)), 1.0 * pressed))) == 48


def _jumping(*places: tuple[int, float], status: Status = Status.CONTACT) -> Events:
    """Samples of one contact at places along x [m], as many as stated at each, with 0.1 mm of noise."""
    x = np.concatenate([np.full(count, place) for count, place in places])
    point = np.zeros((len(x), 3))
    point[:, 0] = x + 1e-4 * np.random.default_rng(0).normal(size=len(x))
    return find_touches(np.arange(len(x)) / RATE, _estimate(np.full(len(x), status), point, np.ones(len(x)), 1e-4))


def test_a_point_that_jumps_is_of_another_touch() -> None:
    found = _jumping((200, 0.0), (200, 0.01), (200, 0.02))
    assert found.samples.tolist() == [200, 200, 200]
    np.testing.assert_allclose(found.point[:, 0], [0.0, 0.01, 0.02], atol=5e-4)
    assert len(_jumping((200, 0.0), (200, 0.01), status=Status.AMBIGUOUS)) == 1


def test_a_point_that_slides_or_is_unknown_is_of_one_touch() -> None:
    slide = _jumping(*((1, 0.0004 * k) for k in range(300)))  # 0.4 m/s
    assert len(slide) == 1
    assert slide.slid[0] == pytest.approx(0.08, rel=0.1)  # from one mean over 0.1 s to the next but one
    point = np.zeros((300, 3))
    point[100:, 0] = 0.1
    estimate = _estimate(np.full(300, Status.CONTACT), point, np.ones(300))
    unknown = replace(estimate, covariance=np.full((300, 3, 3), np.nan))
    found = find_touches(np.arange(300) / RATE, unknown)
    assert len(found) == 1
    assert np.isnan(found.deviation).all()


def test_a_point_that_is_back_at_once_has_not_left() -> None:
    found = _jumping((100, 0.0), (1, 0.02), (100, 0.0), (10, 0.02), (5, 0.04), (100, 0.02))
    assert found.samples.tolist() == [200, 110]


@pytest.mark.parametrize("turns", [0.0, 0.5, 3.0])
def test_a_slide_on_a_curved_body_is_placed_on_it(turns: float) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi * turns, 4000)
    point = 0.02 * np.stack([np.cos(angle), np.sin(angle), np.zeros(4000)], axis=1)
    force = 1.0 + np.sin(np.linspace(0, np.pi, 4000))
    found = find_touches(np.arange(4000) / RATE, _estimate(np.full(4000, Status.CONTACT), point, force))
    assert np.linalg.norm(found.point, axis=1) == pytest.approx(0.02)
    assert np.linalg.norm(found.paths[0][:, 1:], axis=1) == pytest.approx(np.full(40, 0.02))


@pytest.mark.parametrize("count", [0, 1, 50])
def test_without_contact_there_are_no_touches(count: int) -> None:
    estimate = _estimate(np.full(count, Status.NO_CONTACT), np.zeros((count, 3)), np.zeros(count))
    found = find(replace(Contacts.single(np.arange(count) / RATE, estimate), features={"cells": np.zeros(count)}))
    assert len(found) == 0
    assert {name: each.shape for name, each in found.features.items()} == ({"cells": (0,)} if count else {})
    assert found.covariance.shape == (0, 3, 3)
    assert found.deviation.shape == (0,)


def test_numbers_that_no_contact_has_are_left_out() -> None:
    """A damaged file may hold them; their sums and squares would overflow, which a warning would say."""
    time, estimate = _session()
    known = find_touches(time, estimate)
    rows = np.flatnonzero(estimate.answered)[[5, 9, 12]]
    wild = {name: np.array(getattr(estimate, name)) for name in ("point", "force", "covariance")}
    wild["point"][rows[0]], wild["force"][rows[1]], wild["covariance"][rows[2]] = 1e300, -np.inf, 1e300
    found = find_touches(time, replace(estimate, **wild))
    assert found.start.tolist() == known.start.tolist()
    assert found.samples.sum() == known.samples.sum() - 2
    for name in ("point", "peak_force", "covariance"):  # one sample of hundreds cannot move a mean of them far
        assert np.allclose(getattr(found, name), getattr(known, name), rtol=0.05, atol=1e-4)


def _two_at_once() -> Contacts:
    """Two touches at once, of 1 N and 2 N, 0.1 to 0.5 s and 0.2 to 0.6 s, with the row of a sheet that each is felt in.

    The second is felt in row 3, then 5, for as long each; a sample without a contact has a row that says so.
    """
    rows: list[tuple[int, int, float, list[float], float]] = []
    for k in range(1000):
        first, second = 100 <= k < 500, 200 <= k < 600
        if first:
            rows.append((k, 7, 1.0, [0.01, 0.0, 0.0], 1.0))
        if second:
            rows.append((k, 9, 2.0, [0.0, 0.02, 0.0], 3.0 if k < 400 else 5.0))
        if not (first or second):
            rows.append((k, 0, 0.0, [np.nan] * 3, np.nan))
    sample, identity, force, point, row = (np.array(column) for column in zip(*rows, strict=True))
    estimate = _estimate(np.where(force > 0, Status.CONTACT, Status.NO_CONTACT), point, force)
    return Contacts(sample, sample / RATE, identity, estimate, {"row": row, "never": np.full(len(row), np.nan)})


def test_two_touches_at_once_are_two_events() -> None:
    found = find(_two_at_once())
    assert found.identity.tolist() == [7, 9]
    np.testing.assert_allclose(found.start, [0.1, 0.2])
    np.testing.assert_allclose(found.end, [0.499, 0.599])
    np.testing.assert_allclose(found.point, [[0.01, 0.0, 0.0], [0.0, 0.02, 0.0]], atol=1e-15)
    assert found.peak_force.tolist() == [1.0, 2.0]
    assert found.samples.tolist() == [400, 400]
    np.testing.assert_allclose(found.slid, 0.0, atol=1e-15)


def test_a_feature_is_that_of_the_largest_force() -> None:
    contacts = _two_at_once()
    stronger = contacts.estimate.force * np.where(contacts.time == 0.45, 2.0, 1.0)[:, None]
    features = find(replace(contacts, estimate=replace(contacts.estimate, force=stronger))).features
    np.testing.assert_allclose(features["row"], [1.0, 5.0])
    assert np.isnan(features["never"]).all()


def test_blocks_do_not_matter_for_several_either() -> None:
    """Nor that the blocks of the first 0.3 s do not have a feature, which is no number then."""
    contacts = _two_at_once()
    known = {**contacts.features, "row": np.where(contacts.time < 0.3, np.nan, contacts.features["row"])}
    finder = TouchFinder()
    for early in (True, False):
        part = contacts[(contacts.time < 0.3) == early]
        part = replace(part, features={"never": part.features["never"]}) if early else part
        for start in range(0, len(part), 17):
            finder.add(part[start : start + 17])
    _assert_close(finder.touches(), find(replace(contacts, features=known)))


def test_the_touches_of_each_identity_are_those_that_it_has_alone() -> None:
    contacts = _two_at_once()
    together = find(contacts)
    for k, identity in enumerate((7, 9)):
        alone = find(contacts[contacts.identity == identity])
        for name in ("start", "end", "point", "covariance", "mean_force", "samples", "slid"):
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(together, name)[k])
