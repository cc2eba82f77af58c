"""The tree of /tf and joint states give the sensor's pose, whatever the order, the clock or the damage of messages."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from claims.evidence import robot as bag
from claims.evidence.logs_written import wrench_stamped, write_mcap
from claims.evidence.robot import KINDS, ROS2, TYPES, WRENCH, Posture, transform, wrench, write_robot
from palpate.cli import main
from palpate.errors import InputError
from palpate.files.logs import LogLayout, read_poses, read_recording
from palpate.files.logs.joints import joint_positions
from palpate.files.logs.transforms import transforms
from palpate.files.messages import Topic
from palpate.setup import load_rig
from palpate.signals.recording import ORIENTATION, POSITION, Recording
from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation.session import Session, simulate_session
from palpate_lab.simulation.session_files import write_session
from tests.support.given_source import block

ROS1, OLD = get_typestore(Stores.ROS1_NOETIC), "tf/msg/tfMessage"
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", OLD))
TREE = LogLayout(wrench_topic=WRENCH, frames=("world", "ft_sensor"))


@pytest.fixture(scope="module")
def session() -> Session:
    return simulate_session(3, touches=4, facets=300)


@pytest.fixture(scope="module")
def robot(session: Session, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The session as a robot records it, its marks and truth, and what the README's commands make of it."""
    folder = tmp_path_factory.mktemp("robot")
    write_session(session, folder)
    write_robot(session, folder)
    bag.readme(folder)
    return folder


def _trees(rng: np.random.Generator, count: int, types: Any = TYPES) -> list[Any]:
    """Messages of any number of transforms between frames whose names have any length."""
    made: list[Any] = []
    for _ in range(count):
        each: list[Any] = []
        for _ in range(rng.integers(0, 6)):
            names = ["f" * int(size) for size in rng.integers(0, 20, 2)]
            numbers = [*rng.normal(size=7)]
            one = transform(int(rng.integers(1, 2**60)), names[0], names[1], numbers[:3], numbers[3:])
            each.append(one if types is TYPES else _in_ros1(one))
        made.append(types[OLD if types is ROS1.types else KINDS["/tf"]](each))
    return made


def _in_ros1(one: Any) -> Any:
    types, head = ROS1.types, one.header
    time = types["builtin_interfaces/msg/Time"](head.stamp.sec, head.stamp.nanosec)
    shift, turn = one.transform.translation, one.transform.rotation
    inside = types["geometry_msgs/msg/Transform"](
        types["geometry_msgs/msg/Vector3"](shift.x, shift.y, shift.z),
        types["geometry_msgs/msg/Quaternion"](turn.x, turn.y, turn.z, turn.w),
    )
    header = types["std_msgs/msg/Header"](7, time, head.frame_id)
    return types["geometry_msgs/msg/TransformStamped"](header, one.child_frame_id, inside)


def _rows(messages: list[Any]) -> list[tuple[Any, ...]]:
    return [
        (
            k,
            each.header.frame_id,
            each.child_frame_id,
            each.header.stamp.sec * 10**9 + each.header.stamp.nanosec,
            *(getattr(each.transform.translation, axis) for axis in "xyz"),
            *(getattr(each.transform.rotation, axis) for axis in "xyzw"),
        )
        for k, message in enumerate(messages)
        for each in message.transforms
    ]


@pytest.mark.parametrize("encoding", ["cdr", "cdr, big endian", "ros1"])
def test_transforms_are_read_as_rosbags_wrote_them(encoding: str) -> None:
    kind, store = (OLD, ROS1) if encoding == "ros1" else (KINDS["/tf"], ROS2)
    messages = _trees(np.random.default_rng(0), 60, store.types)
    raws = [
        bytes(
            ROS1.serialize_ros1(m, kind)
            if store is ROS1
            else ROS2.serialize_cdr(m, kind, little_endian="big" not in encoding)
        )
        for m in messages
    ]
    names = dict[str, int]()
    found, sound = transforms(
        block("", "", raws), Topic("/tf", kind.replace("/msg/", "/"), encoding[:4].strip(",")), names
    )
    called = list(names)
    rows = zip(found.message, found.parent, found.child, found.stamp, found.values.tolist(), strict=True)
    assert sound.all()
    assert [(m, called[p], called[c], s, *v) for m, p, c, s, v in rows] == _rows(messages)


def test_messages_that_are_cut_or_damaged_change_no_other() -> None:
    """Every cut of one message and 1,000 with two changed bytes, each behind a whole one: no exception, those stay."""
    rng = np.random.default_rng(1)
    states = [bag.joints(k, rng.normal(size=3)) for k in (1, 2)]
    for kind, messages in {"tf2_msgs/TFMessage": _trees(rng, 2), "sensor_msgs/JointState": states}.items():
        whole, other = (bytes(ROS2.serialize_cdr(m, kind.replace("/", "/msg/"))) for m in messages)
        damaged = [other[:kept] for kept in range(len(other))]
        for _ in range(1000):
            raw = np.frombuffer(other, dtype=np.uint8).copy()
            raw[rng.integers(len(raw), size=2)] = rng.integers(256, size=2)
            damaged.append(raw.tobytes())
        found, sound = _read(kind, [each for raw in damaged for each in (whole, raw)])
        assert sound[::2].all()
        assert found[::2] == _read(kind, [whole])[0] * len(damaged)
        behind = 0 if "tf2" in kind else 2 * (4 + 4 + 4 * 8)  # bytes of velocities and efforts, which are not read
        assert not sound[1 : 2 * (len(other) - behind) : 2].any()


def _read(kind: str, raws: list[bytes]) -> tuple[list[list[Any]], np.ndarray]:
    """What is read of each message."""
    if "Joint" in kind:
        wanted = ("shoulder_joint", "elbow_joint", "flange_joint")
        stamp, values, sound, _ = joint_positions(block("", "", raws), Topic("", kind, "cdr"), wanted)
        return [[s, *row] for s, row in zip(stamp.tolist(), values.tolist(), strict=True)], sound
    names = dict[str, int]()
    found, sound = transforms(block("", "", raws), Topic("", kind, "cdr"), names)
    called = list(names)
    rows = [
        [
            (called[found.parent[k]], called[found.child[k]], *found.values[k])
            for k in np.flatnonzero(found.message == m)
        ]
        for m in range(len(raws))
    ]
    return rows, sound


def test_a_robots_bag_gives_the_sensors_pose(robot: Path, session: Session) -> None:
    recording = read_recording(robot / "touches", TREE)
    assert bag.apart(recording, session.touches) < 1e-12
    assert len(recording) == len(session.touches)
    assert "world -> base_link -> shoulder -> elbow -> flange -> ft_sensor in the tree of /tf" in recording.notes[0]


def test_joint_states_give_the_same_pose(robot: Path, session: Session) -> None:
    layout = LogLayout(wrench_topic=WRENCH, frames=("world", "ft_sensor"), urdf=robot / "robot.urdf")
    recording, at = read_recording(robot / "touches", layout), slice(0, None, bag.EVERY)
    assert bag.apart(recording, session.touches) < 1e-12
    time, quaternion, _ = read_poses(robot / "touches", layout)
    assert np.array_equal(quaternion, recording.channels[ORIENTATION][at])
    assert np.array_equal(time, recording.time[at])


def test_the_pose_does_not_depend_on_the_file(robot: Path, session: Session, tmp_path: Path) -> None:
    """A database and small chunks of MCAP, to the last bit; and the poses alone."""
    path = tmp_path / "log.mcap"
    start = session.touches.picked(slice(800))
    write_mcap(path, sorted(bag.messages(start), key=lambda each: each[0]), KINDS, chunk_size=20_000)
    one, other = read_recording(robot / "touches", TREE).picked(slice(800)), read_recording(path, TREE)
    for channel in (ORIENTATION, POSITION):  # the last sample lies behind the last transform of the short log
        assert np.array_equal(one.channels[channel][:-1], other.channels[channel][:-1])
    time, quaternion, _ = read_poses(path, TREE)
    assert np.array_equal(quaternion, other.channels[ORIENTATION][:: bag.EVERY])
    assert np.array_equal(time, other.time[:: bag.EVERY])


Step = tuple[int, list[Any]]  # stamp [ns] of recording, transforms


def _log(path: Path, moving: list[Step], still: list[Any] | None = None, count: int = 11, frame: str = "tool") -> Path:
    """Wrenches at 0, 0.1, ... s, and what is said of /tf and /tf_static, in an MCAP file."""
    messages = [(10**8 * k, WRENCH, wrench(10**8 * k, [k] * 6, frame)) for k in range(count)]
    messages += [(stamp, "/tf", TYPES["tf2_msgs/msg/TFMessage"](each)) for stamp, each in moving]
    if still is not None:
        messages.append((5, "/tf_static", TYPES["tf2_msgs/msg/TFMessage"](still)))
    kinds = {name: KINDS[name] for name in (WRENCH, "/tf", "/tf_static")}
    write_mcap(path, sorted(messages, key=lambda each: each[0]), kinds)
    return path


def _moved(stamp: int, at: float, *, parent: str = "base", child: str = "tool", said: int | None = None) -> Step:
    """A transform along x; its header says another stamp where one is given."""
    return stamp, [transform(stamp if said is None else said, parent, child, (at, 0, 0))]


def _read_x(path: Path, layout: LogLayout | None = None) -> tuple[np.ndarray, Recording]:
    recording = read_recording(path, layout or LogLayout(frames=("base", "tool")))
    return recording.channels[POSITION][:, 0], recording


def test_a_clock_that_jumps_back_and_a_quaternion_of_zero_leave_poses_out(tmp_path: Path) -> None:
    steps = [_moved(10**8 * k, k) for k in range(11)]
    steps += [
        _moved(450_000_000, 99.0, said=1),
        (460_000_000, [transform(460_000_000, "base", "tool", (99, 0, 0), [0] * 4)]),
    ]
    x, recording = _read_x(_log(tmp_path / "log.mcap", steps))
    assert x.tolist() == list(range(11))
    assert (
        "between frames base and tool: 1 poses are not newer than an earlier one and were left out" in recording.notes
    )
    assert any("1 poses have no stamp, or a quaternion" in note for note in recording.notes)


def test_transforms_without_stamps_have_the_time_at_which_they_were_recorded(tmp_path: Path) -> None:
    x, _ = _read_x(_log(tmp_path / "log.mcap", [_moved(10**8 * k, k, said=0) for k in range(11)]))
    assert x.tolist() == list(range(11))


def test_what_is_published_again_and_never_moves_may_be_rare(tmp_path: Path) -> None:
    """An edge at 1 Hz that stands still has no gap; one that moves has."""
    rare = _log(tmp_path / "rare.mcap", [_moved(0, 2.0), _moved(10**9, 2.0)])
    assert _read_x(rare)[0].tolist() == [2.0] * 11
    moves = _log(tmp_path / "moves.mcap", [_moved(0, 2.0), _moved(10**9, 3.0)])
    assert np.isfinite(_read_x(moves)[0]).tolist() == [True] + [False] * 9 + [True]


def test_a_static_transform_holds_for_the_whole_log_unless_it_moves(tmp_path: Path) -> None:
    still = [transform(0, "base", "tool", (7, 0, 0))]
    x, recording = _read_x(_log(tmp_path / "still.mcap", [_moved(5, 7.0)], still))
    assert x.tolist() == [7.0] * 11
    assert "none of these transforms changes: the sensor is assumed not to move" in recording.notes
    x, recording = _read_x(_log(tmp_path / "both.mcap", [_moved(10**8 * k, k) for k in range(11)], still))
    assert x.tolist() == list(range(11))
    assert "base -> tool is on /tf_static, but changes on /tf, which is used" in recording.notes


@pytest.mark.parametrize(
    ("edges", "word"),
    [
        ([("base", "arm"), ("arm", "tol")], "there is no frame 'tool'.*3 frames.*nearest in name: tol"),
        ([("base", "arm"), ("x", "tool")], "no transform joins frame 'base'"),
        ([("base", "arm"), ("arm", "tool"), ("x", "tool")], "frame 'tool' has 2 parents: arm, x"),
        ([("a", "tool"), ("tool", "a"), ("base", "b")], "loop: tool -> a -> tool"),
        ([], "the log has no transforms"),
    ],
)
def test_what_is_no_tree_is_a_sentence(tmp_path: Path, edges: list[tuple[str, str]], word: str) -> None:
    steps = [(1, [transform(1, parent, child, (0, 0, 0)) for parent, child in edges])]
    with pytest.raises(InputError, match=rf"log\.mcap: .*{word}"):
        _read_x(_log(tmp_path / "log.mcap", steps))


def test_joint_states_that_lack_a_joint_are_said(tmp_path: Path, robot: Path) -> None:
    kind, names = "sensor_msgs/msg/JointState", ["elbow_joint", "shoulder_joint", "flange_joint"]

    def state(stamp: int, named: list[str], position: list[float]) -> tuple[int, str, Any]:
        nothing = np.zeros(0)
        return stamp, "/joint_states", TYPES[kind](bag.header(stamp, ""), named, np.array(position), nothing, nothing)

    states = [
        state(0, names, [0.1, 0.2, 0.3]),
        state(1, ["finger"], [9.0]),  # of another publisher: nothing to say
        state(2, names[:2], [9.0, 9.0]),
        state(3, names, [9.0, np.nan, 9.0]),
        state(10**8, names[::-1], [0.3, 0.2, 0.1]),
    ]
    rows = [(10**7 * k, WRENCH, wrench(10**7 * k, [k] * 6, "ft_sensor")) for k in range(11)]
    kinds = {WRENCH: KINDS[WRENCH], "/joint_states": kind}
    write_mcap(tmp_path / "log.mcap", sorted([*rows, *states], key=lambda each: each[0]), kinds)
    layout = LogLayout(frames=("base_link", "ft_sensor"), urdf=robot / "robot.urdf")
    recording = read_recording(tmp_path / "log.mcap", layout)
    wanted = Posture(np.array([[0.2, 0.1, 0.3]])).positions()
    assert np.abs(recording.channels[POSITION] - wanted).max() < 1e-12
    said = "2 of 5 messages of '/joint_states' have no position of flange_joint, shoulder_joint, and were left out"
    assert sorted(re.findall(r"\w+_joint", " ".join(recording.notes))) == ["flange_joint", "shoulder_joint"]
    assert any(note.startswith(said[:50]) for note in recording.notes)
    write_mcap(tmp_path / "none.mcap", sorted([*rows, states[2]], key=lambda each: each[0]), kinds)
    notes = read_recording(tmp_path / "none.mcap", layout).notes
    assert any(note.startswith("no message of '/joint_states' has all of the joints") for note in notes)


def test_poses_of_other_things_never_block(robot: Path) -> None:
    recording = read_recording(robot / "touches", LogLayout(wrench_topic=WRENCH))
    assert ORIENTATION not in recording.channels
    assert "2 topics hold poses, and none is used: /camera/object_pose, /vision/marker" in recording.notes[0]
    none = read_recording(robot / "touches", LogLayout(wrench_topic=WRENCH, orientation_topic="none"))
    assert ORIENTATION not in none.channels
    assert none.notes == ()


def test_a_ros_1_bag_has_the_same_tree(tmp_path: Path, session: Session) -> None:
    """The first two seconds, written in the other format."""
    types, count, log = ROS1.types, 400, session.touches
    kinds = {WRENCH: KINDS[WRENCH], "/tf": OLD, "/tf_static": OLD}
    with Writer1(tmp_path / "log.bag") as writer:
        topics = {name: writer.add_connection(name, kind, typestore=ROS1) for name, kind in kinds.items()}
        for stamp, name, message in sorted(bag.messages(log), key=lambda each: each[0]):
            if name in topics and stamp <= count * 5_000_000:
                made = (
                    wrench_stamped(stamp, log.wrenches()[stamp // 5_000_000], "ft_sensor", types)
                    if name == WRENCH
                    else types[OLD]([_in_ros1(each) for each in message.transforms])
                )
                writer.write(topics[name], stamp, ROS1.serialize_ros1(made, kinds[name]))
    recording = read_recording(tmp_path / "log.bag", LogLayout(frames=("/world", "ft_sensor")))
    wanted = session.touches.channels[ORIENTATION][:count:2]
    turned = rotation_from_quaternion(recording.channels[ORIENTATION][:count:2])
    assert np.abs(turned - rotation_from_quaternion(wanted)).max() < 1e-12


def test_without_a_tree_joint_states_move_the_urdf(robot: Path, session: Session, tmp_path: Path) -> None:
    kinds = {name: KINDS[name] for name in (WRENCH, "/joint_states")}
    start = session.touches.picked(slice(400))
    kept = [each for each in bag.messages(start) if each[1] in kinds]
    write_mcap(tmp_path / "log.mcap", sorted(kept, key=lambda each: each[0]), kinds)
    rig = tmp_path / "rig.toml"
    urdf = str(robot / "robot.urdf")
    assert main(["rig", "new", str(tmp_path / "log.mcap"), urdf, "--link", "probe", "-o", str(rig)]) == 0
    made = load_rig(rig)
    assert (made.orientation.base, made.orientation.sensor) == ("world", "ft_sensor")
    assert made.orientation.joints == "/joint_states"
    found = read_recording(tmp_path / "log.mcap", made.layout()).channels[ORIENTATION][:: bag.EVERY]
    wanted = rotation_from_quaternion(start.channels[ORIENTATION][:: bag.EVERY])
    assert np.abs(rotation_from_quaternion(found) - wanted).max() < 1e-12
