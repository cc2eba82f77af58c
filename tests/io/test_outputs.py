"""Outputs: an input is never overwritten, only regular files are replaced, links are followed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from palpate.errors import InputError
from palpate.io.atomic import keep_inputs, write_text


def test_an_input_is_not_overwritten_by_whatever_name(tmp_path: Path) -> None:
    log, link = tmp_path / "log.csv", tmp_path / "link.csv"
    log.write_text("rows")
    link.symlink_to(log)
    (tmp_path / "sub").mkdir()
    for name in (log, link, tmp_path / "sub" / ".." / "log.csv"):
        with pytest.raises(InputError, match="would overwrite an input"):
            keep_inputs(name, [None, log])
    keep_inputs(tmp_path / "new.csv", [log, None, tmp_path / "missing"])


def test_nor_by_what_is_written_beside_it(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text("")
    with pytest.raises(InputError, match=r"rig\.toml: would overwrite an input"):
        keep_inputs(tmp_path / "rig", [tmp_path / "rig.toml"], beside=[tmp_path / "rig.toml"])


def test_folders_pipes_and_devices_are_no_outputs(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, word in ((tmp_path, "folder"), (tmp_path / "pipe", "pipe"), (Path(os.devnull), "device")):
        with pytest.raises(InputError, match=word):
            keep_inputs(path, [])
        with pytest.raises(InputError, match=word):
            write_text(path, "text")
    assert (tmp_path / "pipe").is_fifo()


def test_a_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    link, real = tmp_path / "link.csv", tmp_path / "sub" / "real.csv"
    link.symlink_to(real)
    for text in ("new", "newer"):  # where it leads to nothing yet, and where it leads to a file
        write_text(link, text)
        assert link.is_symlink()
        assert real.read_text() == text


@pytest.mark.parametrize("name", ["a\0b", "x" * 300, "file/x"])
def test_a_name_that_cannot_be_written_is_said(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write here"):
        write_text(tmp_path / name, "text")


@pytest.mark.parametrize("name", ["a\0b", "file/x", "no/x"])
def test_a_place_where_nothing_can_be_written_is_said_before_the_work(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write here"):
        keep_inputs(tmp_path / name, [])


def test_a_circle_of_links_is_said(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(InputError, match="cannot write here"):
        write_text(tmp_path / "a", "text")


def test_text_that_is_not_utf8_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not UTF-8"):
        write_text(tmp_path / "rig.toml", "bad \udcff")
    assert not list(tmp_path.iterdir())
