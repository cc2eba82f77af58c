"""Messages that hold a frame of cells: images and arrays of ROS, taken apart one by one."""

from __future__ import annotations

from struct import error as StructError
from struct import unpack_from

import numpy as np
from jaxtyping import Float

__all__ = ["FRAMES", "STAMPED", "frame"]

_DEPTHS = {  # of an image -> type of a pixel; one channel
    "mono8": "u1",
    "8UC1": "u1",
    "8SC1": "i1",
    "mono16": "u2",
    "16UC1": "u2",
    "16SC1": "i2",
    "32SC1": "i4",
    "32FC1": "f4",
    "64FC1": "f8",
}
_ARRAYS = {
    f"std_msgs/{name}MultiArray": kind
    for name, kind in (
        ("UInt8", "u1"),
        ("Int8", "i1"),
        ("UInt16", "u2"),
        ("Int16", "i2"),
        ("UInt32", "u4"),
        ("Int32", "i4"),
        ("Float32", "f4"),
        ("Float64", "f8"),
    )
}
STAMPED = "sensor_msgs/Image"
FRAMES = (STAMPED, *_ARRAYS)


class _Cursor:
    """Reads on through one message: in CDR numbers stand at multiples of their size, in ROS 1 side by side."""

    def __init__(self, data: memoryview, encoding: str) -> None:
        self._cdr = encoding == "cdr"
        self.order = "<"
        if self._cdr:
            if len(data) < 4 or data[0] != 0 or data[1] > 1:
                raise StructError
            self.order, data = "<" if data[1] == 1 else ">", data[4:]
        self._data, self._at = data, 0

    def number(self, code: str, size: int) -> int:
        """One whole number."""
        self._align(size)
        (value,) = unpack_from(self.order + code, self._data, self._at)
        self._at += size
        return value

    def text(self) -> str:
        """A string."""
        length = self.number("I", 4)
        raw = bytes(self._data[self._at : self._at + length])
        if len(raw) < length:
            raise StructError
        self._at += length
        return raw.rstrip(b"\0").decode("utf-8", "replace")

    def array(self, kind: str, big: bool | None = None) -> np.ndarray:
        """A sequence of numbers of this type."""
        length = self.number("I", 4)
        size = int(kind[1])
        self._align(size if length else 1)
        if self._at + length * size > len(self._data):
            raise StructError
        order = self.order if big is None else ">" if big else "<"
        return np.frombuffer(self._data, dtype=f"{order}{kind}", count=length, offset=self._at)

    def _align(self, size: int) -> None:
        if self._cdr:
            self._at += -self._at % size

    def header(self) -> int:
        """The stamp [ns]."""
        if not self._cdr:
            self.number("I", 4)
        seconds, rest = self.number("i", 4), self.number("I", 4)
        self.text()
        return seconds * 10**9 + rest


def frame(
    data: memoryview, kind: str, encoding: str, rows: int, columns: int
) -> tuple[int, Float[np.ndarray, "rows columns"]] | None:
    """Stamp [ns] (0 where the type has none) and cells of a message; None where it is cut or of another size."""
    try:
        cursor = _Cursor(data, encoding)
        if kind == STAMPED:
            return _image(cursor, rows, columns)
        for _ in range(min(cursor.number("I", 4), 16)):
            cursor.text()
            for _ in ("size", "stride"):
                cursor.number("I", 4)
        start = cursor.number("I", 4)
        values = cursor.array(_ARRAYS[kind])[start:]
    except (StructError, ValueError):
        return None
    return (0, values.astype(np.float64).reshape(rows, columns)) if values.size == rows * columns else None


def _image(cursor: _Cursor, rows: int, columns: int) -> tuple[int, Float[np.ndarray, "rows columns"]] | None:
    """Rows of an image may be longer than their pixels."""
    stamp = cursor.header()
    height, width, depth = cursor.number("I", 4), cursor.number("I", 4), _DEPTHS.get(cursor.text())
    big, step = bool(cursor.number("B", 1)), cursor.number("I", 4)
    raw = cursor.array("u1")
    if depth is None or (height, width) != (rows, columns) or raw.size < height * step:
        return None
    lines = raw[: height * step].reshape(height, step)[:, : width * int(depth[1])]
    pixels = np.ascontiguousarray(lines).view(f"{'>' if big else '<'}{depth}")
    return stamp, pixels.astype(np.float64)
