"""Voltages as arrays in an MCAP log."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.logs import ArrayChannel, LogLayout, read_recording
from palpate.signals.recording import VOLTAGE

rosbags = pytest.importorskip("rosbags", reason="rosbags writes the logs (pip install 'palpate[ros]')")
NAMES = tuple(f"u{cell}{axis}" for cell in (1, 2, 3) for axis in "xyz")
CELLS = ArrayChannel(VOLTAGE, (9,), NAMES, scale=(1e-3,) * 9, table="load_cells")
LAYOUT = LogLayout(wrench=None, arrays=(CELLS,))


def written(folder: Path, rows: np.ndarray, labels: tuple[str, ...] = ()) -> Path:
    """A bag of MCAP with a row a message, 1 ms apart; with dimensions of these labels."""
    from rosbags.rosbag2 import Writer
    from rosbags.rosbag2.enums import StoragePlugin
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    array, layout, dimension = (
        store.types[f"std_msgs/msg/{name}"] for name in ("Float64MultiArray", "MultiArrayLayout", "MultiArrayDimension")
    )
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/cells", array.__msgtype__, typestore=store)
        for k, row in enumerate(rows):
            dimensions = [dimension(label=label, size=len(row), stride=len(row)) for label in labels]
            message = array(layout=layout(dim=dimensions, data_offset=0), data=row)
            raw = store.serialize_cdr(message, array.__msgtype__)
            writer.write(connection, 10**9 + 10**6 * k, raw)
    return folder / "bag"


@pytest.mark.parametrize("labels", [(), ("cells",), ("a", "second label")])
def test_arrays_are_voltages(tmp_path: Path, labels: tuple[str, ...]) -> None:
    rows = np.random.default_rng(1).normal(size=(50, 9))
    log = read_recording(written(tmp_path, rows, labels), LAYOUT)
    np.testing.assert_array_equal(log.channels[VOLTAGE], rows * 1e-3)
    np.testing.assert_allclose(np.diff(log.time), 1e-3)
    assert any("no stamps" in note for note in log.notes)


def test_arrays_of_another_length_are_not_read(tmp_path: Path) -> None:
    log = read_recording(written(tmp_path, np.ones((20, 12))), LAYOUT)
    assert np.isnan(log.channels[VOLTAGE]).all()
    assert any("20 of 20 messages" in note for note in log.notes)


def test_a_log_without_voltages_says_what_there_is(tmp_path: Path) -> None:
    bag = written(tmp_path, np.ones((5, 9)))
    with pytest.raises(InputError, match="no topic holds wrenches; the log has /cells"):
        read_recording(bag)
    with pytest.raises(InputError, match="there is no topic '/other'"):
        read_recording(bag, LogLayout(wrench=None, arrays=(replace(CELLS, topic="/other"),)))
