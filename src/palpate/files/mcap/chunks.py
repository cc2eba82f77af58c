"""Decompress the chunks of an MCAP file, damaged ones as far as possible."""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterator
from struct import error as StructError
from struct import unpack_from
from typing import Any

LARGEST = 1 << 30  # bytes in a chunk
_STEP = 1 << 17  # bytes: what was decompressed before damage is kept in steps of this


def inflate(content: memoryview) -> tuple[bytes, str]:
    """Return the decompressed records of an MCAP chunk, and a sentence on its damage, or "".

    Of a damaged chunk they are those before the damage; b"" if its header is unusable.
    """
    try:
        _, _, size, checksum, named = unpack_from("<QQQII", content)
        compression = bytes(content[32 : 32 + named]).decode(errors="replace")
        (length,) = unpack_from("<Q", content, 32 + named)
    except StructError:
        return b"", "a chunk without a complete header"
    if size > LARGEST or length > LARGEST:
        return b"", "a chunk that states a size of more than 1 GiB"
    if compression not in ("", "lz4", "zstd"):
        return b"", f"a chunk whose compression {compression!r} is not known"
    packed = content[40 + named :][:length]
    steps = {"": _stored, "lz4": _lz4, "zstd": _zstd}[compression](packed, size)
    pieces: list[bytes] = []
    try:
        pieces.extend(steps)
    except _broken() as problem:
        return b"".join(pieces), f"a chunk that does not decompress: {problem}"
    data = b"".join(pieces)
    if len(packed) < length:
        return data, "it ends within a chunk"
    if len(data) != size:
        return data, f"a chunk of {len(data)} bytes that states a size of {size}"
    if checksum and checksum != zlib.crc32(data):
        return data, "a chunk whose checksum does not match: numbers in it may be wrong"
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
