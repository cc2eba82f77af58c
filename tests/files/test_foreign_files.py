"""Files of others as a newcomer brings them: nothing is misread without a word, and what is not read is said."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from claims.evidence import robot
from claims.evidence.exports import TIME, WRENCH
from palpate.cli import main
from palpate.files.logs import read_recording
from palpate.setup import load_rig
from palpate.setup.names import wrenches

FT = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]
STAMPS = np.rint(TIME * 1e9).astype(np.int64).tolist()
SPHERE = '<geometry><sphere radius="{radius}"/></geometry>'
URDF = """<robot name="arm"><link name="base"/><link name="ft"/>
<link name="tool"><visual>{shape}</visual></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="ft"/><axis xyz="0 0 1"/></joint>
<joint name="fixed" type="fixed"><parent link="ft"/><child link="tool"/></joint></robot>
"""


def _table(names: Sequence[str], columns: Sequence[np.ndarray], before: str = "", sep: str = ",") -> str:
    rows = [sep.join(f"{value:.12g}" for value in row) for row in zip(*columns, strict=True)]
    return before + "\n".join([*([sep.join(names)] if names else []), *rows]) + "\n"


def _plain(time: np.ndarray = TIME, name: str = "time", names: Sequence[str] = FT, torque: float = 1.0) -> str:
    return _table([name, *names], [time, *WRENCH.T[:3], *WRENCH.T[3:] * torque])


def _rig(log: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str]:
    rig = log.parent / "rig.toml"
    code = main(["rig", "new", str(log), *options, "-o", str(rig)])
    said = capsys.readouterr()
    return code, said.out + said.err


_TAILS = [f"{name}_left" for name in FT], [f"{name}_right" for name in FT]
_TWO = [TIME, *WRENCH.T, *(2.0 * WRENCH.T)]
_BIAS = [TIME, *(0.0 * WRENCH.T), *WRENCH.T]
_TITLE = "Versuch 12;;;;;;\nDatum;22.11.2025;;;;;\n;;;;;;\n"
_LABVIEW = "LabVIEW Measurement\t\n" + "".join(f"Key_{k}\t2\n" for k in range(12)) + "***End_of_Header***\t\n\t\n"
_LABVIEW += "Channels\t6\t\t\t\t\t\nSamples\t120\t120\t120\t120\t120\t120\n***End_of_Header***\t\t\t\t\t\t\n"
_ROWS = "".join("\t" + "\t".join(f"{value:.12g}" for value in row) + "\n" for row in WRENCH.tolist())


@pytest.mark.parametrize(
    ("text", "said", "options"),
    [
        pytest.param(_table(["time", *_TAILS[0], *_TAILS[1]], _TWO), "the log has 2 wrenches", (), id="suffixes"),
        pytest.param(
            _table(["time", "Fx_raw", "Fy_raw", "Fz_raw", *FT], [TIME, *(WRENCH.T[:3] + 9.0), *WRENCH.T]),
            "columns Fx, Fy",
            (),
            id="forces_of_another",
        ),
        pytest.param(_table(["time", *(f"bias_{n}" for n in FT), *FT], _BIAS), "not bias_Fx", (), id="bias_first"),
        pytest.param(_plain(1e3 * TIME, "millis"), "", (), id="millis"),
        pytest.param(_plain(TIME, "elapsed"), "", (), id="elapsed"),
        pytest.param(_table([str(k) for k in range(7)], [TIME, *WRENCH.T]), "without names", (), id="pandas_numbers"),
        pytest.param(_TITLE + _table(["Zeit", *FT], [TIME, *WRENCH.T], sep=";"), "", (), id="title"),
        pytest.param(
            _plain(names=[*FT[:3], *(f"{n} (ft-lbs)" for n in FT[3:])], torque=1 / 1.3558179483314004),
            "",
            (),
            id="foot_pounds",
        ),
        pytest.param(
            f"{_LABVIEW}X_Value\t" + "\t".join(FT) + "\tComment\n" + _ROWS, "", ("--rate", "100"), id="labview_no_x"
        ),
    ],
)
def test_the_right_columns_are_read_and_what_else_could_be_meant_is_said(
    text: str, said: str, options: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log.csv"
    log.write_text(text, encoding="utf-8")
    code, all_said = _rig(log, capsys, *options)
    assert code == 0, all_said
    assert said in all_said
    recording = read_recording(log, load_rig(tmp_path / "rig.toml").layout())
    assert len(recording) == len(TIME)
    assert np.abs(recording.time - TIME).max() < 1e-9  # s: twelve digits were written
    assert np.abs(recording.wrenches() - WRENCH).max() < 1e-9


@pytest.mark.parametrize(
    ("data", "said"),
    [
        pytest.param(_plain(TIME / 60.0, "time_min"), "unknown unit 'min'", id="minutes"),
        pytest.param(_plain(TIME / 60.0, "Time (min)"), "unknown unit 'min'", id="minutes_round"),
        pytest.param(_plain(TIME / 3600.0, "Zeit in h"), "unknown unit 'h'", id="hours"),
        pytest.param(_plain(names=[f"{name} (V)" for name in FT]), "unknown unit 'V'", id="volts"),
        pytest.param(_plain(names=[f"{name}_counts" for name in FT]), "unknown unit 'counts'", id="counts"),
        pytest.param(_plain(np.full(len(TIME), np.nan)), "no times in column 'time'", id="no_times"),
        pytest.param(b"\x1f\x8b" + bytes(99), "is compressed", id="gzip"),
        pytest.param(b"PK\x03\x04" + bytes(26) + b"[Content_Types].xml" + bytes(99), "is a workbook", id="workbook"),
        pytest.param(b"MATLAB 5.0 MAT-file, Platform" + bytes(99), "is a MAT file", id="mat"),
    ],
)
def test_what_is_not_read_is_refused_with_its_reason(
    data: str | bytes, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log.csv"
    log.write_bytes(data if isinstance(data, bytes) else data.encode())
    code, all_said = _rig(log, capsys)
    assert (code, said in all_said) == (1, True), all_said


@pytest.mark.parametrize("time", [0.0 * TIME, TIME[::-1]], ids=["stands_still", "runs_backwards"])
def test_a_time_that_does_not_go_on_is_doubted(
    time: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log.csv"
    log.write_text(_plain(time, "runtime"), encoding="utf-8")
    code, said = _rig(log, capsys)
    assert (code, "'runtime' may not be the time" in said) == (0, True), said


def test_suffixes_do_not_part_the_columns_of_one_sensor() -> None:
    """Channels that are numbered through, and units that are not known, stand behind the axes of one wrench."""
    numbered = [f"{name} {k}" for k, name in enumerate(FT)]
    assert wrenches(["t", *numbered]) == [tuple(numbered)]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wrench, and joint states of two arms whose joints are called the same."""
    path = tmp_path_factory.mktemp("bag") / "run"
    topics = {"/ft": robot.KINDS[robot.WRENCH]} | dict.fromkeys(
        ("/a/joints", "/b/joints"), robot.KINDS["/joint_states"]
    )
    stamped = [(stamp, "/ft", robot.wrench(stamp, row, "ft")) for stamp, row in zip(STAMPS, WRENCH, strict=True)]
    kind = robot.TYPES["sensor_msgs/msg/JointState"]
    for stamp in STAMPS[::10]:
        state = kind(robot.header(stamp, ""), ["turn"], np.zeros(1), np.zeros(0), np.zeros(0))
        stamped += [(stamp, "/a/joints", state), (stamp, "/b/joints", state)]
    robot.write_bag(path, iter(stamped), topics)
    return path


@pytest.mark.parametrize(
    ("radius", "said"),
    [("0.01", "states of these joints: /a/joints, /b/joints"), ("10", "an unusual size of a robot's link")],
)
def test_a_rig_of_a_bag_and_a_urdf_names_its_doubts(
    bag: Path, radius: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf, rig = tmp_path / "arm.urdf", tmp_path / "rig.toml"
    urdf.write_text(URDF.format(shape=SPHERE.format(radius=radius)), encoding="utf-8")
    code = main(["rig", "new", str(bag), str(urdf), "--link", "tool", "-o", str(rig)])
    assert (code, said in capsys.readouterr().out) == (0, True)
    assert load_rig(rig).layout().frame == "sensor"


def test_options_that_do_not_fit_a_log_are_refused(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, rig, out = tmp_path / "log.csv", tmp_path / "rig.toml", str(tmp_path / "contacts.csv")
    table.write_text(_plain(), encoding="utf-8")
    assert _rig(table, capsys)[0] == 0
    for said, command in {
        "holds sensor_msgs/JointState": ["inspect", str(bag), "--topic", "/a/joints"],
        "is a table": ["estimate", str(table), "--rig", str(rig), "-o", out, "--topic", "/ft"],
        "is a log of messages": ["rig", "new", str(bag), "-o", out, "--rate", "100"],
    }.items():
        assert main(command) == 1
        assert said in capsys.readouterr().err
