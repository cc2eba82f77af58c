"""`palpate simulate arena`: a recording that the product reads, a film, and many runs that go on where they stopped."""

import json
import sys
from dataclasses import replace
from math import nan
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main
from palpate_lab.cli import arena_batch
from palpate_lab.cli.arena_batch import read_results
from palpate_lab.cli.arena_file import read_arena
from palpate_lab.cli.arena_setup import ArenaRequest, command
from palpate_lab.simulation.arena.layout import ArenaLayout, Block
from palpate_lab.simulation.arena.moment import ArenaResult
from palpate_lab.simulation.arena.random_layouts import random_layout
from palpate_lab.simulation.arena.run_files import write_arena

pytest.importorskip("mujoco")
pytest.importorskip("skfem")
pytest.importorskip("rosbags")

FILES = {f"run{end}" for end in (".mcap", "_arena.toml", "_truth.csv", "_felt.csv")}
DONE = ArenaResult(0, (12.5, nan), (1.0, 2.0), (2.0, 2.5), 2.2, (1, 0), (0, 1), ("arrived: there", "back: no"), 20.0)


def _simulate(*words: str | Path) -> int:
    return main(["simulate", "arena", "--robots", "2", "--seconds", "1", *(str(word) for word in words)])


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Runs that take no time, and which there were; even seeds bring both robots home."""
    ran = list[int]()

    def one(asked: ArenaRequest, seed: int) -> ArenaResult:
        ran.append(seed)
        return replace(DONE, seed=seed, arrived=(12.5, 30.0 if seed % 2 == 0 else nan))

    monkeypatch.setattr(arena_batch, "_one", one)
    return ran


def test_a_run_is_recorded_filmed_and_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2 = pytest.importorskip("cv2")
    assert _simulate("-o", tmp_path / "run.mcap", "--film", tmp_path / "film.mp4", "--seed", "7") == 0
    assert {path.name for path in tmp_path.iterdir()} == FILES | {"film.mp4"}
    assert "0 of 2" in capsys.readouterr().out
    video = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 5
    assert video.read()[1].std() > 10.0
    assert main(["inspect", str(tmp_path / "run.mcap"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    messages = {row["topic"]: row["messages"] for row in said["tables"][0]}
    assert messages["/robot_2/truth/pose"] == 30
    assert [part["facts"]["samples"] for part in said["parts"]] == [30, 30]


def test_a_robots_camera_is_estimated_from_the_recording(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    assert _simulate("-o", tmp_path / "run.mcap", "--images", "--seconds", "0.2", "--robots", "1") == 0
    rig, found = tmp_path / "run_rig.toml", tmp_path / "contacts.csv"
    main(["estimate", str(tmp_path / "run.mcap"), "--rig", str(rig), "-o", str(found)])
    rows = found.read_text().splitlines()[1:]
    assert len(rows) == 6
    assert all("no_contact" in row for row in rows)  # nothing stands where robots start


def test_many_runs_go_on_where_they_stopped(
    tmp_path: Path, quick: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    """A line that a killed process left half written is run again."""
    page, kept = tmp_path / "sum.html", tmp_path / "sum.jsonl"
    assert _simulate("-o", page, "--seeds", "3", "--jobs", "1", "--seed", "5") == 0
    assert quick == [5, 6, 7]
    said = capsys.readouterr().out
    assert "33.3 % of 3 runs" in said
    assert "--seed 5 --view" in said
    kept.write_text(kept.read_text()[:-20])
    assert _simulate("-o", page, "--seeds", "4", "--jobs", "1", "--seed", "5") == 0
    assert quick == [5, 6, 7, 7, 8]
    assert "2 of 4 seeds are in" in capsys.readouterr().out
    settings, results = read_results(kept)
    assert settings["robots"] == 2
    assert results[6] == replace(DONE, seed=6, arrived=(12.5, 30.0))
    assert sorted(results) == [5, 6, 7, 8]
    written = page.read_text()
    assert "palpate simulate arena -o run.mcap --robots 2 --seconds 1.0 --seed 7 --view" in written
    assert "<svg" in written


def test_results_of_other_settings_are_not_mixed(
    tmp_path: Path, quick: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "sum.html"
    assert _simulate("-o", page, "--seeds", "1", "--jobs", "1") == 0
    before = (tmp_path / "sum.jsonl").read_bytes()
    assert _simulate("-o", page, "--seeds", "2", "--jobs", "1", "--density", "dense") == 1
    assert "other settings: density 'paper' instead of 'dense'" in capsys.readouterr().err
    assert (tmp_path / "sum.jsonl").read_bytes() == before
    (tmp_path / "sum.jsonl").write_text("time,fx\n1,2\n")
    assert _simulate("-o", page, "--seeds", "2", "--jobs", "1") == 1
    assert "does not hold results of runs" in capsys.readouterr().err


def test_ctrl_c_keeps_what_is_done(
    tmp_path: Path, quick: list[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = arena_batch._one

    def one(asked: ArenaRequest, seed: int) -> ArenaResult:
        if seed == 2:
            raise KeyboardInterrupt
        return before(asked, seed)

    monkeypatch.setattr(arena_batch, "_one", one)
    assert _simulate("-o", tmp_path / "sum.html", "--seeds", "5", "--jobs", "1") == 130
    assert "2 of 5 seeds are in" in capsys.readouterr().out
    assert sorted(read_results(tmp_path / "sum.jsonl")[1]) == [0, 1]
    assert not (tmp_path / "sum.html").exists()


def test_many_runs_in_parallel_need_joblib(
    tmp_path: Path, quick: list[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "joblib", None)
    assert _simulate("-o", tmp_path / "sum.html", "--seeds", "2", "--jobs", "2") == 1
    assert "need joblib" in capsys.readouterr().err


def test_a_rig_without_a_ring_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('[surface]\nmesh = "probe.stl"\nunit = "m"\n\n[force_torque]\nframe = "sensor"\n')
    assert _simulate("-o", tmp_path / "run.mcap", "--rig", rig) == 1
    assert "robots of the arena wear rings" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [rig]


def test_the_command_that_shows_a_run_says_what_is_unusual() -> None:
    assert command(ArenaRequest(), 4) == "palpate simulate arena -o run.mcap --seed 4 --view"
    asked = ArenaRequest(robots=2, method="paper", images=True)
    assert command(asked, 4) == "palpate simulate arena -o run.mcap --robots 2 --method paper --images --seed 4 --view"


def test_an_arena_of_ones_own_is_read_or_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    layout = random_layout(5, 2)
    file = tmp_path / "mine.toml"
    write_arena(file, layout, {"seed": 5, "method": "ours", "sensing": "skin", "seconds": 1.0, "fault": "blind"})
    again = read_arena(file)
    assert again.blocks == layout.blocks
    assert (again.starts == layout.starts).all()
    assert (again.goals == layout.goals).all()
    wall = Block(1.5, 1.0, 0.0, (0.05, 0.999))
    wrong = {
        "robot 1 has no way": ArenaLayout((3.0, 2.0), (wall,), np.array([[0.3, 1.0, 0.0]]), np.array([[2.7, 1.0]])),
        "the goal of robot 1": ArenaLayout((3.0, 2.0), (), np.array([[0.3, 1.0, 0.0]]), np.array([[2.99, 1.0]])),
        "robots 1 and 2": ArenaLayout(
            (3.0, 2.0), (), np.array([[0.3, 1.0, 0.0], [0.35, 1.0, 0.0]]), np.array([[2.7, 1.0], [2.7, 0.5]])
        ),
    }
    for said, arena in wrong.items():
        write_arena(file, arena, {})
        assert main(["simulate", "arena", "--layout", str(file), "-o", str(tmp_path / "run.mcap")]) == 1
        assert said in capsys.readouterr().err, said
    file.write_text(file.read_text().replace("goals", "gaols"))
    assert main(["simulate", "arena", "--layout", str(file), "-o", str(tmp_path / "run.mcap")]) == 1
    assert "Did you mean 'goals'" in capsys.readouterr().err
