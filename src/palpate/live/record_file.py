"""One file of a live record while it grows: what is whole in it stays so, and is gone on with after a kill."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.errors import InputError
from palpate.files.atomic import PART, part
from palpate.files.mcap.regain import Regained, regained
from palpate.files.mcap.writer import McapWriter, WrittenTopic
from palpate.live.record_messages import EVENTS, READINGS

__all__ = ["Span", "grown", "named", "place", "span_of"]

_WRAP = 2**32  # sequence numbers
_HEAD = 1 << 14  # bytes that a file may have whose head is torn


def named(output: Path, which: int) -> Path:
    """The files of a record: run.mcap, run.1.mcap, run.2.mcap, ..."""
    return output.with_name(f"{output.stem}.{which}{output.suffix}") if which else output


def grown(output: Path) -> list[int]:
    """Which files of a record stand there unfinished."""
    found = [0] if part(output).exists() else []
    target = part(output).with_name(part(output).name.removesuffix(PART))
    pattern = re.compile(re.escape(target.stem) + r"\.([1-9]\d*)" + re.escape(target.suffix + PART))
    with suppress(OSError):
        matches = [pattern.fullmatch(file.name) for file in target.parent.iterdir()]
        found += sorted(int(match[1]) for match in matches if match)
    return found


class Span(NamedTuple):
    """The samples in a file.

    Attributes:
        first: number of the first.
        end: number after the last.
        samples: how many; less than `end - first` where some are missing.
        noted: number of the last sentence, 0 where there is none.
    """

    first: int
    end: int
    samples: int
    noted: int


def span_of(found: Regained, latest: int) -> Span:
    """Which samples are in a file.

    Args:
        found: the file.
        latest: number after the last sample that there is; numbers in files are modulo 2**32.
    """
    noted = found.sequences[EVENTS].most if EVENTS in found.sequences else 0
    count = sum(chunk.counts[READINGS - 1] for chunk in found.writer.chunks)
    if not count:
        return Span(0, 0, 0, noted)
    readings = found.sequences[READINGS]
    first, last = (latest - 1 - (latest - 1 - number) % _WRAP for number in (readings.first, readings.last))
    return Span(first, last + 1, count, noted)


class RecordFile:
    """OUTPUT.part, begun or gone on with; what was torn at its end is cut off.

    Args:
        path: that it will have.
        topics: of what it holds; None: whatever it holds already.
        latest: number after the last sample that there is.

    Attributes:
        path: as given.
        span: samples that it held when it was opened.

    Raises:
        InputError: there is a file of something else.
        OSError: it cannot be written.
    """

    def __init__(self, path: Path, topics: tuple[WrittenTopic, ...] | None, latest: int) -> None:
        self.path, self._growing = path, part(path)
        there = regained(self._growing) if self._growing.exists() else None
        if there is None:
            _require_small(self._growing, topics)
            self._writer = McapWriter(topics or (), f"palpate {version('palpate')}")
            self._size, self.span = 0, Span(0, 0, 0, 0)
        else:
            if topics not in (None, there.topics):
                hint = f"Remove it, or record to another file than {path.name}."
                raise InputError("was not recorded with this rig.", where=str(self._growing), hint=hint)
            self._writer, self._size, self.span = there.writer, there.writer.size, span_of(there, latest)
        self._file = os.open(self._growing, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            os.ftruncate(self._file, self._size)
            if there is None:
                self._write(self._writer.head)
        except OSError:
            self.close()
            if there is None:
                self._growing.unlink()
            raise

    @property
    def size(self) -> int:
        """Bytes so far."""
        return self._writer.size

    def append(self, records: np.ndarray, messages: Sequence[np.ndarray]) -> None:
        """Append a chunk.

        Args:
            records: bytes of all its messages.
            messages: the same bytes as rows of one channel each.

        Raises:
            OSError: the disk is full; what was there before is still whole once the file is ended.
        """
        raw, chunk = self._writer.chunk(records, messages)
        self._size = self._writer.size  # what one before this could not write to its end is written over
        self._write(raw)
        self._writer.chunks.append(chunk)

    def sync(self) -> None:
        """Everything so far is on the disk."""
        os.fdatasync(self._file)

    def end(self) -> int:
        """Write what ends the file; where the disk has no room for that, the last chunks give way.

        Returns:
            how many samples gave way.

        Raises:
            OSError: there is no room even then.
        """
        given = 0
        while True:
            os.ftruncate(self._file, self._writer.size)
            self._size = self._writer.size
            try:
                self._write(self._writer.tail())
                os.fdatasync(self._file)
                return given
            except OSError:
                if not self._writer.chunks:
                    raise
                given += self._writer.chunks.pop().counts[READINGS - 1]

    def place(self) -> None:
        """The ended file takes its name."""
        self.close()
        place(self.path)

    def close(self) -> None:
        """Leave it as it is; may be called twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _write(self, raw: bytes) -> None:
        left = memoryview(raw)
        while left:
            count = os.pwrite(self._file, left, self._size)
            left, self._size = left[count:], self._size + count


def _require_small(growing: Path, topics: tuple[WrittenTopic, ...] | None) -> None:
    """Refuse to write over a file whose head cannot be read, unless it is nothing but a head that was not written."""
    if growing.exists() and (topics is None or growing.stat().st_size > _HEAD):
        raise InputError("is no file of `palpate live`, or nothing in it is whole.", where=str(growing))


def place(path: Path) -> None:
    """OUTPUT.part becomes OUTPUT, also should the power be cut now."""
    growing = part(path)
    target = growing.with_name(growing.name.removesuffix(PART))
    growing.replace(target)
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
