"""Gravity from an IMU, live: as in a log of the same messages, a status where they stop, and refused without any."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import palpate
from claims.evidence.payload_imu import NOISE, G, Rests, touches
from palpate.contact.estimate import ROW, Status
from palpate.errors import InputError
from palpate.files.messages import MessageBlock
from palpate.live.dds import DdsNode
from palpate.live.imu_source import ImuSource
from palpate.live.live import Live
from palpate.live.source import Batch, Source, source_of
from palpate.setup.source import RigSource
from palpate.signals.payload import Payload
from palpate_lab.simulation.bags import nanoseconds, wrenches, write_bag
from tests.conformance.live import recorded
from tests.sensors.force_torque.test_payload_imu import RIG as OF_LOGS
from tests.support.given_source import Given, block
from tests.support.listened import PATIENCE
from tests.support.ros_kinds import TYPES, packed

STEP = 0.02  # s between wrenches
RIG = OF_LOGS.replace("[acceleration]\n", '[acceleration]\ntopic = "/imu"\n')


def messages(time: np.ndarray, felt: np.ndarray) -> list[Any]:
    """Return an Imu [m/s^2] for each time [s]."""
    nothing, turn, header = np.zeros(9), TYPES["geometry_msgs/msg/Quaternion"], TYPES["std_msgs/msg/Header"]
    vector, stamp = TYPES["geometry_msgs/msg/Vector3"], TYPES["builtin_interfaces/msg/Time"]
    still = turn(0.0, 0.0, 0.0, 1.0), nothing, vector(0.0, 0.0, 0.0), nothing
    return [
        TYPES["sensor_msgs/msg/Imu"](header(stamp(*divmod(at, 10**9)), "imu"), *still, vector(*row), nothing)
        for at, row in zip(nanoseconds(time), felt.tolist(), strict=True)
    ]


def heard(time: np.ndarray, felt: np.ndarray) -> MessageBlock:
    return block("/imu", "sensor_msgs/Imu", [packed("sensor_msgs/Imu", each) for each in messages(time, felt)])


@pytest.fixture
def streams(tmp_path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Write a payload, a rig and log.mcap of touches; return times and wrenches, times and accelerations of an IMU."""
    Rests.of(0).identified().save(tmp_path / "payload.toml")
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    pressed = np.repeat(touches(0)[0].readings, 5, axis=0)
    pressed = pressed + NOISE * np.random.default_rng(3).normal(size=pressed.shape)
    time_ = 1.0 + STEP * np.arange(len(pressed))
    own = np.arange(0.99, time_[-1] + 0.05, 0.0073)
    felt = pressed[np.clip(((own - 1.0) / STEP).astype(int), 0, len(pressed) - 1), 6:]
    kinds = {"/wrench": "geometry_msgs/msg/WrenchStamped", "/imu": "sensor_msgs/msg/Imu"}

    def made(types: Any) -> list[Any]:
        imus = ((at, "/imu", each) for at, each in zip(nanoseconds(own), messages(own, felt), strict=True))
        return [wrenches(types, "/wrench", time_, pressed[:, :6]), imus]

    write_bag(tmp_path / "log.mcap", kinds, made)
    return time_, pressed[:, :6], own, felt


def answered(rig: Path, source: Source | None = None) -> tuple[Live, Given, ImuSource]:
    given = Given((6,))
    made = ImuSource(given, "/imu", DdsNode())
    return Live(rig, source=made if source is None else source), given, made


def test_a_stream_is_answered_as_a_log_of_the_same_messages(
    tmp_path: Path, streams: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
) -> None:
    """To the last bit, as a replayed log, whose record is estimated as the log is; a wrench waits for the IMU."""
    (times, readings, own, felt), rig = streams, tmp_path / "rig.toml"
    live, given, source = answered(rig)
    rows = list[np.ndarray]()
    for start in range(0, len(times), 7):
        given.give(np.array(nanoseconds(times[start : start + 7])), readings[start : start + 7])
        begun, end = times[start], times[min(start + 7, len(times)) - 1] + STEP / 2
        first = 0 if start == 0 else np.searchsorted(own, begun - STEP / 2)
        some = slice(first, np.searchsorted(own, end))
        source.add(heard(own[some], felt[some]))
        rows += [row for _, row in live.step(0.0)]
    assert len(rows) == len(times)
    assert np.mean(np.array(rows)[:, ROW.status] == Status.CONTACT) > 0.5
    stated = f'{RIG}\n[source]\nkind = "replay"\naddress = "log.mcap"\nspeed = 0\n'
    (tmp_path / "replay.toml").write_text(stated, encoding="utf-8")
    with palpate.open_live(tmp_path / "replay.toml") as replayed:
        np.testing.assert_array_equal(np.array(rows), np.array([row for _, row in replayed]))
    once, again = (palpate.estimate(log, rig) for log in (tmp_path / "log.mcap", recorded(tmp_path / "log.mcap", rig)))
    np.testing.assert_array_equal(once.point, again.point)
    np.testing.assert_array_equal(once.covariance, again.covariance)


def test_an_imu_that_stops_is_a_status(
    tmp_path: Path, streams: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
) -> None:
    """A wrench later than the last message, or within a long gap of them, has no acceleration, so no contact."""
    (times, readings, own, felt), some = streams, slice(0, 3)
    live, given, source = answered(tmp_path / "rig.toml")
    source.add(heard(own[:5], felt[:5]))
    stamps = np.array(nanoseconds(np.array([times[0], own[4] + 1e-3, own[4] + 0.2])))
    given.give(stamps, readings[some])
    statuses = [row[ROW.status] for _, row in live.step(0.0)]
    assert len(statuses) == 1  # the others wait
    source._since -= 1.0  # as if that long had passed
    statuses += [row[ROW.status] for _, row in live.step(0.0)]
    assert statuses[1:] == [Status.NO_POSE, Status.NO_POSE]
    given.give(stamps[2:] + 10**8, readings[2:3])
    assert not list(live.step(0.0))
    source._since, source._heard = source._since - 1.0, source._heard - 10.0
    assert [row[ROW.status] for _, row in live.step(0.0)] == [Status.NO_POSE]
    live.step(0.0)
    assert "no acceleration has the time of a sample" in " ".join(live.events())
    later = stamps[2:] + 2 * 10**8
    given.give(later, readings[2:3])
    source.add(heard(1e-9 * later[0] + np.array([-0.001, 0.001]), felt[:2]))  # 0.37 s after the fifth
    assert [row[ROW.status] for _, row in live.step(0.0)] != [Status.NO_POSE]
    assert "samples have accelerations again" in " ".join(live.events())


@pytest.mark.parametrize("source", ['kind = "netft"\naddress = "10.0.0.1"', 'kind = "serial"\naddress = "/dev/ttyX"'])
def test_a_source_without_the_imu_is_refused(tmp_path: Path, source: str) -> None:
    Rests.of(0).identified().save(tmp_path / "payload.toml")
    text = RIG.replace('topic = "/imu"\n', "")
    (tmp_path / "rig.toml").write_text(f"{text}\n[source]\n{source}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"gravity from an IMU.*sends wrenches alone.*IMU in \[acceleration\]"):
        Live(tmp_path / "rig.toml")
    (tmp_path / "rig.toml").write_text(f"{RIG}\n[source]\n{source}\n", encoding="utf-8")
    assert isinstance(Live(tmp_path / "rig.toml").source, ImuSource)


def test_the_gravity_in_accelerations_is_taken_off_with_poses_too(tmp_path: Path) -> None:
    """A payload without an IMU, live: the forces that a log gives, to five deviations of the noise."""
    rng, time_ = np.random.default_rng(0), 0.005 * np.arange(800)
    turned, centre = Rotation.from_euler("xyz", np.outer(time_, [0.3, 0.2, 0.1])), np.array([0.0, 0.0, 0.03])
    Payload(mass=0.5, center_of_mass=centre).save(tmp_path / "payload.toml")
    hangs = turned.inv().apply([0.0, 0.0, -0.5 * G])
    push = np.where(time_[:, None] > 2.0, [0.0, 0.0, -5.0], 0.0)
    both = np.column_stack([hangs + push, np.cross(centre, hangs)]) + NOISE[:6] * rng.normal(size=(800, 6))
    table = np.column_stack([time_, both, turned.as_quat(), turned.inv().apply([0.0, 0.0, G])])
    names = "time,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw,ax,ay,az"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=names, comments="", fmt="%.12g")
    stated = RIG.replace('topic = "/imu"\n', "")
    replay = f'{stated}\n[source]\nkind = "replay"\naddress = "log.csv"\nspeed = 0\n'
    (tmp_path / "rig.toml").write_text(replay, encoding="utf-8")
    with palpate.open_live(tmp_path / "rig.toml") as live:
        rows = np.array([row for _, row in live])
    touched = time_ > 2.0
    assert (rows[~touched, ROW.status] == Status.CONTACT).mean() < 0.01
    assert (rows[touched, ROW.status] == Status.CONTACT).mean() > 0.99
    np.testing.assert_allclose(rows[touched][:, ROW.force].mean(axis=0), [0.0, 0.0, -5.0], atol=5 * 0.05 / 20)


def test_a_topic_of_ros_is_heard(node: DdsNode, domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.live.imu_source._PATIENCE", PATIENCE)
    monkeypatch.setattr("palpate.live.waiting_source.WAITS", PATIENCE)  # or it would be given without
    given, writer = Given((6,)), node.writer("/imu", "sensor_msgs/Imu")
    other = node.writer("/wrench", "geometry_msgs/WrenchStamped")
    wrong = ImuSource(given, "/wrench", DdsNode(domain))
    with pytest.raises(InputError, match=r"not an acceleration.*Correct"):
        wrong.open()
    source = ImuSource(given, "/imu", DdsNode(domain))
    source.open()
    batch, count, deadline = Batch((6,)), 0, time.monotonic() + PATIENCE
    given.give(np.array([10**9]), np.ones((1, 6)))
    reader: Any = source._reader
    while not (writer.readers and reader.publishers) and time.monotonic() < deadline:  # or it may hear the second alone
        time.sleep(0.01)
    while not count and time.monotonic() < deadline:
        for each in messages(np.array([0.9, 1.1]), np.array([[1.0, 2.0, 9.0], [3.0, 2.0, 9.0]])):
            writer.write(packed("sensor_msgs/Imu", each))
        count = source.receive(batch, 0.2)
    assert batch.acceleration[:count].tolist() == [pytest.approx([2.0, 2.0, 9.0])]
    source.close()
    assert other is not None


def test_a_combined_source_is_wrapped_once(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    Rests.of(0).identified().save(tmp_path / "payload.toml")
    rig.write_text(f'{RIG}\n[source]\nkind = "ros2"\n', encoding="utf-8")
    setup = palpate.load_rig(rig).resolve("force_torque")
    made = source_of(RigSource("ros2"), setup)
    assert isinstance(made, ImuSource)
    assert type(made._samples).__name__ == "RosTopics"
