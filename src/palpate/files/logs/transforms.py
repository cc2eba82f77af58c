"""Read the tree of /tf and /tf_static: its frames, and the pose of one in another over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import count, pairwise
from struct import Struct
from struct import error as StructError

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.files.logs.cursor import taken
from palpate.files.logs.decoding import seconds
from palpate.files.messages import MessageBlock, MessageFile, Topic
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.frames import FramePath, FrameTree
from palpate.spatial.pose import Pose
from palpate.spatial.pose_track import PoseTrack, sound_quaternions

__all__ = ["TREES", "SeenEdge", "TransformTree", "TreePoses", "frame_name", "read_frames", "transforms", "tree_topics"]

TREES = ("tf2_msgs/TFMessage", "tf/tfMessage")
_MOVED = 1e-9  # m, and of an entry of a quaternion: what a transform that is published again differs by is rounding
_FORMS = 32  # forms of messages of one length that are looked for among all of them


@dataclass(frozen=True)
class Transforms:
    """The m transforms in some messages.

    Attributes:
        parent, child: (m,) numbers of the frames' names.
        stamp: (m,) [ns].
        message: (m,) index of the message of each.
        values: (m, 7) position [m] and quaternion x, y, z, w of the child in the parent.
    """

    parent: Int[np.ndarray, " m"]
    child: Int[np.ndarray, " m"]
    stamp: Int[np.ndarray, " m"]
    message: Int[np.ndarray, " m"]
    values: Float[np.ndarray, "m 7"]

    def edges(self) -> Iterator[tuple[int, int, Int[np.ndarray, " k"]]]:
        """Yield the numbers of parent and child, and the indices (k,) of the rows, of each edge."""
        key = (self.parent << 32) + self.child
        order = np.argsort(key, kind="stable")
        starts = np.flatnonzero(np.diff(key[order], prepend=-1))
        for rows in np.split(order, starts[1:]) if len(order) else ():
            yield int(self.parent[rows[0]]), int(self.child[rows[0]]), rows


def transforms(
    messages: MessageBlock, topic: Topic, names: dict[str, int]
) -> tuple[Transforms, Bool[np.ndarray, " n"]]:
    """Return all transforms in n messages, in order, and a mask (n,), True for each readable message.

    Args:
        messages: of the topic.
        topic: of a type of `TREES`.
        names: frame, without a leading slash -> its number; new frames are added.
    """
    pieces, sound = list[Transforms](), np.zeros(len(messages.start), dtype=bool)
    for size in np.unique(messages.length).tolist():
        left = np.flatnonzero(messages.length == size)
        for tried in count():
            if not len(left):
                break
            start = messages.start[left]
            form = _form(messages.data[start[0] : start[0] + size], topic.encoding == "cdr")
            same = np.zeros(len(left), dtype=bool)
            same[0] = True
            if form is not None:
                if tried < _FORMS:
                    same = form.fits(messages.data, start, size)
                sound[left[same]] = True
                pieces.append(form.read(messages.data, start[same], left[same], names))
            left = left[~same]
    return _in_order(pieces), sound


@dataclass(frozen=True)
class _Form:
    """The common form of messages that differ only in stamps and numbers.

    Attributes:
        fixed: byte offset, and bytes that all share: counts, names and their lengths.
        frames: parent and child of each transform.
        stamps, values: byte offsets of the stamp and the numbers of each.
    """

    little: bool
    fixed: list[tuple[int, bytes]]
    frames: list[tuple[str, str]]
    stamps: list[int]
    values: list[int]

    def fits(self, data: bytes, start: Int[np.ndarray, " n"], size: int) -> Bool[np.ndarray, " n"]:
        same = np.ones(len(start), dtype=bool)
        for at, wanted in self.fixed:
            if at + len(wanted) > size:
                return ~same
            same &= (_bytes(data, start + at, len(wanted)) == np.frombuffer(wanted, dtype=np.uint8)).all(axis=1)
        return same

    def read(
        self, data: bytes, start: Int[np.ndarray, " n"], message: Int[np.ndarray, " n"], names: dict[str, int]
    ) -> Transforms:
        order = "<" if self.little else ">"
        each = np.zeros((len(self.frames), 3, len(start)), dtype=np.int64)
        values = np.zeros((len(self.frames), len(start), 7))
        for k, (stamp, number, frames) in enumerate(zip(self.stamps, self.values, self.frames, strict=True)):
            whole, part = _bytes(data, start + stamp, 8).view(f"{order}i4").T.astype(np.int64)
            each[k, :2] = [[names.setdefault(name, len(names))] for name in frames]
            each[k, 2] = whole * 10**9 + (part & 0xFFFFFFFF)
            values[k] = _bytes(data, start + number, 56).view(f"{order}f8")
        parent, child, stamps = each.transpose(1, 0, 2).reshape(3, -1)
        values[np.isnan(values)] = np.nan  # of the many that bytes can make, the one that arithmetic does not warn of
        return Transforms(parent, child, stamps, np.tile(message, len(self.frames)), values.reshape(-1, 7))


def _form(raw: bytes, cdr: bool) -> _Form | None:
    """Return the form of one message; None if it is malformed."""
    origin = 4 if cdr else 0
    if cdr and (len(raw) < 4 or raw[0] or raw[1] > 1):
        return None
    little = not cdr or raw[1] == 1
    number = Struct("<I" if little else ">I")
    fixed, frames, stamps, values = list[tuple[int, bytes]](), list[tuple[str, str]](), list[int](), list[int]()
    try:
        left = number.unpack_from(raw, origin)[0]
        fixed += [(0, raw[:origin]), (origin, raw[origin : origin + 4])]
        at = origin + 4
        for _ in range(left):
            at += (origin - at) % 4 if cdr else 4  # the number of a header of ROS 1
            stamps.append(at)
            at += 8
            texts = list[str]()
            for _ in ("parent", "child"):
                begin = at + ((origin - at) % 4 if cdr else 0)
                at = begin + 4 + number.unpack_from(raw, begin)[0]
                fixed.append((begin, raw[begin:at]))
                texts.append(frame_name(raw[begin + 4 : at]))
            at += (origin - at) % 8 if cdr else 0
            frames.append((texts[0], texts[1]))
            values.append(at)
            at += 56
            if at > len(raw):
                return None
    except StructError:
        return None
    return _Form(little, fixed, frames, stamps, values)


def frame_name(text: bytes) -> str:
    """Return a frame's name without the leading slash that ROS 1 allows."""
    return text.rstrip(b"\0").decode(errors="replace").removeprefix("/")


def _bytes(data: bytes, at: Int[np.ndarray, " n"], width: int) -> np.ndarray:
    return taken(data, at, width, np.ones(len(at), dtype=bool))


def _in_order(pieces: list[Transforms]) -> Transforms:
    """Join transforms, sorted by message."""
    none = np.zeros(0, dtype=np.int64)
    pieces = [Transforms(none, none, none, none, np.zeros((0, 7))), *pieces]
    joined = [np.concatenate([getattr(piece, each.name) for piece in pieces]) for each in fields(Transforms)]
    order = np.argsort(joined[3], kind="stable")
    return Transforms(*(values[order] for values in joined))


@takes_arrays
@dataclass
class SeenEdge:
    """The transforms of one edge in a log.

    Attributes:
        count: number of those on topics that are not static.
        first: the first of these, (7,): position [m] and quaternion.
        moves: True if another of these differs from it.
        stamped: True if one of these has a stamp.
        constant: the last one of /tf_static; None without any.
    """

    count: int = 0
    first: Float[np.ndarray, "7"] | None = None
    moves: bool = False
    stamped: bool = False
    constant: Float[np.ndarray, "7"] | None = None

    def add(self, values: Float[np.ndarray, "k 7"], stamp: Int[np.ndarray, " k"], *, static: bool) -> None:
        """Add transforms (k, 7) with stamps (k,) [ns], of /tf_static if `static`.

        Those that are not finite, or no rotations, only count; of /tf_static they are ignored.

        Raises:
            InputError: arrays of other shapes.
        """
        fine = values[sound_quaternions(values[:, 3:]) & np.isfinite(values).all(axis=1)]
        if static and len(fine):
            self.constant = fine[-1]
        if static or not len(values):
            return
        self.count += len(values)
        self.stamped |= bool(stamp.any())
        if len(fine):
            first = fine[0] if self.first is None else self.first
            self.first = first
            self.moves |= _differs(fine, first)

    @property
    def holds(self) -> bool:
        """True if the edge is one pose in the complete log: it is on /tf_static, and /tf does not differ."""
        return self.constant is not None and not self.contradicted

    @property
    def contradicted(self) -> bool:
        """True if /tf and /tf_static differ."""
        if self.constant is None or self.first is None:
            return False
        return self.moves or _differs(self.constant[None], self.first)


def _differs(values: Float[np.ndarray, "k 7"], first: Float[np.ndarray, "7"]) -> bool:
    """Check whether a pose differs by more than rounding; q and -q are one rotation."""
    turn = np.minimum(*(np.abs(values[:, 3:] + sign * first[3:]).max(axis=1, initial=0.0) for sign in (1, -1)))
    shift = np.abs(values[:, :3] - first[:3]).max(axis=1, initial=0.0)
    return bool((np.maximum(turn, shift) > _MOVED).any())


@dataclass
class TransformTree:
    """All edges of a log's tree.

    Attributes:
        topics: of transforms.
        edges: (parent, child) -> transforms found.
        names: name of a frame -> its number.
    """

    topics: tuple[Topic, ...] = ()
    edges: dict[tuple[str, str], SeenEdge] = field(default_factory=dict[tuple[str, str], SeenEdge])
    names: dict[str, int] = field(default_factory=dict[str, int])

    def add(self, messages: MessageBlock) -> None:
        """Add the transforms in a block of the log."""
        for topic in self.topics:
            rows, _ = transforms(messages.of(topic), topic, self.names)
            called = list(self.names)
            for parent, child, which in rows.edges():
                seen = self.edges.setdefault((called[parent], called[child]), SeenEdge())
                seen.add(rows.values[which], rows.stamp[which], static=_static(topic))

    def tree(self, offset: float = 0.0, max_gap: float = 0.25) -> FrameTree:
        """Return the tree with constant poses, and with an empty `PoseTrack` for each edge on /tf.

        Its tracks have `offset` [s], and `max_gap` [s] if they move, else any gap.
        """
        made = FrameTree()
        for (parent, child), seen in self.edges.items():
            if seen.holds and seen.constant is not None:
                made.add(parent, child, Pose.from_quaternion(seen.constant[3:], seen.constant[:3]))
            elif seen.first is not None:
                made.add(parent, child, PoseTrack(offset, max_gap if seen.moves else np.inf))
        return made

    def moving(self, frames: Sequence[str]) -> list[tuple[str, str]]:
        """Return the edges (parent, child) between neighbours in `frames` that move."""
        pairs = {frozenset(pair) for pair in pairwise(frames)}
        return [edge for edge, seen in self.edges.items() if seen.moves and frozenset(edge) in pairs]


def tree_topics(topics: Sequence[Topic]) -> list[Topic]:
    """Return those topics that hold transforms and can be read."""
    return [topic for topic in topics if topic.kind in TREES and topic.encoding in ("cdr", "ros1")]


def _static(topic: Topic) -> bool:
    return topic.name.endswith("tf_static")


def read_frames(source: MessageFile, topics: Sequence[Topic]) -> TransformTree:
    """Return the tree of the topics of transforms in the complete file.

    Raises:
        InputError: the file cannot be read.
    """
    found = TransformTree(tuple(topics))
    for messages in source.messages([topic.name for topic in topics]) if topics else ():
        found.add(messages)
    return found


class TreePoses:
    """The pose of frame `sensor` in frame `base` over time, from /tf.

    Args:
        frames: tree of the log.
        base, sensor: frames.
        offset: [s] added to the stamps.
        max_gap: [s] largest gap that is interpolated.
        where: path of the log.

    Raises:
        InputError: there is no such frame, or not one path between the two.
    """

    def __init__(
        self, frames: TransformTree, base: str, sensor: str, offset: float, max_gap: float, where: str
    ) -> None:
        self._frames = frames
        base, sensor = (name.removeprefix("/") for name in (base, sensor))
        try:
            self.track: FramePath = frames.tree(offset, max_gap).path(base, sensor)
        except InputError as problem:
            raise InputError(problem.what, where=where, hint=problem.hint) from problem
        names = pairwise(self.track.frames)
        self._needed: Mapping[tuple[str, str], PoseTrack] = {
            ((second, first) if inverted else (first, second)): edge
            for (first, second), (edge, inverted) in zip(names, self.track.steps, strict=True)
            if isinstance(edge, PoseTrack)
        }
        self.topics = tuple(topic for topic in frames.topics if not _static(topic)) if self._needed else ()
        self.count = self.unread = 0
        self._names = dict[str, int]()

    def add(self, messages: MessageBlock) -> None:
        """Add the transforms in a block of messages to the track."""
        for topic in self.topics:
            own = messages.of(topic)
            rows, sound = transforms(own, topic, self._names)
            self.count += len(sound)
            self.unread += int(np.count_nonzero(~sound))
            called = list(self._names)
            for parent, child, which in rows.edges():
                edge = (called[parent], called[child])
                if (track := self._needed.get(edge)) is not None:
                    stamped = self._frames.edges[edge].stamped
                    time = rows.stamp[which] if stamped else own.time[rows.message[which]]
                    track.add(seconds(time), rows.values[which, 3:], rows.values[which, :3])

    def notes(self) -> tuple[str, ...]:
        """Return notes, one sentence each: the path of frames, contradictory or unreadable transforms."""
        said = [f"the sensor's pose is taken from {' -> '.join(self.track.frames)} in the tree of /tf"]
        if not self._needed:
            said.append("none of these transforms changes: the sensor is assumed not to move")
        for edge in self._frames.edges:
            if edge in self._needed and self._frames.edges[edge].contradicted:
                said.append(f"{edge[0]} -> {edge[1]} is on /tf_static, but changes on /tf, which is used")
        if self.unread:
            said.append(f"{self.unread} of {self.count} messages of transforms are cut short, or are of another type")
        return (*said, *self.track.notes())
