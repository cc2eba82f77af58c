"""`palpate simulate phantom`: a recording that the product reads, with its truth."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.cli import main

pytest.importorskip("mujoco")
pytest.importorskip("pinocchio")
pytest.importorskip("rosbags")

FILES = {f"run{end}" for end in (".mcap", "_rig.toml", "_robot.urdf", "_probe.stl", "_payload.toml", "_truth.csv")}


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
