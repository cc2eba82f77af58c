"""ATI's calibration files: what they are is said, and inspecting one gives the units and ranges for a rig."""

import tomllib
from pathlib import Path

import pytest

from palpate import InputError
from palpate.cli import main
from palpate.files.ati import AtiCalibration
from palpate.files.logs import read_recording
from palpate.files.models import load_toml

CALIBRATION = """<?xml version="1.0" encoding="utf-8"?>
<!-- NOTE: a comment -->
<FTSensor  Serial="FT00001" BodyStyle="Gamma" Family="DAQ" NumGages="6" CalFileVersion="1.1">
\t<Calibration  PartNumber="US-15-50" CalDate="1/25/2023" ForceUnits="lbf" TorqueUnits="lbf-in" DistUnits="in">
{axes}
\t</Calibration>
</FTSensor>
"""
RANGES = {"Fx": "15", "Fy": "15", "Fz": "50", "Tx": "50", "Ty": "50", "Tz": "40"}


def _written(path: Path, old: str = "", new: str = "") -> Path:
    axes = "\n".join(
        f'\t\t<UserAxis Name="{name}" values=" 1 0 0 0 0 0 " max="{most}"/>' for name, most in RANGES.items()
    )
    path.write_text(CALIBRATION.format(axes=axes).replace(old, new), "utf-8")
    return path


def test_ranges_are_in_si(tmp_path: Path) -> None:
    found = AtiCalibration.of(_written(tmp_path / "a.cal"))
    pound, inch = 4.4482216152605, 0.0254
    assert found.ranges == pytest.approx(
        [15 * pound, 15 * pound, 50 * pound, *(x * pound * inch for x in (50, 50, 40))]
    )
    assert (found.model, found.serial, found.part) == ("Gamma", "FT00001", "US-15-50")


def test_inspect_writes_the_lines_of_a_rig(shared: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(shared / "data/nano17/calibration_files_FT44297.cal")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Nano17 FT44297 SI-25-0.25" in said
    start = said.index("units = {")
    written = tomllib.loads(said[start:].split(" and ")[0] + "\n" + said[start:].split(" and ")[1])
    assert written["units"] == {"force": "N", "torque": "N-mm"}
    assert written["range"] == {"force": [25, 25, 35], "torque": [0.25, 0.25, 0.25]}


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('max="15"', 'max="-1"', "cal: .*UserAxis Fx is '-1'"),
        ('Name="Tz"', 'Name="T"', "cal: .*UserAxis Tz is ''"),
        ('ForceUnits="lbf"', 'ForceUnits="x"', "unknown unit 'x'.*Known"),
        ("Calibration", "Cal", "cal: .*has no FTSensor/Calibration"),
        ("</FTSensor>", "", "cal: .*not a calibration of ATI that can be read"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, old: str, new: str, word: str) -> None:
    with pytest.raises(InputError, match=word):
        AtiCalibration.of(_written(tmp_path / "a.cal", old, new))


def test_it_is_neither_a_log_nor_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = _written(tmp_path / "a.cal")
    for read in (read_recording, load_toml):
        with pytest.raises(
            InputError, match=r"is ATI's calibration of a force/torque sensor: neither a log nor a model.*palpate"
        ):
            read(file)
    assert main(["rig", "new", str(file), "-o", str(tmp_path / "rig.toml")]) == 1
    assert "`palpate inspect` shows its units and ranges" in " ".join("".join(capsys.readouterr()).split())
