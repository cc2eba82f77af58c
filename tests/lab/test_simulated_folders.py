"""Simulated folders on which Palpate's commands work, with their truth, and `palpate demo` before its work."""

import json
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest

from palpate.cli import main
from palpate.setup import load_rig
from palpate_lab.simulation.load_cell_bench import BENCHES
from palpate_lab.simulation.load_cell_files import load_cell_rig, write_load_cell_session

pytest.importorskip("mujoco")
pytest.importorskip("pinocchio")
pytest.importorskip("rosbags")

FILES = {f"run{end}" for end in (".mcap", "_rig.toml", "_robot.urdf", "_probe.stl", "_payload.toml", "_truth.csv")}
FOREARM = {"both.mcap", "both.toml", "skin_map.toml", "intensity.toml", "payload.toml", "link.stl", "truth.csv"}


def test_a_run_is_recorded_and_read_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Estimated from the recording alone, and located where the tissue truly pressed."""
    command = ["simulate", "phantom", "--motion", "still", "--seconds", "2"]
    assert main([*command, "-o", str(tmp_path / "run.mcap")]) == 0
    assert {path.name for path in tmp_path.iterdir()} == FILES
    assert "without contact" in capsys.readouterr().out
    found = tmp_path / "contacts.csv"
    rig, truth = tmp_path / "run_rig.toml", tmp_path / "run_truth.csv"
    assert main(["estimate", str(tmp_path / "run.mcap"), "--rig", str(rig), "-o", str(found)]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(found), str(truth), "--json"]) == 0
    errors = {row["name"]: row["median"] for row in json.loads(capsys.readouterr().out)["tables"][0]}
    assert errors["location [mm]"] < 2.0  # 1.5 mN m of noise at 1 N, where it presses lightly, is 1.5 mm


def test_a_film_is_drawn_without_a_screen(tmp_path: Path) -> None:
    """In a process of its own: how MuJoCo draws is settled when it is first imported."""
    cv2 = pytest.importorskip("cv2")
    film = tmp_path / "run.mp4"
    command = ["simulate", "phantom", "--seconds", "0.1", "-o", "run.mcap", "--film", "run.mp4"]
    ran = subprocess.run([sys.executable, "-m", "palpate", *command], cwd=tmp_path, capture_output=True, text=True)
    if "needs EGL or OSMesa" in ran.stderr:
        pytest.skip("nothing here can draw without a screen")
    assert ran.returncode == 0, ran.stderr
    assert {path.name for path in tmp_path.iterdir()} == FILES | {"run.mp4"}
    video = cv2.VideoCapture(str(film))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 3
    assert video.read()[1].std() > 10.0  # a picture, not one colour


def test_a_session_is_made_and_its_skin_is_located(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where the engine has the contacts, beside which the skin knows nothing but counts."""
    folder = tmp_path / "run"
    assert main(["simulate", "forearm", "--seconds", "6", "-o", str(folder), "--seed", "1"]) == 0
    assert {path.name for path in folder.iterdir()} == FOREARM | {"load_cell_log.csv", "README.txt"}
    assert f"palpate inspect {folder / 'both.mcap'}" in " ".join(capsys.readouterr().out.split())
    log, found = str(folder / "both.mcap"), tmp_path / "skin.csv"
    rig = ("--rig", str(folder / "both.toml"), "--sensor", "skin")
    assert main(["estimate", log, *rig, "-o", str(found)]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(found), str(folder / "truth.csv"), "--json"]) == 0
    errors = {row["name"]: row["median"] for row in json.loads(capsys.readouterr().out)["tables"][0]}
    assert errors["location [mm]"] < 2.0  # a fifth of a cell


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


def test_what_is_missing_is_named_with_the_extra_that_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("palpate_lab.cli.demo.find_spec", lambda name: None)
    assert main(["demo", "--no-view", "-o", str(tmp_path / "made")]) == 1
    said = capsys.readouterr().err
    assert "rosbags" in said
    assert "palpate[all]" in said
    assert not (tmp_path / "made").exists()


def test_a_folder_that_holds_something_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["demo", "--no-view", "-o", str(tmp_path)]) == 1
    assert "is not empty" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]
