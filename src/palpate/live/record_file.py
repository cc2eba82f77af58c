"""Write one file of a live record so that its complete part stays valid, and continue it after a kill."""

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
from palpate.live.record_messages import event_channels

__all__ = ["Span", "grown", "named", "place", "span_of"]

_WRAP = 2**32  # sequence numbers
_HEAD = 1 << 14  # bytes that a file may have whose head is torn


def named(output: Path, which: int) -> Path:
    """Return the path of a record's file by its index: run.mcap, run.1.mcap, run.2.mcap, ..."""
    return output.with_name(f"{output.stem}.{which}{output.suffix}") if which else output


def grown(output: Path) -> list[int]:
    """Return the indices of a record's unfinished files (OUTPUT.part), in increasing order.

    Raises:
        InputError: the path cannot be resolved, such as links in a circle.
        ValueError: the path has no name, such as "/".
    """
    found = [0] if part(output).exists() else []
    target = part(output).with_suffix("")
    pattern = re.compile(re.escape(target.stem) + r"\.([1-9]\d*)" + re.escape(target.suffix + PART))
    with suppress(OSError):
        matches = [pattern.fullmatch(file.name) for file in target.parent.iterdir()]
        found += sorted(int(match[1]) for match in matches if match)
    return found


class Span(NamedTuple):
    """The range of samples of a stream in a file.

    Attributes:
        first: number of the first sample.
        end: number after the last sample.
        samples: number of samples in the file, without missing ones.
        noted: number of the last sentence; 0 if there is none.
    """

    first: int
    end: int
    samples: int
    noted: int


def span_of(found: Regained, latest: int, stream: int = 0) -> Span:
    """Return the range of a stream's samples in a file; its first three numbers are 0 if there is no sample.

    Args:
        found: the complete part of the file.
        latest: number after the last sample of the stream; the file's are modulo 2^32.
        stream: place of the stream among those of the file.
    """
    events = event_channels(found.topics)[stream]
    noted = found.sequences[events].most if events in found.sequences else 0
    count = sum(chunk.counts[events - 2] for chunk in found.writer.chunks)
    if not count:
        return Span(0, 0, 0, noted)
    readings = found.sequences[events - 1]
    first, last = (latest - 1 - (latest - 1 - number) % _WRAP for number in (readings.first, readings.last))
    return Span(first, last + 1, count, noted)


class RecordFile:
    """A growing file OUTPUT.part, begun or continued; an incomplete chunk at its end is cut off.

    Args:
        path: path of the ended file, OUTPUT.
        topics: topics of the file; None: those of the existing file.
        latest: number after the last sample of each stream; of those not given, 0.

    Attributes:
        path: as given.
        spans: the range of samples of each stream when it was opened.

    Raises:
        InputError: the existing file is no record, or has other topics.
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path, topics: tuple[WrittenTopic, ...] | None, latest: Sequence[int] = ()) -> None:
        self.path, self._growing = path, part(path)
        there = regained(self._growing) if self._growing.exists() else None
        if there is None:
            _require_small(self._growing, topics)
            self._writer = McapWriter(topics or (), f"palpate {version('palpate')}")
            self._streams = event_channels(topics or ())
            self._size, self.spans = 0, [Span(0, 0, 0, 0)] * len(self._streams)
        else:
            if topics not in (None, there.topics):
                hint = f"Remove it, or record to another file than {path.name}."
                raise InputError("was not recorded with this rig.", where=str(self._growing), hint=hint)
            self._streams = event_channels(there.topics)
            if not self._streams:
                raise InputError("is not a file of `palpate live`.", where=str(self._growing))
            ends = dict(enumerate(latest))
            self._writer, self._size = there.writer, there.writer.size
            self.spans = [span_of(there, ends.get(k, 0), k) for k in range(len(self._streams))]
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
        """Number of bytes so far."""
        return self._writer.size

    def append(self, messages: Sequence[np.ndarray]) -> None:
        """Append a chunk of messages.

        Args:
            messages: rows of one channel each.

        Raises:
            OSError: the disk is full; earlier chunks stay complete.
        """
        raw, chunk = self._writer.chunk(messages)
        self._size = self._writer.size  # an earlier incomplete chunk is overwritten
        self._write(raw)
        self._writer.chunks.append(chunk)

    def sync(self) -> None:
        """Wait until all data so far are on the disk.

        Raises:
            OSError: they cannot be written.
        """
        os.fdatasync(self._file)

    def end(self) -> list[int]:
        """Write the end of the file; return how many samples of each stream were removed to make room on a full disk.

        Raises:
            OSError: there is no room even without samples.
        """
        given = [0] * len(self._streams)
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
                counts = self._writer.chunks.pop().counts
                given = [count + counts[events - 2] for count, events in zip(given, self._streams, strict=True)]

    def place(self) -> None:
        """Close the ended file and rename OUTPUT.part to OUTPUT.

        Raises:
            OSError: it cannot be renamed.
        """
        self.close()
        place(self.path)

    def close(self) -> None:
        """Close the file as it is; may be called again."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _write(self, raw: bytes) -> None:
        left = memoryview(raw)
        while left:
            count = os.pwrite(self._file, left, self._size)
            left, self._size = left[count:], self._size + count


def _require_small(growing: Path, topics: tuple[WrittenTopic, ...] | None) -> None:
    """Raise InputError if an existing file that cannot be read is more than an incomplete head."""
    if growing.exists() and (topics is None or growing.stat().st_size > _HEAD):
        raise InputError("is not a file of `palpate live`, or contains no complete data.", where=str(growing))


def place(path: Path) -> None:
    """Rename OUTPUT.part to OUTPUT, and wait until the new name is on the disk.

    Raises:
        OSError: it cannot be renamed.
    """
    growing = part(path)
    target = growing.with_suffix("")
    growing.replace(target)
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
