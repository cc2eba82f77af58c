"""Parse many ROS messages at once."""

from __future__ import annotations

from copy import copy

import numpy as np
from jaxtyping import Bool, Int

from palpate.files.messages import MessageBlock
from palpate.spatial.arguments import takes_arrays

__all__ = ["taken"]

_MOST_DIMENSIONS = 16


@takes_arrays
class Cursor:
    """A parser of n messages at once, with a read position in each.

    In CDR (ROS 2) the second byte states the byte order, and numbers are aligned to their size from the fifth byte on;
    in ROS 1 nothing is aligned, and a header begins with an additional number.

    Attributes:
        data: bytes that contain the messages.
        at: (n,) index of the byte at which each is read next.
        sound: (n,) False once one is found to be cut or malformed; numbers read from it mean nothing.
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
        """Return `count` numbers of each message, (n, count), of a type such as "f8"; `sound` marks cut messages.

        `before` others of this type are skipped first, and `after` last.
        """
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

    def skip(self, size: int, count: Int[np.ndarray, " n"]) -> None:
        """Skip so many numbers of a size in each message; where there are none, nothing is aligned.

        Raises:
            InputError: count has another shape.
        """
        before = self.at
        self._align(size)
        self.at = np.where(count > 0, self.at + size * count, before)
        self.sound &= self.at <= self._end

    def number(self) -> Int[np.ndarray, " n"]:
        """Return the next four-byte unsigned integer of each message, (n,)."""
        return self.numbers("u4", 1)[:, 0].astype(np.int64)

    def length(self) -> Int[np.ndarray, " n"]:
        """Return the number (n,) of bytes that follow; 0 in a message with fewer, which `sound` marks."""
        found = self.number()
        self.sound &= found <= self._end - self.at
        return np.where(self.sound, found, 0)

    def text(self) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Read a string; return the index of its first byte in `data`, and its length, (n,) each."""
        length = self.length()
        self.at = self.at + length
        return self.at - length, length

    def stamp(self) -> Int[np.ndarray, " n"]:
        """Read a header; return its stamp (n,) [ns]."""
        return self.header()[0]

    def header(self) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Read a header; return its stamp [ns], and start and length of its frame's name, (n,) each."""
        if not self._cdr:
            self.number()
        part = self.numbers("u4", 2)
        whole = part[:, 0].view(np.int32) if self._cdr else part[:, 0]
        return whole.astype(np.int64) * 10**9 + part[:, 1].astype(np.int64), *self.text()

    def picked(self, which: Int[np.ndarray, " k"]) -> Cursor:
        """Return a cursor at the same positions in a selection of the messages.

        Raises:
            InputError: which has another shape.
        """
        other = copy(self)
        for name in ("at", "_end", "_origin", "sound", "_little"):
            setattr(other, name, getattr(self, name)[which])
        return other

    def dimensions(self) -> list[Int[np.ndarray, " n"]]:
        """Read a list of array dimensions, and return their sizes; a list of more than 16 is malformed.

        Each is (n,), 0 where a message has fewer dimensions.
        """
        left, sizes = self.number(), list[np.ndarray]()
        self.sound &= left <= _MOST_DIMENSIONS
        while (more := self.sound & (left > 0)).any():
            at, sound = self.at, self.sound.copy()
            self.text()
            sizes.append(np.where(more, self.numbers("u4", 2)[:, 0].astype(np.int64), 0))
            self.at, self.sound = np.where(more, self.at, at), np.where(more, self.sound, sound)
            left = left - more
        return sizes

    def _align(self, size: int) -> None:
        if self._cdr:
            self.at = self.at + (self._origin - self.at) % size


@takes_arrays
def taken(data: bytes, at: Int[np.ndarray, " n"], width: int, sound: Bool[np.ndarray, " n"]) -> np.ndarray:
    """Return (n, width) bytes from each `at` on, as uint8; 0xff where not `sound`, which is NaN as float64.

    Raises:
        InputError: arrays of other shapes.
    """
    if not sound.all():
        found = np.full((len(at), width), 0xFF, dtype=np.uint8)
        found[sound] = taken(data, at[sound], width, sound[sound])
        return found
    if not len(at) or not width:
        return np.zeros((len(at), width), dtype=np.uint8)
    everywhere = np.ndarray(len(data) - width + 1, f"V{width}", data, strides=(1,))  # a view at every byte
    return everywhere[at].view(np.uint8).reshape(-1, width)
