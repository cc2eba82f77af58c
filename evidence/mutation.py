"""How good files are spoilt: by their bytes, their lines, their numbers, the values of TOML, the records of MCAP."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from functools import partial

import numpy as np

from evidence.mcap_records import CHANNEL, CHUNK, MESSAGE, Record, pack, unpack

__all__ = ["Random", "mutate"]

Random = np.random.Generator
Mutation = Callable[[bytes, Random], bytes]

NUMBERS = ("nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "-0", "0", "1", "-1", "1e9", "1e17", "-1e17", "1e-17", "")
NUMBERS += ("9" * 400, "18446744073709551616", "0x10", "1_000", "1,5", "NaN", "abc", "--1", '"', "True", "é", "1e", ".")
VALUES = ("nan", "inf", "-inf", "1e308", "1e-308", "-0.0", "0", "1", "-1", "1e17", "-1e17", "1e-14", "9" * 400, "true")
VALUES += ('""', '"x"', '"\\u0000"', "[]", "[[]]", "{}", "[1, 2]", "[0.0, 0.0, 0.0]", "[nan, 0.0, 1.0]", "1979-05-27")
VALUES += ('"base"', '"sensor"', '"plane"', '"mesh"', '"kalman"', '"zero_phase"', '"imu"', '"."', '"/"', '["x", "x", "y"]')
REALS = ("0.0", "1.0", "-1.0", "1", "0", "-3", "1e17", "-1e17", "1e-17", "1e-300", "1e308", "1e9", "0.3", "7", "1e4")
BYTES = (b"\0", b"\xff", b'"', b"'", b"\n", b"\r", b"\r\n", b"\n\n", b",", b";", b"\t", b"\xef\xbb\xbf", b"\xff\xfe", b"#", b"=")
DOUBLES = (np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, -0.0, 0.0, 1e9, 1e18, 1.0, -1.0, 1e-12)
COUNTS = (0, 1, 2, 3, 0xFF, 0x7FFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 40, (1 << 63) - 1, (1 << 64) - 1)


def mutate(data: bytes, ways: str, random: Random) -> bytes:
    """One to four mutations, of bytes and in one of the ways named by letters of `WAYS`."""
    for _ in range(int(random.choice([1, 1, 1, 2, 4]))):
        some = WAYS[ways] if random.random() < 0.75 else WAYS["bytes"]
        data = some[int(random.integers(len(some)))](data, random)
    return data


def _stretch(data: bytes, random: Random, longest: int = 400) -> tuple[int, int]:
    begin = int(random.integers(len(data) + 1))
    return begin, min(len(data), begin + int(random.integers(1, int(random.choice([4, 40, longest])) + 1)))


# --- bytes


def _flip(data: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(int(random.choice([1, 2, 30])) if data else 0):
        changed[int(random.integers(len(data)))] ^= 1 << int(random.integers(8))
    return bytes(changed)


def _delete(data: bytes, random: Random) -> bytes:
    begin, end = _stretch(data, random)
    return data[:begin] + data[end:]


def _double(data: bytes, random: Random) -> bytes:
    begin, end = _stretch(data, random)
    return data[:end] + data[begin:end] * int(random.choice([1, 1, 50])) + data[end:]


def _swap(data: bytes, random: Random) -> bytes:
    (a, b), (c, d) = sorted([_stretch(data, random), _stretch(data, random)])
    return data if c < b else data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def _insert(data: bytes, random: Random) -> bytes:
    at = int(random.integers(len(data) + 1))
    new = BYTES[int(random.integers(len(BYTES)))] if random.random() < 0.5 else random.bytes(int(random.integers(1, 60)))
    return data[:at] + new + data[at:]


def _overwrite(data: bytes, random: Random) -> bytes:
    begin, end = _stretch(data, random)
    new = random.bytes(end - begin) if random.random() < 0.5 else bytes([int(random.choice([0, 255]))]) * (end - begin)
    return data[:begin] + new + data[end:]


def _cut(data: bytes, random: Random) -> bytes:
    return data[: int(random.integers(len(data) + 1))]


def _head_gone(data: bytes, random: Random) -> bytes:
    return data[int(random.integers(min(len(data), 200) + 1)) :]


# --- text


def _encoded(data: bytes, random: Random) -> bytes:
    text = data.decode(errors="replace")
    encoding = str(random.choice(["utf-16", "utf-16-le", "utf-32", "utf-8-sig", "cp037", "latin-1"]))
    return text.encode(encoding, errors="replace")


def _line_ends(data: bytes, random: Random) -> bytes:
    return data.replace(b"\n", (b"\r", b"\r\n", b"\n\n", b"\n\r", b"\x0b", b" \n")[int(random.integers(6))])


def _delimiters(data: bytes, random: Random) -> bytes:
    new = (b";", b"\t", b", ", b" ", b"|", b",,", b'","')[int(random.integers(7))]
    return data.replace(b",", new, -1 if random.random() < 0.7 else int(random.integers(40)))


def _lines(data: bytes, random: Random) -> bytes:
    lines = data.split(b"\n")
    count, at = len(lines), int(random.integers(len(lines)))
    match int(random.integers(7)):
        case 0:
            del lines[at : at + int(random.integers(1, 60))]
        case 1:
            lines = [lines[0], *(lines[1 + k] for k in random.permutation(count - 1).tolist())]
        case 2:
            lines[at:at] = [lines[at]] * int(random.integers(1, 300))
        case 3:
            lines[1:] = lines[:0:-1]
        case 4:
            lines[at] = b""
        case 5:
            lines = lines[at:]
        case _:
            lines[at] = lines[int(random.integers(count))]
    return b"\n".join(lines)


def _fields(data: bytes, random: Random) -> bytes:
    """Numbers anywhere in the text become something else: one, a few, or a column of a table."""
    found = list(re.finditer(rb"(?<![\w.])[-+]?\d[\w.+-]*", data))
    if not found:
        return data
    at = int(random.integers(len(found)))
    some = (found[at : at + 1], found[at : at + 40], found[at::11])[int(random.integers(3))]
    new = NUMBERS[int(random.integers(len(NUMBERS)))].encode()
    for match in reversed(some):
        data = data[: match.start()] + new + data[match.end() :]
    return data


def _header(data: bytes, random: Random) -> bytes:
    """A name of the first line is dropped, repeated, misspelt, or quoted."""
    first, end, rest = data.partition(b"\n")
    names = first.split(b",")
    at = int(random.integers(len(names)))
    odd = (b"", b" ", b'"', names[0], names[at].upper(), names[at][:-1], names[at] + b"x", b'"' + names[at] + b'"', b"\xff")
    names[at] = odd[int(random.integers(len(odd)))]
    return b",".join(names) + end + rest


# --- TOML


def _value(data: bytes, random: Random) -> bytes:
    found = list(re.finditer(rb"(?m)(?<==)[ ]*([^\n#=]+?)[ ]*(?=[#,}\n]|$)", data))
    return _replaced(data, found, VALUES, random)


def _element(data: bytes, random: Random, by: tuple[str, ...] = VALUES) -> bytes:
    return _replaced(data, list(re.finditer(rb"(?<![\w\"])[-+]?\d[\w.+-]*", data)), by, random)


def _replaced(data: bytes, found: list[re.Match[bytes]], by: tuple[str, ...], random: Random) -> bytes:
    if not found:
        return data
    match = found[int(random.integers(len(found)))]
    new = by[int(random.integers(len(by)))].encode()
    return data[: match.start()] + b" " + new + data[match.end() :]


def _key(data: bytes, random: Random) -> bytes:
    found = list(re.finditer(rb"(?m)\w+(?= *=)|(?<=^\[)\w+(?=\]$)", data))
    keys = tuple(match[0].decode() for match in found)
    return _replaced(data, found, (*keys, "x", "folder", "a.b", '""'), random)


# --- binary numbers


def _double_in(data: bytes, random: Random, kind: str = "<d") -> bytes:
    size = struct.calcsize(kind)
    if len(data) < size:
        return data
    at = int(random.integers(len(data) - size + 1))
    with np.errstate(over="ignore"):
        new = np.array(DOUBLES[int(random.integers(len(DOUBLES)))], dtype=f"<f{size}").tobytes()
    return data[:at] + new + data[at + size :]


def _count(data: bytes, random: Random, first: int = 0, last: int = -1, size: int = 4) -> bytes:
    """A number of so many bytes somewhere between."""
    last = len(data) - size if last < 0 else min(last, len(data) - size)
    if last < first:
        return data
    at = int(random.integers(first, last + 1))
    new = COUNTS[int(random.integers(len(COUNTS)))] % (1 << 8 * size)
    return data[:at] + new.to_bytes(size, "little") + data[at + size :]


def _stl_corners(data: bytes, random: Random) -> bytes:
    """Facets of a binary STL: another number in some corners, or a corner as the one before."""
    if len(data) < 134:
        return data
    rows = np.frombuffer(data[84 : 84 + (len(data) - 84) // 50 * 50], dtype=np.uint8).reshape(-1, 50).copy()
    corners = rows[:, 12:48].copy().view("<f4")
    some = random.random(len(rows)) < float(random.choice([0.02, 0.3, 1.0]))
    column = int(random.integers(9))
    with np.errstate(over="ignore", invalid="ignore"):
        match int(random.integers(4)):
            case 0:
                corners[some, column] = np.float32(random.choice(DOUBLES))
            case 1:
                corners[some] *= np.float32(random.choice([1e-30, 1e30, -1, 1e6, 1e-6]))
            case 2:
                corners[some, 3:6] = corners[some, :3]
            case _:
                corners[some] = corners[some][:, [3, 4, 5, 0, 1, 2, 6, 7, 8]]
    rows[:, 12:48] = corners.view(np.uint8)
    return data[:84] + rows.tobytes()


# --- MCAP


def _records(change: Callable[[list[Record], Random], list[Record]], data: bytes, random: Random) -> bytes:
    """The records of the file are changed, or those in one of its chunks; lengths around them are put right again."""
    records, rest = unpack(data)
    return pack(change(records, random), data[:8]) + rest if records else data


def _inside(change: Callable[[list[Record], Random], list[Record]], records: list[Record], random: Random) -> list[Record]:
    from evidence.mcap_records import chunk, chunk_records

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
    """Some records of a kind are spoilt."""
    records = list(records)
    for _ in range(int(random.integers(1, most + 1))):
        at = _some(records, random, kind)
        if at is not None:
            records[at] = records[at][0], spoil(records[at][1], random)
    return records


def _everywhere(records: list[Record], random: Random) -> list[Record]:
    """One place of every message: a stamp, a number."""
    at, size = int(random.integers(0, 130)), int(random.choice([2, 4, 8]))
    new = COUNTS[int(random.integers(len(COUNTS)))] % (1 << 8 * size)
    if random.random() < 0.3:
        at, size, new = int(random.integers(0, 130)), 8, int(np.float64(random.choice(DOUBLES)).view(np.uint64))
    word = new.to_bytes(size, "little")
    return [(k, c[:at] + word + c[at + size :] if k == MESSAGE and at + size <= len(c) else c) for k, c in records]


_payload_number = partial(_content, kind=MESSAGE, spoil=_double_in, most=30)
_payload_length = partial(_content, kind=MESSAGE, spoil=partial(_count, first=20, last=60), most=30)
_payload_cut = partial(_content, kind=MESSAGE, spoil=_cut, most=30)
_message_head = partial(_content, kind=MESSAGE, spoil=partial(_count, last=21, size=8), most=30)
_message_channel = partial(_content, kind=MESSAGE, spoil=partial(_count, last=0, size=2), most=30)
_channel = partial(_content, kind=CHANNEL, spoil=_flip)
_channel_number = partial(_content, kind=CHANNEL, spoil=partial(_count, last=10, size=2))
_schema = partial(_content, kind=3, spoil=partial(_count, last=10, size=2))
_chunk_head = partial(_content, kind=CHUNK, spoil=partial(_count, last=48, size=8))
_any_count = partial(_content, kind=0, spoil=partial(_count, size=8))
_in_messages = (_payload_number, _payload_length, _payload_cut, _message_head, _message_channel, _everywhere)
_anywhere = (_reorder, _opcode, _channel, _channel_number, _schema)

WAYS: dict[str, tuple[Mutation, ...]] = {
    "bytes": (_flip, _delete, _double, _swap, _insert, _overwrite, _cut, _head_gone),
    "table": (_fields, _fields, _fields, _lines, _lines, _header, _header, _delimiters, _line_ends, _encoded),
    "toml": (*(partial(_element, by=REALS),) * 12, _value, _value, _element, _element, _key, _key, _lines, _encoded),
    "stl": (_stl_corners, _stl_corners, partial(_count, first=80, last=80), partial(_double_in, kind="<f"), _count),
    "ascii": (_fields, _fields, _lines, _line_ends),
    "binary": (_count, _double_in, partial(_count, size=8), partial(_count, size=2)),
    "mcap": (
        *(partial(_records, partial(_inside, change)) for change in (*_in_messages, *_anywhere)),
        *(partial(_records, change) for change in (*_anywhere, _chunk_head, _chunk_head, _any_count)),
    ),
}
