"""Decode many ROS messages of known types to numbers at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.files.logs.cursor import Cursor, taken
from palpate.files.logs.message_fields import FieldPath
from palpate.files.message_types import NUMBERS
from palpate.files.messages import MessageBlock, Topic
from palpate.spatial.arguments import takes_arrays

__all__ = ["ARRAYS", "FIXED", "IMAGE", "decode", "decode_array", "has_header", "role", "seconds", "shape_of"]


@dataclass(frozen=True)
class MessageLayout:
    """The positions of the numbers in a message type of fixed size.

    Args:
        role: "wrench", "pose", "acceleration" or "temperature".
        before, count, after: number of doubles before those wanted, of these, and after them.
        strings: number of strings before them, with the header's; 0 without a header.
    """

    role: str
    before: int
    count: int
    after: int
    strings: int = 1


FIXED: Mapping[str, MessageLayout] = {
    "geometry_msgs/WrenchStamped": MessageLayout("wrench", 0, 6, 0),
    "geometry_msgs/Wrench": MessageLayout("wrench", 0, 6, 0, strings=0),
    "geometry_msgs/PoseStamped": MessageLayout("pose", 0, 7, 0),
    "geometry_msgs/Pose": MessageLayout("pose", 0, 7, 0, strings=0),
    "geometry_msgs/TransformStamped": MessageLayout("pose", 0, 7, 0, strings=2),
    "geometry_msgs/PoseWithCovarianceStamped": MessageLayout("pose", 0, 7, 36),
    "nav_msgs/Odometry": MessageLayout("pose", 0, 7, 36 + 6 + 36, strings=2),
    "geometry_msgs/AccelStamped": MessageLayout("acceleration", 0, 3, 3),
    "geometry_msgs/Vector3Stamped": MessageLayout("acceleration", 0, 3, 0),
    "sensor_msgs/Imu": MessageLayout("acceleration", 4 + 9 + 3 + 9, 3, 9),
    "sensor_msgs/Temperature": MessageLayout("temperature", 0, 1, 1),
    "std_msgs/Float64": MessageLayout("temperature", 0, 1, 0, strings=0),
}
ARRAYS: Mapping[str, str] = {  # -> NumPy's code of each number, such as "f8"
    f"std_msgs/{name}MultiArray": np.dtype(name.lower()).str[1:] for name in NUMBERS
}
IMAGE = "sensor_msgs/Image"
_DEPTHS: Mapping[bytes, str] = {  # encoding of an image with one channel -> what each pixel is
    b"mono8": "u1",
    b"8UC1": "u1",
    b"8SC1": "i1",
    b"mono16": "u2",
    b"16UC1": "u2",
    b"16SC1": "i2",
    b"32SC1": "i4",
    b"32FC1": "f4",
    b"64FC1": "f8",
}
_NAME = 8  # bytes: the longest of these with its end

Decoded = tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n k"], Bool[np.ndarray, " n"]]


def role(kind: str) -> str:
    """Return the use of a message type: "wrench", "pose", "acceleration", "temperature" or "array"; "" for others."""
    return FIXED[kind].role if kind in FIXED else "array" if kind in ARRAYS or kind == IMAGE else ""


def has_header(kind: str) -> bool:
    """Return True if messages of a type that has a role have a header."""
    return FIXED[kind].strings > 0 if kind in FIXED else kind == IMAGE


def decode(
    messages: MessageBlock, topic: Topic, shape: tuple[int, ...] = (), field: FieldPath | None = None
) -> Decoded:
    """Return stamps (n,) [ns], numbers (n, k), and a mask (n,), True where a message is readable.

    The numbers of a `field` replace those that the type has. Stamps are 0 if the type has none. Numbers are as
    recorded; NaN where unreadable, as are arrays not of the `shape`.

    Raises:
        KeyError: the type of the topic has no role.
    """
    cursor = Cursor(messages, topic.encoding)
    if field is not None:
        ahead = Cursor(messages, topic.encoding)
        stamps = ahead.stamp() if field.stamped else np.zeros(len(cursor.at), dtype=np.int64)
        values = field.read(cursor, prod(shape)).astype(np.float64)
        values[~cursor.sound] = np.nan
    elif topic.kind == IMAGE:
        stamps, values = _image(cursor, shape)
    elif topic.kind in ARRAYS:
        stamps, values = np.zeros(len(cursor.at), dtype=np.int64), _array(cursor, ARRAYS[topic.kind], shape)
    else:
        stamps, values = _fixed(cursor, FIXED[topic.kind])
    return stamps, values, cursor.sound


def shape_of(messages: MessageBlock, topic: Topic) -> tuple[int, ...] | None:
    """Return the shape of the array, or (rows, columns) of the one-channel image, in the first readable message.

    It is the shape that the array's layout states, if it holds as many numbers. None if no message is readable. The
    topic has images, or a type in `ARRAYS`.
    """
    cursor = Cursor(messages, topic.encoding)
    if topic.kind == IMAGE:
        cursor.stamp()
        sizes = np.stack([cursor.number(), cursor.number()], axis=1)
        start, length = cursor.text()
        ends = zip(start.tolist(), (start + length).tolist(), strict=True)
        known = [messages.data[first:end].rstrip(b"\0") in _DEPTHS for first, end in ends]
        cursor.sound &= np.array(known, dtype=bool)  # of no message, too
        cursor.numbers("u1", 1)
        cursor.number()
        cursor.sound &= sizes[:, 0] <= cursor.length() // np.maximum(sizes[:, 1], 1)
    else:
        stated = cursor.dimensions()
        offset, held = cursor.number(), cursor.number()
        cursor.skip(int(ARRAYS[topic.kind][1]), held)
        sizes = (held - offset)[:, None]
        sides = np.stack([*stated, np.zeros_like(offset)], axis=1)[cursor.sound & (sizes > 0).all(axis=1)][:1]
        shape = tuple(side for side in sides.ravel().tolist() if side)
        if shape and prod(shape) == sizes[cursor.sound & (sizes > 0).all(axis=1)][0, 0]:
            return shape
    found = sizes[cursor.sound & (sizes > 0).all(axis=1)]
    return tuple(found[0].tolist()) if len(found) else None


@takes_arrays
def seconds(nanoseconds: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return nanoseconds (n,) as seconds (n,), to the nearest double.

    Raises:
        InputError: nanoseconds has another shape.
    """
    whole = nanoseconds // 10**9
    split = whole + (nanoseconds - whole * 10**9) / 1e9
    if len(nanoseconds) and nanoseconds.min() >= 2**53:  # as all are since 1970
        return split
    return np.where(np.abs(nanoseconds) < 2**53, nanoseconds / 1e9, split)


def _fixed(cursor: Cursor, kind: MessageLayout) -> tuple[np.ndarray, np.ndarray]:
    stamps = cursor.stamp() if kind.strings else np.zeros(len(cursor.at), dtype=np.int64)
    for _ in range(kind.strings - 1):
        cursor.text()
    values = cursor.numbers("f8", kind.count, kind.before, kind.after)
    values[np.isnan(values)] = np.nan  # of the many that bytes can make, the one that arithmetic does not warn of
    return stamps, values


def decode_array(
    messages: MessageBlock, topic: Topic, shape: tuple[int, ...]
) -> tuple[np.ndarray, Bool[np.ndarray, " n"]]:
    """Return the numbers of arrays, (n, k) in their stored type, and a mask (n,), True where a message is readable.

    `shape` is that of an array; a message with another count of numbers is unreadable, and its row means nothing.

    Raises:
        KeyError: the type is not in `ARRAYS`.
    """
    cursor = Cursor(messages, topic.encoding)
    return _stored(cursor, ARRAYS[topic.kind], shape), cursor.sound


def _stored(cursor: Cursor, code: str, shape: tuple[int, ...]) -> np.ndarray:
    count = int(np.prod(shape))
    cursor.dimensions()
    offset, held = cursor.number(), cursor.number()
    cursor.sound &= held == offset + count
    return cursor.numbers(code, count, np.where(cursor.sound, offset, 0))


def _array(cursor: Cursor, code: str, shape: tuple[int, ...]) -> np.ndarray:
    values = _stored(cursor, code, shape)
    with np.errstate(invalid="ignore"):  # bytes make NaNs of which arithmetic warns
        values = values.astype(np.float64, copy=False)
    values[~cursor.sound] = np.nan
    if code[0] == "f":
        values[np.isnan(values)] = np.nan
    return values


def _image(cursor: Cursor, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps and pixels of images of this shape; rows may be longer than their pixels."""
    rows, columns = shape
    stamps = cursor.stamp()
    cursor.sound &= (cursor.number() == rows) & (cursor.number() == columns)
    start, length = cursor.text()
    big, step = cursor.numbers("u1", 1)[:, 0] != 0, cursor.number()
    cursor.sound &= rows * step <= cursor.length()
    name = taken(cursor.data, start, _NAME, cursor.sound)  # there are as many bytes behind it
    name[np.arange(_NAME) >= length[:, None]] = 0
    made = np.stack([*np.ascontiguousarray(name).view(np.int64).T, big, step], axis=1)
    values = np.full((len(start), rows * columns), np.nan)
    for one in np.unique(made[cursor.sound], axis=0):  # as a rule all are of one make
        code, mask = _DEPTHS.get(one[:1].tobytes().rstrip(b"\0")), cursor.sound & (made == one).all(axis=1)
        width = int(one[2])
        if code is None or width < columns * int(code[1]):
            cursor.sound &= ~mask
            continue
        lines = taken(cursor.data, cursor.at[mask], rows * width, np.ones(np.count_nonzero(mask), dtype=bool))
        lines = lines.reshape(-1, rows, width)[:, :, : columns * int(code[1])]
        pixels = np.ascontiguousarray(lines).view(f"{'>' if one[1] else '<'}{code}")
        values[mask] = pixels.reshape(-1, rows * columns)
    return stamps, values
