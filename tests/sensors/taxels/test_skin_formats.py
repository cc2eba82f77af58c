"""A log of a skin in the format of a maker or a recorder is read taxel by taxel, or refused with the reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.logs import read_recording
from palpate.setup import load_rig
from palpate.setup.new import Proposal, propose_rig
from palpate.signals.recording import CELLS
from tests.support.skin_formats import COLUMNS, FRAMES, PITCH, REFUSED, RIGHT, ROWS, TIME


def _frames(log: Path, proposal: Proposal, *more: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times from the first on, and frames, as the proposed rig reads them, with its sheet's true size."""
    edited = {"rows": ROWS, "columns": COLUMNS, "pitch": PITCH}
    lines = [line for line in proposal.text.splitlines() if line.partition(" =")[0] not in edited]
    stated = "\n".join(f"{key} = {value}" for key, value in edited.items())
    rig = log.parent / "rig.toml"
    rig.write_text("\n".join(lines).replace("[skin]", "\n".join(["[skin]", stated, *more])) + "\n")
    recording = read_recording(log, load_rig(rig).layout())
    return recording.time - recording.time[0], recording.channels[CELLS]


@pytest.mark.parametrize("name", RIGHT)
def test_a_format_is_read_taxel_by_taxel(name: str, tmp_path: Path) -> None:
    file, write, newtons, rate = RIGHT[name]
    write(tmp_path / file)
    proposal = propose_rig(tmp_path / file, None, tmp_path, rate=rate)
    time, frames = _frames(tmp_path / file, proposal)
    known = np.isfinite(frames)
    assert np.count_nonzero(~known) == (name == "long_lost")
    np.testing.assert_allclose(frames[known], newtons * FRAMES[known], rtol=1e-9)
    np.testing.assert_allclose(time, TIME, atol=1e-6)
    sized = "nothing states the sheet's rows and columns" not in proposal.text + " ".join(proposal.remarks)
    assert sized == (f"rows = {ROWS}\ncolumns = {COLUMNS}\n" in proposal.text)


@pytest.mark.parametrize("name", REFUSED)
def test_a_format_that_holds_too_little_is_refused(name: str, tmp_path: Path) -> None:
    file, write, reason = REFUSED[name]
    write(tmp_path / file)
    with pytest.raises(InputError, match=reason):
        propose_rig(tmp_path / file, None, tmp_path)


@pytest.mark.parametrize(("name", "path"), [("axes", "*_z"), ("axes_blocks", "z*")])
def test_a_field_path_picks_one_axis(name: str, path: str, tmp_path: Path) -> None:
    file, write, _ = REFUSED[name]
    write(tmp_path / file)
    stated = Proposal(f'[skin]\ncells = "{path}"\n', "", "", ())
    if name == "axes":
        np.testing.assert_array_equal(_frames(tmp_path / file, stated)[1], FRAMES)
    else:
        assert _frames(tmp_path / file, stated)[1].shape == FRAMES.shape
