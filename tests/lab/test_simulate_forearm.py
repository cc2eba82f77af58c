"""`palpate simulate forearm`: a folder on which Palpate's commands work."""

import json
from pathlib import Path

import pytest

from palpate.cli import main

pytest.importorskip("mujoco")
pytest.importorskip("rosbags")

TABLES = {"truth.csv", "load_cell_log.csv"}
FILES = {"both.mcap", "both.toml", "skin_map.toml", "intensity.toml", "payload.toml", "link.stl"} | TABLES


def test_a_session_is_made_and_its_skin_is_located(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where the engine has the contacts, beside which the skin knows nothing but counts."""
    folder = tmp_path / "run"
    assert main(["simulate", "forearm", "--seconds", "6", "-o", str(folder), "--seed", "1"]) == 0
    assert {path.name for path in folder.iterdir()} == FILES | {"README.txt"}
    assert f"palpate inspect {folder / 'both.mcap'}" in " ".join(capsys.readouterr().out.split())
    log, found = str(folder / "both.mcap"), tmp_path / "skin.csv"
    rig = ("--rig", str(folder / "both.toml"), "--sensor", "skin")
    assert main(["estimate", log, *rig, "-o", str(found)]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(found), str(folder / "truth.csv"), "--json"]) == 0
    errors = {row["name"]: row["median"] for row in json.loads(capsys.readouterr().out)["tables"][0]}
    assert errors["location [mm]"] < 2.0  # a fifth of a cell
