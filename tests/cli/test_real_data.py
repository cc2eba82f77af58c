"""The commands on recordings that nobody here made; skipped where they are not there."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from claims.evidence.files import REAL
from palpate.cli import main
from palpate.files.contacts import read_contacts
from palpate.files.models import read_model
from palpate.signals.payload import Payload

# The driver swaps y and z of force and torque. Unswapped, pad x = 0.06 + p0 and pad y = 0.142 - p2 on the plane
# p1 = 0.008 m: the pad's frame is the sensor's, turned by -90 degrees about x.
PAD = """\
[surface]
kind = "plane"
point = [0.06, 0.07, 0.0]
half_width = 0.1
pose = { xyz = [-0.06, 0.008, 0.142], quaternion_xyzw = [-0.7071067811865476, 0, 0, 0.7071067811865476] }
[time]
column = "timestamp"
[force_torque]
columns = [
  "ft_wrench_force_x", "ft_wrench_force_y", "ft_wrench_force_z",
  "ft_wrench_torque_x", "ft_wrench_torque_y", "ft_wrench_torque_z",
]
axes = ["x", "z", "y"]
left_handed = true
[estimate]
friction = 3.0
torsion = 0.05
contact = { on = 1.5, off = 1.5 }
"""


def test_the_real_pad(shared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """1,197 rows with |Fz| > 1.5 N as logged: 3.9 mm as recorded (the authors' own 3.92), 3.4 mm less one offset."""
    log = shared / "data/pad/trajectory_panda_ft_opti.csv"
    (tmp_path / "rig.toml").write_text(PAD)
    contacts = tmp_path / "contacts.csv"
    assert main(["estimate", str(log), "--rig", str(tmp_path / "rig.toml"), "-o", str(contacts)]) == 0
    assert "warning" not in "".join(capsys.readouterr())
    table = pl.read_csv(log)
    truth = table.select("opti_x", "opti_y").to_numpy()
    pressed = np.abs(table["ft_wrench_force_z"].to_numpy()) > 1.5
    found = read_contacts(contacts)
    assert len(found) == len(table) == 1937
    assert np.count_nonzero(pressed) == 1197
    assert found.estimate.answered[pressed].all()
    error = found.estimate.point[pressed, :2] - truth[pressed]
    assert np.linalg.norm(error, axis=1).mean() <= 3.9e-3
    half = len(error) // 2
    for fitted, judged in ((error[:half], error[half:]), (error[half:], error[:half])):
        assert np.linalg.norm(judged - fitted.mean(axis=0), axis=1).mean() <= 3.4e-3
    table.select(time="timestamp", px="opti_x", py="opti_y", pz=pl.lit(0.0)).write_csv(tmp_path / "truth.csv")
    capsys.readouterr()
    assert main(["evaluate", str(contacts), str(tmp_path / "truth.csv")]) == 0
    assert "location [mm]" in capsys.readouterr().out


def test_the_pad_read_as_right_handed_is_refused(
    shared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.toml").write_text(PAD.replace("left_handed = true\n", ""))
    log = shared / "data/pad/trajectory_panda_ft_opti.csv"
    assert main(["estimate", str(log), "--rig", str(tmp_path / "rig.toml"), "-o", str(tmp_path / "c.csv")]) == 1
    assert "left_handed = true" in capsys.readouterr().err


@pytest.fixture
def hundred(shared: Path, tmp_path: Path) -> Path:
    """100 poses and wrenches of two files without headers, as one log."""
    folder = shared / "data/payload"
    poses = np.loadtxt(folder / "recorded_messages_pose_100.txt", delimiter=",")
    wrenches = np.loadtxt(folder / "recorded_messages_wrench_100.txt", delimiter=",")
    names = ["time", "x", "y", "z", "qx", "qy", "qz", "qw", "fx", "fy", "fz", "tx", "ty", "tz"]
    pl.DataFrame(np.column_stack([np.arange(100.0), poses, wrenches]), schema=names).write_csv(tmp_path / "log.csv")
    return tmp_path / "log.csv"


def test_the_real_payload_in_the_base_frame(hundred: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """1.2396 kg and the figures beside it, computed by hand from the same files."""
    call = ["calibrate", "payload", str(hundred), "-o", str(tmp_path / "payload.toml"), "--base-frame"]
    assert main(call) == 0
    assert "warning" not in "".join(capsys.readouterr())
    payload = read_model(tmp_path / "payload.toml", Payload)
    assert payload.mass == pytest.approx(1.2396, abs=5e-4)
    assert payload.force_bias == pytest.approx([-3.468, -4.577, -16.719], abs=0.01)
    assert payload.center_of_mass == pytest.approx([-0.0010, -0.0001, 0.0451], abs=5e-4)


def test_the_real_payload_in_the_wrong_frame_is_named(
    hundred: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["calibrate", "payload", str(hundred), "-o", str(tmp_path / "payload.toml")])
    assert 'Write frame = "base"' in capsys.readouterr().err


@pytest.mark.parametrize(
    "name", ["UsProbe_SPL40.stl", "UsProbe_Ultrasonix_C5-2_60.stl", "UsProbe_Ultrasonix_L14-5_38.stl"]
)
def test_real_meshes_are_inspected(shared: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    assert main(["inspect", str(shared / "data/probes" / name)]) == 0
    assert "as mm" in capsys.readouterr().out


@pytest.mark.parametrize(("name", "code", "words"), [(each.name, each.code, each.words) for each in REAL])
def test_real_tables_are_taken_for_what_they_are(
    shared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, code: int, words: tuple[str, ...]
) -> None:
    assert main(["rig", "new", str(shared / "data" / name), "-o", str(tmp_path / "rig.toml")]) == code
    said = "".join(capsys.readouterr())
    assert [word for word in words if word not in said] == []


def test_real_torques_in_newton_millimetres_are_told(
    shared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three Nano17 in a table without names: N and N mm, and the first of the three is taken."""
    log = shared / "data/nano17/roll_400_rows.csv"
    assert main(["rig", "new", str(log), "-o", str(tmp_path / "rig.toml"), "--rate", "100"]) == 0
    said = capsys.readouterr().out
    assert "the log has 3 wrenches: column_1 ... column_6 is used" in said
    assert 'torque = "N mm"' in (tmp_path / "rig.toml").read_text()
