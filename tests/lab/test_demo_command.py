"""`palpate demo` before its work: what is missing is one sentence, and nobody's folder is written into.

The chain itself runs in `make demo`, which is this command.
"""

from pathlib import Path

import pytest

from palpate.cli import main


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
