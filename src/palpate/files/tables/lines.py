"""Open input files, and read the complete lines of a text file in pieces."""

from __future__ import annotations

import codecs
import os
import select
from collections.abc import Callable, Iterator
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO
from xml.etree import ElementTree

from palpate.errors import InputError
from palpate.files.atomic import irregular
from palpate.files.units import near

_INTO_A_FILE = "Save its contents to a file first, and name that file."
_WAIT = 1.5  # s that a pipe is given until its first byte
_LONGEST = 1 << 26  # bytes of a line, beyond which a file is no text


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


def read_xml(path: Path, called: str) -> ElementTree.Element:
    """Return the root of an XML file; `called` is what it should be, in a message.

    Raises:
        InputError: the file cannot be read, or is no XML.
    """
    try:
        with open_input(path) as file:
            return ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError, UnicodeError, ValueError) as problem:
        raise InputError(f"is not {called} that can be read ({problem}).", where=str(path)) from problem


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
