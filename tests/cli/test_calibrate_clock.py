"""`palpate calibrate clock` and `servo` on files that rosbags wrote, and on columns."""

from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate import Payload
from palpate.cli import main
from palpate.control.servo import Servo, ServoModel
from palpate.files.logs import join, open_log
from palpate.files.logs.layout import LogLayout
from palpate.files.models import read_model, write_model
from palpate.setup import load_rig
from palpate.signals.recording import ORIENTATION
from palpate_lab.simulation.session import GRAVITY, Session, simulate_session
from palpate_lab.simulation.session_files import POSE_TOPIC, WRENCH_TOPIC
from palpate_lab.simulation.session_mcap import CLOCK_OFFSET, write_session_mcap
from tests.calibration.test_servo import rows, short

RIG = f"""# my rig
[surface]
kind = "plane"  # a table

[orientation]
topic = "{POSE_TOPIC}"  # of the arm

[force_torque]
topic = "{WRENCH_TOPIC}"
"""


@pytest.fixture(scope="module")
def session() -> Session:
    return simulate_session(5, touches=2, facets=80)


@pytest.fixture(scope="module")
def made(session: Session, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clock")
    write_session_mcap(session, folder)
    return folder


def clock(log: Path, rig: str, folder: Path, *options: str) -> tuple[int, Path]:
    (folder / "rig.toml").write_text(rig)
    code = main(
        ["calibrate", "clock", str(log), "--rig", str(folder / "rig.toml"), "-o", str(folder / "out.toml"), *options]
    )
    return code, folder / "out.toml"


def test_the_offset_is_found_and_written_beside_what_a_person_wrote(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out = clock(made / "free_motion.mcap", RIG, tmp_path)
    assert code == 0
    assert abs(load_rig(out).orientation.offset - CLOCK_OFFSET) < 1e-3
    text = out.read_text()
    assert all(line in text.splitlines() for line in RIG.splitlines())
    assert "# s, from free_motion.mcap (sha256:" in text
    said = capsys.readouterr().out
    assert "added to the poses' stamps" in said
    assert "before           0.000 ms" in said


def test_it_starts_from_the_offset_that_the_rig_has_and_finds_the_same(made: Path, tmp_path: Path) -> None:
    first = load_rig(clock(made / "free_motion.mcap", RIG, tmp_path)[1]).orientation.offset
    code, out = clock(made / "free_motion.mcap", RIG.replace("  # of the arm", "\noffset = 0.1  # guessed"), tmp_path)
    assert code == 0
    assert load_rig(out).orientation.offset == pytest.approx(first, abs=1e-5)
    assert "guessed" not in out.read_text()


def test_at_the_edge_of_the_search_it_looks_further(made: Path, tmp_path: Path) -> None:
    code, out = clock(made / "free_motion.mcap", RIG, tmp_path, "--search", "0.02")
    assert code == 0
    assert abs(load_rig(out).orientation.offset - CLOCK_OFFSET) < 1e-3


def test_beyond_the_widest_search_it_says_so_and_writes_nothing(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate.calibration.clock.WIDEST", 0.0)
    code, out = clock(made / "free_motion.mcap", RIG, tmp_path, "--search", "0.02")
    assert code == 1
    assert "edge of the search" in capsys.readouterr().err
    assert not out.exists()


def in_columns(session: Session, late: int, path: Path) -> Path:
    """Rows whose orientations are so many rows old."""
    free = session.free_motion
    rows = np.column_stack([free.time, free.wrenches(), np.roll(free.channels[ORIENTATION], late, axis=0)])[late:]
    np.savetxt(path, rows, delimiter=",", header="time,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw", comments="")
    return path


@pytest.mark.parametrize("late", [0, 8])
def test_columns_are_calibrated(
    session: Session, late: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Eight rows at 200 Hz are 40 ms."""
    code, out = clock(in_columns(session, late, tmp_path / "log.csv"), '[surface]\nkind = "plane"\n', tmp_path)
    assert code == 0
    assert load_rig(out).orientation.offset == pytest.approx(-late / 200.0, abs=1e-3)
    assert ("on one clock" in capsys.readouterr().out) == (late == 0)


@pytest.mark.parametrize("form", ["file", "arrays"])
def test_an_offset_acts_on_columns(session: Session, form: str, tmp_path: Path) -> None:
    """Rows with the orientations of eight rows ago get theirs; the last eight have none."""
    path = in_columns(session, 8, tmp_path / "log.csv")
    names = path.read_text().splitlines()[0].split(",")
    arrays = dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))
    log = join(list(open_log(path if form == "file" else arrays, LogLayout(offset=-0.04)).blocks()))
    true = session.free_motion.channels[ORIENTATION][8:]
    found = log.channels[ORIENTATION]
    assert np.isnan(found[-8:]).all()
    assert np.abs(np.abs(np.sum(found[:-8] * true[:-8], axis=1)) - 1.0).max() < 1e-9
    np.testing.assert_array_equal(log.wrenches(), np.column_stack([arrays[name] for name in names[1:7]]))


@pytest.mark.parametrize("late", [0, 30, 110])
def test_estimate_names_the_calibration_of_a_late_clock(session: Session, late: int, tmp_path: Path) -> None:
    """30 rows at 200 Hz are 0.15 s. The payload is that of the session."""
    log = in_columns(session, late, tmp_path / "log.csv")
    load = session.load
    payload = Payload(load.mass * GRAVITY, load.force_bias, load.center_of_mass, load.torque_bias)
    write_model(tmp_path / "payload.toml", payload)
    rig = tmp_path / "rig.toml"
    rig.write_text('[surface]\nkind = "sphere"\nradius = 0.05\n[force_torque]\npayload = "payload.toml"\n')
    said = [note for note in palpate.estimate(log, rig).notes if "calibrate clock" in note]
    assert len(said) == (late > 0)
    assert not late or abs(float(said[0].split(" s late")[0].split()[-1]) - late / 200) <= 0.021


def test_wrenches_that_were_turned_with_the_poses_are_refused(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _ = clock(made / "free_motion.mcap", RIG + 'frame = "base"\n', tmp_path)
    assert code == 1
    assert "sensor's frame" in capsys.readouterr().err


@pytest.mark.parametrize(
    "table",
    [
        "",
        "[orientation]\nmax_gap = 0.5\n[time]\nunit = 's'\n",
        "orientation.max_gap = 0.5\n",
        "orientation = { max_gap = 0.5 }\n",
        "[orientation]\noffset = 0.15 # old\n",
    ],
)
def test_the_offset_finds_its_place_in_any_form_of_rig(session: Session, table: str, tmp_path: Path) -> None:
    surface = '[surface]\nkind = "plane"\n'
    rig = surface + table if table.startswith("[") else table + surface
    code, out = clock(in_columns(session, 0, tmp_path / "log.csv"), rig, tmp_path, "--search", "0.2")
    assert code == 0
    assert abs(load_rig(out).orientation.offset) < 1e-3
    assert load_rig(out).orientation.max_gap == (0.5 if "max_gap" in table else 0.25)


NAMES = ("time", *(f"{kind}_{joint}" for kind in ("command", "position") for joint in (1, 2, 3)))


def test_the_command_writes_what_the_controller_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time, commands, positions, _ = rows(short(rate=200.0))
    table = np.column_stack([time, commands, positions])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=",".join(NAMES), comments="")
    out = tmp_path / "servo.toml"
    assert main(["calibrate", "servo", str(tmp_path / "log.csv"), "-o", str(out)]) == 0
    servo = read_model(out, Servo)
    assert (servo.delay, servo.lag) == pytest.approx((0.021, 0.033), abs=1e-3)
    assert "left out" in capsys.readouterr().out
    assert ServoModel(servo, 3).total_delay == pytest.approx(0.074, abs=1e-3)
    wrong = ["calibrate", "servo", str(tmp_path / "log.csv"), "--commands", "goal_*", "-o", str(tmp_path / "no.toml")]
    assert main(wrong) == 1
    assert "no columns or topic 'goal_*' of joints. Available" in capsys.readouterr().err
    assert not (tmp_path / "no.toml").exists()
