"""Tables as others write them: every row, at its line, in the units that it says, whatever stands around it."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from claims.evidence.exports import EXPORTS, PRESSED, TIME, WRENCH
from palpate.cli import main
from palpate.errors import InputError
from palpate.files.contacts import read_contacts
from palpate.files.logs import contents, open_log, read_recording
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.opening import join
from palpate.files.models import write_model
from palpate.files.tables.stamps import seconds
from palpate.files.units import FORCE_UNITS, TORQUE_UNITS, measured, split_unit, to_si
from palpate.setup import load_rig
from palpate.signals.payload import Payload

BALL = '[surface]\nkind = "sphere"\nradius = 0.01\n'


def _log(folder: Path, name: str) -> Path:
    path = folder / name
    path.write_bytes(EXPORTS[name].data)
    return path


def _layout(name: str) -> LogLayout:
    """How to read one of those that need no rig."""
    return (
        LogLayout()
        if name != "savetxt.txt"
        else LogLayout("column_1", wrench=tuple(f"column_{k}" for k in range(2, 8)))
    )


@pytest.mark.parametrize(
    "name", ["savetxt_header.txt", "savetxt.txt", "unicode_text.txt", "remarks.csv", "unit_row.csv"]
)
def test_pieces_do_not_change_what_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    path, layout = _log(tmp_path, name), _layout(name)
    if name == "unit_row.csv":
        layout = LogLayout("Time", wrench=("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"))
    whole = read_recording(path, layout)
    monkeypatch.setattr("palpate.files.logs.text.PIECE", 89)
    monkeypatch.setattr("palpate.files.logs.stuck.FIRST", 1)
    blocks = list(open_log(path, layout).blocks())
    assert len(blocks) > 2
    joined = join(blocks)
    assert np.array_equal(joined.time, whole.time)
    assert np.array_equal(joined.wrenches(), whole.wrenches())
    assert np.array_equal(whole.wrenches(), WRENCH)


def test_lines_are_those_of_the_file_whatever_stands_before(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    rows = [
        "# made by a robot",
        "# on a day",
        "time fx fy fz tx ty tz",
        "0 1 2 3 4 5 6",
        "# a remark",
        "1 oops 2 3 4 5 6",
    ]
    path.write_text("\n".join([*rows, "2 1 2 3 4 5 6", "3 1 2"]))
    recording = read_recording(path)
    assert np.isnan(recording.wrenches()[:, 0]).tolist() == [False, True, False, True]
    assert "line 6, column 'fx', 'oops'" in " ".join(recording.notes)
    assert "1 rows do not have 7 fields (first: line 8)" in recording.notes


def test_a_mesh_alone_reads_names_that_state_their_units(tmp_path: Path) -> None:
    """As the plain table with those names: `Fx [N]` can only be fx; `Fx` may be the force of anything."""
    path = _log(tmp_path, "milli.csv")
    recording = read_recording(path)
    assert np.abs(recording.time - TIME).max() < 1e-12
    assert np.abs(recording.wrenches() - WRENCH).max() < 1e-12
    with pytest.raises(InputError, match="palpate rig new"):
        read_recording(_log(tmp_path, "clock.csv"))
    path.write_text(path.read_text().replace("Fy (mN)", "Fx [N]"))
    with pytest.raises(InputError, match=r"no column.*Did"):
        read_recording(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('force = "mN"', 'force = "N"', ("Fx (mN)", "'mN'", "'N'", "[force_torque]")),
        ('torque = "mN m"', 'torque = "N m"', ("Tx (mNm)", "'mNm'", "'N m'. Correct")),
        ('unit = "ms"', 'unit = "s"', ("Time (ms)' is in 'ms', but it is read in 's'. Correct", "'ms'", "[time] unit")),
    ],
)
def test_a_rig_that_contradicts_the_header_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: tuple[str, ...]
) -> None:
    path, rig = _log(tmp_path, "milli.csv"), tmp_path / "rig.toml"
    assert main(["rig", "new", str(path), "-o", str(rig)]) == 0
    assert old in rig.read_text()
    rig.write_text(rig.read_text().replace(old, new))
    capsys.readouterr()
    assert main(["estimate", str(path), "--rig", str(rig), "-o", str(tmp_path / "c.csv")]) == 1
    said = capsys.readouterr().err
    assert [word for word in words if word not in said] == []


def test_counts_are_divided_by_what_the_lines_before_the_names_say(tmp_path: Path) -> None:
    stated = contents(_log(tmp_path, "netft_mm.csv")).stated
    assert (stated.force, stated.torque, stated.rate) == ("N/1000000", "Nmm/1000", 100.0)
    averaged = contents(_log(tmp_path, "daq_ft.csv")).stated
    assert averaged.rate == 100.0  # 10,000 Hz, of which 100 make one sample


@pytest.mark.parametrize(
    "first", ["<Pose> t fx fy fz tx ty tz", "<Pose>\nt fx fy fz tx ty tz", "<Pose>, t fx fy fz tx ty tz"]
)
def test_a_table_may_begin_with_a_tag(tmp_path: Path, first: str) -> None:
    rows = "\n".join(f"{k / 100} {k} 0 -{k} 0.1 0 {k / 7:.3f}" for k in range(40))
    for name, text in {
        "spaces.txt": f"{first}\n{rows}\n",
        "commas.txt": f"{first}\n{rows}\n".replace(" ", ","),
    }.items():
        (tmp_path / name).write_text(text.replace(",,", ","), "utf-8")
        found = read_recording(tmp_path / name, LogLayout(time="t"))
        assert found.channels["force"][:, 2].tolist() == [-k for k in range(40)]
        assert found.time[-1] == 0.39


@pytest.mark.parametrize(
    "text", ["<?xml version='1.0'?>\n<a>", "<!DOCTYPE html>\n", "<a><b c='1'/>\n1,2\n", "<a>\n1,2\n</a>"]
)
def test_markup_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text, "utf-8")
    with pytest.raises(InputError, match=r"csv: is XML or HTML, not a table"):
        read_recording(tmp_path / "a.csv")


def test_a_long_step_is_asked_about(tmp_path: Path) -> None:
    """Milliseconds under the plain name, and a layout that says seconds."""
    path = _log(tmp_path, "milliseconds.csv")
    path.write_text(path.read_text().replace("t,fx", "time,fx"))
    assert "a step between samples is 10 s" in " ".join(read_recording(path, LogLayout(time_unit="s")).notes)
    assert "its steps of 10 are taken for ms (100 Hz)" in " ".join(read_recording(path).notes)


@pytest.mark.parametrize(
    ("name", "bare", "unit"),
    [
        ("Fx [N]", "Fx", "N"),
        ("Fx (N)", "Fx", "N"),
        ("Fx_N", "Fx", "N"),
        ("F_x / N", "F_x", "N"),
        ("Kraft X in N", "Kraft X", "N"),
        ("Zeit [\u00b5s]", "Zeit", "\u00b5s"),
        ("Fx [N] (filtered)", "Fx (filtered)", "N"),
        ("Fx [daN]", "Fx", "daN"),
        ("Fx (left)", "Fx (left)", ""),
        ("O_F_ext_hat_K[0]", "O_F_ext_hat_K[0]", ""),
        ("fx_g", "fx_g", ""),  # without gravity, perhaps
        ("fx_n", "fx_n", ""),
        ("/wrench/force/x", "/wrench/force/x", ""),
    ],
)
def test_units_are_parted_from_names(name: str, bare: str, unit: str) -> None:
    assert split_unit(name) == (bare, unit)


def test_units_have_other_spellings_and_counts() -> None:
    assert to_si("lb-in", TORQUE_UNITS, where="") == to_si("lbf in", TORQUE_UNITS, where="")
    assert to_si("N/1000", FORCE_UNITS, where="") == 1e-3
    for unit in ("MNm", "N/0", "N/x", "N/-1"):
        with pytest.raises(InputError, match=r"unknown unit.*Known"):
            to_si(unit, TORQUE_UNITS | FORCE_UNITS, where="")


def test_values_have_two_digits_of_their_largest_deviation() -> None:
    assert measured([1.23456], [0.0123], "N") == "1.235 +- 0.012 N"
    assert measured([-1e-4, 123.456], [0.01, 45.6], "N") == "(0, 123) +- (0, 46) N"
    least, none, most = (measured([1.0], [spread], "N") for spread in (1e-30, 0.0, np.inf))
    assert (least[:13], none, most) == ("1.00000000 +-", "1.0000 +- 0.0000 N", "1.0000 +- inf N")
    with pytest.raises(ValueError, match="argument"):
        measured([1.0, 2.0], [1.0], "N")


def test_stamps_are_seconds() -> None:
    """Against the standard library's reading of the same instants."""
    same = ["2025-03-04T12:34:56.5Z", "2025-03-04 13:34:56.500+01:00", "04.03.2025 12:34:56,5", "2025/03/04 12:34:56.5"]
    assert seconds(pl.Series(same)).to_list() == [1741091696.5] * 4
    assert seconds(pl.Series(["12:00:01", "12:00:01 AM", "1:00:01.25 PM"])).to_list() == [43201.0, 1.0, 46801.25]
    assert seconds(pl.Series(["3/4/2025 12:00:00", "noon", None])).to_list() == [None] * 3


@pytest.mark.parametrize(
    ("line", "code", "word"), [("", 1, 'write kind = "imu"'), ('kind = "imu"', 0, ""), ('kind = "none"', 0, "")]
)
def test_gravity_among_accelerations_is_not_taken_for_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str, code: int, word: str
) -> None:
    """The arm stands still, so that with gravity taken off, and without accelerations, the places are the same."""
    path = tmp_path / "log.csv"
    columns = EXPORTS["imu.csv"].data.decode().splitlines()
    path.write_text("\n".join([f"{columns[0]},qx,qy,qz,qw", *(f"{row},0,0,0,1" for row in columns[1:])]))
    zero = np.zeros(3)
    write_model(tmp_path / "payload.toml", Payload(np.array([0.0, 0.0, -1e-3]), zero, zero, zero))
    rig, found = tmp_path / "rig.toml", tmp_path / "contacts.csv"
    rig.write_text(f'{BALL}[force_torque]\npayload = "payload.toml"\n[acceleration]\n{line}\n')
    load_rig(rig)
    assert main(["estimate", str(path), "--rig", str(rig), "-o", str(found)]) == code
    assert word in capsys.readouterr().err
    if not code:
        assert read_contacts(found).estimate.answered[PRESSED].all()
