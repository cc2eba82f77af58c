"""Frames of a tree: as pytransform3d composes them, between stamps as scipy turns them, and what is no tree is said."""

import numpy as np
import pytest
from pytransform3d.transform_manager import TransformManager
from pytransform3d.transformations import transform_from
from scipy.spatial.transform import Rotation, Slerp

from palpate.errors import InputError
from palpate.spatial.frames import FramePath, FrameTree
from palpate.spatial.pose import Pose, rotation_from_quaternion
from palpate.spatial.pose_track import PoseTrack

STAMPS = np.arange(20) / 10
FRAMES = ("map", "base", "shoulder", "elbow", "tool", "sensor", "camera", "eye")
PARENTS = (None, "map", "base", "shoulder", "elbow", "tool", "base", "camera")
MOVING = {"shoulder", "elbow", "tool", "eye"}


def _poses(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Quaternions and positions [m] of an edge at all stamps."""
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.3, (len(STAMPS), 3)), axis=0))
    return turns.as_quat(), rng.normal(size=(len(STAMPS), 3))


def _tree(
    seed: int, delays: dict[str, float] | None = None
) -> tuple[FrameTree, dict[str, tuple[np.ndarray, np.ndarray]]]:
    rng, tree, poses = np.random.default_rng(seed), FrameTree(), dict[str, tuple[np.ndarray, np.ndarray]]()
    for parent, child in zip(PARENTS, FRAMES, strict=True):
        if parent is None:
            continue
        quaternion, position = poses[child] = _poses(rng)
        if child in MOVING:
            track = PoseTrack()
            track.add(STAMPS + (delays or {}).get(child, 0.0), quaternion, position)
            tree.add(parent, child, track)
        else:
            tree.add(parent, child, Pose.from_quaternion(quaternion[0], position[0]))
    return tree, poses


def _matrices(path: FramePath, time: np.ndarray) -> np.ndarray:
    quaternion, position = path.at(time)
    made = np.tile(np.eye(4), (len(time), 1, 1))
    made[:, :3, :3], made[:, :3, 3] = rotation_from_quaternion(quaternion), position
    return made


@pytest.mark.parametrize("base", ["map", "base", "eye", "sensor"])
@pytest.mark.parametrize("sensor", ["sensor", "map", "elbow", "eye"])
def test_one_frame_in_another_is_as_pytransform3d_composes_it(base: str, sensor: str) -> None:
    """Positions of some metres over seven edges: rounding is 1e-15 of that."""
    tree, poses = _tree(0)
    found = _matrices(tree.path(base, sensor), STAMPS)
    for k in range(0, len(STAMPS), 4):
        manager = TransformManager()
        for parent, child in zip(PARENTS, FRAMES, strict=True):
            if parent is not None:
                quaternion, position = (each[k if child in MOVING else 0] for each in poses[child])
                made = transform_from(Rotation.from_quat(quaternion).as_matrix(), position)
                manager.add_transform(child, parent, made)
        assert np.abs(found[k] - manager.get_transform(sensor, base)).max() < 1e-12


def test_each_edge_is_interpolated_between_its_own_stamps() -> None:
    """Slerp and straight lines by scipy and numpy, each edge on its own clock and at its own rate, as matrices."""
    delays = {"elbow": 0.03, "tool": -0.04}
    tree, poses = _tree(1, delays)
    kept = {"shoulder": np.r_[0:20], "elbow": np.r_[0:20:3, 19], "tool": np.r_[0:20:2, 19], "sensor": np.r_[0:20]}
    for parent, child in (("shoulder", "elbow"), ("elbow", "tool")):  # three times and twice as rarely
        track, rows = PoseTrack(max_gap=1.0), kept[child]
        track.add(STAMPS[rows] + delays[child], poses[child][0][rows], poses[child][1][rows])
        tree.add(parent, child, track)
    time = np.random.default_rng(2).uniform(0.1, 1.8, 200)
    wanted = np.tile(np.eye(4), (len(time), 1, 1))
    for child in ("shoulder", "elbow", "tool", "sensor"):
        quaternion, position = (part[kept[child]] for part in poses[child])
        at, edge = time - delays.get(child, 0.0), np.tile(np.eye(4), (len(time), 1, 1))
        if child not in MOVING:
            at = np.zeros(len(time))
        edge[:, :3, :3] = Slerp(STAMPS[kept[child]], Rotation.from_quat(quaternion))(at).as_matrix()
        edge[:, :3, 3] = np.stack([np.interp(at, STAMPS[kept[child]], column) for column in position.T], axis=1)
        wanted = wanted @ edge
    path = tree.path("base", "sensor")
    assert np.abs(_matrices(path, time) - wanted).max() < 1e-12
    np.testing.assert_array_equal(path.stamps, STAMPS)  # of the one with the most
    asked = np.array([1.5, 1.85, 1.87, 1.95])  # the tool's last pose is at 1.86 s, that of the others later
    assert [each.answerable(asked) for each in (path, tree.path("tool", "sensor"))] == [2, 4]
    path.forget(1.8)
    found = np.isfinite(path.at(np.array([1.0, 1.85]))[1]).all(axis=1)
    assert found.tolist() == [False, True]
    assert all(track.stamps[0] > 1.0 for track in path.tracks)


def test_without_one_of_its_edges_a_pose_is_not_known() -> None:
    """A gap in one, before the first and after the last of another; the others go on."""
    tree, poses = _tree(4)
    gap = PoseTrack(max_gap=0.15)
    kept = np.r_[0:5, 7:20]
    gap.add(STAMPS[kept], poses["elbow"][0][kept], poses["elbow"][1][kept])
    tree.add("shoulder", "elbow", gap)
    path = tree.path("base", "sensor")
    time = np.array([-0.01, 0.0, 0.39, 0.41, 0.69, 0.71, 1.9, 1.91])
    assert np.isfinite(path.at(time)[0]).all(axis=1).tolist() == [False, True, True, False, False, True, True, False]
    assert np.isfinite(tree.path("base", "shoulder").at(time)[0]).all(axis=1)[3]
    assert path.answerable(np.array([0.5, 1.95, 0.2])) == 1
    path.complete()
    assert path.answerable(np.array([0.5, 1.95, 0.2])) == 3


def test_what_was_left_out_of_an_edge_is_said_with_its_frames() -> None:
    tree, poses = _tree(5)
    track = PoseTrack()
    track.add(STAMPS[[0, 1, 1, 2]], poses["tool"][0][:4] * [[1], [1], [1], [0]], poses["tool"][1][:4])
    tree.add("elbow", "tool", track)
    notes = tree.path("map", "sensor").notes()
    assert len(notes) == 2
    assert all(note.startswith("between frames elbow and tool: 1 poses ") for note in notes)


@pytest.mark.parametrize(
    ("edges", "word"),
    [
        ([("base", "arm"), ("arm", "ft_sensor")], "no frame 'sensor'.*3 frames.*nearest in name: ft_sensor"),
        ([("world", "base"), ("tool", "sensor")], "joins frame 'base' .tree of 'world'. and frame 'sensor'.*Name"),
        ([("base", "arm"), ("cart", "arm"), ("arm", "sensor")], "'arm' has 2 parents: base, cart.*Stop"),
        ([("base", "x"), ("a", "b"), ("b", "a"), ("b", "sensor")], "loop: b -> a -> b.*Remove"),
        ([("base", "x"), ("sensor", "sensor")], "loop: sensor -> sensor.*Remove"),
        ([], "no frame 'sensor'.*nearest in name: none"),
    ],
)
def test_what_is_no_tree_is_said(edges: list[tuple[str, str]], word: str) -> None:
    tree = FrameTree((parent, child, Pose.identity()) for parent, child in edges)
    with pytest.raises(InputError, match=word):
        tree.path("base", "sensor")


def test_what_is_wrong_above_the_base_does_not_matter() -> None:
    edges = [("a", "b"), ("b", "a"), ("a", "base"), ("other", "base"), ("base", "sensor")]
    tree = FrameTree((parent, child, Pose.identity()) for parent, child in edges)
    assert tree.path("base", "sensor").frames == ("base", "sensor")
    with pytest.raises(InputError, match=r"2 parents.*Stop"):
        tree.up("sensor")
