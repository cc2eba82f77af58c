"""`palpate inspect` says of images how many there are, and which of them say nothing."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from palpate.cli import main
from tests.support.image_files import (
    HEIGHT,
    RATE,
    WIDTH,
    compressed,
    frame,
    raw,
    write_frames,
    write_images,
    write_video,
)


def _said(file: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    code = main(["inspect", str(file), "--json", *options])
    return code, json.loads(capsys.readouterr().out)


def test_a_video_is_described(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said = _said(write_video(tmp_path / "log.avi", 50), capsys)
    facts = said["facts"]
    assert code == 0
    assert (facts["frames"], facts["size"], facts["codec"]) == (50, [WIDTH, HEIGHT], "MJPG")
    assert facts["time"] == {"from_to": [0.0, pytest.approx(49 / RATE)], "rate": pytest.approx(RATE)}
    expected = np.mean([frame(k).mean() for k in range(50)])
    assert facts["brightness"]["mean"] == pytest.approx(expected, abs=2)  # the coding loses something
    assert (facts["black"], facts["repeated"], facts["not decoded"]) == (0, 0, 0)
    assert "warnings" not in said


def test_frames_that_say_nothing_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_frames(tmp_path / "frames", [f"{k}.png" for k in range(40)])
    for k in (3, 4):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((HEIGHT, WIDTH, 3), 2, dtype=np.uint8))
    for k in range(31, 36):  # across the end of a block too
        cv2.imwrite(str(folder / f"{k}.png"), frame(30))
    (folder / "38.png").write_bytes(b"")
    code, said = _said(folder, capsys)
    facts = said["facts"]
    assert code == 0
    assert (facts["frames"], facts["black"], facts["repeated"], facts["not decoded"]) == (40, 2, 5, 1)
    assert any("series has 6 frames, from 1.000 s on" in warning for warning in said["warnings"])
    assert any("38.png" in note for note in said["notes"])


def test_a_black_video_is_doubted_and_a_cut_one_told_by_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_frames(tmp_path / "frames", ["a.png", "b.png"])
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / name), np.ones((HEIGHT, WIDTH, 3), dtype=np.uint8))
    code, said = _said(folder, capsys)
    assert code == 0
    assert any("every frame is black" in warning for warning in said["warnings"])
    path = write_video(tmp_path / "log.avi", 50)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    code, said = _said(path, capsys)
    assert code == 3
    assert any("announces 50 frames" in warning for warning in said["warnings"])


@pytest.mark.parametrize("name", ["log.mcap", "log.bag"])
def test_images_of_topics_are_described(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    """Colour is no frame of taxels, whatever its size."""
    frames = [frame(k) for k in range(10)]
    for messages in ([raw(each, "bgr8") for each in frames], [compressed(each, "png") for each in frames]):
        (tmp_path / name).unlink(missing_ok=True)
        path = write_images(tmp_path / name, messages)
        for options in ((), ("--topic", "/camera")):
            code, said = _said(path, capsys, *options)
            assert code == 0
            assert (said["facts"]["frames"], said["facts"]["size"]) == (10, [WIDTH, HEIGHT])
            assert said["facts"]["time"]["rate"] == pytest.approx(25.0)
            assert "cells" not in said["facts"].get("taken for", "")


def test_a_video_has_no_topics_and_no_wrenches(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, rig = write_video(tmp_path / "log.avi", 5), tmp_path / "rig.toml"
    rig.write_text('[surface]\nkind = "sphere"\nradius = 0.01\n[force_torque]\n')
    for options, sentence in ((("--topic", "/x"), "has no topics"), (("--rig", str(rig)), "requested is a wrench")):
        assert main(["inspect", str(path), *options]) == 1
        assert sentence in capsys.readouterr().err


def test_what_is_no_video_is_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "log.mp4"
    path.write_text("no video")
    assert main(["inspect", str(path)]) == 1
    assert ": does not begin as a video does" in capsys.readouterr().err
