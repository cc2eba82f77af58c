"""Arrays, wrenches and poses are the same channels from a table, an .npz and topics; what a log has is told unread."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from claims.evidence.logs_written import (
    COLUMNS,
    POSE,
    ROS1,
    ROS2,
    STAMPED,
    WRENCH,
    Session,
    cdr,
    session,
    write_csv,
    write_mcap,
    write_parquet,
    write_ros1,
)
from palpate.errors import InputError
from palpate.files.logs import ArrayChannel, LogLayout, contents, missing, open_log, read_recording
from palpate.files.logs.cursor import Cursor
from palpate.files.logs.decoding import ARRAYS, decode
from palpate.files.logs.message_fields import field_of
from palpate.files.messages import MessageBlock, Topic
from palpate.signals.recording import CELLS, FORCE, ORIENTATION, POSITION, REFERENCE, TORQUE, VOLTAGE
from tests.support.skin_formats import FRAMES, RIGHT, TIME

LOG = session(60)
ROWS = np.random.default_rng(3).integers(0, 200, (60, 3, 4)).astype(np.float64)
SHEET = ArrayChannel(CELLS, (3, 4), table="skin")
SKIN = LogLayout(wrench=None, arrays=(SHEET,))
CELL_TOPIC, ARRAY = "/skin", "std_msgs/msg/Float64MultiArray"
DEPTHS = {
    "mono8": "u1",
    "8UC1": "u1",
    "8SC1": "i1",
    "mono16": "u2",
    "16UC1": "u2",
    "16SC1": "i2",
    "32SC1": "i4",
    "32FC1": "f4",
    "64FC1": "f8",
}


def _array(values: np.ndarray, kind: str = ARRAY, front: int = 0, types: Any = ROS2.types) -> Any:
    layout = types["std_msgs/msg/MultiArrayLayout"]([], front)
    return types[kind](layout, np.concatenate([np.zeros(front, values.dtype), values.ravel()]))


def _table(path: Path, log: Session = LOG) -> pl.DataFrame:
    cells = {f"c{k}": ROWS.reshape(60, -1)[:, k] for k in range(12)}
    frame = pl.DataFrame(dict(zip(COLUMNS, log.table.T, strict=True)) | cells)
    return frame.drop(COLUMNS[1:7])


def _mcap(path: Path) -> None:
    kinds = {CELL_TOPIC: ARRAY, POSE: STAMPED[POSE]}
    messages = list(LOG.messages())[1::2]
    arrays = [(stamp, CELL_TOPIC, _array(ROWS[k])) for k, (stamp, _, _) in enumerate(messages)]
    write_mcap(path, [both for pair in zip(arrays, messages, strict=True) for both in pair], kinds)


FORMATS: dict[str, Callable[[Path], object]] = {
    "log.csv": lambda path: _table(path).write_csv(path),
    "log.parquet": lambda path: _table(path).write_parquet(path),
    "log.npz": lambda path: np.savez(
        path, time=LOG.table[:, 0], frames=ROWS, orientation=LOG.quaternion, position=LOG.position
    ),
    "log.mcap": _mcap,
}


@pytest.mark.parametrize("name", FORMATS)
def test_frames_have_poses_whatever_the_format(tmp_path: Path, name: str) -> None:
    FORMATS[name](tmp_path / name)
    found = read_recording(tmp_path / name, SKIN)
    assert set(found.channels) == {CELLS, ORIENTATION, POSITION}
    np.testing.assert_array_equal(found.channels[CELLS], ROWS)
    np.testing.assert_array_equal(found.channels[ORIENTATION], LOG.quaternion)
    np.testing.assert_array_equal(found.channels[POSITION], LOG.position)
    np.testing.assert_array_equal(found.time, LOG.table[:, 0])
    assert missing(contents(tmp_path / name), SKIN) == []
    times, frames = map(np.concatenate, zip(*open_log(tmp_path / name, SKIN).stored(), strict=True))
    np.testing.assert_array_equal(times, LOG.table[:, 0])
    np.testing.assert_array_equal(frames, ROWS.reshape(60, -1))


def _wrenches(path: Path) -> None:
    np.savez(
        path,
        time=LOG.table[:, 0],
        force=LOG.wrench[:, :3],
        torque=LOG.wrench[:, 3:],
        orientation=LOG.quaternion,
        position=LOG.position,
    )


WRENCHES: dict[str, Callable[[Path], object]] = {
    "log.csv": lambda path: write_csv(path, LOG),
    "log.parquet": lambda path: write_parquet(path, LOG),
    "arrays.npz": _wrenches,
    "six.npz": lambda path: np.savez(path, time=LOG.table[:, [0]], wrench=LOG.wrench, orientation=LOG.quaternion),
    "columns.npz": lambda path: np.savez(path, **dict(zip(COLUMNS, LOG.table.T, strict=True))),
    "log.mcap": lambda path: write_mcap(path, LOG.messages()),
    "log.bag": lambda path: write_ros1(path, LOG),
}


@pytest.mark.parametrize("name", WRENCHES)
def test_channels_are_read_only_and_by_rows_from_every_reader(tmp_path: Path, name: str) -> None:
    """What is held by columns makes numba compile every kernel once more."""
    WRENCHES[name](tmp_path / name)
    log = open_log(tmp_path / name, LogLayout(axes=("z", "x", "y"), wrench_topic=WRENCH, orientation_topic=POSE))
    for block in log.blocks():
        assert {FORCE, TORQUE, ORIENTATION} <= set(block.channels)
        np.testing.assert_array_equal(block.wrenches(), LOG.wrench[:, [2, 0, 1, 5, 3, 4]])
        for values in (block.time, *block.channels.values()):
            assert values.dtype == np.float64
            assert values.flags.c_contiguous
            assert not values.flags.writeable


def test_voltages_and_their_reference_are_arrays_of_one_table(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    volts, reference, time = rng.normal(size=(20, 9)), rng.normal(size=(20, 6)), np.arange(20) / 100
    named = ArrayChannel(REFERENCE, (6,), tuple(f"r{k}" for k in range(6)))
    layout = LogLayout(wrench=None, arrays=(ArrayChannel(VOLTAGE, (9,), scale=1e-3, table="load_cells"), named))
    columns = {f"u{k}": volts[:, k] for k in range(9)} | {f"r{k}": reference[:, k] for k in range(6)}
    pl.DataFrame({"time": time, **columns}).write_csv(tmp_path / "log.csv")
    np.savez(tmp_path / "log.npz", time=time, voltage=volts, reference=reference)
    for name in ("log.csv", "log.npz"):
        found = read_recording(tmp_path / name, layout)
        np.testing.assert_array_equal(found.channels[VOLTAGE], volts * 1e-3)
        np.testing.assert_array_equal(found.channels[REFERENCE], reference)
    write_mcap(tmp_path / "log.mcap", [(1, CELL_TOPIC, _array(volts[0]))], {CELL_TOPIC: ARRAY})
    with pytest.raises(InputError, match=r"voltage and reference cannot be read from one log of topics.*Write"):
        read_recording(tmp_path / "log.mcap", layout)


def test_a_file_without_times_has_those_of_a_rate(tmp_path: Path) -> None:
    pl.DataFrame({f"c{k}": ROWS.reshape(60, -1)[:, k] for k in range(12)}).write_csv(tmp_path / "log.csv")
    np.save(tmp_path / "log.npy", ROWS)
    for name in ("log.csv", "log.npy"):
        found = read_recording(tmp_path / name, LogLayout(wrench=None, arrays=(SHEET,), rate=50.0))
        np.testing.assert_array_equal(found.time, np.arange(60) / 50.0)
        assert "a rate of 50 Hz is assumed" in found.notes[0]


def test_blocks_do_not_change_what_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.files.logs.columns.BLOCK", 7)
    monkeypatch.setattr("palpate.files.logs.log.Log.block_rows", 7)
    monkeypatch.setattr("palpate.files.logs.parquet.PIECE", 17)
    for name in ("log.npz", "log.mcap", "log.parquet"):
        FORMATS[name](tmp_path / name)
        log = open_log(tmp_path / name, SKIN)
        for _ in range(2):  # once more
            blocks = list(log.blocks())
            assert max(map(len, blocks)) == 7
            np.testing.assert_array_equal(np.concatenate([block.channels[CELLS] for block in blocks]), ROWS)
            assert log.position == log.size


@pytest.mark.parametrize("encoding", ["cdr", "cdr, big endian", "ros1"])
@pytest.mark.parametrize("kind", ARRAYS)
@pytest.mark.parametrize("labels", [(), ("a",), ("rows", "of columns")])
def test_every_array_is_read_as_rosbags_wrote_it(kind: str, encoding: str, labels: tuple[str, ...]) -> None:
    """With dimensions and others in front; one message in between that holds one number less, another that is cut."""
    store = ROS1 if encoding == "ros1" else ROS2
    name, types, rng = kind.replace("/", "/msg/"), store.types, np.random.default_rng(0)
    truth = rng.integers(0, 100, (6, 12)).astype(ARRAYS[kind])
    dims = [types["std_msgs/msg/MultiArrayDimension"](label, k, k + 1) for k, label in enumerate(labels)]
    raws: list[bytes] = []
    for k, values in enumerate(truth):
        held = np.concatenate([np.ones(k, values.dtype), values if k != 3 else values[:-1]])
        message = types[name](types["std_msgs/msg/MultiArrayLayout"](dims[: k + 1], k), held)
        raws.append(_serialized(message, name, encoding))
    raws[5] = raws[5][:-1]
    stamps, values, sound = decode(_together(raws), Topic("", kind, encoding[:4].strip(",")), (12,))
    assert sound.tolist() == [True, True, True, False, True, False]
    assert values[sound].tolist() == truth[sound].tolist()
    assert np.isnan(values[~sound]).all()
    assert not stamps.any()


@pytest.mark.parametrize("encoding", ["cdr", "cdr, big endian", "ros1"])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("depth", DEPTHS)
def test_every_image_is_read_as_rosbags_wrote_it(depth: str, order: str, encoding: str) -> None:
    """Rows longer than their pixels, frames of any length; what is of another make, colour or size keeps its row."""
    truth = np.random.default_rng(0).integers(0, 100, (8, 3, 4)).astype(order + DEPTHS[depth])
    raws: list[bytes] = []
    for k, pixels in enumerate(truth):
        step = 4 * pixels.itemsize + 3 * (k % 3)
        lines = np.zeros((3, step), dtype=np.uint8)
        lines[:, : 4 * pixels.itemsize] = np.ascontiguousarray(pixels).view(np.uint8)
        made = "rgb8" if k == 5 else "bayer_rggb8" if k == 6 else depth
        image = _image(encoding, k, (3, 5 if k == 4 else 4), made, order == ">", step, lines.ravel())
        raws.append(_serialized(image, "sensor_msgs/msg/Image", encoding))
    raws[7] = raws[7][:-1]
    stamps, values, sound = decode(_together(raws), Topic("", "sensor_msgs/Image", encoding[:4].strip(",")), (3, 4))
    assert sound.tolist() == [True] * 4 + [False] * 4
    assert values[sound].tolist() == truth[sound].reshape(-1, 12).astype(float).tolist()
    assert np.isnan(values[~sound]).all()
    assert stamps[sound].tolist() == [k * 10**9 + 5 for k in range(4)]


def test_a_message_cut_anywhere_cannot_be_read() -> None:
    lines = np.arange(12, dtype=np.uint8)
    image = _serialized(_image("cdr", 1, (3, 4), "mono8", False, 4, lines), "sensor_msgs/msg/Image", "cdr")
    for whole, kind in ((image, "sensor_msgs/Image"), (cdr(_array(np.arange(12.0))), "std_msgs/Float64MultiArray")):
        raws = [whole[:kept] for kept in range(len(whole) + 1)]
        _, values, sound = decode(_together([*raws, whole]), Topic("", kind, "cdr"), (3, 4))
        assert np.flatnonzero(sound).tolist() == [len(raws) - 1, len(raws)]
        assert values[sound].tolist() == [list(range(12))] * 2


def _image(
    encoding: str, second: int, size: tuple[int, int], depth: str, big: bool, step: int, data: np.ndarray
) -> Any:
    types: Any = ROS1.types if encoding == "ros1" else ROS2.types
    time, make = types["builtin_interfaces/msg/Time"](second, 5), types["std_msgs/msg/Header"]
    header = make(7, time, "x" * second) if encoding == "ros1" else make(time, "x" * second)
    return types["sensor_msgs/msg/Image"](header, *size, depth, int(big), step, data)


def _serialized(message: Any, name: str, encoding: str) -> bytes:
    if encoding == "ros1":
        return bytes(ROS1.serialize_ros1(message, name))
    return bytes(ROS2.serialize_cdr(message, name, little_endian="big" not in encoding))


def _together(raws: list[bytes]) -> MessageBlock:
    length, nothing = np.array([len(raw) for raw in raws]), np.zeros(len(raws), dtype=int)
    return MessageBlock(b"".join(raws), {}, nothing, nothing, np.cumsum(length) - length, length)


def test_numbers_stand_behind_any_list_of_messages_but_one_too_long() -> None:
    name, rule, counts = "skin/msg/Pad", "=" * 80, [0, 4097, 3, 4096]
    text = f"skin/Cell[] cells\nfloat64[] values\n{rule}\nMSG: skin/Cell\nuint8 state\nstring name\n"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, name))
    cells = [store.types["skin/msg/Cell"](1, "c" * (k % 5)) for k in range(max(counts))]
    pads = [store.types[name](cells[:count], np.array([count, -2.0])) for count in counts]
    cursor = Cursor(_together([bytes(store.serialize_cdr(pad, name)) for pad in pads]), "cdr")
    path = field_of(Topic("", "skin/Pad", "cdr", definition=text), "values")
    assert path.read(cursor, 2)[cursor.sound].tolist() == [[count, -2.0] for count in counts if count <= 4096]


@pytest.mark.parametrize("name", ["long_shuffled", "long_cells", "long_scanned", "tekscan", "blocks", "blocks_timed"])
def test_frames_of_several_lines_are_those_that_were_written(name: str, tmp_path: Path) -> None:
    file, write, _, rate = RIGHT[name]
    write(tmp_path / file)
    time, sheet = "t" if name == "long_cells" else "time", ArrayChannel(CELLS, FRAMES.shape[1:])
    found = read_recording(tmp_path / file, LogLayout(time, wrench=None, arrays=(sheet,), rate=rate))
    np.testing.assert_array_equal(found.channels[CELLS], FRAMES)
    np.testing.assert_allclose(found.time, TIME, atol=1e-12)


def test_what_a_log_has_is_told_before_it_is_read(tmp_path: Path) -> None:
    for name, write in {**FORMATS, **WRENCHES}.items():
        write(tmp_path / name)
    assert list(contents(tmp_path / "log.csv").names) == list(COLUMNS)
    (tmp_path / "rows.csv").write_text("time,temp,taxel,value\n" + 9 * "0,31,1,5\n")  # either may be the time
    assert list(contents(tmp_path / "rows.csv").names) == ["time", "temp", "taxel", "value"]
    assert contents(tmp_path / "arrays.npz").names == {
        "time": (),
        "force": (3,),
        "torque": (3,),
        "orientation": (4,),
        "position": (3,),
    }
    assert {topic.name for topic in contents(tmp_path / "log.bag").topics} == {WRENCH, POSE}
    cells = LogLayout(wrench=None, arrays=(ArrayChannel(VOLTAGE, (9,), tuple("abcdefghi"), table="load_cells"),))
    for name in WRENCHES:
        assert missing(contents(tmp_path / name), LogLayout()) == []
        assert len(missing(contents(tmp_path / name), cells)) == 1
    FORMATS["log.npz"](tmp_path / "frames.npz")
    FORMATS["log.mcap"](tmp_path / "frames.mcap")
    assert missing(contents(tmp_path / "frames.npz"), LogLayout())[0].startswith("there is no column 'fx'")
    assert missing(contents(tmp_path / "frames.mcap"), LogLayout())[0].startswith("no topic holds wrenches")
    assert missing(contents(tmp_path / "frames.npz"), cells) == ["has no array 'voltage'."]


@pytest.mark.parametrize("suffix", [".mcap", ".parquet", ".bag", ".db3", ".npy", ".npz"])
def test_a_file_is_what_its_suffix_says_or_is_refused(tmp_path: Path, suffix: str) -> None:
    write_csv(tmp_path / f"log{suffix}", LOG)
    np.savez(tmp_path / "arrays.npz", time=LOG.table[:, 0])
    wrong = "log.parquet" if suffix == ".mcap" else "log.mcap"
    WRENCHES[wrong](tmp_path / wrong)
    (tmp_path / f"other{suffix}").write_bytes((tmp_path / wrong).read_bytes())
    for read in (contents, read_recording):
        with pytest.raises(InputError, match=r": does not begin as"):
            read(tmp_path / f"log{suffix}")
        with pytest.raises(InputError, match=r"does not begin as .* rename it"):
            read(tmp_path / f"other{suffix}")


@pytest.mark.parametrize("name", WRENCHES)
def test_a_file_of_another_suffix_is_told_by_what_is_in_it(tmp_path: Path, name: str) -> None:
    WRENCHES[name](tmp_path / name)
    if name.endswith(".bag"):
        return  # rosbags goes by the suffix
    (tmp_path / name).rename(tmp_path / "log.dat")
    assert len(read_recording(tmp_path / "log.dat")) == 60


@pytest.mark.parametrize(
    ("arrays", "word"),
    [
        ({"frames": ROWS}, "has no array of times, 'time'.*Write"),
        ({"time": np.arange(60.0)}, "has 0 columns in addition to the time|has no array"),
        ({"time": np.arange(60.0), "cels": ROWS[:, :2]}, "has no array 'frames'.*Available"),
        ({"time": np.arange(59.0), "frames": ROWS}, "npz: has 59 rows of time and 60 rows of frames"),
        ({"time": np.arange(60.0), "frames": ROWS > 3}, "npz: .*frames holds bool, not numbers"),
        ({"time": np.arange(0.0), "frames": ROWS[:0]}, "npz: holds no samples"),
        ({"time": np.arange(60.0), "frames": ROWS.astype("U4")}, "npz: .*not numbers"),
        ({"time": np.float64(1.0), "frames": ROWS}, "has no array of times.*Write"),
    ],
)
def test_arrays_that_cannot_be_meant_are_refused(tmp_path: Path, arrays: dict[str, np.ndarray], word: str) -> None:
    np.savez(tmp_path / "log.npz", **arrays)
    with pytest.raises(InputError, match=word):
        read_recording(tmp_path / "log.npz", SKIN)
