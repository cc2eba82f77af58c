"""Topics of an MCAP file become rows: every type as rosbags understands it, poses at the wrenches' times."""

import zlib
from pathlib import Path
from struct import pack
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation, Slerp

from claims.evidence.logs_written import (
    POSE,
    ROS1,
    ROS2,
    STAMPED,
    WRENCH,
    cdr,
    header,
    pose_stamped,
    session,
    vector,
    wrench_stamped,
    write_mcap,
)
from palpate.errors import InputError
from palpate.files.logs import open_log, read_recording
from palpate.files.logs.decoding import FIXED, decode, seconds
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.opening import messages_of
from palpate.files.logs.stamp_delays import stamp_delays
from palpate.files.mcap._walk import walk
from palpate.files.mcap.reader import MAGIC
from palpate.files.mcap.regain import SequenceSpan, regained
from palpate.files.mcap.writer import MESSAGE, McapWriter, WrittenTopic
from palpate.files.messages import MessageBlock, Topic
from palpate.signals.recording import ACCELERATION, ORIENTATION, POSITION, Recording

IMU = "/imu"


def _numbers(message: Any) -> list[float]:
    """All numbers of a message in the order of its definition, the header left out: an oracle for `decode`."""
    if isinstance(message, float):
        return [message]
    if isinstance(message, np.ndarray):
        return message.tolist()
    fields = [name for name in message.__dataclass_fields__ if name not in ("__msgtype__", "header", "child_frame_id")]
    return [number for name in fields for number in _numbers(getattr(message, name))]


def _random(kind: str, store: Any, rng: np.random.Generator, name: str) -> Any:
    """A message of any type, its doubles random and its strings `name`."""
    made: dict[str, Any] = {}
    for field, (node, what) in store.fielddefs[kind][1]:
        if node == 1 and what[0] == "string":
            made[field] = name
        elif node == 1:
            made[field] = float(rng.normal()) if what[0] == "float64" else int(rng.integers(1, 2**31 - 1))
        elif node == 2:
            made[field] = _random(what, store, rng, name)
        else:
            made[field] = rng.normal(size=what[1])
    return store.types[kind](**made)


@pytest.mark.parametrize("encoding", ["cdr", "cdr, big endian", "ros1"])
@pytest.mark.parametrize("kind", FIXED)
def test_every_type_is_read_as_rosbags_wrote_it(kind: str, encoding: str) -> None:
    rng, name = np.random.default_rng(0), kind.replace("/", "/msg/")
    store = ROS1 if encoding == "ros1" else ROS2
    messages = [_random(name, store, rng, "x" * length) for length in range(18)]
    raws = [
        bytes(
            store.serialize_ros1(m, name)
            if store is ROS1
            else store.serialize_cdr(m, name, little_endian="big" not in encoding)
        )
        for m in messages
    ]
    length = np.array([len(raw) for raw in raws])
    nothing = np.zeros(len(raws), dtype=int)
    given = MessageBlock(b"".join(raws), {}, nothing, nothing, np.cumsum(length) - length, length)
    stamps, values, sound = decode(given, Topic("", kind, encoding[:4].strip(",")))
    assert sound.all()
    first, last = FIXED[kind].before, FIXED[kind].before + FIXED[kind].count
    assert values.tolist() == [_numbers(message)[first:last] for message in messages]
    if FIXED[kind].strings:
        assert stamps.tolist() == [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages]


def test_a_message_that_is_cut_is_a_row_without_numbers(tmp_path: Path) -> None:
    """At every length of one message in between whole ones."""
    whole = cdr(wrench_stamped(10**9, np.arange(6.0)))
    others = [wrench_stamped(k * 10**9, np.full(6, k)) for k in (2, 3)]
    for kept in range(len(whole)):
        messages = [(1, WRENCH, whole[:kept]), *((k, WRENCH, other) for k, other in enumerate(others, start=2))]
        write_mcap(tmp_path / "log.mcap", messages)
        recording = read_recording(tmp_path / "log.mcap")
        assert np.isnan(recording.wrenches()[0]).all()
        assert recording.wrenches()[1:].tolist() == [[2] * 6, [3] * 6]
        assert "1 of 3 messages of '/ft/wrench' are cut short" in recording.notes[0]


def test_the_kernel_finds_what_the_mcap_library_finds(tmp_path: Path) -> None:
    """Compiled or not."""
    write_mcap(tmp_path / "log.mcap", session(40).messages(), use_chunking=False)
    raw = (tmp_path / "log.mcap").read_bytes()
    found: list[list[tuple[int, bytes]]] = []
    for function in (walk, walk.py_func):
        messages, others = np.empty((4, 100), dtype=np.int64), np.empty((100, 3), dtype=np.int64)
        count, rest, _ = function(np.frombuffer(raw, dtype=np.uint8), len(MAGIC), messages, others)
        found.append([(time, raw[at : at + length]) for _, time, at, length in messages[:, :count].T.tolist()])
        assert others[:rest, 0].tolist()[-1] == 2  # the footer is the last
    with (tmp_path / "log.mcap").open("rb") as file:
        truth = [(message.log_time, message.data) for _, _, message in make_reader(file).iter_messages()]
    assert found == [truth, truth]


@pytest.mark.parametrize(
    "text", ["0.235", "0.000000001", "4503599.627370495", "1700000000.123456789", "2147483647.999999999"]
)
def test_a_stamp_is_the_double_nearest_to_its_decimal(text: str) -> None:
    whole, rest = text.split(".")
    nanoseconds = int(whole) * 10**9 + int(rest.ljust(9, "0"))
    assert seconds(np.array([nanoseconds]))[0] == float(text)


def test_without_stamps_the_times_of_recording_are_taken(tmp_path: Path) -> None:
    messages = [(10**9 * k, WRENCH, wrench_stamped(0, np.ones(6))) for k in range(3, 6)]
    write_mcap(tmp_path / "log.mcap", messages)
    recording = read_recording(tmp_path / "log.mcap")
    assert recording.time.tolist() == [3, 4, 5]
    assert "'/ft/wrench' have no stamps" in recording.notes[0]
    bare = ROS2.types["geometry_msgs/msg/Wrench"](vector(np.arange(3)), vector(np.arange(3, 6)))
    write_mcap(tmp_path / "log.mcap", [(10**9, WRENCH, bare)], {WRENCH: "geometry_msgs/msg/Wrench"})
    recording = read_recording(tmp_path / "log.mcap")
    assert recording.time.tolist() == [1]
    assert recording.wrenches().tolist() == [[0, 1, 2, 3, 4, 5]]


def test_a_clock_may_begin_at_zero(tmp_path: Path) -> None:
    messages = [(77 + stamp, WRENCH, wrench_stamped(stamp, np.ones(6))) for stamp in (0, 10**9)]
    write_mcap(tmp_path / "log.mcap", messages, chunk_size=10)
    assert read_recording(tmp_path / "log.mcap").time.tolist() == [0, 1]


def _two_rates(count: int = 2000, every: int = 10, late: int = 0) -> list[tuple[int, str, Any]]:
    """Wrenches at 1 kHz; poses more slowly, recorded `late` milliseconds after their stamps."""
    log = session(count, start=10**9)
    messages: list[tuple[int, str, Any]] = []
    for k, stamp in enumerate(log.stamp.tolist()):
        messages.append((stamp, WRENCH, wrench_stamped(stamp, log.wrench[k])))
        if k % every == 0:
            turned = Rotation.from_euler("xyz", [0.1 * k / every, 0.2, 0]).as_quat()
            messages.append((stamp + late * 10**6, POSE, pose_stamped(stamp, turned, np.array([k, 0, 1.0]))))
    return sorted(messages, key=lambda message: message[0])


def test_poses_of_another_rate_are_interpolated(tmp_path: Path) -> None:
    write_mcap(tmp_path / "log.mcap", _two_rates())
    recording = read_recording(tmp_path / "log.mcap", LogLayout(offset=0.004))
    stamps = 1.0 + 0.01 * np.arange(200) + 0.004
    turned = Slerp(stamps, Rotation.from_euler("xyz", [[0.1 * k, 0.2, 0] for k in range(200)]))
    inside = (recording.time >= stamps[0]) & (recording.time <= stamps[-1])
    assert np.array_equal(inside, np.isfinite(recording.channels[ORIENTATION]).all(axis=1))
    difference = turned(recording.time[inside]).inv() * Rotation.from_quat(recording.channels[ORIENTATION][inside])
    assert difference.magnitude().max() < 1e-9  # times of a few seconds in float64, turning at 10 rad/s
    x = np.interp(recording.time[inside], stamps, 10.0 * np.arange(200))
    assert np.abs(recording.channels[POSITION][inside, 0] - x).max() < 1e-9


def _same(one: Recording, other: Recording) -> bool:
    return all(np.array_equal(one.channels[name], other.channels[name], equal_nan=True) for name in one.channels)


@pytest.mark.parametrize(("chunk", "late"), [(300, 35), (3000, 0), (3000, 35), (10**7, 0), (10**7, 35)])
def test_how_a_file_is_cut_into_chunks_does_not_matter(tmp_path: Path, chunk: int, late: int) -> None:
    write_mcap(tmp_path / "log.mcap", _two_rates(), use_chunking=False)
    write_mcap(tmp_path / "other.mcap", _two_rates(late=late), chunk_size=chunk)
    assert _same(read_recording(tmp_path / "log.mcap"), read_recording(tmp_path / "other.mcap"))


def test_rows_do_not_wait_for_a_topic_that_fell_silent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.files.logs.log.Log.block_rows", 100)
    monkeypatch.setattr("palpate.files.logs.topic_log.HELD", 300)
    monkeypatch.setattr("palpate.files.logs.stuck.FIRST", 100)
    log = session(2000, start=10**9)
    messages = [m for k, m in enumerate(log.messages()) if m[1] == WRENCH or k < 500]
    write_mcap(tmp_path / "log.mcap", messages, chunk_size=3000)
    opened = open_log(tmp_path / "log.mcap")
    blocks = list(opened.blocks())
    assert max(len(block) for block in blocks) <= 500
    assert np.array_equal(np.concatenate([block.wrenches() for block in blocks]), log.wrench)
    known = np.concatenate([np.isfinite(block.channels[ORIENTATION]).all(axis=1) for block in blocks])
    assert np.flatnonzero(known).tolist() == list(range(250))
    assert "samples have no pose" in " ".join(opened.notes())


def test_one_stamp_from_the_future_costs_one_pose(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.files.logs.log.Log.block_rows", 100)
    monkeypatch.setattr("palpate.files.logs.topic_log.HELD", 300)
    log = session(2000, start=10**9)
    messages = list(log.messages())
    messages[1000] = (messages[1000][0], WRENCH, wrench_stamped(2**30 * 10**9, log.wrench[500]))
    write_mcap(tmp_path / "log.mcap", messages, chunk_size=3000)
    recording = read_recording(tmp_path / "log.mcap")
    known = np.isfinite(recording.channels[ORIENTATION]).all(axis=1)
    assert np.flatnonzero(~known).tolist() == [500]


def test_an_acceleration_runs_straight_between_its_readings(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    readings = rng.normal(size=(50, 3))
    kind, types = "sensor_msgs/msg/Imu", ROS2.types
    messages: list[tuple[int, str, Any]] = [
        (t, WRENCH, wrench_stamped(t, np.ones(6))) for t in range(10**9, 2 * 10**9, 10**7)
    ]
    for k, reading in enumerate(readings):
        stamp = 10**9 + 2 * 10**7 * k
        nothing = np.zeros(9)
        turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        zero = vector(np.zeros(3))
        message = types[kind](header(stamp), turn, nothing, zero, nothing, vector(reading), nothing)
        messages.append((stamp, IMU, message))
    messages.sort(key=lambda message: message[0])
    write_mcap(tmp_path / "log.mcap", messages, {WRENCH: STAMPED[WRENCH], IMU: kind})
    assert ACCELERATION not in read_recording(tmp_path / "log.mcap").channels  # it may sit anywhere: to be named
    recording = read_recording(tmp_path / "log.mcap", LogLayout(acceleration_topic=IMU))
    at = 1 + 0.02 * np.arange(50)
    inside = recording.time <= at[-1]
    for k in range(3):
        expected = np.interp(recording.time[inside], at, readings[:, k])
        assert (
            np.abs(recording.channels[ACCELERATION][inside, k] - expected).max() < 1e-12
        )  # a few steps of 1e-16 / 0.02
    assert np.isnan(recording.channels[ACCELERATION][~inside]).all()


@pytest.mark.parametrize(
    ("layout", "word"),
    [
        (LogLayout(), "2 topics hold a wrench: /ft/wrench, /other.*force_torque"),
        (LogLayout(wrench_topic="/ft/wrnch"), "no topic '/ft/wrnch'.*Did you mean '/ft/wrench'"),
        (LogLayout(wrench_topic="/tf"), "'/tf' holds tf2_msgs/TFMessage.*Wrenches are read from WrenchStamped"),
        (LogLayout(wrench_topic="/other", orientation_topic="/tf"), "Poses are read from .*from the tree of /tf if"),
        (LogLayout(wrench_topic="/other", orientation_topic="/ft/wrench"), "holds geometry_msgs/WrenchStamped.*Poses"),
        (LogLayout(wrench_topic="/empty"), "mcap: topic '/empty' has no messages"),
    ],
)
def test_a_topic_that_cannot_be_meant_is_refused(tmp_path: Path, layout: LogLayout, word: str) -> None:
    kinds = {
        WRENCH: STAMPED[WRENCH],
        "/other": STAMPED[WRENCH],
        "/tf": "tf2_msgs/msg/TFMessage",
        "/empty": STAMPED[WRENCH],
    }
    wrench = wrench_stamped(1, np.ones(6))
    write_mcap(tmp_path / "log.mcap", [(1, WRENCH, wrench), (2, "/other", wrench), (3, "/tf", b"\0\1\0\0")], kinds)
    with pytest.raises(InputError, match=word):
        read_recording(tmp_path / "log.mcap", layout)


def test_a_file_without_wrenches_lists_what_it_has(tmp_path: Path) -> None:
    write_mcap(tmp_path / "log.mcap", [m for m in session(3).messages() if m[1] == POSE], {POSE: STAMPED[POSE]})
    with pytest.raises(
        InputError, match=r"no topic holds wrenches; the log has /arm/pose \(geometry_msgs/PoseStamped, 3\).*Wrenches"
    ):
        read_recording(tmp_path / "log.mcap")


def _record(kind: int, content: bytes) -> bytes:
    return pack("<BQ", kind, len(content)) + content


def _text(text: str) -> bytes:
    return pack("<I", len(text)) + text.encode()


SCHEMA = _record(3, pack("<H", 1) + _text("geometry_msgs/msg/WrenchStamped") + _text("ros2msg") + _text(""))
CHANNEL = _record(4, pack("<HH", 1, 1) + _text(WRENCH) + _text("cdr") + pack("<I", 0))
MESSAGES = b"".join(
    _record(5, pack("<HIQQ", 1, k, k, k) + cdr(wrench_stamped(k * 10**9, np.full(6, k)))) for k in (1, 2, 3)
)
END = _record(15, bytes(4)) + _record(2, bytes(20)) + MAGIC


def _chunk(records: bytes, *, size: int | None = None, compression: str = "", checksum: int = 0) -> bytes:
    says = len(records) if size is None else size
    head = pack("<QQQI", 0, 0, says, checksum) + _text(compression) + pack("<Q", len(records))
    return _record(6, head + records)


GOOD = SCHEMA + CHANNEL + MESSAGES


@pytest.mark.parametrize(
    ("records", "count", "word"),
    [
        (GOOD, 3, ""),
        (CHANNEL + SCHEMA + MESSAGES, 3, ""),
        (_chunk(GOOD), 3, ""),
        (_chunk(b"") + _chunk(GOOD), 3, ""),
        (_chunk(GOOD, checksum=zlib.crc32(GOOD)), 3, ""),
        (_record(0x42, b"of the future") + GOOD + _record(9, bytes(1 << 23)) + _chunk(MESSAGES), 6, ""),
        (SCHEMA + CHANNEL + _record(5, pack("<HIQQ", 1, 0, 0, 0) + bytes(1 << 23)) + MESSAGES, 3, ""),
        (GOOD + _chunk(MESSAGES, checksum=1), 6, "a chunk whose checksum does not match"),
        (GOOD + _chunk(MESSAGES, size=1 << 40) + MESSAGES, 6, "a chunk that states a size of more than 1 GiB"),
        (GOOD + _chunk(MESSAGES, compression="br") + MESSAGES, 6, "a chunk whose compression 'br' is not known"),
        (GOOD + _chunk(MESSAGES, compression="zstd") + MESSAGES, 6, "a chunk that does not decompress"),
        (GOOD + _chunk(MESSAGES, compression="lz4") + MESSAGES, 6, "a chunk that does not decompress"),
        (GOOD + _chunk(MESSAGES[:-1]), 5, "a chunk with an incomplete record"),
        (GOOD + _record(6, b"short") + MESSAGES, 6, "a chunk without a complete header"),
        (GOOD + _record(6, bytes(28) + b"\xff\xff\xff\xff") + MESSAGES, 6, "a chunk without a complete header"),
        (GOOD + _record(4, b"\2\0\1\0\xff\xff\xff\x7f/x") + MESSAGES, 6, ""),
        (GOOD + _chunk(_chunk(MESSAGES)), 3, ""),
        (GOOD + _record(0, b"no kind") + MESSAGES, 3, "it is not a valid record"),
        (GOOD + bytes(1000), 3, "it is not a valid record"),
        (GOOD + pack("<BQ", 5, 2**64 - 1) + MESSAGES, 3, "it ends within a record"),
        (GOOD + pack("<BQ", 6, 2**63) + MESSAGES, 3, "a chunk that states a size of more than 1 GiB"),
    ],
)
def test_an_odd_file_is_read_as_far_as_it_can_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, records: bytes, count: int, word: str
) -> None:
    path = tmp_path / "log.mcap"
    monkeypatch.setattr("palpate.files.mcap.reader.LONGEST", {6: 1 << 30})  # of a chunk; of a message as of any record
    path.write_bytes(MAGIC + _record(1, _text("") * 2) + records + END)
    log = open_log(path)
    wrenches = np.concatenate([block.wrenches() for block in log.blocks()])
    known = wrenches[np.isfinite(wrenches).all(axis=1)]
    assert len(known) == count
    assert np.array_equal(known, np.array([1, 2, 3] * 3, dtype=float)[:count, None] * np.ones(6))
    assert bool(log.torn) == bool(word)
    if word:
        with pytest.raises(AssertionError, match=word):
            raise AssertionError(log.torn)


def test_messages_that_belong_to_nothing_are_said(tmp_path: Path) -> None:
    stray = _record(5, pack("<HIQQ", 9, 0, 0, 0) + b"?")
    (tmp_path / "log.mcap").write_bytes(MAGIC + GOOD + stray + END)
    assert "1 messages belong to topics that are not declared" in read_recording(tmp_path / "log.mcap").notes


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("log.mcap", b"", "is empty"),
        ("log.mcap", MAGIC[:5], "does not begin as an MCAP file does"),
        ("log.mcap", MAGIC, "the log has no topics.*torn at byte 8 of 8"),
        ("log.mcap", MAGIC + END, "the log has no topics"),
        ("log.mcap", b"time,fx\n", "does not begin as an MCAP file does"),
        ("log.bag", b"", "is empty"),
        ("log.csv", MAGIC, "the log has no topics"),
        ("log.mcap", MAGIC + SCHEMA + CHANNEL, "no topic holds wrenches; the log has /ft/wrench .*torn"),
        ("log.mcap", MAGIC + CHANNEL + MESSAGES + END, "/ft/wrench .of no type, 3..*Wrenches"),
    ],
)
def test_a_file_that_holds_nothing_is_refused_in_a_sentence(
    tmp_path: Path, name: str, content: bytes, word: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=word):
        read_recording(tmp_path / name)


def test_a_file_whose_writer_was_killed_is_regained_to_its_last_whole_chunk(tmp_path: Path) -> None:
    """Cut or damaged anywhere: the chunks before, with the sequence numbers of each channel; none of another's file."""
    topics = tuple(WrittenTopic(name, "std_msgs/msg/UInt32", "uint32 data") for name in ("/a", "/b"))
    writer, path, kind = McapWriter(topics, "test"), tmp_path / "log.mcap", np.dtype([*MESSAGE.descr, ("data", "<u8")])
    raw, ends = writer.head, [len(writer.head)]
    for first in (10, 20, 30):
        rows = [np.zeros(5 * channel, kind) for channel in (1, 2)]
        for channel, each in enumerate(rows, 1):
            each["opcode"], each["channel"], each["length"] = 5, channel, kind.itemsize - 9
            each["sequence"], each["log"] = first + np.arange(len(each)), 1 + np.arange(len(each))
        made, written = writer.chunk(rows)
        writer.chunks.append(written)
        raw, ends = raw + made, [*ends, len(raw) + len(made)]
    assert ends[-1] == writer.size
    cuts = [(raw[:at], sum(end <= at for end in ends) - 1) for at in range(ends[0], len(raw) + 1, 7)]
    cuts += [(raw[: end + 60] + bytes(40) + raw[end + 100 :], k) for k, end in enumerate(ends[:-1])]
    for text, whole in [*cuts, (raw, 3), (raw + writer.tail(), 3)]:
        path.write_bytes(text)
        found, last = regained(path), 10 * whole
        assert found is not None
        assert (found.topics, found.writer.chunks) == (topics, writer.chunks[:whole])
        numbers = {1: SequenceSpan(10, last + 4, last + 4), 2: SequenceSpan(10, last + 9, last + 9)}
        assert found.sequences == (numbers if whole else {})
    for text in (raw[: ends[0] - 1], raw[1:], raw.replace(b"uint32 data", b"uint64 data")[: len(MAGIC)]):
        path.write_bytes(text)
        assert regained(path) is None


def test_messages_are_recorded_later_than_they_are_stamped(tmp_path: Path) -> None:
    """By 10 ms in the middle, where headers have stamps, which are after 1970; other topics have no delay."""
    late = 0, 10_000_000, 20_000_000, 5 * 10**9
    rows = [(10**9 + k, WRENCH, wrench_stamped(10**9 + k - late[k % 4], np.zeros(6))) for k in range(100)]
    bare = [(10**9 + k, "/bare", ROS2.types["std_msgs/msg/Float64"](1.0)) for k in range(100)]
    kinds = {WRENCH: STAMPED[WRENCH], "/bare": "std_msgs/msg/Float64"}
    write_mcap(tmp_path / "log.mcap", sorted([*rows, *bare], key=lambda each: each[0]), kinds)
    source = messages_of(tmp_path / "log.mcap")
    assert source is not None
    assert stamp_delays(source, [WRENCH, "/bare"]) == {WRENCH: pytest.approx(0.01)}
    assert stamp_delays(source, ["/bare"]) == {}
