"""A log of topics: wrenches row by row, each with the pose and acceleration that other topics have at its time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.io.layout import Layout
from palpate.io.messages import KINDS, Messages, Source, Topic, decode, seconds
from palpate.io.samples import Samples
from palpate.io.units import near
from palpate.sensors.pose_track import PoseTrack
from palpate.sensors.recording import ACCELERATION, ORIENTATION, POSITION, Recording

__all__ = ["TopicLog"]

BLOCK = 1 << 14  # rows
HELD = 1 << 16  # rows that wait for a pose; a topic that fell silent must not hold the others for ever
ENCODINGS = ("cdr", "ros1")
_SHOWN = 12  # topics in a sentence


class TopicLog:
    """One sample a wrench, in the order of the file; times are the stamps of the headers."""

    def __init__(self, path: Path, layout: Layout, source: Source) -> None:
        self.path, self._layout, self._source = path, layout, source
        self._join: _Join | None = None

    @property
    def size(self) -> int:
        """See `palpate.io.log.Log`."""
        return self._source.size

    @property
    def position(self) -> int:
        """See `palpate.io.log.Log`."""
        return self._source.position

    @property
    def torn(self) -> str:
        """See `palpate.io.log.Log`."""
        return self._source.torn

    def blocks(self) -> Iterator[Recording]:
        """See `palpate.io.log.Log`."""
        streams = _streams(self._source, self._layout, self.path)
        self._join = join = _Join(streams, Samples(self._layout, self.path), self._layout)
        for messages in self._source.messages([stream.topic.name for stream in streams.values()]):
            yield from join.take(messages)
        yield from join.finish()
        if not join.rows:
            name = streams["wrench"].topic.name
            raise InputError(f"topic {name!r} has no messages.", where=str(self.path), mend=_said(self.torn))

    def poses(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k 7"]]:
        """Stamps [s] as recorded, without the layout's offset, and positions [m] and quaternions of the pose topic."""
        stream = _streams(self._source, self._layout, self.path).get("pose")
        if stream is None:
            raise InputError("no topic holds poses.", where=str(self.path), mend=_READ["pose"])
        pieces = [stream.read(messages) for messages in self._source.messages([stream.topic.name])]
        times, values = [piece[0] for piece in pieces], [piece[1] for piece in pieces]
        return np.concatenate([np.zeros(0), *times]), np.concatenate([np.zeros((0, 7)), *values])

    def notes(self) -> tuple[str, ...]:
        """See `palpate.io.log.Log`."""
        return (*self._source.notes(), *(() if self._join is None else self._join.notes()))


class _Stream:
    """The times and numbers of one topic."""

    def __init__(self, topic: Topic, source: Source, remark: str = "") -> None:
        self.topic, self._kind, self._remark = topic, KINDS[topic.kind], remark
        self.count = self.unread = 0
        self._stamped = self._has_stamps(source)

    def read(self, messages: Messages) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n k"]]:
        """Times [s] and numbers; NaN where a message is cut or of another make."""
        messages = messages.of(self.topic)
        stamps, values, sound = decode(messages, self._kind, self.topic.encoding)
        time = np.where(sound, seconds(stamps if self._stamped else messages.time), np.nan)
        self.count += len(sound)
        self.unread += int(np.count_nonzero(~sound))
        return time, values

    def notes(self) -> tuple[str, ...]:
        """What was odd."""
        name, unread = repr(self.topic.name), self.unread
        said = (
            (self._remark, self._remark),
            (unread, f"{unread} of {self.count} messages of {name} are cut short, or not {self.topic.kind}"),
            (not self._stamped, f"messages of {name} have no stamps: the times at which they were recorded are taken"),
        )
        return tuple(sentence for there, sentence in said if there)

    def _has_stamps(self, source: Source) -> bool:
        """Whether one of the first two stamps is not 0: a clock may begin there."""
        if not self._kind.strings:
            return False
        found = np.empty(0, dtype=np.int64)
        with closing(source.messages([self.topic.name])) as pieces:
            for messages in pieces:
                stamps, _, sound = decode(messages.of(self.topic), self._kind, self.topic.encoding)
                found = np.concatenate([found, stamps[sound]])
                if len(found) > 1:
                    break
        return bool(found[:2].any()) or not len(found)


class _Join:
    """Rows of wrenches that wait until poses and accelerations around their time have come."""

    def __init__(self, streams: dict[str, _Stream], samples: Samples, layout: Layout) -> None:
        self._streams, self._samples = streams, samples
        offsets = {"pose": layout.offset, "acceleration": 0.0}
        self._tracks = {role: PoseTrack(offsets[role], layout.max_gap) for role in streams if role != "wrench"}
        self._waiting: list[np.ndarray] = []  # time and wrench
        self._fresh = self.rows = self._lost = 0

    def take(self, messages: Messages) -> Iterator[Recording]:
        """Some more messages, and the rows that can now be answered."""
        for role, track in self._tracks.items():
            time, values = self._streams[role].read(messages)
            if role == "pose":
                track.add(time, values[:, 3:], values[:, :3])
            else:  # what runs straight between its readings is a position too
                track.add(time, np.tile([0.0, 0.0, 0.0, 1.0], (len(time), 1)), values)
        time, wrench = self._streams["wrench"].read(messages)
        self._waiting.append(np.column_stack([time, wrench]))
        self._fresh += len(time)
        if self._fresh >= BLOCK:
            self._fresh = 0
            yield from self._release(complete=False)

    def finish(self) -> Iterator[Recording]:
        """The rows that are left, once there are no more messages."""
        for track in self._tracks.values():
            track.complete()
        if self._waiting:
            yield from self._release(complete=True)

    def notes(self) -> tuple[str, ...]:
        """What was odd, one sentence each."""
        said = [note for stream in self._streams.values() for note in stream.notes()]
        said += [note for track in self._tracks.values() for note in track.notes()]
        if self._lost:
            said.append(f"{self._lost} wrenches have no pose: none of their time had come {HELD} rows later")
        return tuple(dict.fromkeys((*said, *self._samples.notes())))

    def _release(self, *, complete: bool) -> Iterator[Recording]:
        rows = np.concatenate(self._waiting)
        time = rows[:, 0]
        ready = min((track.answerable(time) for track in self._tracks.values()), default=len(rows))
        if not complete and len(rows) - ready > HELD:
            self._lost += len(rows) - HELD - ready
            ready = len(rows) - HELD
        self._waiting = [rows[ready:]]
        if ready:
            self.rows += ready
            yield self._samples.block(time[:ready], rows[:ready, 1:], self._others(time[:ready]))
        oldest = float(np.min(time, initial=np.inf, where=np.isfinite(time)))
        for track in self._tracks.values() if np.isfinite(oldest) else ():
            track.forget(oldest)

    def _others(self, time: Float[np.ndarray, " n"]) -> dict[str, Float[np.ndarray, "n _"]]:
        found: dict[str, np.ndarray] = {}
        for role, track in self._tracks.items():
            quaternion, position = track.at(time)
            found |= {ORIENTATION: quaternion, POSITION: position} if role == "pose" else {ACCELERATION: position}
        return found


def _streams(source: Source, layout: Layout, path: Path) -> dict[str, _Stream]:
    """Role -> topic."""
    topics = source.topics()
    wrench = _named(topics, "wrench", layout.wrench_topic, path) or _only(topics, "wrench", path)
    if wrench is None:
        listed = ", ".join(f"{t.name} ({t.kind or 'of no type'}, {t.count:,})" for t in topics[:_SHOWN])
        raise InputError(
            f"no topic holds wrenches; {f'there is {listed}' if listed else 'there is no topic at all'}.",
            where=str(path),
            mend=_said(source.torn) or _READ["wrench"],
        )
    pose = _named(topics, "pose", layout.orientation_topic, path)
    guessed = None if pose else _only(topics, "pose", path)
    acceleration = _named(topics, "acceleration", layout.acceleration_topic, path)  # an accelerometer may sit anywhere
    remark = f"the orientation is taken from {guessed.name!r}, the only topic of poses" if guessed else ""
    chosen = {"wrench": wrench, "pose": pose or guessed, "acceleration": acceleration}
    return {role: _Stream(topic, source, remark if role == "pose" else "") for role, topic in chosen.items() if topic}


def _said(torn: str) -> str:
    """As a sentence of its own."""
    return torn and f"{torn[0].upper()}{torn[1:]}."


def _named(topics: Sequence[Topic], role: str, name: str | None, path: Path) -> Topic | None:
    """The topic that the rig names."""
    if name is None:
        return None
    found = [topic for topic in topics if topic.name == name]
    if not found:
        raise InputError(f"there is no topic {name!r}.", where=str(path), mend=near(name, (t.name for t in topics)))
    fitting = [topic for topic in found if _fits(topic, role)]
    if not fitting:
        raise InputError(
            f"topic {name!r} holds {found[0].kind or 'messages of no type'} ({found[0].encoding or 'no encoding'}).",
            where=str(path),
            mend=_READ[role],
        )
    return fitting[0]


def _only(topics: Sequence[Topic], role: str, path: Path) -> Topic | None:
    """The only topic with messages of a fitting type."""
    fitting = [topic for topic in topics if _fits(topic, role) and topic.count]
    if len(fitting) > 1:
        raise InputError(
            f"{len(fitting)} topics hold a {role}: {', '.join(topic.name for topic in fitting)}.",
            where=str(path),
            mend=f"Name one in the rig, as topic in [{_TABLES[role]}].",
        )
    return fitting[0] if fitting else None


def _fits(topic: Topic, role: str) -> bool:
    return topic.kind in KINDS and KINDS[topic.kind].role == role and topic.encoding in ENCODINGS


def _kinds(role: str) -> str:
    return ", ".join(name.split("/")[1] for name, kind in KINDS.items() if kind.role == role)


_TABLES = {"wrench": "force_torque", "pose": "orientation", "acceleration": "acceleration"}
_READ = {
    "wrench": f"Wrenches are read from {_kinds('wrench')}.",
    "pose": f"Poses are read from {_kinds('pose')}; not from the tree of /tf, so record the sensor's pose on a topic.",
    "acceleration": f"Accelerations are read from {_kinds('acceleration')}.",
}
