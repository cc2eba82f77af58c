"""Logs of frames: what does not fit is said, and keeps its row; a bag of ROS 1, and damage."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from palpate.errors import InputError
from palpate.files.logs import ArrayChannel, LogLayout, open_log
from palpate.signals.recording import CELLS as CHANNEL
from tests.support.skin_formats import RIGHT

CELLS = np.random.default_rng(1).integers(0, 256, (9, 3, 4)).astype(np.float64)
TIME = 100.0 + np.arange(9) / 50.0


def _layout(rows: int = 3, columns: int = 4, *, cells: tuple[str, ...] | None = None, **changes: Any) -> LogLayout:
    return LogLayout(wrench=None, arrays=(ArrayChannel(CHANNEL, (rows, columns), cells, table="skin"),), **changes)


def _csv(path: Path, cells: np.ndarray = CELLS) -> Path:
    flat = cells.reshape(len(cells), -1)
    pl.DataFrame({"time": TIME[: len(cells)]} | {f"c{k}": flat[:, k] for k in range(flat.shape[1])}).write_csv(path)
    return path


def _read(path: Path, layout: LogLayout | None = None) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    log = open_log(path, layout or _layout())
    blocks = list(log.blocks())
    return np.concatenate([b.time for b in blocks]), np.concatenate([b.channels[CHANNEL] for b in blocks]), log.notes()


def test_messages_of_another_size_keep_their_rows(tmp_path: Path) -> None:
    RIGHT["multi_array"][1](tmp_path / "bag")
    _, cells, notes = _read(tmp_path / "bag", _layout(3, 5))
    assert cells.shape == (40, 3, 5)
    assert np.isnan(cells).all()
    assert "40 of 40 messages of '/skin' are cut short, or do not hold 3 x 5 numbers" in notes[0]


def test_a_table_of_another_sheet_is_refused_with_both_sizes(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"12 columns in addition to the time, but 132 cells .6 x 22. are needed"):
        _read(_csv(tmp_path / "log.csv"), _layout(6, 22))
    np.savez(tmp_path / "log.npz", time=TIME, frames=CELLS)
    with pytest.raises(InputError, match=r"array 'frames' holds n x 3 x 4 numbers, not 6 x 22.*Correct"):
        _read(tmp_path / "log.npz", _layout(6, 22))


def test_a_row_that_is_cut_or_holds_text_stays_and_is_named(tmp_path: Path) -> None:
    path = _csv(tmp_path / "log.csv")
    lines = path.read_text().splitlines()
    lines[3] = lines[3].rsplit(",", 2)[0]
    lines[5] = lines[5].replace(",", ",oops", 1)
    path.write_text("\n".join(lines) + "\n")
    _, cells, notes = _read(path)
    assert len(cells) == 9
    assert np.isnan(cells[2]).all()
    assert np.isnan(cells[4]).any()
    assert notes[0] == "1 rows do not have 13 fields (first: line 4)"
    assert any("column 'c0', 'oops" in note for note in notes)


def test_columns_may_be_named(tmp_path: Path) -> None:
    path = _csv(tmp_path / "log.csv")
    named = _layout(1, 3, cells=("c2", "c0", "c11"))
    _, cells, _ = _read(path, named)
    np.testing.assert_array_equal(cells[:, 0], CELLS.reshape(9, 12)[:, [2, 0, 11]])
    with pytest.raises(InputError, match=r"no column 'c99'.*Did"):
        _read(path, _layout(1, 2, cells=("c0", "c99")))


def test_pickles_are_never_opened(tmp_path: Path) -> None:
    np.save(tmp_path / "evil.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match=r"npy: .*not a NumPy file that can be read"):
        _read(tmp_path / "evil.npy")


def test_a_bag_of_ros_1_is_read(tmp_path: Path) -> None:
    """There nothing is aligned, and the header begins with a number of its own."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types: Any = store.types
    kind = "sensor_msgs/msg/Image"
    with Writer(tmp_path / "log.bag") as writer:
        topic = writer.add_connection("/skin", kind, typestore=store)
        for k, cells in enumerate(CELLS):
            stamp = round(TIME[k] * 1e9)
            header = types["std_msgs/msg/Header"](k, types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), "a")
            image = types[kind](header, 3, 4, "mono16", 0, 8, cells.astype("<u2").view(np.uint8).ravel())
            writer.write(topic, stamp, store.serialize_ros1(image, kind))
    time, cells, _ = _read(tmp_path / "log.bag")
    np.testing.assert_array_equal(cells, CELLS)
    np.testing.assert_allclose(time, TIME, atol=1e-9)


def test_a_damaged_archive_is_said_and_nothing_else_is_raised(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", time=TIME, frames=CELLS)
    whole = (tmp_path / "log.npz").read_bytes()
    rng = np.random.default_rng(2)
    for _ in range(60):
        raw = bytearray(whole[: rng.integers(len(whole) // 2, len(whole) + 1)])
        raw[rng.integers(4, len(raw))] ^= int(rng.integers(1, 256))
        (tmp_path / "log.npz").write_bytes(bytes(raw))
        said = "log.npz"
        try:
            _read(tmp_path / "log.npz")
        except InputError as problem:
            said = str(problem)
        assert "log.npz" in said
