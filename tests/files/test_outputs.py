"""Outputs: an input is never overwritten, only regular files are replaced, links are followed."""

import fcntl
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.errors import InputError
from palpate.files.atomic import growing, keep_inputs, part, replacing, write_text
from palpate.files.inputs import open_input
from palpate.files.output_lock import inherited, reserving

HOLD = """
import sys
from pathlib import Path
from palpate.files.atomic import growing

with growing(Path(sys.argv[1])):
    print("holds", flush=True)
    sys.stdin.read()
"""


def test_an_input_is_not_overwritten_by_whatever_name(tmp_path: Path) -> None:
    log, link = tmp_path / "log.csv", tmp_path / "link.csv"
    log.write_text("rows")
    link.symlink_to(log)
    (tmp_path / "sub").mkdir()
    for name in (log, link, tmp_path / "sub" / ".." / "log.csv"):
        with pytest.raises(InputError, match=r"would overwrite an input.*Name"):
            keep_inputs(name, [None, log])
    keep_inputs(tmp_path / "new.csv", [log, None, tmp_path / "missing"])


def test_nor_by_what_is_written_beside_it(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text("")
    with pytest.raises(InputError, match=r"rig\.toml: would overwrite an input.*Name"):
        keep_inputs(tmp_path / "rig", [tmp_path / "rig.toml"], siblings=[tmp_path / "rig.toml"])


def test_folders_pipes_and_devices_are_no_outputs(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, word in ((tmp_path, "folder.*Name"), (tmp_path / "pipe", "pipe"), (Path(os.devnull), "device.*Name")):
        with pytest.raises(InputError, match=word):
            keep_inputs(path, [])
        with pytest.raises(InputError, match=word):
            write_text(path, "text")
    assert (tmp_path / "pipe").is_fifo()


def test_a_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    link, real = tmp_path / "link.csv", tmp_path / "sub" / "real.csv"
    link.symlink_to(real)
    before = os.listdir("/dev/fd")
    for text in ("new", "newer"):  # where it leads to nothing yet, and where it leads to a file
        write_text(link, text)
        assert link.is_symlink()
        assert real.read_text() == text
    assert os.listdir("/dev/fd") == before  # all are closed


@pytest.mark.parametrize("name", ["a\0b", "x" * 300, "file/x", "no/x"])
@pytest.mark.parametrize("write", [write_text, keep_inputs])
def test_a_name_that_cannot_be_written_is_said(tmp_path: Path, name: str, write: Callable[..., object]) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write here"):
        write(tmp_path / name, [] if write is keep_inputs else "text")


def test_a_circle_of_links_is_said(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(InputError, match=r"a: cannot write here"):
        write_text(tmp_path / "a", "text")


def test_text_that_is_not_utf8_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"toml: .*not UTF-8"):
        write_text(tmp_path / "rig.toml", "bad \udcff")
    assert not list(tmp_path.iterdir())


def test_one_process_writes_an_output_whatever_its_spelling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output, link = tmp_path / "contacts.csv", tmp_path / "link.csv"
    link.symlink_to(output)
    monkeypatch.chdir(tmp_path)
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", HOLD, output], stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout.readline() == "holds\n"
        for name in (output, link, Path("contacts.csv"), tmp_path / ".." / tmp_path.name / "contacts.csv"):
            with pytest.raises(InputError, match=rf"is already being written by process {other.pid} on.*Wait"):
                write_text(name, "mine")
            with pytest.raises(InputError, match=r"is already being written.*Wait"), reserving():
                keep_inputs(tmp_path / "other.csv", [], siblings=[name])
        other.kill()  # the system releases the lock of a process that dies
    write_text(output, "mine")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["contacts.csv", "link.csv"]


def test_what_a_command_reserves_it_writes_and_nobody_else(tmp_path: Path) -> None:
    output = tmp_path / "contacts.csv"
    with reserving():
        keep_inputs(output, [])
        write_text(output, "mine")
        other = subprocess.run(
            [sys.executable, "-c", f"exec({HOLD!r})", output], input="", capture_output=True, text=True, check=False
        )
        assert other.returncode == 1
        assert "is already being written" in other.stderr
    with inherited(output), growing(output) as file:  # a process that a command starts is told so
        file.write_text("mine")
    assert [file.name for file in tmp_path.iterdir()] == ["contacts.csv"]
    write_text(output, "again")


def test_what_a_kill_leaves_of_a_piece_of_an_output_is_removed(tmp_path: Path) -> None:
    output = tmp_path / "contacts.parquet"
    part(output).mkdir()
    with replacing(part(output) / "0.parquet") as piece:
        piece.write_text("rows")
    piece.write_text("half")
    with growing(output) as file:
        assert not file.exists()


def test_a_thread_is_another_writer(tmp_path: Path) -> None:
    with growing(tmp_path / "a.csv") as file:
        file.write_text("")
        with pytest.raises(InputError, match=rf"process {os.getpid()} on.*Wait"), growing(tmp_path / "a.csv"):
            pass


def test_without_locks_outputs_are_written_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(fcntl, "flock", refuse)
    write_text(tmp_path / "a.csv", "rows")
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]


def test_what_is_no_file_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, word in ((tmp_path, "a folder"), (tmp_path / "pipe", "a pipe"), (Path("/dev/zero"), "a device")):
        with pytest.raises(InputError, match=f"is {word}, not a file"):
            open_input(path)
    with pytest.raises(InputError, match=r"into which nothing was written.*Save"):
        open_input(tmp_path / "pipe", pipe=True)


def test_a_pipe_with_something_in_it_can_be_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    into = os.open(tmp_path / "pipe", os.O_RDWR)
    os.write(into, b"rows")
    with open_input(tmp_path / "pipe", pipe=True) as file:
        os.close(into)
        assert file.read() == b"rows"
