"""Write an MCAP file chunk by chunk, whose messages are the rows of structured arrays."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from struct import pack
from typing import Any, NamedTuple

import numpy as np
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from palpate.files.mcap.reader import MAGIC

__all__ = ["MESSAGE", "WrittenTopic"]

MESSAGE = np.dtype(  # what stands before the bytes of a message
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)


class Written(NamedTuple):
    """A chunk that is in the file.

    Attributes:
        entry: its record in the summary.
        end: byte of the file at which the next chunk begins.
        span: first and last time of its messages [ns].
        counts: number of its messages in each channel.
    """

    entry: bytes
    end: int
    span: tuple[int, int]
    counts: tuple[int, ...]


class WrittenTopic(NamedTuple):
    """A channel of CDR messages: its name, their type and the definition of that (ros2msg)."""

    name: str
    kind: str
    definition: str


class McapWriter:
    """Maker of the bytes of an MCAP file, in their order.

    Args:
        topics: the channels, numbered from 1.
        library: named in the head.

    Attributes:
        head: bytes with which the file begins.
        chunks: that were written.
    """

    def __init__(self, topics: Sequence[WrittenTopic], library: str) -> None:
        self._schemas = [
            mcap.Schema(k, each.definition.encode(), "ros2msg", each.kind) for k, each in enumerate(topics, 1)
        ]
        self._channels = [mcap.Channel(k, each.name, "cdr", {}, k) for k, each in enumerate(topics, 1)]
        self.head = MAGIC + _raw(mcap.Header("ros2", library), *self._schemas, *self._channels)
        self.chunks: list[Written] = []

    @property
    def size(self) -> int:
        """Number of bytes of the head and of all `chunks`."""
        return self.chunks[-1].end if self.chunks else len(self.head)

    def chunk(self, messages: Sequence[np.ndarray]) -> tuple[bytes, Written]:
        """Return the bytes of the next chunk, and the entry to append to `chunks` once they are written.

        Args:
            messages: rows of one topic each, at least one in all; their type begins with `MESSAGE`'s fields.
        """
        present = {int(rows["channel"][0]): rows for rows in messages if len(rows)}
        times = np.concatenate([rows["log"] for rows in present.values()])
        first, last, checksum = int(times.min()), int(times.max()), 0
        for rows in present.values():
            checksum = zlib.crc32(rows.view(np.uint8).data, checksum)
        size = sum(rows.nbytes for rows in present.values())
        made = mcap.Chunk("lz4", _compressed(present.values()), last, first, checksum, size)
        parts = [_raw(made)]
        length = whole = len(parts[0])
        places, offset = dict[int, int](), 0
        for channel, rows in present.items():
            places[channel] = self.size + whole
            parts.append(_message_index(channel, rows, offset))
            whole, offset = whole + len(parts[-1]), offset + rows.nbytes
        counts = {channel: len(rows) for channel, rows in present.items()}
        return b"".join(parts), self.written(made, (length, whole), places, counts)

    def written(
        self, chunk: mcap.Chunk, lengths: tuple[int, int], places: dict[int, int], counts: dict[int, int]
    ) -> Written:
        """Return the entry to append to `chunks` for a chunk that follows them in the file.

        Args:
            chunk: the record.
            lengths: bytes of the record, without and with its message indices.
            places: channel -> byte of the file at which its message index begins.
            counts: channel -> number of messages.
        """
        length, whole = lengths
        index = mcap.ChunkIndex(
            chunk_length=length,
            chunk_start_offset=self.size,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            message_end_time=chunk.message_end_time,
            message_index_length=whole - length,
            message_index_offsets=places,
            message_start_time=chunk.message_start_time,
            uncompressed_size=chunk.uncompressed_size,
        )
        span = chunk.message_start_time, chunk.message_end_time
        counted = tuple(counts.get(channel.id, 0) for channel in self._channels)
        return Written(_raw(index), self.size + whole, span, counted)

    def tail(self) -> bytes:
        """Return the bytes that end the file, with the summary."""
        end = _raw(mcap.DataEnd(0))
        start = self.size + len(end)
        records = (
            (Opcode.SCHEMA, _raw(*self._schemas)),
            (Opcode.CHANNEL, _raw(*self._channels)),
            (Opcode.STATISTICS, _raw(self._statistics())),
            (Opcode.CHUNK_INDEX, b"".join(chunk.entry for chunk in self.chunks)),
        )
        summary, offsets = b"", b""
        for opcode, raw in records:
            if raw:
                offsets += _raw(mcap.SummaryOffset(opcode, start + len(summary), len(raw)))
                summary += raw
        footer = _raw(mcap.Footer(start, start + len(summary), 0))[:-4]
        ended = summary + offsets + footer
        return end + ended + pack("<I", zlib.crc32(ended)) + MAGIC

    def _statistics(self) -> mcap.Statistics:
        sums = np.sum([chunk.counts for chunk in self.chunks], axis=0) if self.chunks else [0] * len(self._channels)
        counts = {channel.id: int(count) for channel, count in zip(self._channels, sums, strict=True)}
        return mcap.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=counts,
            chunk_count=len(self.chunks),
            message_count=sum(counts.values()),
            message_end_time=max((chunk.span[1] for chunk in self.chunks), default=0),
            message_start_time=min((chunk.span[0] for chunk in self.chunks), default=0),
            metadata_count=0,
            schema_count=len(self._schemas),
        )


def _raw(*records: mcap.McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def _message_index(channel: int, rows: np.ndarray, offset: int) -> bytes:
    """Return a message index, made at once: the library's own writes entry by entry."""
    entries = np.column_stack([rows["log"], offset + rows.itemsize * np.arange(len(rows), dtype=np.uint64)])
    content = pack("<HI", channel, entries.nbytes) + entries.astype("<u8").tobytes()
    return pack("<BQ", Opcode.MESSAGE_INDEX, len(content)) + content


def _compressed(messages: Iterable[np.ndarray]) -> bytes:
    """Compress fast: the noise in doubles cannot be compressed, and NaN always can."""
    from lz4.frame import LZ4FrameCompressor  # pyright: ignore[reportMissingTypeStubs] - it has none

    frame: Any = LZ4FrameCompressor(compression_level=-4)
    return b"".join([frame.begin(), *(frame.compress(rows.view(np.uint8)) for rows in messages), frame.flush()])
