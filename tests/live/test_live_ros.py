"""ROS 2 without ROS: messages both ways over loopback, topics as a source, contacts published, errors said."""

import json
import os
import socket
import subprocess
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from subprocess import PIPE
from threading import Thread
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from claims.evidence.robot import FLANGE_SENSOR, GROUND, URDF, Posture, joints, transform
from palpate.contact import ContactEstimate, Contacts, Status
from palpate.contact.estimate import ROW
from palpate.errors import InputError
from palpate.files.logs.layout import ArrayChannel, ImageChannel, LogLayout
from palpate.files.message_types import DEFINITIONS
from palpate.live.dds import DdsNode, DdsReader, Writer
from palpate.live.publish_ros import TARE, TOPICS, RosPublisher
from palpate.live.ros2 import RosTopics
from palpate.live.ros_device import RosDevice
from palpate.live.ros_poses import RosPoses
from palpate.live.source import Batch, Device, Source, source_of
from palpate.live.stream_buffer import SlotForm
from palpate.setup.rig import Rig
from palpate.setup.source import RigSource
from palpate.setup.tables import RigOrientation
from palpate.setup.wrench_table import RigForceTorque
from tests.support.listened import PATIENCE, received, said_until, until
from tests.support.live_rings import slots
from tests.support.ros_kinds import ROS2, TYPES, drawn, full, members, packed, packed_tree, read

pytest.importorskip("cyclonedds", reason="ROS 2 is reached through cyclonedds")

ROOT = Path(__file__).resolve().parents[2]
SECOND = 10**9


@pytest.fixture
def ends(domain: int, node: DdsNode) -> Iterator[tuple[DdsNode, DdsNode]]:
    """Two participants, with the loopback interface between them."""
    with closing(DdsNode(domain)) as other:
        assert other.open() == ""
        yield node, other


def _join(writer: Writer | None, reader: DdsReader | None) -> None:
    assert writer is not None
    assert reader is not None
    until(lambda: writer.readers and reader.publishers)


def _received(reader: DdsReader, wanted: int = 1) -> list[bytes]:
    found: list[bytes] = []
    deadline = time.monotonic() + PATIENCE
    while len(found) < wanted and time.monotonic() < deadline:
        reader.wait(0.5)
        some = reader.take()
        found += [some.data[a : a + n] for a, n in zip(some.start.tolist(), some.length.tolist(), strict=True)]
    assert len(found) == wanted
    return found


def test_types_are_those_of_ros() -> None:
    for kind, definition in DEFINITIONS.items():
        said = [(name, what) for what, name in (member.split(" ") for member in definition.split(", "))]
        assert said == members(kind)


def test_every_message_arrives_as_it_was_sent(ends: tuple[DdsNode, DdsNode]) -> None:
    rng = np.random.default_rng(1)
    for number, kind in enumerate(sorted(DEFINITIONS)):
        writer, reader = ends[0].writer(f"all{number}", kind), ends[1].reader(f"/all{number}", kind)
        _join(writer, reader)
        sent = [packed(kind, drawn(full(kind), rng)) for _ in range(5)]
        for data in sent:
            assert writer.write(data + bytes(-len(data) % 4))
        for data, found in zip(sent, _received(reader, 5), strict=True):
            assert found[4 : len(data)] == data[4:]


def test_nothing_listens_beyond_loopback(ends: tuple[DdsNode, DdsNode]) -> None:
    table = Path("/proc/net/udp")
    if not table.exists():
        pytest.skip("this system does not list its sockets")
    rows = [line.split() for line in table.read_text().splitlines()[1:]]
    address = {row[9]: row[1].split(":")[0] for row in rows}
    found = 0
    for name in os.listdir("/proc/self/fd"):
        try:
            inode = os.readlink(f"/proc/self/fd/{name}").removeprefix("socket:[").removesuffix("]")
        except OSError:  # the folder itself
            continue
        if inode in address:
            found += 1
            with socket.socket(fileno=os.dup(int(name))) as own:
                bound = own.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, 16).rstrip(b"\0")
            assert bound == b"lo" or address[inode] == "0100007F"
    assert found >= 2 * len(ends)  # each receives what is said to all, and to it


def test_who_comes_late_hears_what_holds(ends: tuple[DdsNode, DdsNode]) -> None:
    kind = "std_msgs/Float64MultiArray"
    message = packed(kind, drawn(full(kind), np.random.default_rng(2)))
    latched, plain = (ends[0].writer(name, kind, latched=name == "held") for name in ("held", "gone"))
    for writer in (latched, plain):
        assert writer.write(message)
    held, gone = ends[1].reader("held", kind, latched=True), ends[1].reader("gone", kind)
    _join(plain, gone)
    assert _received(held) == [message]
    assert plain.write(message[:4] + bytes(len(message) - 4))
    assert _received(gone) == [message[:4] + bytes(len(message) - 4)]  # only what came after it


def _meet(device: RosDevice, source: RosTopics, publishers: int = 1) -> None:
    """Both ends know of each other: what is sent before the reader knows its writer is dropped, and never counted."""
    until(lambda: device._writer is not None and device._writer.readers)
    until(lambda: source._reader is not None and source._reader.publishers == publishers)


@contextmanager
def _opened(
    domain: int, shape: tuple[int, ...] = (6,), topic: str = "/ft", layout: LogLayout | None = None
) -> Iterator[tuple[RosDevice, RosTopics]]:
    layout = LogLayout(wrench_topic=topic) if layout is None else layout
    with closing(RosDevice(topic, shape, domain)) as device, closing(RosTopics(layout, DdsNode(domain))) as source:
        device.open()
        source.open()
        _meet(device, source)
        assert device.send(np.zeros(0, dtype=int), np.zeros((0, int(np.prod(shape))))) == 0
        yield device, source


def test_a_thousand_samples_a_second_arrive_to_the_last_bit(domain: int) -> None:
    rng, wanted = np.random.default_rng(3), 600
    stamp, values = np.arange(wanted) * 10**6, rng.normal(size=(wanted, 6))  # a log may begin at 0
    batch, found = Batch((6,)), [np.zeros((0, 7))]
    with _opened(domain) as (device, source):
        assert isinstance(device, Device)
        assert isinstance(source, Source)
        begun = time.monotonic()
        for k in range(wanted):
            assert device.send(stamp[k : k + 1], values[k : k + 1]) == 1
            time.sleep(max(0.0, begun + 1e-3 * (k + 1) - time.monotonic()))
            if k % 3 == 0 and (n := source.receive(batch, 0.0)):
                assert not batch.lost[:n].any()
                found.append(np.column_stack([batch.stamp[:n], batch.values[:n]]))
        rest = received(source, wanted - sum(map(len, found)))
        source.close()  # and once more
    assert not rest.lost.any()
    found.append(np.column_stack([rest.stamp, rest.values]))
    assert np.array_equal(np.concatenate(found), np.column_stack([stamp, values]))


def test_wrenches_of_any_make_are_read_alike(domain: int, node: DdsNode) -> None:
    source = RosTopics(LogLayout(wrench_topic="/ft"), DdsNode(domain))
    kind, rng = "geometry_msgs/WrenchStamped", np.random.default_rng(9)
    writer = node.writer("/ft", kind)
    source.open()
    _join(writer, source._reader)
    sent: list[np.ndarray] = []
    for frame_id in ["sensor"] * 3 + ["s"] * 2 + ["sensor_"] * 2 + ["tensor"] * 2:  # of one length, of another
        message = drawn(full(kind), rng)
        message.header.frame_id = frame_id
        message.header.stamp = TYPES["builtin_interfaces/msg/Time"](len(sent) + 1, len(sent))
        if len(sent) in (1, 6):
            message.wrench.torque.y = np.nan
        sent.append(np.array(_numbers(message.wrench.force) + _numbers(message.wrench.torque)))
        big = len(sent) == 3
        data = bytes(ROS2.serialize_cdr(message, full(kind), little_endian=not big))
        assert writer.write(data)
        if len(sent) < 6:  # one by one, then several at once
            one = received(source, 1)
            assert one.stamp.tolist() == [len(sent) * SECOND + len(sent) - 1]
            assert np.array_equal(one.values, sent[-1:], equal_nan=True)
    rest = received(source, 4)
    assert np.array_equal(rest.values, sent[5:], equal_nan=True)
    assert not rest.lost.any()
    source.close()


def test_what_has_no_room_is_counted(domain: int) -> None:
    batch, sent, stamps, lost = Batch((6,)), 0, 0, 0
    with _opened(domain) as (device, source):
        for _ in range(18):
            sent += device.send(1 + np.arange(1000), np.zeros((1000, 6)))
            time.sleep(0.02)
        while found := source.receive(batch, 0.3):
            stamps, lost = stamps + found, lost + int(batch.lost[:found].sum())
        sent += device.send(np.array([SECOND]), np.zeros((1, 6)))
        assert sent == 18_001
        lost += received(source, 1).lost[0]
    assert stamps + 1 + lost == sent
    assert lost > 0  # how many depends on what was still under way when reading began


def test_arrays_and_images_come_in_their_shape(domain: int) -> None:
    rng = np.random.default_rng(4)
    cells = LogLayout(wrench=None, arrays=(ArrayChannel("cells", (6, 22), topic="/skin"),))
    sent = rng.normal(size=(4, 132))
    other = RosDevice("/skin", (5,), domain)
    with _opened(domain, (6, 22), "/skin", cells) as (device, source), closing(other):
        begun = time.time_ns()
        assert device.send(np.arange(4), sent) == 4
        four = received(source, 4)
        assert np.array_equal(four.values, sent.reshape(4, 6, 22))
        assert ((four.stamp >= begun - SECOND) & (four.stamp <= time.time_ns() + SECOND)).all()
        assert "have no stamps: the times at which they were sent" in " ".join(source.events())
        other.open()
        _meet(other, source, publishers=2)
        assert other.send(np.zeros(1, dtype=int), np.zeros((1, 5))) == 1
        assert device.send(np.arange(1), sent[:1]) == 1
        one = received(source, 1)
        source.receive(Batch(source.shape), 0.3)
        assert np.array_equal(one.values, sent[:1].reshape(1, 6, 22))
        assert one.lost[0] in (0, 1)  # the odd one may come behind
        assert ["that do not contain 6 x 22 numbers are ignored" in said for said in source.events()] == [True]


@pytest.mark.parametrize("shape", [(24, 3), (3, 24), (72,)])
def test_axes_come_last_whatever_the_layout_of_arrays_states(domain: int, shape: tuple[int, ...]) -> None:
    cells = ArrayChannel("cells", (6, 4, 3), topic="/skin", axes=("x", "y", "z"))
    sent = np.random.default_rng(4).normal(size=(2, 24, 3))
    with _opened(domain, shape, "/skin", LogLayout(wrench=None, arrays=(cells,))) as (device, source):
        assert device.send(np.arange(2), (sent.swapaxes(1, 2) if shape[0] == 3 else sent).reshape(2, -1)) == 2
        np.testing.assert_array_equal(received(source, 2).values, sent.reshape(2, 6, 4, 3))


def test_images_come_as_they_were_sent(domain: int) -> None:
    pytest.importorskip("cv2", reason="images need OpenCV")
    image = np.random.default_rng(5).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    device = RosDevice("/camera", image.shape, domain, images=True)
    device.open()
    layout = LogLayout(wrench=None, images=ImageChannel("/camera", "marker_ring"))
    with pytest.raises(InputError, match=r"no readable image came on '/camera'.*Check"):
        RosTopics(layout, DdsNode(domain), patience=0.3).open()
    source = RosTopics(layout, DdsNode(domain))
    stop = False

    def show() -> None:
        while not stop:
            device.send(np.array([SECOND]), image.reshape(1, -1).astype(float))
            time.sleep(0.02)

    sender = Thread(target=show)
    sender.start()
    try:
        source.open()
        assert source.shape == image.shape
        found = received(source, 2, size=1)
    finally:
        stop = True
        sender.join()
        source.close()
        device.close()
    assert (found.values == image).all()
    assert (found.stamp == SECOND).all()


class _Knowing(DdsNode):
    """It is open once it has heard of these topics: how long that takes depends on what else the machine does."""

    def __init__(self, domain: int, *names: str) -> None:
        super().__init__(domain)
        self._names = set(names)

    def open(self) -> str:
        said = super().open()
        until(lambda: self._names <= {topic.name for topic in self.topics()})
        return said


def test_the_only_fitting_topic_is_found_and_others_are_named(domain: int) -> None:
    devices = [RosDevice(topic, shape, domain) for topic, shape in (("/ft", (6,)), ("/skin", (5,)))]
    for device in devices:
        device.open()
    publisher = RosPublisher(_form("base", ()), domain=domain)  # wrenches of contacts are no sensor
    publisher.open()
    known = ("/ft", "/skin", *TOPICS)
    found = RosTopics(LogLayout(), _Knowing(domain, *known), patience=0.0)
    found.open()
    assert found.topic.name == "/ft"
    found.close()
    for layout, said in (
        (
            LogLayout(wrench_topic="/fz"),
            "no node publishes '/fz'. Topics that exist: .*/ft .geometry_msgs/WrenchStamped.*Did you mean",
        ),
        (LogLayout(wrench_topic="skin"), "'/skin' holds std_msgs/Float64MultiArray.*Wrenches are read from"),
    ):
        with pytest.raises(InputError, match=said):
            RosTopics(layout, _Knowing(domain, *known), patience=0.0).open()
    for topic, said in (
        ("/ft", "'/ft' has messages of geometry_msgs/WrenchStamped.*Poses"),
        ("/no", "no node publishes '/no'.*Topics"),
    ):
        with closing(_Knowing(domain, *known)) as node:
            node.open()
            with pytest.raises(InputError, match=said):
                RosPoses(RigOrientation(topic=topic), node, patience=0.0).open()
    devices.append(RosDevice("/second", domain=domain))
    devices[-1].open()
    with pytest.raises(InputError, match=r"2 topics hold a wrench: /ft, /second.*Name"):
        RosTopics(LogLayout(), _Knowing(domain, *known, "/second"), patience=0.0).open()
    for each in (*devices, publisher):
        each.close()
    with pytest.raises(InputError, match=r"'a b' cannot be the name of a ROS topic.*Use"):
        RosDevice("a b", domain=domain).open()
    with pytest.raises(InputError, match=r"there is no network interface 'nowhere'.*Write"):
        DdsNode(domain, "nowhere").open()


def test_silence_return_and_jumping_stamps_are_said(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.live.ros2.SILENT", 0.1)
    with _opened(domain) as (device, source):
        device.send(np.array([SECOND]), np.zeros((1, 6)))
        received(source, 1)
        time.sleep(0.15)
        assert source.receive(Batch((6,)), 0.0) == 0
        (said,) = source.events()
        assert said.startswith("no message on '/ft' for 0.1 s; one node publishes it")
        for stamp, jump in ((2 * SECOND, ""), (900 * SECOND, "+898 s"), (450 * SECOND, "-450 s")):
            device.send(np.array([stamp]), np.zeros((1, 6)))
            received(source, 1)
            jumped = [said for said in source.events() if "jumped" in said]
            assert jumped == ([] if not jump else [f"the stamps of '/ft' jumped by {jump}"])
        monkeypatch.setattr("palpate.live.ros2.SILENT", 1.0)  # its leaving is known by then, on a busy machine too
        device.close()
        said_until(source, "nobody publishes it now")
        device.open()
        _meet(device, source)
        assert device.send(np.array([451 * SECOND]), np.ones((1, 6))) == 1
        assert received(source, 1).values.tolist() == [[1.0] * 6]
        assert source.events()[0].startswith("messages on '/ft' again, after ")


def test_a_rig_says_what_is_heard(domain: int, node: DdsNode) -> None:
    device = RosDevice("/arm/ft", domain=domain)
    assert f"domain = {domain}" in device.open()
    rig = Rig(
        sensors={"force_torque": RigForceTorque(topic="/arm/ft")}, orientation=RigOrientation(base="base", sensor="ft")
    )
    source = source_of(RigSource("ros2", domain=domain), rig.resolve())
    assert isinstance(source, RosTopics)
    source.open()
    moving, static = (node.writer(name, "tf2_msgs/TFMessage", latched=name != "tf") for name in ("tf", "tf_static"))
    until(lambda: static.readers and moving.readers)
    assert source._poses is not None
    heard = [reader for reader, _ in source._poses._readers]
    until(lambda: all(reader.publishers for reader in heard))
    now = time.time_ns()
    assert static.write(packed_tree(transform(now, "tool", "ft", (0, 0, 0.1))))
    for k in range(4):
        assert moving.write(packed_tree(transform(now + k * 10**7, "base", "tool", (0.1 * k, 0, 0), (1, 0, 0, 0))))
    _meet(device, source)
    time.sleep(0.2)
    device.send(np.array([now + 15 * 10**6, now + 5 * 10**7, now + SECOND]), np.zeros((3, 6)))
    found = received(source, 3)
    assert np.allclose(found.orientation[:2], [1.0, 0.0, 0.0, 0.0])
    assert np.allclose(found.position[:2], [[0.15, 0.0, -0.1], [0.5, 0.0, -0.1]])  # between two, and ahead of the last
    assert np.isnan(found.orientation[2]).all()  # too old
    assert np.allclose(source._poses.at(found.stamp).age, [0.0, 0.02, 0.97])
    assert "the sensor's pose is taken from base -> tool -> ft in the tree of /tf" in source.events()
    source.close()
    device.close()


def test_poses_of_a_topic_stand_for_any_source(domain: int, node: DdsNode) -> None:
    rng = np.random.default_rng(6)
    for number, kind in enumerate(("PoseStamped", "PoseWithCovarianceStamped", "TransformStamped")):
        kind, name = f"geometry_msgs/{kind}", f"/pose{number}"
        writer = node.writer(name, kind)
        orientation = RigOrientation(topic=name[1:])
        poses = RosPoses.of(orientation, RigSource("netft", "nobody", domain=domain))
        assert poses is not None
        poses.open()
        until(lambda writer=writer: writer.readers)
        message = drawn(full(kind), rng)
        message.header.stamp = TYPES["builtin_interfaces/msg/Time"](7, 0)
        body = message.transform if hasattr(message, "transform") else getattr(message.pose, "pose", message.pose)
        turned = body.rotation if hasattr(body, "rotation") else body.orientation
        turned.x, turned.y, turned.z, turned.w = 0.0, 0.6, 0.0, 0.8
        data = packed(kind, message)
        writer.write(data)
        until(lambda poses=poses: np.isfinite(poses.at(np.array([7 * SECOND])).quaternion).all())
        assert poses.at(np.array([7 * SECOND])).quaternion[0].tolist() == [0.0, 0.6, 0.0, 0.8]
        poses.close()
    assert RosPoses.of(RigOrientation(), None) is None
    with pytest.raises(InputError, match="name of the topic of joint states"):
        RosPoses.of(RigOrientation(urdf="arm.urdf", base="base", sensor="ft", joints={"a": "a"}), None)


@pytest.mark.parametrize("above", ["nothing", "base called sensor", "tf", "imu"])
def test_joint_states_pose_the_sensor(node: DdsNode, tmp_path: Path, above: str) -> None:
    """Of a wrist, as its joints turn one after the other; its base in /tf, or turned as an IMU on it states."""
    pytest.importorskip("pinocchio")
    root = "sensor" if "called" in above else "base_link"
    (tmp_path / "wrist.urdf").write_text(URDF.replace('"base_link"', f'"{root}"'))
    base, imu = ("odom" if above == "tf" else root), ("/imu" if above == "imu" else None)
    table = RigOrientation(urdf="wrist.urdf", base=base, sensor="ft_sensor", joints="/joint_states", imu=imu)
    kinds = {"/joint_states": "sensor_msgs/JointState"}
    kinds |= {"tf": {"/tf": "tf2_msgs/TFMessage"}, "imu": {"/imu": "sensor_msgs/Imu"}}.get(above, {})
    writers = {name: node.writer(name, kind) for name, kind in kinds.items()}
    turned = Rotation.from_euler("xyz", [0.2, -0.5, 0.9])
    stamps = np.arange(1, 5) * SECOND // 10
    angles = np.array([[0.3, -0.2, 0.1], [0.4, 0.1, 0.2], [0.5, 0.3, -0.4], [0.1, 0.0, 0.6]])

    def send() -> None:
        for stamp, row in zip(stamps.tolist(), angles, strict=True):
            writers["/joint_states"].write(packed("sensor_msgs/JointState", joints(stamp, row)))
            if above == "tf":
                writers["/tf"].write(packed_tree(transform(stamp, "odom", "world", (3, 2, 0), turned.as_quat())))
            if above == "imu":
                message = drawn(full("sensor_msgs/Imu"), np.random.default_rng(1))
                message.header.stamp, message.header.frame_id = TYPES["builtin_interfaces/msg/Time"](0, stamp), "mems"
                message.orientation = TYPES["geometry_msgs/msg/Quaternion"](*turned.as_quat())
                message.orientation_covariance[0] = 0.0
                writers["/imu"].write(packed("sensor_msgs/Imu", message))

    with ThreadPoolExecutor() as pool:  # an IMU's first message is waited for
        poses = RosPoses(table, node, 20.0, tmp_path)
        opened = pool.submit(poses.open)
        until(lambda: all(writer.readers for writer in writers.values()))
        time.sleep(0.2)
        send()
        opened.result()
    send()
    until(lambda: np.isfinite(poses.at(stamps).quaternion).all())
    found = poses.at(stamps)
    wrist = Posture(angles)
    a, b, c = (Rotation.from_euler(axis, angles[:, [k]]) for k, axis in enumerate("zyx"))
    true, at = a * b * c * FLANGE_SENSOR, wrist.positions()
    if above in ("tf", "imu"):
        true, at = turned * true, turned.apply(at + (GROUND if above == "tf" else 0.0))
        at = at + ([3.0, 2.0, 0.0] if above == "tf" else 0.0)
    assert (Rotation.from_quat(found.quaternion) * true.inv()).magnitude().max() < 1e-9
    assert np.abs(found.position - at).max() < 1e-9
    assert any("moved by joint states" in said for said in poses.events())
    poses.close()


def test_joint_states_in_degrees_or_without_a_joint_are_reported(node: DdsNode, tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    (tmp_path / "wrist.urdf").write_text(URDF)
    writer = node.writer("/joint_states", "sensor_msgs/JointState")
    table = RigOrientation(urdf="wrist.urdf", base="base_link", sensor="ft_sensor")
    poses = RosPoses(table, node, 20.0, tmp_path)
    poses.open()
    until(lambda: writer.readers)
    lacking = joints(SECOND, np.array([0.1, 0.2, 0.3]))
    lacking.name, lacking.position = lacking.name[1:], lacking.position[1:]
    lacking.velocity, lacking.effort = lacking.velocity[1:], lacking.effort[1:]
    writer.write(packed("sensor_msgs/JointState", lacking))

    def heard() -> bool:
        assert np.isnan(poses.at(np.array([SECOND])).quaternion).all()
        return any("have no position of flange_joint, and are left out" in said for said in poses.events())

    until(heard)
    writer.write(packed("sensor_msgs/JointState", joints(2 * SECOND, np.array([40.0, 20.0, 30.0]))))
    with pytest.raises(InputError, match=r"seems to be in degrees.*Write"):
        until(lambda: np.isfinite(poses.at(np.array([2 * SECOND])).quaternion).all())
    poses.close()


AREA = ("area", "depth")


def _form(frame: str, features: tuple[str, ...] = AREA, sensor: str = "") -> SlotForm:
    width = ROW.length + len(features) + 1
    return SlotForm("taxels", (5,), False, features, width, 3, frame, origin=(sensor, frame if sensor else ""))


def _contacts(samples: int, each: int, seed: int = 7) -> Contacts:
    """So many contacts in every sample, 1 ms apart."""
    rng, rows = np.random.default_rng(seed), samples * each
    root = 1e-3 * rng.normal(size=(rows, 3, 3))
    normal = rng.normal(size=(rows, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    covariance = root @ np.swapaxes(root, 1, 2)
    covariance = (covariance + np.swapaxes(covariance, 1, 2)) / 2
    numbers = [rng.normal(size=(rows, 3)), normal, rng.normal(size=(rows, 3)), rng.normal(size=rows), covariance]
    status = np.zeros(rows, dtype=np.int8)
    estimate = ContactEstimate(*numbers, np.zeros(rows), np.ones(rows, dtype=np.int64), status)
    features = {"area": rng.normal(size=rows), "depth": rng.normal(size=rows)}
    sample, time_ = np.arange(rows) // each, 1.7e9 + np.arange(rows) // each * 1e-3
    return Contacts(sample, time_, np.arange(rows) % each, estimate, features)


@pytest.mark.parametrize("frame_id", ["base", "a", "", "tool0"])
def test_contacts_are_published_as_they_are(domain: int, node: DdsNode, frame_id: str) -> None:
    publisher = RosPublisher(_form(frame_id), domain=domain)
    publisher.open()
    readers = {name: node.reader(name, kind) for name, kind in TOPICS.items()}
    for name, reader in readers.items():
        _join(publisher._writers[name], reader)
    contacts = _contacts(1, 3)
    assert len(publisher.publish(slots(contacts, _form(frame_id)))) == 1
    found = {name: read(TOPICS[name], _received(reader)[0]) for name, reader in readers.items()}
    assert {message.header.frame_id for name, message in found.items() if "markers" not in name} == {frame_id}
    strongest = int(np.argmax(np.linalg.norm(contacts.force, axis=1)))
    pose, wrench, markers, array = (found[name] for name in TOPICS)
    assert _numbers(pose.pose.pose.position) == contacts.point[strongest].tolist()
    assert np.array_equal(pose.pose.covariance.reshape(6, 6)[:3, :3], contacts.covariance[strongest])
    assert _numbers(wrench.wrench.force) == contacts.force[strongest].tolist()
    assert array.features == ["area", "depth"]
    assert np.array_equal(
        np.reshape(array.values, (3, 2)), np.column_stack([contacts.features[name] for name in ("area", "depth")])
    )
    for k, one in enumerate(array.contacts):
        assert (one.sample, one.contact, one.time, one.status) == (0, k, contacts.time[k], int(Status.CONTACT))
        for name in ("point", "normal", "force"):
            assert _numbers(getattr(one, name)) == getattr(contacts, name)[k].tolist()
        assert np.array_equal(one.covariance.reshape(3, 3), contacts.covariance[k])
    assert [(marker.ns, marker.action) for marker in markers.markers] == [("", 3)] + [("force", 0), ("point", 0)] * 3
    for k, (arrow, ball) in enumerate(zip(markers.markers[1::2], markers.markers[2::2], strict=True)):
        assert _numbers(arrow.points[1]) == contacts.point[k].tolist()
        shaft = np.subtract(_numbers(arrow.points[1]), _numbers(arrow.points[0]))
        assert np.allclose(np.cross(shaft, contacts.force[k]), 0.0)
        assert shaft @ contacts.force[k] > 0  # it pushes with its tip
        assert _numbers(ball.pose.position) == contacts.point[k].tolist()
        axes = Rotation.from_quat([*_numbers(ball.pose.orientation), ball.pose.orientation.w]).as_matrix()
        seen = np.sqrt(np.clip(np.diag(axes.T @ contacts.covariance[k] @ axes), 0, None)) * 2 * 2.796
        assert np.allclose(_numbers(ball.scale), seen.clip(0.002, 0.05), atol=1e-6)
    publisher.close()


def test_contacts_of_a_robot_are_published_by_sensor_and_together(domain: int, node: DdsNode) -> None:
    """Each sensor's in the frame of its link; the array of all has the newest of each, each in its own frame."""
    first = RosPublisher(tip := _form("tip", sensor="thumb"), domain=domain)
    second = RosPublisher(palm := _form("palm", (), "pad"), domain=domain, partner=first)
    first.open()
    second.open()
    kind, alone = "palpate_msgs/ContactArray", "/palpate/contact/contacts"
    names = ("/palpate/thumb/contacts", "/palpate/pad/contacts", alone)
    readers = [node.reader(name, kind) for name in names]
    writers = [first._writers[alone], second._writers[alone], first._writers["together"]]
    for writer, reader in zip(writers, readers, strict=True):
        _join(writer, reader)
    thumb, pad = _contacts(1, 2), replace(_contacts(1, 3, seed=8), features={})
    first.publish(slots(thumb, tip))
    second.publish(slots(replace(pad, time=pad.time + 1.0), palm))
    own, other, everything = (
        [read(kind, each) for each in _received(reader, count)]
        for reader, count in zip(readers, (1, 1, 2), strict=True)
    )
    assert [one.header.frame_id for one in own[-1].contacts] == ["tip"] * 2
    assert [one.header.frame_id for one in other[-1].contacts] == ["palm"] * 3
    assert [one.header.frame_id for one in everything[-1].contacts] == ["tip"] * 2 + ["palm"] * 3
    points = [_numbers(one.point) for one in everything[-1].contacts]
    assert points == [*thumb.point.tolist(), *pad.point.tolist()]
    assert not everything[-1].features
    second.close()
    first.close()


def _numbers(message: Any) -> list[float]:
    return [message.x, message.y, message.z]


def test_publishing_is_limited_by_the_times_of_the_contacts(domain: int, node: DdsNode) -> None:
    publisher = RosPublisher(form := _form("base"), 100.0, domain)
    publisher.open()
    kinds = {name: TOPICS[name] for name in ("/palpate/contact/contacts", "/palpate/contact/markers")}
    readers = [node.reader(name, kind) for name, kind in kinds.items()]
    for name, reader in zip(kinds, readers, strict=True):
        _join(publisher._writers[name], reader)
    contacts = _contacts(1000, 2)
    published = 0
    for start in range(0, 2000, 14):
        published += len(publisher.publish(slots(contacts[start : start + 14], form)))
        time.sleep(1e-3)
    assert published == 100
    assert len(_received(readers[0], 100)) == 100
    assert len(_received(readers[1], 30)) == 30
    gone = ContactEstimate(
        *np.full((3, 1, 3), np.nan), np.full(1, np.nan), np.full((1, 3, 3), np.nan), np.full(1, np.nan),
        np.zeros(1, dtype=np.int64), np.full(1, int(Status.NO_CONTACT), dtype=np.int8),
    )  # fmt: skip
    nothing = replace(Contacts.single(np.array([1.7e9 + 2.0]), gone), features=dict.fromkeys(AREA, np.full(1, np.nan)))
    assert len(publisher.publish(slots(nothing, form))) == 1
    last = read(kinds["/palpate/contact/markers"], _received(readers[1])[0])
    assert [marker.action for marker in last.markers] == [3]
    assert len(publisher.publish(slots(replace(nothing, time=np.array([5.0])), form))) == 1  # another clock
    assert not publisher.tare_requested()
    asks = node.writer(TARE, "std_msgs/Empty")
    until(lambda: asks.readers)
    asks.write(packed("std_msgs/Empty", drawn("std_msgs/msg/Empty", np.random.default_rng(0))) + bytes(3))
    until(publisher.tare_requested)
    assert not publisher.tare_requested()
    assert publisher.events() == []
    publisher.close()


WITHOUT_WHEELS = ("tf2_msgs", "palpate_msgs")


@pytest.fixture
def echo(rclpy: Path, of_ros: dict[str, str]) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """A node of the real ROS 2 that sends every message back, and of which types."""
    kinds = [kind for kind in sorted(DEFINITIONS) if not kind.startswith(WITHOUT_WHEELS)]
    command = [str(rclpy), str(ROOT / "tests" / "support" / "ros_echo.py"), *kinds]
    with subprocess.Popen(command, stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True, env=of_ros) as process:
        yield process, kinds
        process.kill()


def test_every_message_goes_both_ways_with_the_real_ros(
    echo: tuple[subprocess.Popen[str], list[str]], domain: int, node: DdsNode
) -> None:
    process, kinds = echo
    assert process.stdin is not None
    assert process.stdout is not None
    rng, held_kind = np.random.default_rng(8), "std_msgs/Float64MultiArray"
    holds = packed(held_kind, drawn(full(held_kind), rng))
    assert node.writer("/to_ros/held", held_kind, latched=True, depth=1).write(holds)
    if process.stdout.readline() != "ready\n":
        process.kill()
        pytest.fail(process.communicate()[1])
    names = {kind: kind.replace("/", "_") for kind in kinds}
    writers = {kind: node.writer(f"/to_ros/{name}", kind) for kind, name in names.items()}
    readers = {kind: node.reader(f"/from_ros/{name}", kind) for kind, name in names.items()}
    until(lambda: all(writers[kind].readers and readers[kind].publishers for kind in kinds))
    for kind in kinds:
        sent = drawn(full(kind), rng)
        if kind == "std_msgs/Empty":
            sent.structure_needs_at_least_one_member = 0  # of which rclpy knows nothing
        data = packed(kind, sent)
        found: list[bytes] = []
        for _ in range(20):  # who has just met may miss the first
            assert writers[kind].write(data + bytes(-len(data) % 4))
            if readers[kind].wait(0.5):
                found = _received(readers[kind])
                break
        assert [packed(kind, read(kind, one)) for one in found] == [data], kind
    for name, data in (("held", packed(held_kind, _three())), ("held_again", holds)):  # each came before it was asked
        reader = node.reader(f"/from_ros/{name}", held_kind, latched=True)
        assert [packed(held_kind, read(held_kind, one)) for one in _received(reader)] == [data]
    assert {address for address, port in _ports(process.pid) if 0 <= port - 7400 - 250 * domain < 250} == {"0100007F"}
    process.stdin.close()
    counts = json.loads(process.stdout.read())
    assert set(counts) == {*kinds, "held"}


def _three() -> Any:
    layout = TYPES["std_msgs/msg/MultiArrayLayout"]([], 0)
    return TYPES["std_msgs/msg/Float64MultiArray"](layout, np.array([1.0, 2.0, 3.0]))


def _ports(process: int) -> list[tuple[str, int]]:
    """Address, as the system writes it, and port of each UDP socket of a process."""
    rows = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
    table = {f"socket:[{row[9]}]": row[1].split(":") for row in rows}
    names = [os.readlink(link) for link in Path(f"/proc/{process}/fd").iterdir()]
    return [(table[name][0], int(table[name][1], 16)) for name in names if name in table]
