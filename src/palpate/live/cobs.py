"""Frames with COBS and CRC-32: how a device sends samples so that damage is noticed and costs the frames it touches.

A frame is `stuffed(head numbers check) 0x00`, all little endian:

| bytes | what |
|---|---|
| 1 | version of this format: 1 |
| 1 | type of the numbers: 0 u8, 1 i8, 2 u16, 3 i16, 4 u32, 5 i32, 6 f32, 7 f64 |
| 2 | how many numbers |
| 4 | counter: one more than that of the sample before, whether that was sent or not; 0 follows 2^32 - 1 |
| numbers | in the order of a log's columns (a wrench force first), in the rig's units |
| 4 | CRC-32 of all before it, as zlib and Ethernet have it |

Stuffing (COBS, Cheshire and Baker 1999) takes the zeros out, so that 0x00 is only ever the end of a frame: each run of
bytes that are not zero, of 254 at most, stands behind a byte that says how far it is to the next such byte; where
that is less than 255 and more follows, a zero is meant. `docs/serial.md` has it in C.

A counter that stands still is taken as none. A counter that goes back says that the device began anew.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.live import _cobs
from palpate.spatial.arguments import takes_arrays

__all__ = ["TYPES", "encoded"]

TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8")
"""NumPy's names of the types of numbers, in the order of their codes."""

_LEAST = 4096  # bytes: frames of another device are recognised up to this length
_HEAD = [("version", "u1"), ("code", "u1"), ("count", "<u2"), ("counter", "<u4")]


class CobsFrames:
    """Samples out of bytes as they come; nothing is lost but frames that are not whole.

    Args:
        count: numbers a sample.
    """

    unit = "frame"

    def __init__(self, count: int) -> None:
        self.longest = max(12 + 8 * count, _LEAST)
        self._rest = b""
        self._scratch = np.zeros(self.longest + 1, dtype=np.uint8)  # a zero may be written behind
        self._state = np.zeros(_cobs.STATE, dtype=np.int64)
        self._state[_cobs.LAST] = -1
        self._count = count

    def feed(self, data: bytes) -> None:
        """Take bytes as they were read."""
        self._rest += data

    def take(self, values: Float[np.ndarray, "n k"], lost: Int[np.ndarray, " n"]) -> int:
        """Samples of what was fed, as many as fit.

        Args:
            values: filled from the first row on.
            lost: samples missing before each, by the device's counter.

        Returns:
            how many.
        """
        data = np.frombuffer(self._rest, dtype=np.uint8)
        found, done = _cobs.decode(data, self._scratch, values, lost, self._state)
        self._rest = self._rest[done:]
        if found < len(values) and len(self._rest) > self.longest + self.longest // 254 + 1:
            self._rest = b""  # no frame is so long: what is left of it fails its check
        return found

    def waiting(self) -> int:
        """Samples that still lie in what was fed."""
        return self._rest.count(0)

    def forget(self) -> None:
        """Begin anew with the next byte, as after a broken connection; the counter is kept."""
        self._rest = b""
        self._state[_cobs.JOINED] = 0

    def faults(self) -> list[str]:
        """What went wrong since this was last asked."""
        state = self._state
        damaged, foreign, other, restarts, lost = (int(state[k]) for k in range(_cobs.DAMAGED, _cobs.STATE))
        state[_cobs.DAMAGED :] = 0
        found: list[str] = []
        if damaged:
            found.append(f"{damaged} damaged {_plural('frame', damaged)}")
        if lost:
            found.append(f"{lost} {_plural('sample', lost)} missing by the device's counter")
        if foreign:
            found.append(
                f"{foreign} {_plural('frame', foreign)} of {other} numbers passed over, as the sensor has {self._count}"
            )
        if restarts:
            found.append("the device's counter went back: it began anew")
        return found

    def awaited(self) -> str:
        """Why the bytes that came gave no sample, for a message."""
        if self._state[_cobs.FOREIGN]:
            other = int(self._state[_cobs.NUMBERS])
            return f"frames of {other} numbers, where the sensor has {self._count}: is it another device?"
        return "none of them a whole frame: is it `baud` or `framing`?"


@takes_arrays
def encoded(values: Float[np.ndarray, "n k"], counter: int, number: str) -> tuple[bytes, Int[np.ndarray, " n"]]:
    """Samples as frames.

    Args:
        values: one row a frame; of whole numbers the nearest that the type has.
        counter: of the first.
        number: one of `TYPES`.

    Returns:
        the bytes, and where each frame ends in them.
    """
    count, kind = values.shape[1], np.dtype(f"<{number}")
    frames = np.zeros(len(values), dtype=[*_HEAD, ("numbers", kind, (count,)), ("check", "<u4")])
    frames["version"], frames["code"], frames["count"] = 1, TYPES.index(number), count
    frames["counter"] = (counter + np.arange(len(values))) % 2**32
    frames["numbers"] = _rounded(values, kind)
    raw = frames.view(np.uint8).reshape(len(values), -1)
    length = raw.shape[1]
    out = np.empty(len(values) * (length + length // 254 + 3), dtype=np.uint8)
    ends = np.empty(len(values), dtype=np.int64)
    size = _cobs.encode(raw, out, ends)
    return out[:size].tobytes(), ends


def _rounded(values: Float[np.ndarray, "*any"], kind: np.dtype[Any]) -> np.ndarray:
    """Numbers as a type has them: of whole numbers the nearest, the ends of its range beyond it, 0 for NaN."""
    if kind.kind == "f":
        return values.astype(kind)
    limits = np.iinfo(kind.name)
    return np.clip(np.rint(np.nan_to_num(values)), limits.min, limits.max).astype(kind)


def _plural(word: str, count: int) -> str:
    return word if count == 1 else f"{word}s"
