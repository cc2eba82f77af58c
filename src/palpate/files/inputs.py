"""Open input files, and read them: as XML, as TOML, or the complete lines of a text in pieces."""

from __future__ import annotations

import codecs
import os
import select
import stat
import tomllib
from collections.abc import Callable, Iterator
from io import BufferedReader, TextIOWrapper
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree import ElementTree

from palpate.errors import InputError
from palpate.files.units import near

_INTO_A_FILE = "Save its contents to a file first, and name that file."
_WAIT = 1.5  # s that a pipe is given until its first byte
_LONGEST = 1 << 26  # bytes of a line, beyond which a file is no text
_LARGEST = 1 << 25  # characters of a TOML file
_LOOKED_AT = 1 << 12  # characters that tell what a file is


class Watched:
    """A source that is read piece by piece and shows its progress.

    Attributes:
        path: of the file or folder.
        size: bytes to read.
        position: bytes read so far in the running iteration.
        torn: after an iteration, a sentence on where the file was cut; "" if it is complete.
    """

    def __init__(self, path: Path, size: int) -> None:
        self.path, self.size = path, size
        self.position, self.torn = 0, ""

    def notes(self) -> tuple[str, ...]:
        """Return notes on what was read so far, one sentence each."""
        return ()


def open_input(path: Path, *, pipe: bool = False) -> BufferedReader:
    """Return a file opened for reading, in binary.

    `pipe` accepts a pipe, too, if something is written into it within 1.5 s; it can be read only once.

    Raises:
        InputError: the file does not exist, may not be read, or is a folder, a pipe, a device or a socket.
    """
    try:
        kind = irregular(path.stat())
        if kind == "a pipe" and pipe:
            return _open_pipe(path)
        if not kind:
            return path.open("rb")
    except FileNotFoundError:
        siblings = [other.name for other in path.parent.glob("*")] if path.parent.is_dir() else []
        raise InputError("the file does not exist.", where=str(path), hint=near(path.name, siblings)) from None
    except (OSError, ValueError) as problem:  # the second: a NUL in the name
        raise InputError(f"cannot be read ({problem}).", where=str(path)) from problem
    hint = "" if kind == "a folder" else _INTO_A_FILE
    raise InputError(f"is {kind}, not a file that can be read.", where=str(path), hint=hint)


def irregular(status: os.stat_result) -> str:
    """Return what the status is of, such as "a folder"; "" for a regular file."""
    if stat.S_ISREG(status.st_mode):
        return ""
    kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
    return kinds.get(stat.S_IFMT(status.st_mode), "a device")


NO_XML = (OSError, ElementTree.ParseError, ValueError, LookupError)
"""Exceptions that reading an XML file raises; LookupError: the encoding is not known."""


def read_xml(path: Path, called: str) -> ElementTree.Element:
    """Return the root of an XML file; `called` is what it should be, in a message.

    Raises:
        InputError: the file cannot be read, or is no XML.
    """
    try:
        with open_input(path) as file:
            return ElementTree.parse(file).getroot()
    except NO_XML as problem:
        raise InputError(f"is not {called} that can be read ({problem}).", where=str(path)) from problem


def load_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        InputError: the file cannot be read, is longer than 32 MB, or is not TOML (the message names the line).
    """
    path = Path(path)
    try:
        with TextIOWrapper(open_input(path), encoding="utf-8-sig") as file:
            text = file.read(_LARGEST + 1)
        if len(text) > _LARGEST:
            raise InputError("is larger than 32 MB, the limit of a TOML file.", where=str(path))
        refuse_calibration(text[:_LOOKED_AT], path)
        return tomllib.loads(text)
    except (OSError, UnicodeDecodeError) as problem:
        raise InputError(f"cannot be read ({problem}).", where=str(path)) from problem
    except (ValueError, RecursionError) as problem:  # tomllib's own, an integer too long, lists in lists in lists
        raise InputError(f"is not TOML: {problem}.", where=str(path)) from problem


def refuse_calibration(text: bytes | str, path: Path) -> None:
    """Check that a text that should be something else is not a calibration of ATI.

    Raises:
        InputError: it is.
    """
    if "<FTSensor" in (text.decode(errors="replace") if isinstance(text, bytes) else text):
        raise InputError(
            "is ATI's calibration of a force/torque sensor: neither a log nor a model of Palpate.",
            where=str(path),
            hint="`palpate inspect` shows its units and ranges for a rig; log forces and torques, not gauge voltages, "
            "with the sensor's own software, which needs this file.",
        )


def _open_pipe(path: Path) -> BufferedReader:
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # does not wait for who writes
    if not select.select([handle], [], [], _WAIT)[0]:
        os.close(handle)
        what = f"is a pipe, into which nothing was written for {_WAIT:g} s."
        raise InputError(what, where=str(path), hint=_INTO_A_FILE)
    os.set_blocking(handle, True)
    return os.fdopen(handle, "rb")


def complete_lines(file: BinaryIO, path: Path, size: int) -> Iterator[bytes]:
    """Yield a text (UTF-16 as UTF-8) in pieces of about `size` bytes (-1: at once), cut at newlines, which go.

    Raises:
        InputError: the file is not text, has a line of more than 64 MB, or cannot be read.
    """
    piece = read_some(file, path, size).removeprefix(b"\xef\xbb\xbf")
    recode = _from_utf16() if piece.startswith((b"\xff\xfe", b"\xfe\xff")) else None
    piece = piece if recode is None else recode(piece)
    if b"\0" in piece[:4096]:
        raise InputError("is not a text file.", where=str(path), hint="Name a CSV file.")
    returns = b"\n" not in piece  # the line ends of old
    rest = b""
    while piece:
        text = rest + (piece.replace(b"\r", b"\n") if returns else piece)
        piece = read_some(file, path, size)
        piece = piece if recode is None else recode(piece)
        if not piece:
            yield text.removesuffix(b"\n")
            return
        whole, end, rest = text.rpartition(b"\n")
        if end:
            yield whole
        if len(rest) > _LONGEST:
            raise InputError("has a line of more than 64 MB.", where=str(path), hint="Name a CSV file.")


def _from_utf16() -> Callable[[bytes], bytes]:
    """Return a function that converts successive pieces of UTF-16 to UTF-8."""
    decoder = codecs.getincrementaldecoder("utf-16")("replace")
    return lambda piece: decoder.decode(piece, final=not piece).encode()


def read_some(file: BinaryIO, path: Path, size: int) -> bytes:
    """Read `size` bytes, fewer at the end of the file; -1: all that is left.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        return file.read(size)
    except OSError as problem:  # a folder, a disk that fails
        raise InputError(f"cannot be read ({problem}).", where=str(path)) from problem
