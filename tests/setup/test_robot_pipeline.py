"""Streams of contacts are merged in time; errors of a link's pose widen the contacts on it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate
from palpate.contact.origins import Origin, Origins
from palpate.errors import InputError
from palpate.setup.load import load_robot
from palpate.setup.robot_pipeline import RobotPipeline, merged, widened
from palpate.setup.robot_view import in_pictures, robot_scene
from palpate.viewer.film import ScenePicture
from tests.support.dice import agree, joint, mixed, rolled
from tests.support.robots import turning_arm

TIMES = st.sampled_from([0.0, 0.1, 0.1, 0.25, 0.5, 1.0, 2.0, np.nan])


def _stream(times: Sequence[float], place: int) -> Contacts:
    """Rows of sensor number `place`, whose samples count them."""
    count = len(times)
    origins = Origins(np.zeros(count, dtype=np.int64), (Origin(f"s{place}", "link"),))
    rows = np.arange(count, dtype=np.int64)
    return Contacts(rows, np.array(times, dtype=float), rows * 0, _blank(count), origins=origins)


def _blank(count: int) -> ContactEstimate:
    none = np.full((count, 3), np.nan)
    status, candidates = np.full(count, 2, dtype=np.int8), np.zeros(count, dtype=np.int64)
    return ContactEstimate(
        none, none, np.zeros((count, 3)), none[:, 0], np.full((count, 3, 3), np.nan), none[:, 0], candidates, status
    )


def _blocks(rows: Contacts, cuts: Sequence[int]) -> Iterator[Contacts]:
    for start, end in zip([0, *cuts], [*cuts, len(rows)], strict=True):
        yield rows[start:end]


def _by_hand(streams: list[list[float]]) -> list[tuple[int, int]]:
    """Sensor and row of each row in order: a stable sort by the latest time so far."""
    keyed = list[tuple[float, int, int]]()
    for place, times in enumerate(streams):
        latest = -np.inf
        for row, time in enumerate(times):
            latest = max(latest, time) if np.isfinite(time) else latest
            keyed.append((latest, place, row))
    return [(place, row) for _, place, row in sorted(keyed)]


@given(st.data(), st.lists(st.lists(TIMES, max_size=12), max_size=4), st.booleans())
def test_any_blocks_are_merged_as_one_sort(data: st.DataObject, streams: list[list[float]], rising: bool) -> None:
    """Times that are missing, repeat or go back, empty streams, and no stream at all."""
    if rising:
        streams = [sorted(times, key=lambda time: np.inf if np.isnan(time) else time) for times in streams]
    cut = [sorted(data.draw(st.lists(st.integers(0, len(times)), max_size=4))) for times in streams]
    rows = [_stream(times, place) for place, times in enumerate(streams)]
    found = list(merged([_blocks(each, cuts) for each, cuts in zip(rows, cut, strict=True)]))
    wanted = _by_hand(streams)
    got = [(int(name[1:]), int(row)) for part in found for name, row in zip(part.sensor, part.sample, strict=True)]
    assert got == wanted
    assert all(len(part) for part in found)
    for part in found:
        places = zip(part.sensor, part.sample, strict=True)
        times = [float(streams[int(name[1:])][int(row)]) for name, row in places]
        np.testing.assert_array_equal(part.time, np.array(times))


def test_no_block_waits_for_the_end_of_the_log() -> None:
    """Memory stays flat: after a second of both sensors, the first of its rows are out."""
    taken = list[int]()

    def blocks(place: int) -> Iterator[Contacts]:
        for k in range(10):
            taken.append(place)
            yield _stream([k + 0.1 * row for row in range(10)], place)

    first = next(merged([blocks(0), blocks(1)]))
    assert len(first)
    assert len(taken) <= 4


def _placed(rng: np.random.Generator, count: int) -> ContactEstimate:
    blank, half = _blank(count), rng.normal(scale=1e-4, size=(count, 3, 3))
    return replace(blank, point=rng.normal(size=(count, 3)), covariance=half @ half.transpose(0, 2, 1))


def test_widened_covariances_are_those_of_dice() -> None:
    """The link's pose is off by a small rotation about its origin and a shift, and the point in it is off too."""
    rng = np.random.default_rng(1)
    estimate, origins = _placed(rng, 2), np.array([[0.3, -0.2, 0.5], [-0.4, 0.1, 0.2]])
    poses = np.stack([mixed(np.repeat([1e-3, 5e-4], 3), seed) for seed in (1, 2)])
    stated = widened(estimate, origins, poses).covariance
    for point, own, origin, pose, found in zip(
        estimate.point, estimate.covariance, origins, poses, stated, strict=True
    ):

        def moved(off: np.ndarray, point: np.ndarray = point, origin: np.ndarray = origin) -> np.ndarray:
            return origin + off[3:6] + Rotation.from_rotvec(off[:3]).apply(point + off[6:] - origin)

        agree(found, rolled(moved, joint(pose, own)))


def test_a_pose_without_error_widens_nothing() -> None:
    rng = np.random.default_rng(2)
    estimate = _placed(rng, 5)
    same = widened(estimate, np.zeros((5, 3)), np.zeros((5, 6, 6)))
    np.testing.assert_array_equal(same.covariance, estimate.covariance)
    with pytest.raises(InputError, match="covariance"):
        widened(estimate, np.zeros((5, 3)), np.zeros((5, 3, 3)))


def test_a_film_shows_the_robot_where_it_is(tmp_path: Path) -> None:
    """Its grey pixels are as many before and after the turn, and elsewhere; compared contacts are drawn in green."""
    robot = turning_arm(tmp_path)
    pytest.importorskip("pinocchio")
    pytest.importorskip("cv2")
    rig, log = load_robot(robot / "robot.toml"), robot / "run.csv"
    scene, _ = robot_scene(rig, log)
    pictures = ScenePicture(scene)
    assert scene.layers[0]._rates == {"arm": pytest.approx(100.0)}

    def grey(seconds: float) -> np.ndarray:
        top = pictures.draw(seconds)[80:540].astype(int)
        return (np.ptp(top, axis=2) < 25) & (top.max(axis=2) < 230)

    before, after, later = grey(0.5), grey(2.5), grey(2.8)
    assert before.sum() > 3_000  # the box is 4,062 pixels as the upright camera sees it
    assert np.count_nonzero(before & ~after) > 0.2 * before.sum()
    assert np.count_nonzero(after != later) < 0.05 * before.sum()  # nothing moves then
    found = Contacts.joined(list(RobotPipeline(rig, log, "base").stream()))
    both = ScenePicture(scene.compared(in_pictures(found), "other"))
    blue, green, red = np.moveaxis(both.draw(3.3)[80:540].astype(int), 2, 0)
    assert np.count_nonzero((green - red > 60) & (green >= blue)) > 100
