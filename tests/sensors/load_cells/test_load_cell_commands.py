"""`calibrate load-cells` and `estimate` of voltages, from files of a simulated bench."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.cli import main
from palpate.files.contacts import read_contacts
from palpate_lab.simulation.load_cell_bench import BENCHES
from palpate_lab.simulation.load_cell_files import voltage_columns, write_bench_log, write_voltage_log

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
    assert (
        main(
            [
                "calibrate",
                "load-cells",
                str(made / "bench.csv"),
                "--rig",
                str(made / "plain.toml"),
                "-o",
                str(made / "tip.toml"),
            ]
        )
        == 0
    )
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


def test_parquet_is_the_same(folder: Path) -> None:
    pl.read_csv(folder / "log.csv").write_parquet(folder / "log.parquet")
    for name in ("log.csv", "log.parquet"):
        out = folder / f"{name}.contacts.csv"
        assert main(["estimate", str(folder / name), "--rig", str(folder / "rig.toml"), "-o", str(out)]) == 0
    assert (folder / "log.csv.contacts.csv").read_text() == (folder / "log.parquet.contacts.csv").read_text()


def changed(folder: Path, name: str, **columns: pl.Expr) -> Path:
    pl.read_csv(folder / "log.csv").with_columns(**columns).write_csv(folder / name)
    return folder / name


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({f"u2{axis}": pl.lit(0.01) for axis in "xyz"}, "cell 2 is dead"),
        ({"u3z": pl.col("u3z") * 1e3}, "u3z reads 1e+03 times what it should"),
        ({f"u{a}{x}": pl.col(f"u{b}{x}") for a, b in ((1, 4), (4, 1)) for x in "xyz"}, "cells 1 and 4 are exchanged"),
        ({f"u1{axis}": pl.col(f"u1{axis}").clip(-0.04, 0.04) for axis in "xyz"}, "cell 1 is saturated"),
        ({f"u4{axis}": pl.col(f"u4{axis}") + 1e-3 * (pl.col("time") % 40) for axis in "xyz"}, "cell 4 drifts"),
    ],
)
def test_bad_cells_are_named(
    folder: Path, columns: dict[str, pl.Expr], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    log = changed(folder, "bad.csv", **columns)
    assert main(["estimate", str(log), "--rig", str(folder / "rig.toml"), "-o", str(folder / "bad_contacts.csv")]) == 0
    assert said in capsys.readouterr().out


def test_a_log_that_begins_touched_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = pl.read_csv(folder / "log.csv").filter(pl.col("time") > 2.6)
    rows.write_csv(folder / "late.csv")
    out = folder / "late_contacts.csv"
    assert main(["estimate", str(folder / "late.csv"), "--rig", str(folder / "rig.toml"), "-o", str(out)]) == 1
    assert "the cells are not at rest at the start" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("rig", "said"),
    [
        (RIG + 'model = "none.toml"\n', "the file does not exist"),
        (RIG, "the cells are not calibrated"),
        (
            RIG + 'model = "tip.toml"\ncolumns = ["u1x", "u1y", "u1z", "u2x", "u2y", "u2z", "u3x", "u3y", "u3z"]\n',
            "has 4 cells",
        ),
        (RIG + 'model = "tip.toml"\nwithout = [5]\n', "cell 5 does not exist: cells are 1 to 4"),
        ('[load_cells]\nmodel = "tip.toml"\n', "needs a [surface]"),
    ],
)
def test_bad_rigs_are_sentences(folder: Path, rig: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "bad.toml").write_text(rig)
    arguments = ["estimate", str(folder / "log.csv"), "--rig", str(folder / "bad.toml"), "-o", str(folder / "x.csv")]
    assert main(arguments) == 1
    assert said in capsys.readouterr().err


def test_too_light_says_what_would_do(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "light.toml").write_text(RIG + 'model = "tip.toml"\naccuracy = 20e-6\n')
    out = folder / "light.csv"
    assert main(["estimate", str(folder / "log.csv"), "--rig", str(folder / "light.toml"), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "too_light" in said
    assert "is located within 0.02 mm" in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda log: log.drop("u2y"), "there is no column 'u2y'"),
        (lambda log: log.drop("ref_fx"), "there is no column 'ref_fx'"),
        (lambda log: log.with_columns(u2z=pl.lit(0.0)), "'u2z' never changes"),
        (lambda log: log.filter(pl.col("time").is_between(4.0, 14.0)), "does not begin unloaded"),
    ],
)
def test_bad_bench_logs_are_sentences(
    folder: Path, change: object, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(change)
    change(pl.read_csv(folder / "bench.csv")).write_csv(folder / "bad_bench.csv")
    arguments = ["calibrate", "load-cells", str(folder / "bad_bench.csv"), "--rig", str(folder / "plain.toml")]
    assert main([*arguments, "-o", str(folder / "bad_tip.toml")]) == 1
    assert said in capsys.readouterr().err
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
