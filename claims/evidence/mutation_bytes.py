"""How any file is spoilt: bits flipped, bytes lost, doubled, moved; and the numbers in binary files."""

import struct
from collections.abc import Callable

import numpy as np

Random = np.random.Generator
Mutation = Callable[[bytes, Random], bytes]

BYTES = (
    b"\0", b"\xff", b'"', b"'", b"\n", b"\r", b"\r\n", b"\n\n", b",", b";", b"\t", b"\xef\xbb\xbf", b"\xff\xfe", b"=",
)  # fmt: skip
DOUBLES = (np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, -0.0, 0.0, 1e9, 1e18, 1.0, -1.0, 1e-12)
COUNTS = (
    *range(4), 0xFF, 0x7FFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 1 << 31, 0xFFFFFFFF, 1 << 40, (1 << 63) - 1, (1 << 64) - 1,
)  # fmt: skip


def _stretch(data: bytes, random: Random) -> tuple[int, int]:
    begin = int(random.integers(len(data) + 1))
    return begin, min(len(data), begin + int(random.integers(1, int(random.choice([4, 40, 400])) + 1)))


def flip(data: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(int(random.choice([1, 2, 30])) if data else 0):
        changed[int(random.integers(len(data)))] ^= 1 << int(random.integers(8))
    return bytes(changed)


def delete(data: bytes, random: Random) -> bytes:
    begin, end = _stretch(data, random)
    return data[:begin] + data[end:]


def repeat(data: bytes, random: Random) -> bytes:
    begin, end = _stretch(data, random)
    return data[:end] + data[begin:end] * int(random.choice([1, 1, 50])) + data[end:]


def swap(data: bytes, random: Random) -> bytes:
    (a, b), (c, d) = sorted([_stretch(data, random), _stretch(data, random)])
    return data if c < b else data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def insert(data: bytes, random: Random) -> bytes:
    at = int(random.integers(len(data) + 1))
    known = random.random() < 0.5
    new = BYTES[int(random.integers(len(BYTES)))] if known else random.bytes(int(random.integers(1, 60)))
    return data[:at] + new + data[at:]


def overwrite(data: bytes, random: Random) -> bytes:
    begin, end = _stretch(data, random)
    new = random.bytes(end - begin) if random.random() < 0.5 else bytes([int(random.choice([0, 255]))]) * (end - begin)
    return data[:begin] + new + data[end:]


def cut(data: bytes, random: Random) -> bytes:
    return data[: int(random.integers(len(data) + 1))]


def behead(data: bytes, random: Random) -> bytes:
    return data[int(random.integers(min(len(data), 200) + 1)) :]


def double(data: bytes, random: Random, kind: str = "<d") -> bytes:
    size = struct.calcsize(kind)
    if len(data) < size:
        return data
    at = int(random.integers(len(data) - size + 1))
    with np.errstate(over="ignore"):
        new = np.array(DOUBLES[int(random.integers(len(DOUBLES)))], dtype=f"<f{size}").tobytes()
    return data[:at] + new + data[at + size :]


def count(data: bytes, random: Random, first: int = 0, last: int = -1, size: int = 4) -> bytes:
    last = len(data) - size if last < 0 else min(last, len(data) - size)
    if last < first:
        return data
    at = int(random.integers(first, last + 1))
    new = COUNTS[int(random.integers(len(COUNTS)))] % (1 << 8 * size)
    return data[:at] + new.to_bytes(size, "little") + data[at + size :]


def corners(data: bytes, random: Random) -> bytes:
    """Facets of a binary STL: another number in some corner, or a corner as the one before."""
    if len(data) < 134:
        return data
    rows = np.frombuffer(data[84 : 84 + (len(data) - 84) // 50 * 50], dtype=np.uint8).reshape(-1, 50).copy()
    corner = rows[:, 12:48].copy().view("<f4")
    some = random.random(len(rows)) < float(random.choice([0.02, 0.3, 1.0]))
    column = int(random.integers(9))
    with np.errstate(over="ignore", invalid="ignore"):
        match int(random.integers(4)):
            case 0:
                corner[some, column] = np.float32(random.choice(DOUBLES))
            case 1:
                corner[some] *= np.float32(random.choice([1e-30, 1e30, -1, 1e6, 1e-6]))
            case 2:
                corner[some, 3:6] = corner[some, :3]
            case _:
                corner[some] = corner[some][:, [3, 4, 5, 0, 1, 2, 6, 7, 8]]
    rows[:, 12:48] = corner.view(np.uint8)
    return data[:84] + rows.tobytes()


ANY: tuple[Mutation, ...] = (flip, delete, repeat, swap, insert, overwrite, cut, behead)
