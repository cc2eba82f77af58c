"""What an MCAP file declares in its records, and the bytes in its chunks, as far as they can be had."""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from struct import error as StructError
from struct import unpack_from
from typing import Any

__all__ = ["LARGEST", "Chunk", "channel", "inflate", "schema", "statistics"]

LARGEST = 1 << 30  # bytes in a chunk
_STEP = 1 << 17  # bytes: what was decompressed before damage is kept in steps of this


@dataclass(frozen=True)
class Chunk:
    """The head of a chunk.

    Attributes:
        size: of the records in it, decompressed, as it says.
        checksum: of these, 0 where there is none.
        compression: "", "lz4", "zstd" or what else it says.
        start: where its records begin in the chunk.
        length: of its records as they are in the file.
    """

    size: int
    checksum: int
    compression: str
    start: int
    length: int

    @classmethod
    def parse(cls, content: memoryview) -> Chunk | None:
        """None where it is not whole."""
        try:
            _, _, size, checksum = unpack_from("<QQQI", content)
            compression, at = _text(content, 28)
            (length,) = unpack_from("<Q", content, at)
        except StructError:
            return None
        return cls(size, checksum, compression, at + 8, length)


def schema(content: memoryview) -> tuple[int, str, str]:
    """Number, name and definition of a type: geometry_msgs/msg/Wrench and geometry_msgs/Wrench are the same."""
    (key,) = unpack_from("<H", content)
    name, at = _text(content, 2)
    _, at = _text(content, at)  # the encoding
    return key, name.replace("/msg/", "/"), _text(content, at)[0]


def channel(content: memoryview) -> tuple[int, int, str, str]:
    """Number, number of its type, topic and encoding of the messages."""
    key, kind = unpack_from("<HH", content)
    topic, at = _text(content, 4)
    return key, kind, topic, _text(content, at)[0]


def statistics(content: memoryview) -> tuple[int, dict[int, int]]:
    """How many channels there are, and the number of messages in each that has some."""
    (channels,) = unpack_from("<I", content, 10)
    (length,) = unpack_from("<I", content, 42)
    pairs = (unpack_from("<HQ", content, 46 + at) for at in range(0, length, 10))
    return channels, dict(pairs)


def _text(content: memoryview, at: int) -> tuple[str, int]:
    """A string and where it ends."""
    (length,) = unpack_from("<I", content, at)
    if at + 4 + length > len(content):
        raise StructError("beyond the record")
    return bytes(content[at + 4 : at + 4 + length]).decode(errors="replace"), at + 4 + length


def inflate(chunk: Chunk, content: memoryview) -> tuple[bytes, str]:
    """The records of a chunk, or the first of them, and what is wrong with it, "" if nothing."""
    packed = content[chunk.start : chunk.start + chunk.length]
    if chunk.size > LARGEST or chunk.length > LARGEST:
        return b"", "a chunk that says it holds more than 1 GiB"
    if chunk.compression not in ("", "lz4", "zstd"):
        return b"", f"a chunk whose compression {chunk.compression!r} is not known"
    steps = {"": _stored, "lz4": _lz4, "zstd": _zstd}[chunk.compression](packed, chunk.size)
    pieces: list[bytes] = []
    try:
        pieces.extend(steps)
    except _broken() as problem:
        return b"".join(pieces), f"a chunk that does not decompress: {problem}"
    data = b"".join(pieces)
    if len(packed) < chunk.length:
        return data, "it ends within a chunk"
    if len(data) != chunk.size:
        return data, f"a chunk of {len(data)} bytes that says it holds {chunk.size}"
    if chunk.checksum and chunk.checksum != zlib.crc32(data):
        return data, "a chunk whose checksum is another: numbers in it may be wrong"
    return data, ""


def _broken() -> tuple[type[Exception], ...]:
    from zstandard import ZstdError

    return ZstdError, RuntimeError, EOFError


def _stored(packed: memoryview, size: int) -> Iterator[bytes]:
    yield bytes(packed[:size])


def _zstd(packed: memoryview, size: int) -> Iterator[bytes]:
    from zstandard import ZstdDecompressor

    with ZstdDecompressor().stream_reader(io.BytesIO(packed), read_across_frames=True) as stream:
        while size > 0 and (piece := stream.read(min(size, _STEP))):
            yield piece
            size -= len(piece)


def _lz4(packed: memoryview, size: int) -> Iterator[bytes]:
    from lz4.frame import LZ4FrameDecompressor  # pyright: ignore[reportMissingTypeStubs] - it has none

    frame: Any = LZ4FrameDecompressor()
    for at in range(0, len(packed), _STEP):
        part = packed[at : at + _STEP]
        while size > 0 and not frame.eof and (piece := frame.decompress(part, max_length=size)):
            yield piece
            size -= len(piece)
            part = b""
