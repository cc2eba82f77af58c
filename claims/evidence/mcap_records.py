"""An MCAP file as a list of its records, by its specification and without palpate: to spoil one and to count in one."""

import struct
import zlib
from collections.abc import Iterable, Iterator
from typing import Any

Record = tuple[int, bytes]
"""Kind and content."""

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 2, 3, 4, 5, 6


def unpack(data: bytes, at: int = len(MAGIC)) -> tuple[list[Record], bytes]:
    """The whole records from a byte on, and what is left behind them; the footer is the last."""
    records: list[Record] = []
    while at + 9 <= len(data):
        kind, length = struct.unpack_from("<BQ", data, at)
        if kind == 0 or length > len(data) - at - 9 or (kind == MESSAGE and length < 22):
            break
        records.append((kind, data[at + 9 : at + 9 + length]))
        at += 9 + length
        if kind == FOOTER:
            break
    return records, data[at:]


def pack(records: Iterable[Record], magic: bytes = MAGIC) -> bytes:
    """The bytes of a file, without what follows its footer."""
    return magic + b"".join(struct.pack("<BQ", kind, len(content)) + content for kind, content in records)


def chunk(records: Iterable[Record], compression: str) -> Record:
    data = pack(records, b"")
    packed = data if not compression else _codec(compression).compress(data)
    name = compression.encode()
    head = struct.pack("<QQQII", 0, 0, len(data), zlib.crc32(data), len(name)) + name
    return CHUNK, head + struct.pack("<Q", len(packed)) + packed


def chunk_records(content: bytes) -> tuple[list[Record], str]:
    """What a chunk holds, and how it is compressed; nothing if it is damaged anywhere."""
    try:
        size, checksum, length = struct.unpack_from("<QII", content, 16)
        compression = content[32 : 32 + length].decode()
        (stated,) = struct.unpack_from("<Q", content, 32 + length)
        packed = content[40 + length :]
        if stated != len(packed) or compression not in ("", "lz4", "zstd") or size > 1 << 24:
            return [], compression
        data = packed if not compression else _codec(compression).decompress(packed)
    except (struct.error, UnicodeDecodeError, RuntimeError, OSError, ValueError, MemoryError):
        return [], ""
    except Exception as problem:
        if "zstd" in type(problem).__name__.lower():
            return [], ""
        raise
    records, rest = unpack(data, 0)
    whole = len(data) == size and not rest and (not checksum or checksum == zlib.crc32(data))
    return (records, compression) if whole else ([], compression)


def counted(data: bytes, topic: str | None, kinds: Iterable[str]) -> tuple[int, int]:
    """The least and the most messages on a topic (None: any) of these types that can be found from front to back.

    They differ where a chunk is damaged, or a channel is declared in more than one way, or after its messages, as in
    the index at the end.
    """
    kinds = {kind.replace("/msg/", "/") for kind in kinds}
    records, rest = unpack(data)
    schemas: dict[int, set[str]] = {}
    channels: dict[int, set[tuple[int, str, str]]] = {}
    messages: list[tuple[int, bool]] = []
    doubtful = False
    for kind, content in [*_flat(records), *_index(data)]:
        if kind == SCHEMA:
            _declare(schemas, content, _schema)
        elif kind == CHANNEL:
            _declare(channels, content, _channel)
        elif kind == MESSAGE:
            key = struct.unpack_from("<H", content)[0]
            messages.append((key, key in channels))
        elif kind == CHUNK:  # one that is damaged: what is in it may be read or not
            doubtful = True
    if rest and struct.unpack_from("<B", rest)[0] == CHUNK:
        doubtful = True
    least = most = 0
    for key, declared in messages:
        said = [(of, name, encoding) for of, name, encoding in channels.get(key, ())]
        fits = [
            topic in (None, name) and encoding in ("cdr", "ros1") and bool(schemas.get(of, set()) & kinds)
            for of, name, encoding in said
        ]
        sure = declared and fits == [True] and len(schemas[said[0][0]]) == 1
        least += sure
        most += any(fits) or doubtful
    return least, (1 << 62) if doubtful else most


def _flat(records: list[Record]) -> Iterator[Record]:
    """With the records of whole chunks in the place of these."""
    for kind, content in records:
        inner = chunk_records(content)[0] if kind == CHUNK else []
        if inner:
            yield from inner
        else:
            yield kind, content


def _index(data: bytes) -> list[Record]:
    """What the end of the file declares, where it is whole."""
    foot = data[-37:-8]
    if not data.endswith(MAGIC) or foot[:9] != struct.pack("<BQ", FOOTER, 20):
        return []
    (start,) = struct.unpack_from("<Q", foot, 9)
    return [record for record in unpack(data, start)[0] if record[0] in (SCHEMA, CHANNEL)] if start else []


def _declare(table: dict[int, set[Any]], content: bytes, read: Any) -> None:
    try:
        key, said = read(content)
    except struct.error:
        return
    table.setdefault(key, set()).add(said)


def _schema(content: bytes) -> tuple[int, str]:
    (key,) = struct.unpack_from("<H", content)
    return key, _text(content, 2)[0].replace("/msg/", "/")


def _channel(content: bytes) -> tuple[int, tuple[int, str, str]]:
    key, of = struct.unpack_from("<HH", content)
    name, at = _text(content, 4)
    return key, (of, name, _text(content, at)[0])


def _text(content: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", content, at)
    if at + 4 + length > len(content):
        raise struct.error
    return content[at + 4 : at + 4 + length].decode(errors="replace"), at + 4 + length


def _codec(compression: str) -> Any:
    if compression == "lz4":
        import lz4.frame

        return lz4.frame
    import zstandard

    return zstandard
