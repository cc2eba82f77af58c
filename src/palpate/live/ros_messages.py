"""Write messages of ROS 2 as bytes (CDR, little-endian), and make their types known to DDS."""

from __future__ import annotations

from functools import cache
from struct import Struct
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.files.message_types import DEFINITIONS
from palpate.files.units import near
from palpate.spatial.arguments import takes_arrays

_HEAD = b"\0\1\0\0"  # plain, little-endian


class Cdr:
    """A writer of one message from front to back, with numbers aligned to their size."""

    def __init__(self) -> None:
        self._data = bytearray(_HEAD)

    def align(self, size: int) -> Cdr:
        """Append zeros up to a multiple of `size` bytes, and return the writer."""
        self._data += bytes(-(len(self._data) - len(_HEAD)) % size)
        return self

    def numbers(self, code: str, *values: float | int) -> Cdr:
        """Append aligned numbers of one type, a letter of `struct`, and return the writer.

        Raises:
            struct.error: a number does not fit the type.
        """
        packed = Struct(f"<{len(values)}{code}")
        self.align(packed.size // max(len(values), 1) or 1)
        self._data += packed.pack(*values)
        return self

    def text(self, text: str) -> Cdr:
        """Append a string after its length, and return the writer."""
        raw = text.encode() + b"\0"
        self.numbers("I", len(raw))
        self._data += raw
        return self

    def header(self, stamp: int, frame_id: str) -> Cdr:
        """Append a std_msgs/Header, its stamp in ns, and return the writer."""
        self.numbers("i", stamp // 10**9).numbers("I", stamp % 10**9)
        return self.text(frame_id)

    def raw(self, data: bytes) -> Cdr:
        """Append bytes as they are, and return the writer."""
        self._data += data
        return self

    def done(self) -> bytes:
        """Return the bytes of the message."""
        return bytes(self._data)


@takes_arrays
def stamped(frame_id: str, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> list[bytes]:
    """Return n messages (bytes, CDR) of a header and k doubles, such as WrenchStamped or PoseStamped.

    Args:
        frame_id: name of the frame.
        stamp: (n,) [ns] of each message.
        values: (n, k) in the order of the message, such as force first.

    Raises:
        InputError: arrays of other shapes.
    """
    head = np.frombuffer(Cdr().header(0, frame_id).align(8).done(), dtype=np.uint8)
    rows = np.empty((len(stamp), len(head) + 8 * values.shape[1]), dtype=np.uint8)
    rows[:, : len(head)] = head
    times = np.stack(np.divmod(stamp, 10**9), axis=1).astype("<u4")
    rows[:, 4:12] = times.view(np.uint8)
    rows[:, len(head) :] = np.ascontiguousarray(values, dtype="<f8").view(np.uint8)
    return [row.tobytes() for row in rows]


@takes_arrays
def array_message(values: np.ndarray) -> bytes:
    """Return the bytes (CDR) of a Float64MultiArray of one sample of any shape."""
    names = ["rows", "columns"] if values.ndim == 2 else [f"axis {axis}" for axis in range(values.ndim)]
    message = Cdr().numbers("I", values.ndim)
    for axis, name in enumerate(names):
        message.text(name).numbers("I", values.shape[axis], int(np.prod(values.shape[axis:])))
    message.numbers("I", 0, values.size)
    return message.align(8).raw(np.ascontiguousarray(values, dtype="<f8").tobytes()).done()


@takes_arrays
def image_message(stamp: int, frame_id: str, image: np.ndarray) -> bytes:
    """Return the bytes (CDR) of an Image, encoded as bgr8 or mono8.

    Args:
        stamp: time [ns].
        frame_id: name of the frame.
        image: (height, width, 3) uint8 as blue, green, red, or (height, width) uint8 in grey.

    Raises:
        InputError: the image has neither two nor three axes.
    """
    if image.ndim not in (2, 3):
        raise InputError(f"image must have shape (height, width) or (height, width, 3), not {image.shape}.")
    height, width = image.shape[:2]
    encoding = "bgr8" if image.ndim == 3 else "mono8"
    message = Cdr().header(stamp, frame_id).numbers("I", height, width).text(encoding).numbers("B", 0)
    message.numbers("I", image[0].size, image.size)
    return message.raw(np.ascontiguousarray(image, dtype=np.uint8).tobytes()).done()


class Raw:
    """The bytes of one message for cyclonedds, which sets `sample_info` of a received one: the time of sending."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.sample_info: Any = None


def ros_type_name(name: str) -> str:
    """Return the name in ROS of a type of DDS: "geometry_msgs::msg::dds_::Wrench_" -> "geometry_msgs/Wrench".

    Another form stays as it is.
    """
    package, between, last = name.partition("::msg::dds_::")
    return f"{package}/{last.removesuffix('_')}" if between else name


@cache
def idl_type(kind: str) -> Any:
    """Return the class by which cyclonedds knows a message type; its messages stay bytes, as in `Raw`.

    Raises:
        InputError: the type is none of `DEFINITIONS`.
        ImportError: cyclonedds is not installed.
    """
    from cyclonedds.idl import make_idl_struct

    if kind not in DEFINITIONS:
        hint = near(kind, DEFINITIONS)
        raise InputError(f"messages of {kind} cannot be read or written.", where="ROS 2", hint=hint)
    members = {name: _member(what) for what, name in (each.split(" ") for each in DEFINITIONS[kind].split(", "))}
    package, _, name = kind.partition("/")
    made: Any = make_idl_struct(f"{name}_", f"{package}::msg::dds_::{name}_", members, dataclassify=False)
    made.__init__ = Raw.__init__
    made.serialize = _serialize
    made.deserialize = made.deserialize_key = classmethod(_deserialize)  # a key comes when a publisher leaves
    return made


def _serialize(self: Any, **_: object) -> bytes:
    return self.data


def _deserialize(cls: Any, data: bytes, **_: object) -> Any:
    return cls(data)


def _member(what: str) -> Any:
    from cyclonedds.idl import types

    name, bracket, size = what.partition("[")
    if bracket:
        inner = _member(name)
        return types.sequence[inner] if size == "]" else types.array[inner, int(size[:-1])]
    if "/" in name:
        return idl_type(name)
    return {"string": str, "bool": bool}.get(name) or getattr(types, name)
