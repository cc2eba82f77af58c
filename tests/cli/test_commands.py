"""The commands on a small simulated session, in process: exit codes, files, and what a person reads."""

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import trimesh

from palpate.cli import main
from palpate.contact.locate import OFF, ON
from palpate.files.contacts import read_contacts
from palpate.files.models import load_toml, read_model
from palpate.setup import load_rig
from palpate.signals.payload import Payload
from palpate_lab.simulation.session import Session, simulate_session
from palpate_lab.simulation.session_files import write_session

Edit = Callable[[pl.DataFrame], pl.DataFrame]


@pytest.fixture(scope="module")
def session() -> Session:
    return simulate_session(3, touches=8, facets=2000)


@pytest.fixture(scope="module")
def made(session: Session, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of a session, with its payload identified."""
    folder = tmp_path_factory.mktemp("session")
    write_session(session, folder)
    assert main(["calibrate", "payload", str(folder / "free_motion.csv"), "-o", str(folder / "payload.toml")]) == 0
    return folder


def _edited(made: Path, tmp_path: Path, edit: Edit) -> Path:
    log = pl.read_csv(made / "touches.csv", infer_schema_length=None)
    edit(log).write_csv(tmp_path / "touches.csv")
    return tmp_path / "touches.csv"


def _estimate(log: Path, made: Path, tmp_path: Path, *options: str) -> int:
    rig = [] if "--mesh" in options else ["--rig", str(made / "rig.toml")]
    return main(["estimate", str(log), *rig, "-o", str(tmp_path / "contacts.csv"), *options])


def _mounting(made: Path, output: Path, *options: str) -> int:
    log, rig = str(made / "touches.csv"), str(made / "rig.toml")
    return main(["calibrate", "mounting", log, "--rig", rig, "-o", str(output), *options])


def test_payload_is_what_the_session_carries(session: Session, made: Path) -> None:
    """The biases of 14 poses of 200 samples: noise 0.02 N / sqrt(2800), five times over, and more for the centre."""
    payload = read_model(made / "payload.toml", Payload)
    assert payload.mass == pytest.approx(session.load.mass, abs=1e-3)
    assert payload.force_bias == pytest.approx(session.load.force_bias, abs=5e-3)
    assert payload.center_of_mass == pytest.approx(session.load.center_of_mass, abs=2e-4)
    assert "free_motion.csv sha256:" in payload.provenance["log"]


def test_without_an_output_the_touches_are_said_and_nothing_is_written(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same words as of the contacts that are written."""
    monkeypatch.chdir(tmp_path)
    call = ["estimate", str(made / "touches.csv"), "--rig", str(made / "rig.toml")]
    before = sorted(made.iterdir())
    capsys.readouterr()
    assert main(call) == 0
    said = capsys.readouterr().out.splitlines()
    assert not list(tmp_path.iterdir())
    assert sorted(made.iterdir()) == before
    assert main([*call, "-o", "contacts.csv"]) == 0
    assert main(["events", "contacts.csv"]) == 0
    written = capsys.readouterr().out.splitlines()
    assert [line for line in said if line.startswith("  time ")] != []
    table = [line for line in said if re.match(r"  (touch|\d+) ", line)]
    assert len(table) == 9  # eight touches below a header
    assert set(table) <= set(written)
    assert main([*call, "--report", "page.html"]) == 1
    assert "Add -o FILE" in capsys.readouterr().err


def test_an_implausible_log_names_the_next_command(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And the command works as it is printed; a payload that is not there names the command that writes one."""
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()
    call = ["estimate", str(made / "touches.csv"), "--mesh", str(made / "probe.stl"), "--unit", "mm"]
    assert main(call) in (0, 4)  # some weights are where a contact could be
    named = re.search(r"next: `palpate (.*)`;", capsys.readouterr().out)
    assert named is not None
    assert main(shlex.split(named[1])) == 0
    assert (tmp_path / "rig.toml").exists()
    assert main([*call, "--payload", "payload.toml"]) == 1
    assert "payload.toml: the file does not exist. `palpate calibrate payload` writes" in capsys.readouterr().err


def test_help_states_the_thresholds_that_the_code_has(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["estimate", "--help"]) == 0
    assert f"{ON:g}, {OFF:g} times the noise" in " ".join(capsys.readouterr().out.replace("│", " ").split())


def test_the_chain_of_the_quick_start(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Location after calibration: under a millimetre where assembly alone puts it 1.2 mm and 1.5 degrees off."""
    rig = tmp_path / "rig.toml"
    assert _mounting(made, rig, "--marks", str(made / "marks.csv")) == 0
    assert main(["estimate", str(made / "touches.csv"), "--rig", str(rig), "-o", str(tmp_path / "contacts.csv")]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(tmp_path / "contacts.csv"), str(made / "truth.csv")]) == 0
    said = capsys.readouterr().out
    row = next(line for line in said.splitlines() if "location of touches" in line)
    assert float(row.split()[4]) < 1.0
    assert "contact" in said
    assert load_rig(rig).surface.pose_covariance is not None
    assert "# of the mesh file" in rig.read_text()


def test_mounting_without_marks_uses_presses(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _mounting(made, tmp_path / "rig.toml") == 0
    assert "used of 8 presses somewhere on the surface" in capsys.readouterr().out


def test_the_first_five_minutes_need_a_mesh_only(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _estimate(made / "touches.csv", made, tmp_path, "--mesh", str(made / "probe.stl"), "--unit", "mm") == 0
    said = capsys.readouterr().out
    assert "no payload model: wrenches are taken as they are" in said
    assert "warning: the force is never below" in said
    contacts = read_contacts(tmp_path / "contacts.csv")
    log = pl.read_csv(made / "touches.csv")
    assert contacts.sample.tolist() == list(range(len(log)))
    assert np.array_equal(contacts.time, log["time"].to_numpy())
    record = load_toml(tmp_path / "contacts.csv.toml")
    assert set(record) >= {"palpate", "log", "mesh", "friction", "method", "noise_source"}


def test_the_base_frame_needs_a_position(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _estimate(made / "touches.csv", made, tmp_path, "--frame", "base") == 1
    assert "sensor's position in the base, which this log does not have. Add" in capsys.readouterr().err


def _at(row: int, **values: float | None) -> Edit:
    return lambda table: table.with_columns(
        pl.when(pl.int_range(pl.len()) == row).then(pl.lit(value, dtype=pl.Float64)).otherwise(pl.col(name)).alias(name)
        for name, value in values.items()
    )


@pytest.mark.parametrize(
    ("edit", "status", "word"),
    [
        (_at(5, fx=None), "invalid", "not a number"),
        (_at(5, qx=float("nan")), "no_pose", "not a number"),
        (_at(5, qx=0.0, qy=0.0, qz=0.0, qw=0.0), "no_pose", "length far from 1"),
    ],
)
def test_bad_samples_get_a_status_and_none_is_lost(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], edit: Edit, status: str, word: str
) -> None:
    assert _estimate(_edited(made, tmp_path, edit), made, tmp_path) == 0
    contacts = pl.read_csv(tmp_path / "contacts.csv", infer_schema=False)
    assert contacts["sample"].to_list() == [str(k) for k in range(len(pl.read_csv(made / "touches.csv")))]
    assert contacts["status"][5] == status
    assert word in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('torque = "N m"', 'torque = "kN m"', "further from the middle"),  # as if N mm had been declared N m
        ('unit = "mm"', 'unit = "m"', "check the unit"),
    ],
)
def test_units_that_do_not_fit_are_warned_of(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, word: str
) -> None:
    text = (made / "rig.toml").read_text().replace(old, new, 1)
    text = text.replace('payload = "payload.toml"', "").replace("probe.stl", (made / "probe.stl").as_posix())
    (tmp_path / "rig.toml").write_text(text)
    log = _edited(made, tmp_path, _compensated(made))
    code = main(["estimate", str(log), "--rig", str(tmp_path / "rig.toml"), "-o", str(tmp_path / "contacts.csv")])
    said = capsys.readouterr()
    if old.startswith("unit"):  # a body of 20 m is refused before it is prepared
        assert code == 1
        assert "Correct its unit" in said.err
    else:
        assert code in (0, 4)  # 4: nothing can be believed
        assert word in said.out


def _compensated(made: Path) -> Edit:
    """Readings less what the free sensor reads in about the same pose: enough for a warning about units."""
    payload = read_model(made / "payload.toml", Payload)
    bias = np.concatenate([payload.force_bias, payload.torque_bias])
    names = ("fx", "fy", "fz", "tx", "ty", "tz")
    return lambda table: table.with_columns(
        pl.Series(name, table[name].to_numpy() - value) for name, value in zip(names, bias, strict=True)
    )


def test_misspelt_keys_wrong_calls_and_help_have_their_exit_codes(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.toml").write_text((made / "rig.toml").read_text().replace("crease", "creese"))
    assert main(["inspect", str(tmp_path / "rig.toml")]) == 1
    assert "Did you mean 'crease'" in capsys.readouterr().err
    assert main(["estimate"]) == 2
    assert main(["no-such-command"]) == 2
    assert main(["estimate", "--help"]) == 0
    call = ["estimate", str(made / "touches.csv"), "-o", str(tmp_path / "c.csv")]
    assert main(call) == 1
    assert main([*call, "--mesh", str(made / "probe.stl")]) == 1
    assert "--unit mm" in capsys.readouterr().err


def test_times_too_coarse_for_a_filter_are_refused_with_one_and_noted_without(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """200 samples of each second have its stamp: nothing says how fast they came."""
    log = _edited(made, tmp_path, lambda table: table.with_columns(time=pl.col("time").floor()))
    assert _estimate(log, made, tmp_path) == 1
    assert "the rate that the filter needs is not known. Write" in capsys.readouterr().err
    assert _estimate(log, made, tmp_path, "--filter", "none") == 0
    assert "times repeat" in capsys.readouterr().out
    assert len(read_contacts(tmp_path / "contacts.csv")) == len(pl.read_csv(log))


def test_ctrl_c_before_a_row_leaves_nothing(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from palpate.contact import WrenchEstimator

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(WrenchEstimator, "pairs", interrupted)
    assert _estimate(made / "touches.csv", made, tmp_path) == 130
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("step", "call"),
    [
        ("sensors.force_torque.commands.identify_payload", "payload free_motion.csv --rig rig.toml -o out.toml"),
        ("console.calibration.write_model", "payload free_motion.csv --rig rig.toml -o out.toml"),
        ("sensors.force_torque.mounting_command.identify_mounting", "mounting touches.csv --rig rig.toml -o rig.toml"),
    ],
)
def test_ctrl_c_while_calibrating_leaves_everything_as_it_was(
    made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], step: str, call: str
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.chdir(made)
    monkeypatch.setattr(f"palpate.{step}", interrupted)
    before = {file.name: file.read_bytes() for file in made.iterdir()}
    assert main(["calibrate", *call.split()]) == 130
    assert capsys.readouterr().err == "palpate: interrupted; no file is half written\n"
    assert {file.name: file.read_bytes() for file in made.iterdir()} == before


def test_options_win_over_the_rig(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = "--friction 0.7 --torsion 0.01 --contact 3 2 --method wrench_axis --noise 0.1 0.01"
    assert _estimate(made / "touches.csv", made, tmp_path, *options.split()) == 0
    record = load_toml(tmp_path / "contacts.csv.toml")
    assert (record["friction"], record["torsion"], record["method"]) == ("0.7", "0.01", "wrench_axis")
    assert record["contact"] == "on 3 N, off 2 N"
    assert record["noise_source"] == "given"


def test_truth_on_another_clock_is_refused(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _estimate(made / "touches.csv", made, tmp_path) == 0
    (tmp_path / "truth.csv").write_text("time,px,py,pz\n5000,0,0,0\n")
    assert main(["evaluate", str(tmp_path / "contacts.csv"), str(tmp_path / "truth.csv")]) == 1
    assert "no sample matches the truth" in capsys.readouterr().err


def test_inspect_knows_every_kind_of_file(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _estimate(made / "touches.csv", made, tmp_path) == 0
    capsys.readouterr()
    for file, word in (
        (made / "touches.csv", "a log"),
        (made / "truth.csv", "touches at known points"),
        (made / "probe.stl", "a mesh"),
        (made / "rig.toml", "a rig"),
        (made / "payload.toml", "a payload model"),
        (tmp_path / "contacts.csv", ": contacts"),
        (tmp_path / "contacts.csv.toml", "TOML"),
    ):
        assert main(["inspect", str(file)]) == 0
        said = capsys.readouterr().out
        assert word in said.splitlines()[0]
        assert len(said.splitlines()) <= 45  # one screen
    assert main(["inspect", str(tmp_path / "nothing.csv")]) == 1


def test_inspect_says_what_of_a_mesh_is_covered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A box in a box, and an open one: how many bodies, watertight or not, what cannot be touched."""
    boxes = [trimesh.creation.box((side, side, side)) for side in (20.0, 10.0)]
    trimesh.util.concatenate(boxes).export(tmp_path / "two.stl")
    trimesh.Trimesh(boxes[0].vertices, boxes[0].faces[1:]).export(tmp_path / "open.stl")
    assert main(["inspect", str(tmp_path / "two.stl")]) == 0
    said = capsys.readouterr().out
    assert re.search(r"bodies +2, watertight", said)
    assert re.search(r"covered +12 of 24 facets \(20% of the area\)", said)
    assert "`covered = true`" in said
    assert main(["inspect", str(tmp_path / "open.stl")]) == 0
    said = capsys.readouterr().out
    assert re.search(r"bodies +1, 3 open edges", said)
    assert re.search(r"covered +none", said)


def test_a_new_rig_serves_at_once_and_is_not_overwritten(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "rig.toml"
    call = ["rig", "new", str(made / "touches.csv"), str(made / "probe.stl"), "-o", str(rig)]
    assert main(call) == 0
    assert main(["estimate", str(made / "touches.csv"), "--rig", str(rig), "-o", str(tmp_path / "contacts.csv")]) == 0
    assert main(call) == 1
    assert "--force" in capsys.readouterr().err
    assert main([*call, "--force"]) == 0


def test_a_payload_needs_an_orientation(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pl.read_csv(made / "free_motion.csv").drop("qx", "qy", "qz", "qw").write_csv(tmp_path / "free.csv")
    assert main(["calibrate", "payload", str(tmp_path / "free.csv"), "-o", str(tmp_path / "payload.toml")]) == 1
    assert "the log has no orientation" in capsys.readouterr().err
    log = pl.read_csv(made / "touches.csv").drop("qx", "qy", "qz", "qw")
    log.write_csv(tmp_path / "touches.csv")
    mesh = ("--mesh", str(made / "probe.stl"), "--unit", "mm", "--payload", str(made / "payload.toml"))
    assert _estimate(tmp_path / "touches.csv", made, tmp_path, *mesh) == 1
    assert "the payload's weight turns with the sensor. Add" in capsys.readouterr().err


def test_poses_that_are_late_widen_a_payload(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    late = pl.col("qx", "qy", "qz", "qw").shift(40)  # samples of 5 ms
    pl.read_csv(made / "free_motion.csv").with_columns(late).drop_nulls().write_csv(tmp_path / "free.csv")
    said, masses = list[str](), list[tuple[float, float]]()
    for log in (made / "free_motion.csv", tmp_path / "free.csv"):
        assert main(["calibrate", "payload", str(log), "-o", str(tmp_path / "payload.toml")]) == 0
        said.append(capsys.readouterr().out)
        masses.append(tuple(map(float, re.search(r"mass +(\S+) \+- (\S+) kg", said[-1]).groups())))
    assert ["palpate calibrate clock" in each for each in said] == [False, True]
    assert abs(masses[1][0] - masses[0][0]) < 2.0 * masses[1][1]  # 3 and more with one error a pose


def test_swapped_axes_are_named_with_the_line_that_mends_them(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = pl.read_csv(made / "free_motion.csv")
    swapped = table.rename({"fy": "fz", "fz": "fy", "ty": "tz", "tz": "ty"})
    swapped.write_csv(tmp_path / "free.csv")
    main(["calibrate", "payload", str(tmp_path / "free.csv"), "-o", str(tmp_path / "payload.toml")])
    assert 'Write axes = ["x", "z", "y"] and left_handed = true' in capsys.readouterr().err
    rig, axes = (made / "rig.toml").read_text(), 'axes = ["x", "z", "y"]\nleft_handed = true'
    (tmp_path / "rig.toml").write_text(rig.replace('axes = ["x", "y", "z"]', axes))
    call = ["calibrate", "payload", str(tmp_path / "free.csv"), "-o", str(tmp_path / "payload.toml")]
    assert main([*call, "--rig", str(tmp_path / "rig.toml")]) == 0
    assert "hint:" not in capsys.readouterr().out


@pytest.mark.parametrize("text", ["down", "0,0", "0,0,0", "a,b,c"])
def test_a_gravity_that_is_no_direction_is_refused(made: Path, tmp_path: Path, text: str) -> None:
    call = ["calibrate", "payload", str(made / "free_motion.csv"), "-o", str(tmp_path / "p.toml"), "--gravity", text]
    assert main(call) == 1
    assert not (tmp_path / "p.toml").exists()
