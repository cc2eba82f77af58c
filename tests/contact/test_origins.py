"""Contacts know their sensor and link: picked, joined, written and read, and as touches."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.events import Events
from palpate.contact.origins import EXPECTED, Origin, Origins
from palpate.errors import InputError

AMONG = (Origin("wrist", "hand"), Origin("palm", "hand"), Origin("belly", "torso"))
NAMES = st.sampled_from([*AMONG, Origin(), Origin("wrist", "arm"), Origin("größe", "link 0")])


def drawn(count: int, seed: int = 0, among: tuple[Origin, ...] = AMONG) -> Contacts:
    """Random rows at 100 Hz, of all sensors in turn, a third of which are no contacts and have no point."""
    rng = np.random.default_rng([count, seed])
    status = rng.choice([Status.CONTACT, Status.AMBIGUOUS, Status.NO_CONTACT], count).astype(np.int8)
    none = status == Status.NO_CONTACT
    point, normal, force = rng.normal(size=(3, count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    half = rng.normal(size=(count, 3, 3))
    covariance = half @ half.transpose(0, 2, 1)
    torque, candidates = rng.normal(size=count), rng.integers(1, 4, count)
    for each in (point, normal, covariance, torque):
        each[none] = np.nan
    candidates[none] = 0
    residual = np.full(count, np.nan)  # which files do not have
    estimate = ContactEstimate(point, normal, force, torque, covariance, residual, candidates, status)
    features = {"area": np.where(none, np.nan, rng.random(count))}
    row = np.arange(count, dtype=np.int64)
    origins = Origins(row % len(among), among) if count else Origins(row, ())
    return Contacts(row // len(among), 0.01 * (row // len(among)), row % 7, estimate, features, origins=origins)


def assert_equal(found: Contacts, wanted: Contacts) -> None:
    np.testing.assert_array_equal(found.rows(), wanted.rows())
    for name in ("sample", "time", "sensor", "link"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
    assert list(found.features) == list(wanted.features)


@given(st.lists(st.lists(NAMES, max_size=6), min_size=1, max_size=4))
def test_origins_joined_are_the_names_one_after_the_other(parts: list[list[Origin]]) -> None:
    made = [Origins.of_names([each.sensor for each in part], [each.link for each in part]) for part in parts]
    joined, names = Origins.joined(made), [each for part in parts for each in part]
    assert list(zip(joined.sensor, joined.link, strict=True)) == names
    assert len(set(joined.among)) == len(joined.among)
    for sensor in {each.sensor for each in names}:
        np.testing.assert_array_equal(joined.rows_of(sensor), [each.sensor == sensor for each in names])


def test_what_is_no_origin_is_refused() -> None:
    with pytest.raises(InputError, match="from 0 to 2"):
        Origins(np.array([0, 3]), AMONG)
    with pytest.raises(InputError, match="from 0 to 2"):
        Origins(np.array([-1]), AMONG)
    with pytest.raises(InputError, match="links must be 2 names"):
        Origins.of_names(["a", "b"], ["c"])
    with pytest.raises(InputError, match=r"no sensor 'foot' .* wrist, palm, belly"):
        drawn(6).of("foot")
    with pytest.raises(InputError, match="at least one"):
        Origins.joined([])
    with pytest.raises(InputError, match="origins' index"):
        replace(drawn(6), origins=Origins(np.zeros(5, np.int64), AMONG))


def test_rows_of_one_sensor_are_its_rows_in_order() -> None:
    found = drawn(60)
    for k, origin in enumerate(AMONG):
        own = found.of(origin.sensor)
        rows: np.ndarray = np.flatnonzero(np.arange(60) % 3 == k)
        assert_equal(own, found[rows])
        assert set(own.sensor) == {origin.sensor}
        assert set(own.link) == {origin.link}
        assert len(own.strongest()) == len(own)


def test_each_sensor_counts_its_samples_itself() -> None:
    found = drawn(60)
    rows = found.strongest()
    assert len(rows) == 60
    assert "60 rows," in repr(found)


def test_contacts_of_no_robot_have_blank_names_and_join_robots() -> None:
    robot, alone = drawn(9), replace(drawn(4, 1), origins=None)
    assert list(alone.sensor) == [""] * 4
    assert_equal(alone.of(""), replace(alone, origins=None))
    joined = Contacts.joined([alone, robot, drawn(0)])
    assert list(joined.sensor) == [""] * 4 + list(robot.sensor)
    assert Contacts.joined([alone, alone]).origins is None
    assert_equal(joined.of("palm"), robot.of("palm"))


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mcap"])
@pytest.mark.parametrize("count", [0, 1, 300])
def test_files_keep_sensor_and_link_and_every_bit(tmp_path: Path, suffix: str, count: int) -> None:
    wanted, path = drawn(count), tmp_path / f"contacts.{suffix}"
    wanted.save(path)
    found = Contacts.load(path)
    if count:
        assert_equal(found, wanted)
        assert_equal(found.of(AMONG[0].sensor), wanted.of(AMONG[0].sensor))
    assert len(found) == count


def _touched(among: tuple[Origin, ...], expected: tuple[float, ...]) -> Contacts:
    """One second of contact of each sensor with itself as identity, at its own place, all at once."""
    found = drawn(100 * len(among), among=among)
    index = np.arange(len(found)) % len(among)
    place = np.column_stack([index, np.zeros((len(found), 2))]).astype(float)
    kept = {name: getattr(found.estimate, name) for name in ("normal", "force", "covariance")}
    kept = {name: np.where(np.isnan(value), 1.0, value) for name, value in kept.items()}
    status = np.full(len(found), Status.CONTACT, dtype=np.int8)
    features = {EXPECTED: np.array(expected)[index]}
    return replace(
        found,
        identity=np.zeros(len(found), np.int64),
        estimate=replace(found.estimate, point=place, status=status, **kept),
        features=features,
    )


def test_touches_of_sensors_are_apart_although_their_identities_are_one() -> None:
    found = _touched(AMONG, (0.0, 0.0, 0.0))
    touches = found.touches()
    assert sorted(zip(touches.sensor, touches.link, strict=True)) == sorted(AMONG)
    for touch in (touches[k] for k in range(3)):
        own = found.of(touch.sensor).touches()
        np.testing.assert_array_equal(touch.point, own.point[0])
        np.testing.assert_array_equal(touch.point[0], [each.sensor for each in AMONG].index(touch.sensor))
        assert touch.samples == own.samples[0] == 100


def test_expected_contacts_are_no_touches() -> None:
    assert set(_touched(AMONG, (1.0, 0.0, 1.0)).touches().sensor) == {"palm"}
    none = _touched(AMONG, (1.0, 1.0, 1.0)).touches()
    assert len(none) == 0


def test_touches_join_in_the_order_in_which_they_began() -> None:
    first, second = _touched(AMONG[:1], (0.0,)).touches(), _touched(AMONG[1:2], (0.0,)).touches()
    later = replace(first, start=first.start + 0.5, origins=first.origins)
    joined = Events.joined([later, second])
    assert list(joined.sensor) == ["palm", "wrist"]
    assert list(joined.start) == [second.start[0], later.start[0]]
    with pytest.raises(InputError, match="at least one"):
        Events.joined([])
