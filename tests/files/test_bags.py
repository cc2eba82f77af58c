"""One session as CSV, Parquet, MCAP and bags is one recording, to the last bit; a bag that is damaged is said to be."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin

from claims.evidence.logs_written import (
    POSE,
    WRENCH,
    Session,
    session,
    write_csv,
    write_mcap,
    write_parquet,
    write_ros1,
    write_ros2,
)
from palpate.errors import InputError
from palpate.files.logs import contents, open_log, read_recording
from palpate.files.logs.layout import LogLayout
from palpate.signals.recording import FORCE, ORIENTATION, POSITION, TORQUE

YEAR_2023 = 1_700_000_000_123_456_789  # ns: more than 53 bits

FORMATS: dict[str, Callable[[Path, Session], None]] = {
    "log.csv": write_csv,
    "log.parquet": write_parquet,
    "log.mcap": lambda path, log: write_mcap(path, log.messages()),
    "zstd.mcap": lambda path, log: write_mcap(path, log.messages(), compression=CompressionType.ZSTD, chunk_size=5000),
    "lz4.mcap": lambda path, log: write_mcap(path, log.messages(), compression=CompressionType.LZ4),
    "plain.mcap": lambda path, log: write_mcap(path, log.messages(), use_chunking=False),
    "bag": lambda path, log: write_ros2(path, log.messages(), StoragePlugin.SQLITE3),
    "bag_mcap": lambda path, log: write_ros2(path, log.messages(), StoragePlugin.MCAP),
    "log.bag": write_ros1,
}


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("start", [0, YEAR_2023])
def test_one_session_is_one_recording_whatever_its_format(tmp_path: Path, name: str, start: int) -> None:
    log = session(start=start)
    FORMATS[name](tmp_path / name, log)
    recording = read_recording(tmp_path / name, LogLayout(wrench_topic=WRENCH, orientation_topic=POSE))
    assert recording.notes == ()
    assert np.array_equal(recording.time, log.table[:, 0])
    assert set(recording.channels) == {FORCE, TORQUE, ORIENTATION, POSITION}
    assert np.array_equal(np.hstack([*recording.channels.values()]), log.table[:, 1:])


@pytest.mark.parametrize("name", FORMATS)
def test_units_and_axes_apply_to_every_format(tmp_path: Path, name: str) -> None:
    log = session(20)
    FORMATS[name](tmp_path / name, log)
    layout = LogLayout(axes=("-y", "x", "z"), force_unit="kN", torque_unit="N mm", frame="base")
    recording = read_recording(tmp_path / name, layout)
    turned = np.hstack([-log.wrench[:, [1]], log.wrench[:, [0]], log.wrench[:, [2]]])
    assert np.array_equal(recording.channels[FORCE], 1e3 * turned)
    assert recording.frame == "base"


@pytest.mark.parametrize("name", ["log.mcap", "bag", "log.bag"])
def test_topics_are_listed_with_type_and_count(tmp_path: Path, name: str) -> None:
    FORMATS[name](tmp_path / name, session(7))
    stamped = [(WRENCH, "geometry_msgs/WrenchStamped", 7), (POSE, "geometry_msgs/PoseStamped", 7)]
    found = contents(tmp_path / name).topics
    assert sorted((topic.name, topic.kind, topic.count) for topic in found) == sorted(stamped)


def test_a_log_of_columns_has_no_topics(tmp_path: Path) -> None:
    write_csv(tmp_path / "log.csv", session(3))
    assert contents(tmp_path / "log.csv").topics == ()


def test_a_recorder_that_was_killed_leaves_a_folder_that_is_read(tmp_path: Path) -> None:
    """Files of MCAP in their order, the last of them cut, and no metadata."""
    log, folder = session(300), tmp_path / "bag"
    folder.mkdir()
    messages = list(log.messages())
    write_mcap(folder / "bag_9.mcap", messages[:200], use_chunking=False)
    write_mcap(folder / "bag_10.mcap", messages[200:], use_chunking=False)
    cut = (folder / "bag_10.mcap").read_bytes()
    (folder / "bag_10.mcap").write_bytes(cut[: cut.find(log.wrench[250].tobytes())])
    opened = open_log(folder)
    blocks = list(opened.blocks())
    assert np.array_equal(np.concatenate([block.wrenches() for block in blocks]), log.wrench[:250])
    assert opened.torn.startswith("bag_10.mcap: the file is torn")
    assert opened.position == opened.size


def test_blocks_can_be_read_again(tmp_path: Path) -> None:
    for name, write in FORMATS.items():
        write(tmp_path / name, session(50))
        log = open_log(tmp_path / name)
        counts = [sum(len(block) for block in log.blocks()) for _ in range(2)]
        assert counts == [50, 50]
        assert log.position == log.size
        assert log.torn == ""


@pytest.mark.parametrize("name", ["log.bag", "log.db3"])
@pytest.mark.parametrize("kept", [20, 2000, 9000])
def test_a_bag_that_was_cut_is_refused_in_a_sentence(tmp_path: Path, name: str, kept: int) -> None:
    if name == "log.bag":
        write_ros1(tmp_path / name, session(200))
    else:
        write_ros2(tmp_path / "bag", session(200).messages(), StoragePlugin.SQLITE3)
        shutil.copy(next((tmp_path / "bag").glob("*.db3")), tmp_path / name)
    path = tmp_path / name
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match=r"a bag that cannot be read .*reindex"):
        read_recording(path)


def test_a_database_alone_is_read_too(tmp_path: Path) -> None:
    log = session(40)
    write_ros2(tmp_path / "bag", log.messages(), StoragePlugin.SQLITE3)
    recording = read_recording(next((tmp_path / "bag").glob("*.db3")))
    assert np.array_equal(recording.wrenches(), log.wrench)


def test_a_folder_that_is_no_bag_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"without metadata\.yaml.*Name"):
        read_recording(tmp_path)
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: 3\n")
    with pytest.raises(InputError, match=r"a bag that cannot be read.*Repair"):
        read_recording(tmp_path)


def test_a_folder_of_several_recordings_is_not_one(tmp_path: Path) -> None:
    for name in ("monday.mcap", "tuesday.mcap"):
        write_mcap(tmp_path / name, session(3).messages())
    with pytest.raises(InputError, match=r"several recordings: monday\.mcap, tuesday\.mcap.*Name"):
        read_recording(tmp_path)
