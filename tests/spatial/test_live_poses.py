"""Poses that come beside samples: interpolated, extrapolated, held or missing, and honest about their age."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytransform3d import rotations as pr
from pytransform3d import transformations as pt
from pytransform3d.transform_manager import TransformManager
from scipy.spatial.transform import Rotation

from claims.evidence.robot import transform
from palpate.files.messages import MessageBlock
from palpate.live.poses import LivePoses
from palpate.spatial.live_track import LiveTrack
from tests.support.given_source import block
from tests.support.ros_kinds import TYPES, packed, packed_tree

SECOND = 10**9
START = 1_700_000_000 * SECOND  # doubles of seconds since 1970 would be good to 2e-7 s only
WAY = (("world", "base"), ("base", "arm"), ("arm", "hand"), ("stand", "world"), ("stand", "ft"))


def _tree(
    name: str, rows: list[tuple[int, str, str, np.ndarray, np.ndarray]], sent: int | np.ndarray = START
) -> MessageBlock:
    """One message a row: stamp [ns], parent, child, position, quaternion x, y, z, w; and when it was sent."""
    return block(name, "tf2_msgs/TFMessage", [packed_tree(transform(*row)) for row in rows], sent)


def _between(
    stamps: np.ndarray, quaternion: np.ndarray, position: np.ndarray, at: int
) -> tuple[np.ndarray, np.ndarray]:
    """Position, and quaternion w, x, y, z, of one edge by pytransform3d."""
    k = min(int(np.searchsorted(stamps, at, side="right")) - 1, len(stamps) - 2)
    share = float(at - stamps[k]) / float(stamps[k + 1] - stamps[k])
    first, second = (pr.quaternion_wxyz_from_xyzw(quaternion[k + j]) for j in (0, 1))
    turned = pr.quaternion_slerp(first, second, share, shortest_path=True)
    return (1 - share) * position[k] + share * position[k + 1], turned


@pytest.mark.parametrize("seed", range(3))
def test_the_tree_is_that_of_pytransform3d(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = LivePoses(("arm", "ft"), max_gap=1.0)
    tracks: dict[tuple[str, str], tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    for edge in WAY:
        still = edge == ("base", "arm")
        count = 1 if still else 12
        stamps = np.array([START]) if still else np.linspace(START, START + 2 * SECOND, count).astype(np.int64)
        tracks[edge] = (stamps, Rotation.random(count, rng=rng).as_quat(), rng.normal(size=(count, 3)))
        rows = [(int(stamp), *edge, p, q) for stamp, q, p in zip(*tracks[edge], strict=True)]
        for start in range(0, count, 5):  # piece by piece, as they come
            poses.add(_tree("/tf_static" if still else "/tf", rows[start : start + 5]))
    asked = START + rng.integers(0, 2 * SECOND, 40)
    found = poses.at(asked)
    assert np.array_equal(found.age, np.zeros(40))
    for k, at in enumerate(asked.tolist()):
        oracle = TransformManager()
        for (parent, child), (stamps, quaternion, position) in tracks.items():
            where, turned = (
                (position[0], pr.quaternion_wxyz_from_xyzw(quaternion[0]))
                if len(stamps) == 1
                else _between(stamps, quaternion, position, at)
            )
            oracle.add_transform(child, parent, pt.transform_from_pq(np.hstack([where, turned])))
        known = oracle.get_transform("ft", "arm")
        assert np.abs(Rotation.from_quat(found.quaternion[k]).as_matrix() - known[:3, :3]).max() <= 1e-12
        assert np.abs(found.position[k] - known[:3, 3]).max() <= 1e-12
    assert poses.events() == ["the sensor's pose is taken from arm -> base -> world -> stand -> ft in the tree of /tf"]


@given(
    speed=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    velocity=st.tuples(*[st.floats(-2.0, 2.0)] * 3),
    age=st.floats(1e-6, 0.2499),
    rate=st.sampled_from([20.0, 100.0, 1000.0]),
)
def test_a_steady_motion_goes_on(
    speed: tuple[float, ...], velocity: tuple[float, ...], age: float, rate: float
) -> None:
    times = np.arange(60) / rate
    start = Rotation.from_rotvec([0.3, -0.2, 0.9])

    def truth(time: np.ndarray) -> Rotation:
        return Rotation.from_rotvec(np.outer(time, speed)) * start

    track, held = LiveTrack(), LiveTrack(hold=True)
    for each in (track, held):
        each.add(times, truth(times).as_quat(), np.outer(times, velocity))
    asked = times[-1:] + age
    quaternion, position = track.at(asked)
    assert (Rotation.from_quat(quaternion) * truth(asked).inv()).magnitude().item() <= 1e-9
    assert np.allclose(position, np.outer(asked, velocity), atol=1e-9)
    older, turned = track.lag(asked)
    assert older.item() == pytest.approx(age, abs=1e-12)
    assert turned.item() <= 1e-6  # nothing unsteady was seen
    assert np.array_equal(held.at(asked)[0][0], truth(times).as_quat()[-1])
    assert held.lag(asked)[1].item() == pytest.approx(np.linalg.norm(speed) * age, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize(("rate", "age"), [(50.0, 0.02), (100.0, 0.01), (100.0, 0.05), (1000.0, 0.02)])
def test_what_it_may_have_turned_is_what_it_has(rate: float, age: float, hold: bool) -> None:
    missed, said = np.zeros((2, 80))
    for trial in range(80):
        rng = np.random.default_rng(trial)
        frequency, phase = rng.uniform(0.1, 1.5, (3, 4, 1)), rng.uniform(0, 2 * np.pi, (3, 4, 1))
        times = np.append(np.arange(200) / rate, 199 / rate + age)
        waves = 0.2 * np.sin(2 * np.pi * frequency * times + phase)
        truth = Rotation.from_rotvec(waves.sum(axis=1).T)
        seen = Rotation.from_rotvec(rng.normal(0.0, 1e-4, (200, 3))) * truth[:200]
        track = LiveTrack(hold=hold)
        track.add(times[:200], seen.as_quat())
        missed[trial] = (Rotation.from_quat(track.at(times[200:])[0]) * truth[200].inv()).magnitude().item()
        said[trial] = track.lag(times[200:])[1].item()
    assert 0.75 <= np.sqrt(np.mean(missed**2) / np.mean(said**2)) <= 1.25  # 80 motions: 8 % by chance


def test_what_is_too_old_or_not_known_has_no_answer() -> None:
    track = LiveTrack(max_gap=0.1)
    one = np.array([[0.0, 0.0, 0.0, 1.0]])
    assert np.isnan(track.at(np.array([0.0]))[0]).all()
    track.add(np.array([1.0]), one)
    assert np.isnan(track.at(np.array([1.01]))[0]).all()  # a velocity needs two
    track.add(np.array([1.02]), one)
    assert track.at(np.array([1.03, 1.12, 1.13]))[0][:, 3].tolist() == pytest.approx([1.0, 1.0, np.nan], nan_ok=True)
    assert np.isnan(track.lag(np.array([1.03]))[1]).all()  # and how unsteady it is, three
    assert track.lag(np.array([1.01]))[1].tolist() == [0.0]
    track.add(np.array([0.5]), one)
    assert (track.late, track.restarts) == (1, 0)
    track.add(np.array([-5.0, -4.99]), np.repeat(one, 2, axis=0))
    assert track.restarts == 1
    assert track.at(np.array([-4.98]))[0][0].tolist() == [0.0, 0.0, 0.0, 1.0]


def test_what_is_wrong_with_poses_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.live.poses.SILENT", -1.0)
    up = np.array([0.0, 0.0, 0.0, 1.0])
    poses, asked = LivePoses(("base", "ft")), np.array([START])
    assert np.isnan(poses.at(asked).age).all()
    assert poses.events() == ["there are no poses yet: the sensor's orientation is not known"]
    poses = LivePoses(("base", "ft"))
    fixed = LivePoses(("base", "ft"))
    fixed.add(_tree("/tf_static", [(0, "base", "ft", np.ones(3), up)]))
    assert [part.ravel().tolist() for part in fixed.at(asked)] == [up.tolist(), [1.0, 1.0, 1.0], [0.0], [0.0]]
    poses.add(_tree("/tf", [(START, "base", "hand", np.zeros(3), up)]))
    poses.at(asked)
    assert [said.startswith("there is no frame 'ft'. Use one of the 2 frames") for said in poses.events()] == [True]
    poses.add(_tree("/tf_static", [(0, "hand", "ft", np.ones(3), up)]))
    assert poses.at(asked).position.tolist() == [[1.0, 1.0, 1.0]]
    said = poses.events()
    assert said == ["the sensor's pose is taken from base -> hand -> ft in the tree of /tf", "samples have poses again"]
    poses.at(asked + 3 * SECOND)
    assert poses.events() == ["the newest pose is 3 s older than the samples: the sensor's orientation is not known"]
    poses.add(_tree("/tf", [(START - 60 * SECOND, "base", "hand", np.zeros(3), up)]))
    assert poses.events() == ["the clock of the poses of 'hand' in 'base' went back; earlier poses are discarded"]


def test_poses_without_stamps_are_of_when_they_were_sent() -> None:
    kind = "geometry_msgs/Pose"
    turn, point = TYPES["geometry_msgs/msg/Quaternion"], TYPES["geometry_msgs/msg/Point"]
    raw = packed(kind, TYPES["geometry_msgs/msg/Pose"](point(1.0, 2.0, 3.0), turn(0.0, 0.0, 0.0, 1.0)))
    poses = LivePoses()
    poses.add(block("/pose", kind, [raw], START))
    found = poses.at(np.array([START]))
    assert found.position.tolist() == [[1.0, 2.0, 3.0]]
    poses.add(block("/pose", kind, [raw[:40]], START + 1))
    assert poses.events() == ["some messages of poses are incomplete or of another type, and are ignored"]


NOWHERE, STRAIGHT = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize("oldest", ["first", "last"])
def test_the_oldest_edge_has_the_age_and_what_edges_may_have_turned_adds_as_squares(oldest: str) -> None:
    """Edges that turn about z, faster and faster, the newest of them 20 and 50 ms before the sample."""
    poses, squares = LivePoses(("a", "c")), 0.0
    ages = [50, 20] if oldest == "first" else [20, 50]  # ms
    for (parent, child), speed, age in zip((("a", "b"), ("b", "c")), (1.0, 2.0), ages, strict=True):
        ms = np.arange(-400, -age + 1, 10)
        turned = Rotation.from_rotvec(np.outer((1e-3 * ms) ** 2 * speed, [0.0, 0.0, 1.0])).as_quat()
        alone = LiveTrack()
        alone.add((ms + 400) / 1e3, turned, np.zeros((len(ms), 3)))
        squares += alone.lag(np.full(1, 0.4))[1].item() ** 2
        rows = [(START + int(each) * 10**6, parent, child, NOWHERE, q) for each, q in zip(ms, turned, strict=True)]
        poses.add(_tree("/tf", rows))
    found = poses.at(np.array([START]))
    assert found.age[0] == pytest.approx(0.05)
    assert squares > 1e-8
    assert found.turned[0] ** 2 == pytest.approx(squares, rel=1e-6)


def test_transforms_without_stamps_are_of_when_they_were_sent() -> None:
    poses, sent = LivePoses(("a", "b")), START + np.array([0, 10**7])
    poses.add(_tree("/tf", [(0, "a", "b", np.array([x, 0.0, 0.0]), STRAIGHT) for x in (1.0, 2.0)], sent))
    assert poses.at(np.array([START + 5 * 10**6])).position[0] == pytest.approx([1.5, 0.0, 0.0])


def test_a_fixed_transform_does_not_take_the_place_of_one_that_moves() -> None:
    poses = LivePoses(("a", "b"))
    stamps = START + 10**7 * np.arange(3)
    poses.add(_tree("/tf", [(int(stamp), "a", "b", np.ones(3), STRAIGHT) for stamp in stamps]))
    poses.add(_tree("/tf_static", [(START, "a", "b", NOWHERE, STRAIGHT)]))
    assert poses.at(stamps[1:2]).position[0] == pytest.approx(np.ones(3))


def test_a_fixed_transform_without_a_direction_is_none() -> None:
    poses = LivePoses(("a", "b"))
    poses.add(_tree("/tf_static", [(START, "a", "b", NOWHERE, np.zeros(4))]))
    assert np.isnan(poses.at(np.array([START])).quaternion).all()
    poses.add(_tree("/tf_static", [(START, "a", "b", NOWHERE, STRAIGHT)]))
    assert poses.at(np.array([START])).quaternion[0] == pytest.approx(STRAIGHT)


def test_the_rest_of_a_robot_does_not_matter() -> None:
    up = np.array([0.0, 0.0, 0.0, 1.0])
    poses = LivePoses(("base", "ft"))
    for k in range(20):
        at = START + k * 10**7
        moved = [("base", "hand"), ("hand", "ft"), ("hand", "finger"), ("base", "wheel")]
        poses.add(_tree("/tf", [(at, *edge, np.array([k * 0.01, 0.0, 0.0]), up) for edge in moved]))
        assert poses.at(np.array([at])).position[0].tolist() == pytest.approx([k * 0.02, 0.0, 0.0])
    assert [len(poses._edges[edge].stamps) for edge in moved] == [20, 20, 1, 1]
