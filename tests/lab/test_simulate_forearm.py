"""`palpate simulate forearm`: a folder on which Palpate's commands work, whole or not there."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from palpate.cli import main

pytest.importorskip("mujoco")
pytest.importorskip("rosbags")

TABLES = {"truth.csv", "load_cell_log.csv"}
FILES = {"both.mcap", "both.toml", "skin_map.toml", "intensity.toml", "payload.toml", "link.stl"} | TABLES


def _simulate(*words: str | Path) -> int:
    return main(["simulate", "forearm", "--seconds", "6", *(str(word) for word in words)])


def test_a_session_is_made_and_its_skin_is_located(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where the engine has the contacts, beside which the skin knows nothing but counts."""
    folder = tmp_path / "run"
    assert _simulate("-o", folder, "--seed", "1") == 0
    assert {path.name for path in folder.iterdir()} == FILES | {"README.txt"}
    assert f"palpate inspect {folder / 'both.mcap'}" in " ".join(capsys.readouterr().out.split())
    log, found = str(folder / "both.mcap"), tmp_path / "skin.csv"
    rig = ("--rig", str(folder / "both.toml"), "--sensor", "skin")
    assert main(["estimate", log, *rig, "-o", str(found)]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(found), str(folder / "truth.csv"), "--json"]) == 0
    errors = {row["name"]: row["median"] for row in json.loads(capsys.readouterr().out)["tables"][0]}
    assert errors["location [mm]"] < 2.0  # a fifth of a cell
    assert _simulate("-o", folder) == 1
    assert "is not empty" in capsys.readouterr().err


def test_ctrl_c_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(done: int, share: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("palpate_lab.cli.simulate_forearm.progress", stop)
    assert _simulate("-o", tmp_path / "run") == 130
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--seconds", "1"),
        ("--rows", "2"),
        ("--touches", "6"),
        ("--seed", "-1"),
        ("--unequal", "0.9"),
        ("--clock-offset", "2"),
        ("--free", "-1"),
    ],
)
def test_what_cannot_be_simulated_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    assert _simulate("-o", tmp_path / "run", option, value) == 1
    assert option in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
