"""`palpate simulate`: files that are whole or not there, and one sentence for what is asked in error."""

from pathlib import Path

import pytest

from palpate.cli import main

for _module in ("cv2", "mujoco", "pinocchio", "rosbags", "skfem"):
    pytest.importorskip(_module)

SMALL = {
    "marker-ring": "--small --count 1",
    "arena": "--robots 2 --seconds 1",
    "forearm": "--seconds 6",
    "phantom": "--motion still --seconds 2",
    "hand": "--seconds 8 --touches 2",
    "humanoid": "--seconds 8",
    "load-cells": "",
    "pokes": "",
}
RECORDED = "arena", "phantom"  # they write a recording, the others a folder


def _simulate(command: str, output: Path, words: str = "") -> int:
    return main(["simulate", command, *SMALL[command].split(), "-o", str(output), *words.split()])


def test_a_calibration_run_is_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _simulate("marker-ring", tmp_path / "run") == 0
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert names == {"frames.avi", "truth.csv", "rig.toml", "camera.toml"}
    assert "frames" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize("command", SMALL)
def test_what_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    mine = tmp_path / "mine.mcap"
    mine.write_text("kept", encoding="utf-8")
    refused = {tmp_path: "is not empty", mine: "is a file"}
    if command in RECORDED:
        refused = {mine: "is already there", tmp_path / "run.csv": "not the name of an MCAP file"}
    for output, why in (refused | {tmp_path / "nowhere/run.mcap": "there is no folder"}).items():
        assert _simulate(command, output) == 1
        assert why in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.mcap"]
    assert mine.read_text(encoding="utf-8") == "kept"


@pytest.mark.parametrize(
    ("command", "module"),
    [("marker-ring", ""), ("arena", "_arena"), ("forearm", "_forearm"), ("phantom", "_phantom"), ("hand", "_robot")],
)
def test_ctrl_c_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, module: str) -> None:
    def stop(done: int, share: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(f"palpate_lab.cli.simulate{module}.progress", stop)
    assert _simulate(command, tmp_path / "run.mcap") == 130
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("marker-ring --seed -1", "--seed"),
        ("marker-ring --count 0", "--count"),
        ("marker-ring --rings 4", "--rings: must be from 1 to 3, not 4."),
        ("arena --density crowded", "density 'crowded' is unknown"),
        ("arena --layout maze", "layout 'maze' is unknown"),
        ("arena --method mine", "method 'mine' is unknown"),
        ("arena --fault rust", "fault 'rust'"),
        ("arena --robots 1000", "--robots"),
        ("arena --port 99999", "--port"),
        ("arena --film film.avi", "not the name of a video"),
        ("arena --jobs 2", "is for many runs only"),
        ("arena --layout u --density paper", "is fixed"),
        ("arena -o sum.html --seeds 2 --view", "is possible for one run only"),
        ("arena -o sum.html --seeds 2 --jobs 0", "--jobs"),
        ("arena -o sum.html --seeds 2 --backend slurm", "no backend 'slurm'"),
        ("arena -o sum.csv --seeds 2", "not the name of a page"),
        ("arena -o nowhere/sum.html --seeds 2", "no folder"),
        ("forearm --seconds 1", "--seconds"),
        ("forearm --rows 2", "--rows"),
        ("forearm --touches 6", "--touches"),
        ("forearm --unequal 0.9", "--unequal"),
        ("forearm --clock-offset 2", "--clock-offset"),
        ("forearm --free -1", "--free"),
        ("phantom --motion sideways", "the motion 'sideways' is unknown"),
        ("phantom --probe round", "the probe 'round' is unknown"),
        ("phantom --period 0", "positive number of seconds"),
        ("humanoid --seconds 2", "--seconds"),
        ("humanoid --touches 99", "--touches"),  # in 8 s
        ("humanoid --speed 0", "--speed"),
        ("humanoid --encoder nan", "--encoder"),
        ("humanoid --free 1", "--free"),
        ("humanoid --wrench-rate 300", "--wrench-rate"),
        ("pokes --pokes 6", "--pokes: must be from 7 (one in each pose of the elbow) to 5,000, not 6."),
    ],
)
def test_what_cannot_be_simulated_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], call: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    command, _, words = call.partition(" ")
    assert _simulate(command, Path("run.mcap"), words) == 1
    error = capsys.readouterr().err
    assert error.startswith("palpate: ")
    assert error.count("\n") == 1
    assert said in error
    assert not list(tmp_path.iterdir())
