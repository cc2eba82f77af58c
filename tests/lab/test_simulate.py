"""`palpate simulate`: a folder that is whole or not there."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.cli import main

pytest.importorskip("cv2")
pytest.importorskip("skfem")


def _simulate(*words: str | Path) -> int:
    return main(["simulate", "marker-ring", "--small", "--count", "1", *(str(word) for word in words)])


def test_a_calibration_run_is_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _simulate("-o", tmp_path / "run") == 0
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert names == {"frames.avi", "truth.csv", "rig.toml", "camera.toml"}
    assert "frames" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_what_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text("kept", encoding="utf-8")
    assert _simulate("-o", tmp_path) == 1
    assert _simulate("-o", mine) == 1
    assert _simulate("-o", tmp_path / "nowhere" / "run") == 1
    assert mine.read_text(encoding="utf-8") == "kept"
    said = capsys.readouterr().err
    assert "is not empty" in said
    assert "is a file" in said
    assert "there is no folder" in said


def test_ctrl_c_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(done: int, share: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("palpate_lab.cli.simulate.progress", stop)
    assert _simulate("-o", tmp_path / "run") == 130
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("wrong", [("--seed", "-1"), ("--count", "0"), ("--rings", "4")])
def test_impossible_numbers_are_refused(tmp_path: Path, wrong: tuple[str, str]) -> None:
    assert _simulate("-o", tmp_path / "run", *wrong) == 1
    assert not list(tmp_path.iterdir())
