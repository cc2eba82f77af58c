"""Voltages as arrays of a topic."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.logs import ArrayChannel, LogLayout, read_recording
from palpate.signals.recording import VOLTAGE
from tests.support.skin_formats import FLAT, RIGHT, TIME

NAMES = tuple(f"u{cell}{axis}" for cell in range(1, 9) for axis in "xyz")
CELLS = ArrayChannel(VOLTAGE, (24,), NAMES, scale=(1e-3,) * 24, table="load_cells")


def test_arrays_are_voltages_in_their_unit_and_a_log_without_them_says_what_there_is(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    RIGHT["multi_array"][1](bag)
    log = read_recording(bag, LogLayout(wrench=None, arrays=(CELLS,)))
    np.testing.assert_array_equal(log.channels[VOLTAGE], FLAT * 1e-3)
    np.testing.assert_allclose(log.time - log.time[0], TIME, atol=1e-6)
    assert any("no stamps" in note for note in log.notes)
    with pytest.raises(InputError, match=r"no topic holds wrenches; the log has /skin.*Wrenches"):
        read_recording(bag)
    with pytest.raises(InputError, match=r"there is no topic '/other'.*Available"):
        read_recording(bag, LogLayout(wrench=None, arrays=(replace(CELLS, topic="/other"),)))
