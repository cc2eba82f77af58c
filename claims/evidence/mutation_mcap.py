"""How an MCAP file is spoilt: its records, and the records in its chunks, changed and packed again."""

from collections.abc import Callable
from functools import partial

import numpy as np

from claims.evidence.mcap_records import CHANNEL, CHUNK, MESSAGE, Record, chunk, chunk_records, pack, unpack
from claims.evidence.mutation_bytes import COUNTS, DOUBLES, Mutation, Random, count, cut, double, flip


def _records(change: Callable[[list[Record], Random], list[Record]], data: bytes, random: Random) -> bytes:
    """The records of the file are changed, or those in one of its chunks; lengths around them are put right again."""
    records, rest = unpack(data)
    return pack(change(records, random), data[:8]) + rest if records else data


def _inside(
    change: Callable[[list[Record], Random], list[Record]], records: list[Record], random: Random
) -> list[Record]:
    chunks = [k for k, (kind, _) in enumerate(records) if kind == CHUNK]
    if not chunks:
        return change(records, random)
    at = int(random.choice(chunks))
    inner, compression = chunk_records(records[at][1])
    return [*records[:at], chunk(change(inner, random), compression), *records[at + 1 :]] if inner else records


def _some(records: list[Record], random: Random, kind: int = 0) -> int | None:
    found = [k for k, record in enumerate(records) if kind in (0, record[0])]
    return int(random.choice(found)) if found else None


def _reorder(records: list[Record], random: Random) -> list[Record]:
    at = _some(records, random) or 0
    end = at + int(random.integers(1, 40))
    match int(random.integers(5)):
        case 0:
            return [records[k] for k in random.permutation(len(records)).tolist()]
        case 1:
            return records[:at] + records[end:]
        case 2:
            return records[:end] + records[at:]
        case 3:
            return records[:at] + records[at:end][::-1] + records[end:]
        case _:
            return records[at:] + records[:at]


def _opcode(records: list[Record], random: Random) -> list[Record]:
    at = _some(records, random)
    if at is None:
        return records
    return [*records[:at], (int(random.integers(256)), records[at][1]), *records[at + 1 :]]


def _content(
    records: list[Record], random: Random, *, kind: int, spoil: Callable[[bytes, Random], bytes], most: int = 3
) -> list[Record]:
    records = list(records)
    for _ in range(int(random.integers(1, most + 1))):
        at = _some(records, random, kind)
        if at is not None:
            records[at] = records[at][0], spoil(records[at][1], random)
    return records


def _everywhere(records: list[Record], random: Random) -> list[Record]:
    at, size = int(random.integers(0, 130)), int(random.choice([2, 4, 8]))
    new = COUNTS[int(random.integers(len(COUNTS)))] % (1 << 8 * size)
    if random.random() < 0.3:
        at, size, new = int(random.integers(0, 130)), 8, int(np.float64(random.choice(DOUBLES)).view(np.uint64))
    word = new.to_bytes(size, "little")
    return [(k, c[:at] + word + c[at + size :] if k == MESSAGE and at + size <= len(c) else c) for k, c in records]


_payload_number = partial(_content, kind=MESSAGE, spoil=double, most=30)
_payload_length = partial(_content, kind=MESSAGE, spoil=partial(count, first=20, last=60), most=30)
_payload_cut = partial(_content, kind=MESSAGE, spoil=cut, most=30)
_message_head = partial(_content, kind=MESSAGE, spoil=partial(count, last=21, size=8), most=30)
_message_channel = partial(_content, kind=MESSAGE, spoil=partial(count, last=0, size=2), most=30)
_channel = partial(_content, kind=CHANNEL, spoil=flip)
_channel_number = partial(_content, kind=CHANNEL, spoil=partial(count, last=10, size=2))
_schema = partial(_content, kind=3, spoil=partial(count, last=10, size=2))
_chunk_head = partial(_content, kind=CHUNK, spoil=partial(count, last=48, size=8))
_any_count = partial(_content, kind=0, spoil=partial(count, size=8))
_in_messages = (_payload_number, _payload_length, _payload_cut, _message_head, _message_channel, _everywhere)
_anywhere = (_reorder, _opcode, _channel, _channel_number, _schema)
MCAP: tuple[Mutation, ...] = (
    *(partial(_records, partial(_inside, change)) for change in (*_in_messages, *_anywhere)),
    *(partial(_records, change) for change in (*_anywhere, _chunk_head, _chunk_head, _any_count)),
)
