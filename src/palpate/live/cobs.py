"""Read and write samples as frames with COBS and CRC-32.

A frame is `stuffed(head numbers check) 0x00`, little endian, stuffed by COBS (Cheshire and Baker 1999):

| bytes | what |
|---|---|
| 1 | version of this format: 1 |
| 1 | type of the numbers: 0 u8, 1 i8, 2 u16, 3 i16, 4 u32, 5 i32, 6 f32, 7 f64 |
| 2 | count of numbers |
| 4 | counter of samples, also of those not sent, modulo 2^32 |
| numbers | in the order of a log's columns (a wrench force first), in the rig's units |
| 4 | CRC-32 of all before it, as zlib has it |

A counter that does not change is ignored; one that goes back means a restart. `docs/serial.md` has code in C.
"""

from __future__ import annotations

import zlib
from struct import Struct
from struct import error as StructError
from typing import Any

import numpy as np
from cobs import cobs  # pyright: ignore[reportMissingTypeStubs] - it has none
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays

__all__ = ["TYPES", "encoded"]

TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8")
"""NumPy's names of the types of numbers, in the order of their codes."""

_HEAD, _CHECK = Struct("<BBHI"), Struct("<I")  # version, type, how many numbers, counter; CRC-32
_LEAST = 4096  # bytes: frames of another device are recognised up to this length
_WRAP = 1 << 32  # of the counter


class CobsFrames:
    """A decoder of COBS frames, fed as bytes; only damaged frames are lost.

    Args:
        count: number of values in a sample.

    Attributes:
        unknown: number of restarts, after which the number of missing samples is unknown.
    """

    def __init__(self, count: int) -> None:
        longest = max(12 + 8 * count, _LEAST)
        self._count, self._longest = count, longest + longest // 254 + 1  # with COBS
        self._rest, self._joined = b"", False  # joined: a delimiter was seen, so that a frame begins there
        self._last: int | None = None  # counter of the frame before
        self.unknown = 0
        self._damaged = self._foreign = self._other = self._restarts = self._lost = 0

    def feed(self, data: bytes) -> None:
        """Append bytes, in pieces of any size."""
        self._rest += data

    def take(self, values: Float[np.ndarray, "n k"], lost: Int[np.ndarray, " n"]) -> int:
        """Decode samples into the arrays, as many as they have room for, and return their number.

        Args:
            values: (n, count), filled from the first row on.
            lost: (n,), filled with the number of samples missing before each, by the device's counter.
        """
        found = at = 0
        while found < len(values) and (end := self._rest.find(0, at)) >= 0:
            sample = self._sample(self._rest[at:end]) if end > at else None
            if sample is not None:
                values[found], lost[found] = sample
                found += 1
            at, self._joined = end + 1, True
        self._rest = self._rest[at:]
        if found < len(values) and len(self._rest) > self._longest:
            self._rest = b""  # no frame is so long: its remaining bytes fail their check
        return found

    def _sample(self, encoded: bytes) -> tuple[np.ndarray, int] | None:
        """Return a frame's numbers and the number of samples missing before it; None if damaged or of another count."""
        try:
            frame = cobs.decode(encoded) if len(encoded) <= self._longest else b""
            version, code, count, counter = _HEAD.unpack_from(frame)
            kind = np.dtype(f"<{TYPES[code]}")
            (check,) = _CHECK.unpack_from(frame, len(frame) - _CHECK.size)
        except (cobs.DecodeError, StructError, IndexError):
            self._damaged += self._joined
            return None
        ends = _HEAD.size + count * kind.itemsize
        if version != 1 or len(frame) != ends + _CHECK.size or check != zlib.crc32(frame[:ends]):
            self._damaged += self._joined
            return None
        if count != self._count:
            self._foreign, self._other = self._foreign + 1, count
            return None
        return np.frombuffer(frame, kind, count, _HEAD.size), self._missing(counter)

    def _missing(self, counter: int) -> int:
        """Return the number of samples missing before a counter; 0 after a restart."""
        ahead = 1 if self._last is None else (counter - self._last) % _WRAP
        self._last = counter
        if ahead >= _WRAP // 2:
            self._restarts += 1
            self.unknown += 1
            return 0
        self._lost += max(0, ahead - 1)
        return max(0, ahead - 1)

    def waiting(self) -> int:
        """Return the number of frames fed and not decoded yet, damaged ones included."""
        return self._rest.count(0)

    def position(self) -> tuple[int, ...]:
        """Return the counter of the last frame; () before the first."""
        return () if self._last is None else (self._last,)

    def resume(self, position: tuple[int, ...]) -> None:
        """Continue to count at the position of an earlier decoder."""
        (self._last,) = position

    def forget(self) -> None:
        """Discard the bytes fed so far, but keep the counter."""
        self._rest, self._joined = b"", False

    def faults(self) -> list[str]:
        """Return texts on faults since the last call: damaged or other frames, missing samples, restarts; else []."""
        frames = f"{self._foreign} {_plural('frame', self._foreign)} of {self._other} numbers"
        found = (
            (self._damaged, f"{self._damaged} damaged {_plural('frame', self._damaged)}"),
            (self._lost, f"{self._lost} {_plural('sample', self._lost)} missing according to the device's counter"),
            (self._foreign, f"{frames} ignored, because the sensor has {self._count}"),
            (self._restarts, "the device's counter went back: the device has restarted"),
        )
        self._damaged = self._foreign = self._restarts = self._lost = 0
        return [text for count, text in found if count]

    def awaited(self) -> str:
        """Return why the bytes gave no sample, as a clause for a message."""
        if self._foreign:
            return f"but in frames of {self._other} numbers, not {self._count} as the sensor has: check the device"
        return "but no complete frame: check `baud` and `framing`"


@takes_arrays
def encoded(values: Float[np.ndarray, "n k"], counter: int, number: str) -> tuple[bytes, Int[np.ndarray, " n"]]:
    """Return samples as bytes of frames, and the index (n,) at which each frame ends.

    Args:
        values: (n, k), a row for each frame; for integers they are rounded and clipped, and NaN becomes 0.
        counter: counter of the first sample.
        number: type of the numbers, one of `TYPES`.

    Raises:
        InputError: values has another shape.
        TypeError, ValueError: `number` is not one of `TYPES`.
    """
    numbers = _rounded(values, np.dtype(f"<{number}"))
    frames = list[bytes]()
    for k, row in enumerate(numbers):
        frame = _HEAD.pack(1, TYPES.index(number), len(row), (counter + k) % _WRAP) + row.tobytes()
        frames.append(cobs.encode(frame + _CHECK.pack(zlib.crc32(frame))) + b"\0")
    return b"".join(frames), np.cumsum([len(frame) for frame in frames], dtype=np.int64)


def _rounded(values: Float[np.ndarray, "*any"], kind: np.dtype[Any]) -> np.ndarray:
    if kind.kind == "f":
        return values.astype(kind)
    limits = np.iinfo(kind.name)
    return np.clip(np.rint(np.nan_to_num(values)), limits.min, limits.max).astype(kind)


def _plural(word: str, count: int) -> str:
    return word if count == 1 else f"{word}s"
