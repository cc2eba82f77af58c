"""An MCAP file that grows chunk by chunk, whose messages are the rows of structured arrays.

Layout: the MCAP specification, version 0 (opcodes and fields in its order); integers are little-endian.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from struct import pack
from typing import cast

import numpy as np

__all__ = ["MESSAGE", "McapWriter", "Topic"]

MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX, _STATISTICS = (
    *range(1, 9),
    11,
)
_SUMMARY_OFFSET, _DATA_END = 14, 15
MESSAGE = np.dtype(  # what stands before the bytes of a message
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_INDEX = np.dtype([("time", "<u8"), ("offset", "<u8")])


@dataclass(frozen=True)
class Topic:
    """A channel: its name, the type of its messages and the definition of that type (ros2msg); messages are CDR."""

    name: str
    kind: str
    definition: str


@dataclass(frozen=True)
class _Chunk:
    """What the end of the file says of a chunk."""

    start: int
    end: int
    at: int
    length: int
    compression: bytes
    compressed: int
    uncompressed: int
    index_at: dict[int, int]
    index_length: int
    counts: dict[int, int]


class McapWriter:
    """Makes the bytes of an MCAP file, in the order in which they belong into it.

    The channel of a topic is its place, counted from 1.
    """

    def __init__(self, topics: Sequence[Topic], library: str) -> None:
        self._topics = tuple(topics)
        self._library = library
        self.chunks: list[_Chunk] = []

    def head(self) -> bytes:
        """Where the file begins."""
        return MAGIC + _record(_HEADER, _text("ros2") + _text(self._library)) + self._declared()

    @property
    def size(self) -> int:
        """Bytes of the head and of all `chunks`."""
        if not self.chunks:
            return len(self.head())
        last = self.chunks[-1]
        return last.at + last.length + last.index_length

    def chunk(self, records: np.ndarray, messages: Sequence[np.ndarray]) -> tuple[bytes, _Chunk]:
        """The next chunk, and what to append to `chunks` once it is written.

        Args:
            records: bytes of all its messages.
            messages: the same bytes as rows of one topic each, in order; their type begins with `MESSAGE`'s fields.
        """
        at = self.size
        present = [rows for rows in messages if len(rows)]
        times = np.concatenate([rows["log"] for rows in present])
        start, end = int(times.min()), int(times.max())
        compression, packed = b"lz4", _compressed(records)
        checksum = zlib.crc32(records.data)
        chunk = _record(
            _CHUNK,
            pack("<QQQI", start, end, len(records), checksum) + _bytes(compression) + pack("<Q", len(packed)) + packed,
        )
        index_at, indices, offset = dict[int, int](), list[bytes](), 0
        for rows in present:
            channel = int(rows["channel"][0])
            index_at[channel] = at + len(chunk) + sum(map(len, indices))
            indices.append(_message_index(channel, rows, offset))
            offset += rows.nbytes
        index = b"".join(indices)
        counts = {int(rows["channel"][0]): len(rows) for rows in present}
        sizes = (len(packed), len(records))
        return chunk + index, _Chunk(start, end, at, len(chunk), compression, *sizes, index_at, len(index), counts)

    def tail(self) -> bytes:
        """What ends the file: its summary, by which readers find their way."""
        end = _record(_DATA_END, pack("<I", 0))
        start = self.size + len(end)
        groups = (
            (_SCHEMA, b"".join(self._schemas())),
            (_CHANNEL, b"".join(self._channels())),
            (_STATISTICS, self._statistics()),
            (_CHUNK_INDEX, b"".join(map(_chunk_index, self.chunks))),
        )
        summary, offsets = b"", b""
        for opcode, group in groups:
            if group:
                offsets += _record(_SUMMARY_OFFSET, pack("<BQQ", opcode, start + len(summary), len(group)))
                summary += group
        summary += offsets
        footer = pack("<BQQQ", _FOOTER, 20, start, start + len(summary) - len(offsets))
        return end + summary + footer + pack("<I", zlib.crc32(summary + footer)) + MAGIC

    def _declared(self) -> bytes:
        return b"".join([*self._schemas(), *self._channels()])

    def _schemas(self) -> list[bytes]:
        return [
            _record(_SCHEMA, pack("<H", k) + _text(topic.kind) + _text("ros2msg") + _bytes(topic.definition.encode()))
            for k, topic in enumerate(self._topics, 1)
        ]

    def _channels(self) -> list[bytes]:
        return [
            _record(_CHANNEL, pack("<HH", k, k) + _text(topic.name) + _text("cdr") + _bytes(b""))
            for k, topic in enumerate(self._topics, 1)
        ]

    def _statistics(self) -> bytes:
        counts = {k: sum(chunk.counts.get(k, 0) for chunk in self.chunks) for k in range(1, len(self._topics) + 1)}
        start = min((chunk.start for chunk in self.chunks), default=0)
        end = max((chunk.end for chunk in self.chunks), default=0)
        topics = len(self._topics)
        numbers = pack("<QHIIIIQQ", sum(counts.values()), topics, topics, 0, 0, len(self.chunks), start, end)
        return _record(_STATISTICS, numbers + _map(counts))


def _compressed(records: np.ndarray) -> bytes:
    """Quick rather than small: what noise there is in doubles cannot be squeezed, and NaN vanish anyway."""
    from lz4 import frame  # pyright: ignore[reportMissingTypeStubs] - it has none

    return cast(bytes, frame.compress(records, compression_level=-4, store_size=False))


def _record(opcode: int, content: bytes) -> bytes:
    return pack("<BQ", opcode, len(content)) + content


def _bytes(value: bytes) -> bytes:
    return pack("<I", len(value)) + value


def _text(value: str) -> bytes:
    return _bytes(value.encode())


def _map(values: dict[int, int]) -> bytes:
    return _bytes(b"".join(pack("<HQ", *pair) for pair in values.items()))


def _message_index(channel: int, rows: np.ndarray, offset: int) -> bytes:
    index = np.empty(len(rows), dtype=_INDEX)
    index["time"] = rows["log"]
    index["offset"] = offset + rows.itemsize * np.arange(len(rows))
    return _record(_MESSAGE_INDEX, pack("<H", channel) + _bytes(index.tobytes()))


def _chunk_index(chunk: _Chunk) -> bytes:
    return _record(
        _CHUNK_INDEX,
        pack("<QQQQ", chunk.start, chunk.end, chunk.at, chunk.length)
        + _map(chunk.index_at)
        + pack("<Q", chunk.index_length)
        + _bytes(chunk.compression)
        + pack("<QQ", chunk.compressed, chunk.uncompressed),
    )
