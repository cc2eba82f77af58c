"""Reading on through the bytes of many messages of ROS at once."""

from __future__ import annotations

from copy import copy

import numpy as np
from jaxtyping import Bool, Int

from palpate.files.logs.log import MessageBlock
from palpate.spatial.arguments import takes_arrays

__all__ = ["taken"]

_MOST_DIMENSIONS = 16


@takes_arrays
class Cursor:
    """Reads on through many messages at once, each at its own place.

    In CDR (ROS 2) four bytes come first, of which the second says the order of bytes, and numbers stand at multiples of
    their size behind them; in ROS 1 nothing is aligned, and the header begins with a number of its own.

    Attributes:
        at: (n,) byte at which each message is read next.
        sound: (n,) false from where a message is cut, or is not what it should be; what is read of it means nothing.
    """

    def __init__(self, messages: MessageBlock, encoding: str) -> None:
        self.data, self._cdr = messages.data, encoding == "cdr"
        self.at, self._end = messages.start.copy(), messages.start + messages.length
        self._origin = self.at.copy()
        self.sound, self._little = np.ones((2, len(self.at)), dtype=bool)
        if self._cdr:
            representation = self.numbers("u1", 4)
            self._little = representation[:, 1] == 1
            self.sound &= (representation[:, 0] == 0) & (representation[:, 1] <= 1)
            self._origin = self.at.copy()

    def numbers(self, code: str, count: int, before: int | np.ndarray = 0, after: int = 0) -> np.ndarray:
        """(n, count) numbers of one type, passing over some `before` and `after` them."""
        size = int(code[1])
        self._align(size)
        start = self.at + size * before
        self.at = start + size * (count + after)
        self.sound &= self.at <= self._end
        raw = taken(self.data, start, size * count, self.sound)
        values = raw.view(f"<{code}")
        if not self._little.all():
            values[~self._little] = raw[~self._little].view(f">{code}")
        return values

    def number(self) -> Int[np.ndarray, " n"]:
        """A whole number of four bytes."""
        return self.numbers("u4", 1)[:, 0].astype(np.int64)

    def length(self) -> Int[np.ndarray, " n"]:
        """Of what stands behind it in bytes; a message that is shorter is not sound."""
        found = self.number()
        self.sound &= found <= self._end - self.at
        return np.where(self.sound, found, 0)

    def text(self) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Where a string begins, and its length."""
        length = self.length()
        self.at = self.at + length
        return self.at - length, length

    def stamp(self) -> Int[np.ndarray, " n"]:
        """Of a header [ns], which is passed over."""
        return self.header()[0]

    def header(self) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Its stamp [ns], and where the name of its frame begins and how long it is."""
        if not self._cdr:
            self.number()
        part = self.numbers("u4", 2)
        whole = part[:, 0].view(np.int32) if self._cdr else part[:, 0]
        return whole.astype(np.int64) * 10**9 + part[:, 1].astype(np.int64), *self.text()

    def gap(self, which: int, at: int, size: int) -> int:
        """Bytes from `at` to where a number of this size may stand, in one message."""
        return (int(self._origin[which]) - at) % size if self._cdr else 0

    def little(self, which: int) -> bool:
        """Whether numbers of one message have their least byte first."""
        return bool(self._little[which])

    def picked(self, which: Int[np.ndarray, " k"]) -> Cursor:
        """Another cursor at the same places, in some of the messages."""
        other = copy(self)
        for name in ("at", "_end", "_origin", "sound", "_little"):
            setattr(other, name, getattr(self, name)[which])
        return other

    def dimensions(self) -> None:
        """Passes over a list of labels with a size and a stride each."""
        left = self.number()
        self.sound &= left <= _MOST_DIMENSIONS
        while (more := self.sound & (left > 0)).any():
            at, sound = self.at, self.sound.copy()
            self.text()
            self.numbers("u4", 2)
            self.at, self.sound = np.where(more, self.at, at), np.where(more, self.sound, sound)
            left = left - more

    def _align(self, size: int) -> None:
        if self._cdr:
            self.at = self.at + (self._origin - self.at) % size


@takes_arrays
def taken(data: bytes, at: Int[np.ndarray, " n"], width: int, sound: Bool[np.ndarray, " n"]) -> np.ndarray:
    """(n, width) bytes, of which those that are not sound are 0xff: NaN as doubles."""
    if not sound.all():
        found = np.full((len(at), width), 0xFF, dtype=np.uint8)
        found[sound] = taken(data, at[sound], width, sound[sound])
        return found
    if not len(at) or not width:
        return np.zeros((len(at), width), dtype=np.uint8)
    everywhere = np.ndarray(len(data) - width + 1, f"V{width}", data, strides=(1,))  # a view at every byte
    return everywhere[at].view(np.uint8).reshape(-1, width)
