"""`palpate simulate load-cells` and `simulate pokes`: what is asked in error is one sentence, and nothing is made.

That the folders hold what the other commands need is tested by the tutorials (tests/conformance/test_front_door.py).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from palpate.cli import main
from palpate.setup import load_rig
from palpate_lab.simulation.load_cell_bench import BENCHES
from palpate_lab.simulation.load_cell_files import load_cell_rig, write_load_cell_session


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("load-cells --seed -1", "--seed: must not be negative."),
        ("pokes --seed -1", "--seed: must not be negative."),
        ("pokes --pokes 6", "--pokes: must be from 7 (one in each pose of the elbow) to 5,000, not 6."),
        ("pokes --pokes 1000000", "--pokes: must be from 7 (one in each pose of the elbow) to 5,000, not 1000000."),
    ],
)
def test_impossible_numbers_are_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str, said: str
) -> None:
    assert main(["simulate", *words.split(), "-o", str(tmp_path / "run")]) == 1
    assert capsys.readouterr().err.strip() == f"palpate: {said}"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["load-cells", "pokes"])
def test_what_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text("kept", encoding="utf-8")
    said = {tmp_path: "is not empty", mine: "is a file", tmp_path / "nowhere/run": "there is no folder"}
    for folder, why in said.items():
        assert main(["simulate", command, "-o", str(folder)]) == 1
        assert why in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    assert mine.read_text(encoding="utf-8") == "kept"


def test_a_seed_is_a_fingertip(tmp_path: Path) -> None:
    bench = replace(BENCHES["rigid"], seed=5)
    files: dict[str, dict[str, bytes]] = {}
    for name, own in {"one": bench, "again": bench, "other": replace(bench, seed=6)}.items():
        write_load_cell_session(own, tmp_path / name, thin=400)
        files[name] = {file.name: file.read_bytes() for file in (tmp_path / name).iterdir()}
    assert set(files["one"]) == {"bench_log.csv", "log.csv", "truth.csv", "rig.toml"}
    assert files["one"] == files["again"]
    assert files["one"]["log.csv"] != files["other"]["log.csv"]
    log, truth = pl.read_csv(tmp_path / "one/log.csv"), pl.read_csv(tmp_path / "one/truth.csv")
    assert {"time", *load_rig(tmp_path / "one/rig.toml").sensors["load_cells"].columns} == set(log.columns)
    assert set(truth["time"]) <= set(log["time"])


@pytest.mark.parametrize("kind", ["rigid", "soft layer"])
def test_the_rig_says_whether_the_fingertip_is_soft(tmp_path: Path, kind: str) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(load_cell_rig(BENCHES[kind]), encoding="utf-8")
    assert load_rig(rig).sensors["load_cells"].indentation == (kind == "soft layer")
