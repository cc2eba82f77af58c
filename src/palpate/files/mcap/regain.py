"""Recover an MCAP file of `McapWriter` whose process was killed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from io import SEEK_END, BytesIO
from pathlib import Path
from struct import error as StructError
from struct import unpack_from
from typing import BinaryIO, NamedTuple

import numpy as np
from jaxtyping import Int
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, Schema

from palpate.files.mcap.chunks import inflate
from palpate.files.mcap.reader import MAGIC
from palpate.files.mcap.writer import McapWriter, WrittenTopic

_HEAD = 9  # bytes of a record before its content: a kind and a length
_SEQUENCE = 11  # bytes of a message before its sequence number
_ENTRY, _ENTRIES = 16, 6  # bytes of an index for each message, and before them


class SequenceSpan(NamedTuple):
    """Sequence numbers of a channel: first, last, and the largest of those that begin or end a chunk."""

    first: int
    last: int
    most: int


class Regained(NamedTuple):
    """The part of a file that is complete.

    Attributes:
        writer: with the complete chunks, which end at byte `writer.size`.
        topics: that the file declares.
        sequences: channel -> its sequence numbers, where it has messages.
    """

    writer: McapWriter
    topics: tuple[WrittenTopic, ...]
    sequences: Mapping[int, SequenceSpan]


def regained(path: Path) -> Regained | None:
    """Return the part of a file that is complete and whose checksums agree.

    None if its head is incomplete, or not that of a `McapWriter`.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        found = _head(file)
        if found is None:
            return None
        writer, topics = found
        sequences: dict[int, SequenceSpan] = {}
        for each in _chunks(file, writer):
            for channel, numbers in each.items():
                before = sequences.get(channel, numbers)
                sequences[channel] = SequenceSpan(before.first, numbers.last, max(before.most, numbers.most))
    return Regained(writer, topics, sequences)


def _head(file: BinaryIO) -> tuple[McapWriter, tuple[WrittenTopic, ...]] | None:
    """Return a writer whose head is the file's, and its topics; else None."""
    if file.read(len(MAGIC)) != MAGIC:
        return None
    library, schemas, topics = "", dict[int, Schema](), list[WrittenTopic]()
    with suppress(McapError, StructError, UnicodeDecodeError, KeyError, EOFError):
        for kind, content in _records(file):
            stream = ReadDataStream(BytesIO(content))
            if kind == Opcode.HEADER:
                library = Header.read(stream).library
            elif kind == Opcode.SCHEMA:
                schema = Schema.read(stream)
                schemas[schema.id] = schema
            elif kind == Opcode.CHANNEL:
                channel = Channel.read(stream)
                schema = schemas[channel.schema_id]
                topics.append(WrittenTopic(channel.topic, schema.name, schema.data.decode()))
            else:
                break
    writer = McapWriter(topics, library)
    file.seek(0)
    return (writer, tuple(topics)) if topics and file.read(len(writer.head)) == writer.head else None


def _records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of each complete record."""
    at = file.tell()
    size = file.seek(0, SEEK_END)
    file.seek(at)
    while len(head := file.read(_HEAD)) == _HEAD:
        kind, length = unpack_from("<BQ", head)
        if kind == 0 or length > size - file.tell():
            return
        yield kind, file.read(length)


def _chunks(file: BinaryIO, writer: McapWriter) -> Iterator[dict[int, SequenceSpan]]:
    """Append each complete chunk to the writer's, and yield its channels' sequence numbers."""
    content, data, counts, places, numbers = b"", b"", dict[int, int](), dict[int, int](), dict[int, SequenceSpan]()
    at = left = 0
    for kind, held in _records(file):
        end = file.tell()
        if kind == Opcode.CHUNK and not left:
            content, counts, places, numbers = held, {}, {}, {}
            data, problem = inflate(memoryview(held))
            at, left = end, len(data)
            if problem or not data:
                return
        elif kind == Opcode.MESSAGE_INDEX and left and len(held) % _ENTRY == _ENTRIES:
            channel, count = unpack_from("<HI", held)
            entries = np.frombuffer(held, "<i8", offset=_ENTRIES).reshape(-1, 2)
            found = _numbers(data, entries[:, 1]) if count == _ENTRY * len(entries) and count else None
            if found is None:
                return
            numbers[channel], length = found
            places[channel], counts[channel] = end - len(held) - _HEAD, len(entries)
            left -= length
            if not left:
                chunk = Chunk.read(ReadDataStream(BytesIO(content)))
                lengths = len(content) + _HEAD, end - at + len(content) + _HEAD
                writer.chunks.append(writer.written(chunk, lengths, places, counts))
                yield numbers
        else:
            return


def _numbers(data: bytes, starts: Int[np.ndarray, " n"]) -> tuple[SequenceSpan, int] | None:
    """Return sequence numbers and total bytes of equally long messages; None if an index is wrong."""
    ends = int(starts[0]), int(starts[-1])
    if min(ends) < 0 or max(ends) + _SEQUENCE + 4 > len(data):
        return None
    first, last = (unpack_from("<I", data, at + _SEQUENCE)[0] for at in ends)
    length = unpack_from("<Q", data, ends[0] + 1)[0] + _HEAD
    return SequenceSpan(first, last, max(first, last)), length * len(starts)
