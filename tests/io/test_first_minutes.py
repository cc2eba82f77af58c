"""The first ten minutes with a table of somebody else: inspected, a rig made of it, estimated, without an editor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.exports import EDITED, NOTED, POINTS, PRESSED, RADIUS, READ, REFUSED, TIME, WRENCH, Export

from palpate.cli import main
from palpate.cli.estimate import estimate
from palpate.cli.inspect import inspect
from palpate.cli.setup import Setup
from palpate.io.contacts import read_contacts
from palpate.io.logs import read_recording
from palpate.io.rig import load_rig


def _written(export: Export, folder: Path) -> Path:
    path = folder / export.name
    path.write_bytes(export.data)
    return path


def _rig(export: Export, log: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, Path]:
    """`rig new`: its exit code, what it said, and the rig, with the line changed that it named."""
    rig = log.with_suffix(".toml")
    code = main(["rig", "new", str(log), "-o", str(rig), *export.options])
    said = capsys.readouterr()
    if export.edit is not None:
        old, new = export.edit
        assert old in rig.read_text()
        rig.write_text(rig.read_text().replace(old, new))
    return code, said.out + said.err, rig


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """Status and point of each row of the plain table."""
    folder = tmp_path_factory.mktemp("plain")
    log = _written(READ[0], folder)
    assert main(["rig", "new", str(log), "-o", str(folder / "rig.toml")]) == 0
    assert main(["estimate", str(log), "--rig", str(folder / "rig.toml"), "-o", str(folder / "contacts.csv")]) == 0
    found = _found(folder / "contacts.csv")
    assert (
        np.abs(found[PRESSED, 1:] - POINTS[np.cumsum(np.diff(PRESSED, prepend=False) & PRESSED)[PRESSED] - 1]).max()
        < 1e-4
    )
    return found


def _found(path: Path) -> np.ndarray:
    contacts = read_contacts(path)
    return np.column_stack([contacts.estimate.answered, contacts.estimate.point])


@pytest.mark.parametrize("export", [*READ, *EDITED], ids=lambda export: export.name)
def test_an_export_is_read_as_the_plain_table_is(
    export: Export, plain: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = _written(export, tmp_path)
    inspect(log)  # as the command, without the time that parsing its line takes
    assert "taken for" in capsys.readouterr().out
    code, said, rig = _rig(export, log, capsys)
    assert code == 0, said
    assert [word for word in export.says if word not in said] == []
    recording = read_recording(log, load_rig(rig).layout())
    assert len(recording) == len(TIME)
    if export.name != "wrapped.csv":
        assert np.allclose(recording.time - recording.time[0], TIME, rtol=0, atol=5e-7)  # of a time of day in float64
    for part, tolerance in zip((slice(3), slice(3, 6)), export.tolerance, strict=True):
        assert np.abs(recording.wrenches()[:, part] - WRENCH[:, part]).max() <= tolerance
    contacts = tmp_path / "contacts.csv"
    estimate(log, contacts, Setup(rig=rig))
    found = _found(contacts)[PRESSED]
    assert found[:, 0].all()
    size = (
        2.0 * export.tolerance[0] * RADIUS + export.tolerance[1]
    )  # N m: by how much torques about the touch may be off
    assert np.abs(found[:, 1:] - plain[PRESSED, 1:]).max() <= max(2.0 * size / 3.5, 1e-9)  # N: of the pushes


@pytest.mark.parametrize("export", REFUSED, ids=lambda export: export.name)
def test_what_cannot_be_told_is_refused_with_the_reason(
    export: Export, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said, rig = _rig(export, _written(export, tmp_path), capsys)
    assert code == 1
    assert export.refused in said
    assert not rig.exists()


@pytest.mark.parametrize("export", NOTED, ids=lambda export: export.name)
def test_what_is_lost_is_said(export: Export, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = _written(export, tmp_path)
    assert main(["inspect", str(log)]) == 0
    said = capsys.readouterr().out
    assert all(word in said for word in export.says)
