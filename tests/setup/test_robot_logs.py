"""The log and the rig of a simulated hand, spoiled in one way each: a sentence, the sensor's name, the others' rows."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

import palpate
from palpate.cli import main
from palpate.contact.contacts import Contacts
from palpate.files.mcap import reader
from palpate.setup.load import load_robot
from tests.support.robots import small_hand

pytest.importorskip("mujoco")

ROS2 = get_typestore(Stores.ROS2_HUMBLE)
JOINTS, RING = "/joint_states", "/ring/skin"
CHUNK = 1 << 15
SENSORS = ("thumb", "index", "middle", "ring", "little")
ABOUT_LOGS = ("its stamps", "jumps", "beyond", "left out", "lack joints", "no states")
Change = Callable[[str, bytes], bytes | None]


@pytest.fixture(scope="session")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of eight seconds, with roughly calibrated pads."""
    return small_hand(tmp_path_factory)


@pytest.fixture(scope="session")
def found(hand: Path) -> Contacts:
    """The contacts of all sensors, each in its own frame."""
    return palpate.estimate(hand / "run.mcap", hand / "robot.toml")


@pytest.fixture
def spoiled(hand: Path, tmp_path: Path) -> Path:
    """The session again, to be spoiled."""
    return Path(shutil.copytree(hand, tmp_path / "hand"))


def _rewrite(folder: Path, change: Change, chunk: int = 1 << 20) -> None:
    """Change each message of the log by its topic and bytes, or leave it out where that gives None."""
    log, spoilt, channels = folder / "run.mcap", folder / "spoilt.mcap", dict[str, int]()
    with log.open("rb") as file, spoilt.open("wb") as out:
        writer = Writer(out, chunk, CompressionType.NONE)
        writer.start()
        for schema, channel, message in make_reader(file).iter_messages():
            made = change(channel.topic, message.data)
            if made is None or schema is None:
                continue
            if channel.topic not in channels:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, kind)
            writer.add_message(channels[channel.topic], message.log_time, made, message.publish_time)
        writer.finish()
    spoilt.replace(log)


def _joints(change: Callable[[Any], None]) -> Change:
    """Change each message of joint states."""

    def changed(topic: str, data: bytes) -> bytes:
        if topic != JOINTS:
            return data
        message: Any = ROS2.deserialize_cdr(data, "sensor_msgs/msg/JointState")
        change(message)
        return bytes(ROS2.serialize_cdr(message, message.__msgtype__))

    return changed


def _degrees(message: Any) -> None:
    message.position = np.degrees(message.position) + 720.0


def _jump(message: Any) -> None:
    stamp = message.header.stamp
    if 5.0 <= (stamp.sec - 100) + 1e-9 * stamp.nanosec < 5.0099:  # logs start at 100 s
        message.position = message.position + 0.5


def _one_less(message: Any) -> None:
    keep = [k for k, name in enumerate(message.name) if name != "ring_1_joint"]
    message.name, message.position = [message.name[k] for k in keep], message.position[keep]
    message.velocity = message.effort = np.zeros(0)


def _without_joints(topic: str, data: bytes) -> bytes | None:
    return None if topic == JOINTS else data


def _late(topic: str, seconds: float) -> Change:
    """Move the stamps of one topic: whole seconds and nanoseconds behind the four bytes of CDR's head."""

    def changed(name: str, data: bytes) -> bytes:
        if name != topic:
            return data
        sec, nanosec = np.frombuffer(data[4:12], "<i4").tolist()
        stamp = 10**9 * sec + nanosec + round(1e9 * seconds)
        return data[:4] + np.array(divmod(stamp, 10**9), "<i4").tobytes() + data[12:]

    return changed


def _halved(topic: str, data: bytes) -> bytes | None:
    return None if topic == RING and int.from_bytes(data[4:8], "little") >= 104 else data


def _edit(folder: Path, name: str, old: str, new: str) -> None:
    path = folder / name
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def _estimate(folder: Path, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    capsys.readouterr()
    code = main(["estimate", str(folder / "run.mcap"), "--rig", str(folder / "robot.toml"), *words])
    shown = capsys.readouterr()
    assert "Traceback" not in shown.err
    return code, shown.out, "".join(line for line in shown.err.splitlines(True) if ": finding" not in line)


def test_sensors_in_one_log_answer_as_their_rigs_alone(hand: Path, found: Contacts) -> None:
    robot = load_robot(hand / "robot.toml")
    assert tuple(robot.sensors) == SENSORS
    assert len(np.unique(found.identity[found.answered])) > len(SENSORS)
    for place, each in enumerate(robot.sensors.values()):
        own, alone = found.of(each.name), palpate.estimate(hand / "run.mcap", each.rig)
        np.testing.assert_array_equal(own.identity, alone.identity * len(SENSORS) + place)
        for name in ("time", "sample", "point", "normal", "force", "torque", "covariance", "residual", "status"):
            np.testing.assert_array_equal(getattr(own, name), getattr(alone, name))
        for name, values in alone.features.items():
            np.testing.assert_array_equal(own.features[name], values)
        assert set(own.link) == {f"{each.name}_tip"}
    assert (np.diff(found.time) >= 0).all()
    owners = [set(found.sensor[found.identity == identity]) for identity in np.unique(found.identity)]
    assert all(len(each) == 1 for each in owners)


def test_a_chunk_is_unpacked_about_once(spoiled: Path, found: Contacts, monkeypatch: pytest.MonkeyPatch) -> None:
    _rewrite(spoiled, lambda _, data: data, CHUNK)
    unpacked, inflate = list[int](), reader.inflate
    monkeypatch.setattr(reader, "inflate", lambda content: unpacked.append(len(content)) or inflate(content))
    monkeypatch.setattr("palpate.setup.robot_pipeline.BYTES", 4 * CHUNK)
    again = palpate.estimate(spoiled / "run.mcap", spoiled / "robot.toml")
    np.testing.assert_array_equal(again.covariance, found.covariance)
    assert sum(unpacked) < 2.0 * (spoiled / "run.mcap").stat().st_size  # some for the stamps
    monkeypatch.setattr("palpate.setup.pipeline.HEAD", 1000)
    rig = load_robot(spoiled / "robot.toml").sensors["thumb"].rig
    short, long = (palpate.open_log(spoiled / "run.mcap", rig).in_blocks_of(size).head() for size in (CHUNK, 1 << 30))
    assert len(short) == 1000
    np.testing.assert_array_equal(short.time, long.time)


def test_good_logs_raise_no_alarm(hand: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in ((), ("--frame", "base")):
        code, out, err = _estimate(hand, capsys, *words)
        assert (code, err) == (0, "")
        assert not [each for each in ABOUT_LOGS if each in out]
    free = palpate.estimate(hand / "free.mcap", hand / "robot.toml", frame="base")
    assert not free.answered.any()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_joints(_jump), r"joint '\w+' jumps by 0\.\d+ rad at 105\.0\d\d s"),
        (_late(RING, -0.05), r"ring: its stamps are 50 ms"),
        (_late(JOINTS, 0.05), r"joint states: its stamps are 50 ms"),
        (lambda topic, data: data.replace(b"ring_tip", b"little_1"), "ring: its messages name the frame 'little_1'"),
        (_halved, r"ring: its samples end 4\.0 s before those of the others"),
    ],
    ids=["jump", "clock of a sensor", "clock of the joints", "exchanged topics", "sensor that stops"],
)
def test_doubtful_logs_are_warned_of(
    spoiled: Path, capsys: pytest.CaptureFixture[str], change: Change, said: str
) -> None:
    _rewrite(spoiled, change)
    code, out, _ = _estimate(spoiled, capsys, "--frame", "base")
    assert code == 0
    assert re.search(said, out)
    assert out.count("its stamps are") == ("stamps" in said)


def _without_topic(folder: Path) -> None:
    _rewrite(folder, lambda topic, data: None if topic == RING else data)


def _without_model(folder: Path) -> None:
    (folder / "ring_response.toml").unlink()


def _without_link(folder: Path) -> None:
    _edit(folder, "robot.toml", '"ring_tip"', '"ring_tap"')


CLOSING = '<joint name="closing" type="fixed"><parent link="palm"/><child link="ring_tip"/></joint>'


def _without_kind(folder: Path) -> None:
    _edit(folder, "robot.toml", 'kind = "skin"\nlink = "ring_tip"', 'kind = "skim"\nlink = "ring_tip"')


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_without_topic, "/ring/skin"),
        (_without_model, "ring_response.toml"),
        (_without_link, "no link 'ring_tap'"),
        (_without_kind, "no kind 'skim'"),
    ],
)
def test_a_sensor_that_cannot_be_used_is_named_and_the_others_are_kept(
    spoiled: Path, found: Contacts, capsys: pytest.CaptureFixture[str], spoil: Callable[[Path], None], said: str
) -> None:
    spoil(spoiled)
    code, out, err = _estimate(spoiled, capsys, "-o", str(spoiled / "found.parquet"))
    assert (code, err) == (4, "")
    assert re.search(f"ring is left out: .*{re.escape(said)}", out)
    kept = Contacts.load(spoiled / "found.parquet")
    assert set(kept.sensor) == set(SENSORS) - {"ring"}
    for name in set(kept.sensor):
        np.testing.assert_array_equal(kept.of(name).point, found.of(name).point)
        np.testing.assert_array_equal(kept.of(name).force, found.of(name).force)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_joints(_degrees), r"/joint_states: joint '.*' reads up to .* in degrees"),
        (_joints(_one_less), r"'/joint_states' has no position of the joint 'ring_1_joint'"),
        (_without_joints, r"no topic '/joint_states' of joint states"),
        (("robot.toml", '"/little/skin"', '"/ring/skin"'), r"'ring' and 'little' both read the topic '/ring/skin'"),
        (("robot.toml", 'base = "palm"', 'base = "plam"'), r"no link 'plam'.*palm"),
        (("robot.urdf", "</robot>", '<link name="shelf"/></robot>'), r"2 trees, with the roots 'palm', 'shelf'"),
        (("robot.urdf", "</robot>", f"{CLOSING}</robot>"), r"'ring_tip' has 2 parents, .*'closing'"),
    ],
)
def test_mistakes_in_joint_states_rig_or_urdf_are_one_sentence(
    spoiled: Path, capsys: pytest.CaptureFixture[str], change: Change | tuple[str, str, str], said: str
) -> None:
    _edit(spoiled, *change) if isinstance(change, tuple) else _rewrite(spoiled, change)
    code, _, err = _estimate(spoiled, capsys, "--frame", "base")
    assert code == 1
    assert re.search(said, err)
    assert err.count("\n") == 1


def test_a_log_of_which_no_sensor_can_be_used_names_each(spoiled: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _rewrite(spoiled, lambda topic, data: data if topic == JOINTS else None)
    code, _, err = _estimate(spoiled, capsys)
    assert code == 1
    assert all(f"{name}: " in err for name in SENSORS)
    code, _, err = _estimate(spoiled, capsys, "--sensor", "thum")
    assert code == 1
    assert "no sensor 'thum'" in err
    assert "thumb" in err
