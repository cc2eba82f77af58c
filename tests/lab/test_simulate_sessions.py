"""Sessions of load cells; that a folder holds what commands need is tested by the tutorials (test_front_door.py)."""

from pathlib import Path

import polars as pl
import pytest

from palpate.setup import load_rig
from palpate_lab.simulation.load_cell_bench import BENCHES
from palpate_lab.simulation.load_cell_files import load_cell_rig, write_load_cell_session


def test_a_rig_names_the_columns_of_its_log(tmp_path: Path) -> None:
    write_load_cell_session(BENCHES["rigid"], tmp_path / "one", thin=400)
    assert {file.name for file in (tmp_path / "one").iterdir()} == {"bench_log.csv", "log.csv", "truth.csv", "rig.toml"}
    log, truth = pl.read_csv(tmp_path / "one/log.csv"), pl.read_csv(tmp_path / "one/truth.csv")
    assert {"time", *load_rig(tmp_path / "one/rig.toml").sensors["load_cells"].columns} == set(log.columns)
    assert set(truth["time"]) <= set(log["time"])


@pytest.mark.parametrize("kind", ["rigid", "soft layer"])
def test_the_rig_says_whether_the_fingertip_is_soft(tmp_path: Path, kind: str) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(load_cell_rig(BENCHES[kind]), encoding="utf-8")
    assert load_rig(rig).sensors["load_cells"].indentation == (kind == "soft layer")
