"""What a person gets wrong: outputs that are inputs, options that are no quantities, units, clocks; and Ctrl-C."""

import os
import re
import shutil
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import trimesh

from palpate.cli import main
from palpate.files.models import read_model
from palpate.interrupts import uninterrupted
from palpate.signals.payload import Payload
from palpate_lab.simulation.session import simulate_session
from palpate_lab.simulation.session_files import write_session

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of a small session, with its payload identified."""
    folder = tmp_path_factory.mktemp("session")
    write_session(simulate_session(4, touches=5, facets=320), folder)
    assert main(["calibrate", "payload", str(folder / "free_motion.csv"), "-o", str(folder / "payload.toml")]) == 0
    return folder


@pytest.fixture
def here(session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the session that a test may spoil, as the working folder."""
    shutil.copytree(session, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _edit(name: str, **columns: pl.Expr) -> None:
    pl.read_csv(name, infer_schema_length=None).with_columns(**columns).write_csv(name)


ESTIMATE = "estimate touches.csv --rig rig.toml -o"
MOUNTING = "calibrate mounting touches.csv --rig rig.toml --marks marks.csv -o"


@pytest.mark.parametrize(
    "call",
    [
        *(f"{ESTIMATE} {name}" for name in ("touches.csv", "rig.toml", "probe.stl", "payload.toml", "./touches.csv")),
        f"{ESTIMATE} rig",  # its provenance would be rig.toml
        f"{ESTIMATE} payload",
        "calibrate payload free_motion.csv -o free_motion.csv",
        "calibrate payload free_motion.csv --rig rig.toml -o rig.toml",
        "calibrate payload free_motion.csv --rig rig.toml -o probe.stl",
        *(f"{MOUNTING} {name}" for name in ("touches.csv", "marks.csv", "probe.stl", "payload.toml")),
        "rig new touches.csv probe.stl --force -o touches.csv",
        "rig new touches.csv probe.stl --force -o probe.stl",
    ],
)
def test_no_command_writes_over_what_it_reads(here: Path, capsys: pytest.CaptureFixture[str], call: str) -> None:
    before = {file.name: file.read_bytes() for file in here.iterdir()}
    assert main(call.split()) == 1
    assert "would overwrite an input" in capsys.readouterr().err
    assert {file.name: file.read_bytes() for file in here.iterdir()} == before


def test_a_mounting_that_nobody_should_rely_on_is_warned_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Marks that are each off by centimetres fit no pose; marks as they are bring no warning."""
    write_session(simulate_session(4, touches=16, facets=320), tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "payload", "free_motion.csv", "-o", "payload.toml"]) == 0
    assert main([*MOUNTING.split(), "good.toml"]) == 0
    assert "warning" not in "".join(capsys.readouterr())
    _edit("marks.csv", pz=pl.col("pz") + 0.012 * (pl.int_range(pl.len()) % 2))
    assert main([*MOUNTING.split(), "poor.toml"]) == 0
    assert "times worse than they should" in "".join(capsys.readouterr())


def test_a_mounting_may_be_written_into_its_own_rig(here: Path) -> None:
    assert main([*MOUNTING.split(), "rig.toml"]) == 0
    assert "pose_covariance" in (here / "rig.toml").read_text()


@pytest.mark.parametrize(
    "option",
    [
        *(f"--friction {value}" for value in ("-1", "0", "nan", "inf")),
        *(f"--torsion {value}" for value in ("-1", "nan")),
        *(f"--noise {value}" for value in ("0 0", "-1 1", "nan 1", "inf inf", "1e200 1")),
        *(f"--contact {value}" for value in ("0.3 0.5", "nan nan", "-1 -1", "inf 1")),
        *(f"--crease {value}" for value in ("-1", "nan", "181")),
    ],
)
@pytest.mark.usefixtures("here")
def test_an_option_that_is_no_quantity_is_named(capsys: pytest.CaptureFixture[str], option: str) -> None:
    assert main([*ESTIMATE.split(), "out.csv", *option.split()]) in (1, 2)
    assert option.split()[0].removeprefix("--") in capsys.readouterr().err
    assert not Path("out.csv").exists()


@pytest.mark.parametrize("value", ["nan", "inf", "-1", "0", "1e300"])
@pytest.mark.usefixtures("here")
def test_a_placement_that_is_no_length_is_named(capsys: pytest.CaptureFixture[str], value: str) -> None:
    assert main([*MOUNTING.split(), "out.toml", "--placement", value]) == 1
    said = capsys.readouterr().err
    assert "placement" in said
    assert said.count("\n") == 1


def test_samples_that_no_contact_explains_are_warned_of(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The payload was identified in N m; a rig that calls the log's torques N mm leaves all of its torque in."""
    assert main([*ESTIMATE.split(), "out.csv"]) == 0
    assert "of the loaded samples" not in capsys.readouterr().out
    rig = (here / "rig.toml").read_text()
    (here / "rig.toml").write_text(rig.replace('torque = "N m"', 'torque = "N mm"'))
    assert main([*ESTIMATE.split(), "out.csv"]) == 4  # no result to trust
    assert re.search(r"warning: of the loaded samples .* implausible .* off the surface", capsys.readouterr().out)


@pytest.mark.usefixtures("here")
def test_a_centre_of_mass_beyond_reach_is_refused_unless_forced(capsys: pytest.CaptureFixture[str]) -> None:
    _edit("free_motion.csv", **{name: pl.col(name) * 1e3 for name in WRENCH[3:]})  # N mm written as N m
    assert main(["calibrate", "payload", "free_motion.csv", "-o", "p.toml"]) == 1
    assert "it is nearer if the torque is in N mm. Write" in capsys.readouterr().err
    assert main(["calibrate", "payload", "free_motion.csv", "-o", "p.toml", "--force"]) == 0
    assert "it is nearer if the torque is in N mm. Write" in capsys.readouterr().out


def test_marks_in_millimetres_are_refused(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _edit("marks.csv", **{name: pl.col(name) * 1e3 for name in ("px", "py", "pz")})
    assert main([*MOUNTING.split(), "out.toml"]) == 1
    assert "in metres" in capsys.readouterr().err
    assert not (here / "out.toml").exists()


@pytest.mark.usefixtures("here")
def test_marks_on_another_clock_are_refused_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    _edit("marks.csv", start=pl.col("start") + 1e4, end=pl.col("end") + 1e4)
    assert main([*MOUNTING.split(), "out.toml"]) == 1
    assert "touches are outside the log" in capsys.readouterr().err


@pytest.mark.usefixtures("here")
def test_a_refusal_says_what_was_left_out(capsys: pytest.CaptureFixture[str]) -> None:
    """Two gaps between samples are no touches, and one touch is not enough."""
    marks = pl.read_csv("marks.csv")[:3]
    time = pl.read_csv("touches.csv")["time"]
    empty = [float(time[10]) + 1e-4, float(time[20]) + 1e-4]
    start = pl.Series("start", [marks["start"][0], *empty])
    end = pl.Series("end", [marks["end"][0], *(value + 1e-4 for value in empty)])
    marks.with_columns(start, end, label=pl.Series(["tip", "left", "right"])).write_csv("marks.csv")
    code = main([*MOUNTING.split(), "out.toml"])
    said = capsys.readouterr()
    assert "left is left out" in said.out + said.err
    assert "right is left out" in said.out + said.err
    assert ("Also:" in said.err) == (code == 1)


@pytest.mark.parametrize("marks", [["--marks", "marks.csv"], []])
@pytest.mark.usefixtures("here")
def test_a_log_without_times_places_no_touch(capsys: pytest.CaptureFixture[str], marks: list[str]) -> None:
    _edit("touches.csv", time=pl.lit(float("nan")))
    assert main(["calibrate", "mounting", "touches.csv", "--rig", "rig.toml", *marks, "-o", "out.toml"]) == 1
    assert "time" in capsys.readouterr().err


@pytest.mark.usefixtures("here")
def test_presses_in_a_log_that_runs_backwards_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    pl.read_csv("touches.csv", infer_schema_length=None).reverse().write_csv("touches.csv")
    assert main(["calibrate", "mounting", "touches.csv", "--rig", "rig.toml", "-o", "out.toml"]) == 1
    assert "times run backwards, or are missing, within a press. Sort" in capsys.readouterr().err


@pytest.mark.usefixtures("here")
def test_the_position_has_the_spread_of_the_surfaces_own_place(capsys: pytest.CaptureFixture[str]) -> None:
    """About the sensor's origin, 85 mm away, the uncertain turn would make it several times as large."""
    from palpate.setup import load_rig

    assert main([*MOUNTING.split(), "out.toml"]) == 0
    line = next(row for row in capsys.readouterr().out.splitlines() if row.strip().startswith("position"))
    said = [float(value) for value in line.split("+- (")[1].split(")")[0].split(",")]
    surface = load_rig(Path("out.toml")).surface
    x, y, z = surface.pose.xyz
    moves = np.hstack([np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]]), np.eye(3)])  # omega x t + rho
    covariance = moves @ np.asarray(surface.pose_covariance) @ moves.T
    assert said == pytest.approx(1e3 * np.sqrt(np.diag(covariance)), rel=0.1)  # two digits


def test_touches_without_samples_are_listed_and_not_averaged(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*ESTIMATE.split(), "out.csv"]) == 0
    with (here / "truth.csv").open("a") as file:
        file.write("900,901,0,0,0.02,late\n")
    capsys.readouterr()
    assert main(["evaluate", "out.csv", "truth.csv"]) == 0
    said = capsys.readouterr().out
    assert "nan" not in said
    assert "1 of 3 touches have no sample and are left out of the averages: late" in said


@pytest.mark.usefixtures("here")
def test_without_an_answer_there_is_nothing_to_average(capsys: pytest.CaptureFixture[str]) -> None:
    _edit("touches.csv", **{name: pl.lit(float("nan")) for name in ("qx", "qy", "qz", "qw")})
    main([*ESTIMATE.split(), "out.csv"])
    capsys.readouterr()
    assert main(["evaluate", "out.csv", "truth.csv"]) == 0
    said = capsys.readouterr().out
    assert "no errors to average" in said
    assert "nan" not in said


@pytest.mark.parametrize("value", ["1e150", "-1e200", "1e10", "inf"])
@pytest.mark.usefixtures("here")
def test_numbers_beyond_any_sensor_are_invalid_samples(value: str) -> None:
    row = pl.int_range(pl.len()) % 50 == 5
    columns = {name: pl.when(row).then(pl.lit(float(value))).otherwise(pl.col(name)) for name in ("fx", "tz")}
    _edit("touches.csv", **columns)
    _edit("free_motion.csv", **columns)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main([*ESTIMATE.split(), "out.csv"]) == 0
        assert main(["calibrate", "payload", "free_motion.csv", "-o", "p.toml"]) == 0
    assert pl.read_csv("out.csv")["status"][5] == "invalid"
    # of each 50 samples one is lost: that moves no average by more than its own noise
    assert read_model(Path("p.toml"), Payload).mass == pytest.approx(
        read_model(Path("payload.toml"), Payload).mass, rel=1e-3
    )


def test_accelerations_beyond_any_robot_are_invalid_samples(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _edit("touches.csv", ax=pl.lit(1e200), ay=pl.lit(0.0), az=pl.lit(0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main([*ESTIMATE.split(), "out.csv"]) == 4
    assert capsys.readouterr().out.splitlines()[-1].endswith("no result to trust: the log has no contact")
    assert set(pl.read_csv(here / "out.csv")["status"]) == {"invalid"}


def test_bounds_that_are_too_tight_are_named_with_those_that_would_do(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The session's touches lean by up to their friction, and turn within 5 mm."""
    assert main([*ESTIMATE.split(), "out.csv", "--friction", "0.02"]) in (0, 4)
    said = capsys.readouterr().out
    assert "by friction in" in said
    assert "bound 0.02" in said
    proposed = float(said.split("stay below friction = ")[1].split()[0])
    assert main([*ESTIMATE.split(), "out.csv", "--friction", f"{1.2 * proposed:.3g}"]) == 0
    assert "are implausible" not in capsys.readouterr().out
    assert main(["inspect", "touches.csv", "--rig", "rig.toml"]) == 0
    assert "stay below friction" in capsys.readouterr().out


def _python(script: str, *arguments: str, **given: Any) -> subprocess.Popen[bytes]:
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "-c", script, *arguments], **pipes | given)


CALL = "import sys; from palpate.cli import main; print('here', file=sys.stderr, flush=True); sys.exit(main())"


WAITING = """
import sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "palpate.cli.app":
            print("here", file=sys.stderr, flush=True)
            sys.stdin.readline()
sys.meta_path.insert(0, Finder())
from palpate.cli import main
sys.exit(main())
"""


@pytest.mark.usefixtures("here")
def test_an_early_ctrl_c_is_130_and_a_word() -> None:
    """While the commands are imported: the program waits there for the signal."""
    process = _python(WAITING, *ESTIMATE.split(), "out.csv", stdin=subprocess.PIPE)
    assert process.stderr.readline() == b"here\n"
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(b"\n", timeout=60)
    assert said.decode().startswith("palpate: interrupted")
    assert b"Traceback" not in said
    assert process.returncode == 130
    assert not Path("out.csv").exists()


INTERRUPTING = """
import signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name in ("networkx", "shapely", "lxml", "xxhash"):  # which it does without, whatever the reason
            signal.raise_signal(signal.SIGINT)
import palpate.cli.app
from palpate.cli import main
sys.meta_path.insert(0, Finder())
sys.exit(main())
"""


@pytest.mark.usefixtures("here")
def test_ctrl_c_while_the_mesh_reader_is_imported_is_not_swallowed() -> None:
    trimesh.load("probe.stl").export("probe.obj")  # a binary STL needs no library
    Path("rig.toml").write_text(Path("rig.toml").read_text().replace("probe.stl", "probe.obj"))
    process = _python(INTERRUPTING, *ESTIMATE.split(), "out.csv")
    _, said = process.communicate(timeout=120)
    assert (process.returncode, said) == (130, b"palpate: interrupted; no file is half written\n")
    assert not Path("out.csv").exists()


def test_ctrl_c_is_heard_after_the_block_and_then_as_before() -> None:
    before, done = signal.getsignal(signal.SIGINT), []

    def block() -> None:
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
            done.append("the whole block")

    with pytest.raises(KeyboardInterrupt):
        block()
    assert done
    assert signal.getsignal(signal.SIGINT) is before


IMPORTING = """
import gc
from palpate.interrupts import importing
frozen = []
for _ in range(2):
    with importing():
        import json.tool, email.message
    frozen.append(gc.get_freeze_count())
print(frozen[0] > 1000, frozen[1] <= frozen[0], gc.isenabled())
"""


def test_the_collector_passes_over_what_a_command_imported_and_over_nothing_else() -> None:
    assert subprocess.check_output([sys.executable, "-c", IMPORTING], text=True).split() == ["True"] * 3


@pytest.mark.usefixtures("here")
def test_a_reader_that_leaves_ends_it_silently() -> None:
    process = _python(CALL, "inspect", "touches.csv", stdout=(pipe := os.pipe())[1])
    os.close(pipe[0])
    os.close(pipe[1])
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (0, b"here\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no device that is always full")
@pytest.mark.parametrize("call", ["inspect touches.csv", "--help"])
@pytest.mark.usefixtures("here")
def test_a_full_disk_behind_the_output_is_a_sentence(call: str) -> None:
    with Path("/dev/full").open("wb") as full:
        process = _python(CALL, *call.split(), stdout=full)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    assert said.decode().splitlines()[1:] == ["palpate: [Errno 28] No space left on device"]


EACH = "import sys; from palpate.cli import main; sys.exit(max(main(['inspect', name]) for name in sys.argv[1:]))"


def test_names_that_the_terminal_cannot_spell_are_escaped(here: Path) -> None:
    names = [os.fsdecode(name) for name in ("über.csv".encode(), b"bad\xff.csv")]
    for name in names:
        shutil.copy(here / "touches.csv", name)
    printed, said = _python(EACH, *names, env={**os.environ, "PYTHONIOENCODING": "ascii"}).communicate(timeout=60)
    assert said == b""
    assert b"\\xfcber.csv" in printed
    assert b"bad\\udcff.csv" in printed
