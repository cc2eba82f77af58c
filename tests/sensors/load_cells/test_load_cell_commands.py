"""`calibrate load-cells` and `estimate` of voltages, from files of a simulated bench."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.cli import main
from palpate.files.contacts import read_contacts
from palpate.files.models import write_model
from palpate.sensors.load_cells.resolution import nominal_cells
from palpate_lab.simulation.load_cell_bench import BENCHES
from palpate_lab.simulation.load_cell_files import voltage_columns, write_bench_log, write_voltage_log
from tests.cli.test_calibrate_drift import a_zero, columns, drift, found_in

RIG = """
[surface]
kind = "elliptic_cylinder"
a = 0.014
b = 0.005
half_length = 0.016
upper = true

[load_cells]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibrated fingertip, and a log of another run."""
    made = tmp_path_factory.mktemp("bench")
    bench = BENCHES["rigid"]
    write_bench_log(bench.run(0, thin=10), made / "bench.csv")
    write_voltage_log(bench.run(1, thin=10), made / "log.csv")
    (made / "plain.toml").write_text(RIG)
    calibrate = ["calibrate", "load-cells", f"{made}/bench.csv", "--rig", f"{made}/plain.toml"]
    assert main([*calibrate, "-o", f"{made}/tip.toml"]) == 0
    (made / "rig.toml").write_text(RIG + 'model = "tip.toml"\n')
    return made


def test_contacts_of_every_start(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder / "contacts.csv"
    assert main(["estimate", str(folder / "log.csv"), "--rig", str(folder / "rig.toml"), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "warning" not in said
    assert "is located within 2 mm" in said
    run = BENCHES["rigid"].run(1, thin=10)
    found = read_contacts(out).estimate
    use = np.linalg.norm(run.wrench[:, :3], axis=1) >= 1.0
    off = np.linalg.norm(found.point[use] - run.point[use], axis=1)
    assert np.sqrt(np.mean(off**2)) < 45e-6  # the paper's noise makes 28 um
    assert np.all(found.answered[use])
    assert (folder / "contacts.csv.toml").read_text().count("sha256:") == 3


def test_bad_cells_are_named_and_the_others_locate(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, out = folder / "bad.csv", folder / "bad_contacts.csv"
    dead, unit = {f"u2{axis}": pl.lit(0.01) for axis in "xyz"}, {"u3z": pl.col("u3z") * 1e3}
    for faults, said in ((dead, "cell 2 is dead"), (unit, "u3z reads 1e+03 times what it should")):
        pl.read_csv(folder / "log.csv").with_columns(**faults).write_csv(log)
        assert main(["estimate", str(log), "--rig", f"{folder}/rig.toml", "-o", str(out)]) == 0
        assert said in capsys.readouterr().out
    assert read_contacts(out).estimate.answered[-100:].any()


@pytest.mark.parametrize(
    ("rig", "said"),
    [
        (RIG + 'model = "none.toml"\n', "the file does not exist"),
        (RIG, "the cells are not calibrated. Run"),
        (
            RIG + 'model = "tip.toml"\ncolumns = ["u1x", "u1y", "u1z", "u2x", "u2y", "u2z", "u3x", "u3y", "u3z"]\n',
            "load_cells.columns: names 9 columns, but tip.toml has 4 cells",
        ),
        (RIG + 'model = "tip.toml"\nwithout = [5]\n', "load_cells.without: cell 5 does not exist: cells are 1 to 4"),
        ('[load_cells]\nmodel = "tip.toml"\n', "needs a [surface]. `palpate"),
    ],
)
def test_bad_rigs_are_sentences(folder: Path, rig: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "bad.toml").write_text(rig)
    arguments = ["estimate", str(folder / "log.csv"), "--rig", str(folder / "bad.toml"), "-o", str(folder / "x.csv")]
    assert main(arguments) == 1
    assert said in capsys.readouterr().err


def test_a_bench_log_that_lacks_a_column_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for column in ("u2y", "ref_fx"):
        pl.read_csv(folder / "bench.csv").drop(column).write_csv(folder / "bad_bench.csv")
        arguments = ["calibrate", "load-cells", f"{folder}/bad_bench.csv", "--rig", f"{folder}/plain.toml"]
        assert main([*arguments, "-o", f"{folder}/bad_tip.toml"]) == 1
        assert f"there is no column '{column}'" in capsys.readouterr().err
        assert not (folder / "bad_tip.toml").exists()


def test_columns_by_name_and_unit(folder: Path) -> None:
    names = [f"ch{k}" for k in range(12)]
    log = pl.read_csv(folder / "log.csv").rename(dict(zip(voltage_columns(4), names, strict=True)))
    log.with_columns(pl.col(names) * 1e3).write_csv(folder / "milli.csv", float_precision=9)
    listed = ", ".join(f'"{name}"' for name in names)
    (folder / "milli.toml").write_text(RIG + f'model = "tip.toml"\ncolumns = [{listed}]\nunits = "mV"\n')
    for name, rig in (("log.csv", "rig.toml"), ("milli.csv", "milli.toml")):
        out = folder / f"{name}.out.csv"
        assert main(["estimate", str(folder / name), "--rig", str(folder / rig), "-o", str(out)]) == 0
    one, other = (read_contacts(folder / f"{name}.out.csv").estimate for name in ("log.csv", "milli.csv"))
    np.testing.assert_allclose(one.point, other.point, atol=1e-9)  # nine digits of mV


def test_of_load_cells_it_is_of_voltages(tmp_path: Path) -> None:
    """One channel dead, and left out by the rig."""
    places = 0.01 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0.0]])
    cells = nominal_cells(places, 20.0, 2e-5, 5.0)
    write_model(tmp_path / "cells.toml", cells)
    volts = 1.0 + 1e-3 * np.tile(a_zero()[:, :3], 4)
    volts[:, 3:6] = 0.0
    columns(tmp_path / "free.csv", ",".join(f"u{cell}{axis}" for cell in (1, 2, 3, 4) for axis in "xyz"), volts)
    rig = '[surface]\nkind = "plane"\n[load_cells]\nmodel = "cells.toml"\nwithout = [2]\n'
    code, out = drift(tmp_path, "free.csv", rig)
    assert code == 0
    np.testing.assert_allclose(found_in(out, 12).walk, 4e-6, rtol=0.35)
