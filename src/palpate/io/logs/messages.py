"""Messages of ROS in bulk: which types are understood, and their numbers taken out of the raw bytes."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.io.logs.log import Watched

__all__ = ["ARRAYS", "KINDS", "Kind", "Messages", "Source", "Topic", "decode", "decode_array", "merged", "seconds"]


@dataclass(frozen=True)
class Kind:
    """Where the numbers of a type of message are.

    Args:
        role: "wrench", "pose", "acceleration" or "voltage".
        size: bytes of doubles after the header and the strings.
        first, last: which of these bytes are the numbers wanted.
        strings: how many there are in front, that of the header among them; 0 is a type without a header.
    """

    role: str
    size: int
    first: int
    last: int
    strings: int = 1


_MOST_DIMENSIONS = 8
KINDS: Mapping[str, Kind] = {
    "geometry_msgs/WrenchStamped": Kind("wrench", 48, 0, 48),
    "geometry_msgs/Wrench": Kind("wrench", 48, 0, 48, strings=0),
    "geometry_msgs/PoseStamped": Kind("pose", 56, 0, 56),
    "geometry_msgs/Pose": Kind("pose", 56, 0, 56, strings=0),
    "geometry_msgs/TransformStamped": Kind("pose", 56, 0, 56, strings=2),
    "geometry_msgs/PoseWithCovarianceStamped": Kind("pose", 56 + 288, 0, 56),
    "nav_msgs/Odometry": Kind("pose", 56 + 288 + 48 + 288, 0, 56, strings=2),
    "geometry_msgs/AccelStamped": Kind("acceleration", 48, 0, 24),
    "geometry_msgs/Vector3Stamped": Kind("acceleration", 24, 0, 24),
    "sensor_msgs/Imu": Kind("acceleration", 296, 200, 224),  # behind 4 + 9 + 3 + 9 doubles, before its covariance
}
ARRAYS: Mapping[str, Kind] = {"std_msgs/Float64MultiArray": Kind("voltage", 0, 0, 0, strings=0)}  # see `decode_array`


@dataclass(frozen=True)
class Topic:
    """What a channel or connection carries; `encoding` is cdr (ROS 2) or ros1, and `count` its messages, if known."""

    name: str
    kind: str
    encoding: str
    count: int = 0

    def same(self, other: Topic) -> bool:
        """Whether these only differ in the count."""
        return (self.name, self.kind, self.encoding) == (other.name, other.kind, other.encoding)


def merged(topics: Iterable[Topic]) -> list[Topic]:
    """One entry for those that only differ in the count."""
    counts: dict[Topic, int] = {}
    for topic in topics:
        key = replace(topic, count=0)
        counts[key] = counts.get(key, 0) + topic.count
    return [replace(topic, count=count) for topic, count in counts.items()]


@dataclass(frozen=True)
class Messages:
    """Some messages, in the order of the file.

    Attributes:
        data: the bytes in which they are.
        topic: (n,) a key of `topics`; a message whose key is not there belongs to nothing that was declared.
        time: (n,) [ns] when they were recorded.
        start, length: (n,) of the payload in `data`.
    """

    data: bytes
    topics: Mapping[int, Topic]
    topic: Int[np.ndarray, " n"]
    time: Int[np.ndarray, " n"]
    start: Int[np.ndarray, " n"]
    length: Int[np.ndarray, " n"]

    def of(self, topic: Topic) -> Messages:
        """Those of one topic, as far as they are of its type."""
        mask = np.zeros(len(self.topic), dtype=bool)
        for key, other in self.topics.items():
            if other.same(topic):
                mask |= self.topic == key
        return Messages(self.data, self.topics, self.topic[mask], self.time[mask], self.start[mask], self.length[mask])


@runtime_checkable
class Source(Watched, Protocol):
    """A file of messages."""

    def topics(self) -> list[Topic]:
        """Everything that it declares, one entry a name and type, with how many messages there are."""
        ...

    def messages(self, names: Collection[str] = ()) -> Generator[Messages]:
        """From the start, in the order of the file: all, or at least those of the topics that are named."""
        ...


def decode(
    messages: Messages, kind: Kind, encoding: str
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n k"], Bool[np.ndarray, " n"]]:
    """Stamps [ns] (0 where the type has none), numbers, and which messages could be read.

    In CDR (ROS 2) four bytes come first, of which the second says the order of bytes, and doubles stand at multiples of
    8 behind them; in ROS 1 nothing is aligned, and the header begins with a sequence number.
    """
    cdr = encoding == "cdr"
    little, at, end, sound = _opened(messages, cdr=cdr)
    origin = at.copy()
    stamps = np.zeros(len(at), dtype=np.int64)
    if kind.strings:
        at += 0 if cdr else 4
        sound &= at + 8 <= end
        part = _numbers(messages.data, at, "u4", 2, sound, little)
        whole = part[:, 0].view(np.int32) if cdr else part[:, 0]
        stamps = whole.astype(np.int64) * 10**9 + part[:, 1].astype(np.int64)
        at += 8
    for _ in range(kind.strings):
        at += -(at - origin) % 4 if cdr else 0
        sound &= at + 4 <= end
        at += 4 + _numbers(messages.data, at, "u4", 1, sound, little)[:, 0].astype(np.int64)
        sound &= at <= end
    at += -(at - origin) % 8 if cdr else 0
    sound &= at + kind.size <= end
    values = _numbers(messages.data, at + kind.first, "f8", (kind.last - kind.first) // 8, sound, little)
    values[np.isnan(values)] = np.nan  # of the many that bytes can make, the one that arithmetic does not warn of
    return stamps, values, sound


def _opened(
    messages: Messages, *, cdr: bool
) -> tuple[Bool[np.ndarray, " n"], Int[np.ndarray, " n"], Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Which messages are little-endian, where each begins behind its representation and ends, and which are sound."""
    little = np.ones(len(messages.start), dtype=bool)
    at, end = messages.start.copy(), messages.start + messages.length
    sound = messages.length >= (4 if cdr else 0)
    if cdr:
        representation = _taken(messages.data, at, 2, sound)
        little = representation[:, 1] == 1
        sound &= (representation[:, 0] == 0) & (representation[:, 1] <= 1)
        at += 4
    return little, at, end, sound


def decode_array(
    messages: Messages, count: int, encoding: str
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n k"], Bool[np.ndarray, " n"]]:
    """The same of Float64MultiArray: `count` numbers; a message with another number of them cannot be read.

    In front of them are its dimensions (a label, size and stride each), which say nothing more, and an offset.
    """
    cdr = encoding == "cdr"
    little, at, end, sound = _opened(messages, cdr=cdr)
    origin = at.copy()
    left = _count(messages.data, at, end, sound, little)
    at += 4
    sound &= left <= _MOST_DIMENSIONS
    for _ in range(_MOST_DIMENSIONS):
        more = sound & (left > 0)
        if not more.any():
            break
        start = at + np.where(cdr, -(at - origin) % 4, 0)
        whole = more.copy()
        length = _count(messages.data, start, end, whole, little)
        sound &= whole | ~more
        start += 4 + length
        start += np.where(cdr, -(start - origin) % 4, 0) + 8
        at, left = np.where(more, start, at), left - more
    at += 4 + np.where(cdr, -(at - origin) % 4, 0)
    sound &= _count(messages.data, at, end, sound, little) == count
    at += 4
    at += np.where(cdr, -(at - origin) % 8, 0)
    sound &= at + 8 * count <= end
    values = _numbers(messages.data, at, "f8", count, sound, little)
    values[np.isnan(values)] = np.nan
    return np.zeros(len(at), dtype=np.int64), values, sound


def _count(
    data: bytes,
    at: Int[np.ndarray, " n"],
    end: Int[np.ndarray, " n"],
    sound: Bool[np.ndarray, " n"],
    little: Bool[np.ndarray, " n"],
) -> Int[np.ndarray, " n"]:
    """A length that stands at each place; what is not whole, or too long to be one, makes a message unsound."""
    sound &= at + 4 <= end
    found = _numbers(data, at, "u4", 1, sound, little)[:, 0].astype(np.int64)
    sound &= found <= end - at
    return np.where(sound, found, 0)


def seconds(nanoseconds: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The doubles nearest to these times."""
    whole, rest = np.divmod(nanoseconds, 10**9)
    exact = np.abs(nanoseconds) < 2**53
    return np.where(exact, nanoseconds / 1e9, whole + rest / 1e9)


def _numbers(
    data: bytes,
    at: Int[np.ndarray, " n"],
    kind: str,
    count: int,
    sound: Bool[np.ndarray, " n"],
    little: Bool[np.ndarray, " n"],
) -> np.ndarray:
    """(n, count) numbers in the order of bytes that each message has."""
    raw = _taken(data, at, count * int(kind[1]), sound)
    values = raw.view(f"<{kind}")
    if not little.all():
        values[~little] = raw[~little].view(f">{kind}")
    return values


def _taken(data: bytes, at: Int[np.ndarray, " n"], width: int, sound: Bool[np.ndarray, " n"]) -> np.ndarray:
    """(n, width) bytes, of which those that are not sound are 0xff: NaN as doubles."""
    if not sound.all():
        taken = np.full((len(at), width), 0xFF, dtype=np.uint8)
        taken[sound] = _taken(data, at[sound], width, sound[sound])
        return taken
    if not len(at):
        return np.zeros((0, width), dtype=np.uint8)
    everywhere = np.ndarray(len(data) - width + 1, f"V{width}", data, strides=(1,))  # a view at every byte
    return everywhere[at].view(np.uint8).reshape(-1, width)
