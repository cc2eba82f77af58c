"""A log of topics: wrenches or arrays row by row, each with the pose and acceleration of other topics at its time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.io.logs.decoding import decode, has_header, seconds
from palpate.io.logs.layout import ArrayChannel, Layout
from palpate.io.logs.log import Log, LogContents, Messages, Source, Topic
from palpate.io.logs.samples import NUMBERS, Samples, rows_at_once
from palpate.io.logs.topics import POSE_KINDS, choose, main_channel, sentence
from palpate.sensors.pose_track import PoseTrack
from palpate.sensors.recording import ACCELERATION, ORIENTATION, POSITION, Recording

__all__ = ["TopicLog"]

BLOCK = 1 << 13  # rows, of few numbers each
HELD = 1 << 16  # rows that wait for a pose; a topic that fell silent must not hold the others for ever


class TopicLog(Log):
    """One sample a wrench, or an array, in the order of the file; times are the stamps of the headers."""

    def __init__(self, path: Path, layout: Layout, source: Source) -> None:
        super().__init__(path, source.size)
        self._layout, self._source = layout, source
        self._join: _Join | None = None

    def blocks(self) -> Iterator[Recording]:
        """See `palpate.io.logs.log.Log`."""
        array, chosen = main_channel(self._layout), self._chosen()
        streams = {
            role: _Stream(topic, self._source, array if role == "main" else None) for role, topic in chosen.items()
        }
        self._join = join = _Join(streams, Samples(self._layout, self.path), self._layout)
        for messages in self._source.messages([stream.topic.name for stream in streams.values()]):
            self.position = self._source.position
            yield from join.take(messages)
        self.torn = self._source.torn
        yield from join.finish()
        if not join.rows:
            name = streams["main"].topic.name
            raise InputError(f"topic {name!r} has no messages.", where=str(self.path), hint=sentence(self.torn))

    def poses(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k 7"]]:
        """Stamps [s] as recorded, without the layout's offset, and positions [m] and quaternions of the pose topic."""
        topic = self._chosen().get("pose")
        if topic is None:
            raise InputError("no topic holds poses.", where=str(self.path), hint=POSE_KINDS)
        stream = _Stream(topic, self._source)
        pieces = [stream.read(messages) for messages in self._source.messages([topic.name])]
        times, values = [piece[0] for piece in pieces], [piece[1] for piece in pieces]
        return np.concatenate([np.zeros(0), *times]), np.concatenate([np.zeros((0, 7)), *values])

    def contents(self) -> LogContents:
        """See `palpate.io.logs.log.Log`."""
        return LogContents(self.path, {}, tuple(self._source.topics()), self._source.torn)

    def notes(self) -> tuple[str, ...]:
        """See `palpate.io.logs.log.Log`."""
        return (*self._source.notes(), *(() if self._join is None else self._join.notes()))

    def _chosen(self) -> dict[str, Topic]:
        return choose(self.contents(), self._layout)


class _Stream:
    """The times and numbers of one topic."""

    def __init__(self, topic: Topic, source: Source, array: ArrayChannel | None = None) -> None:
        self.topic, self._array = topic, array
        self._shape = () if array is None else array.shape
        self.count = self.unread = 0
        self._stamped = self._has_stamps(source)

    def read(self, messages: Messages) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n k"]]:
        """Times [s] and numbers; NaN where a message is cut or of another make."""
        messages = messages.of(self.topic)
        stamps, values, sound = decode(messages, self.topic, self._shape)
        self.count += len(sound)
        self.unread += int(np.count_nonzero(~sound))
        if not self._stamped:
            return seconds(messages.time), values
        return np.where(sound, seconds(stamps), np.nan), values

    def notes(self) -> tuple[str, ...]:
        """What was odd."""
        name, unread, array = repr(self.topic.name), self.unread, self._array
        made = f"are not {self.topic.kind}" if array is None else f"do not hold {array.described} numbers"
        said = (
            (unread, f"{unread} of {self.count} messages of {name} are cut short, or {made}"),
            (not self._stamped, f"messages of {name} have no stamps: the times at which they were recorded are taken"),
        )
        return tuple(sentence for there, sentence in said if there)

    def _has_stamps(self, source: Source) -> bool:
        """Whether one of the first two stamps is not 0: a clock may begin there."""
        if not has_header(self.topic.kind):
            return False
        found = np.empty(0, dtype=np.int64)
        with closing(source.messages([self.topic.name])) as pieces:
            for messages in pieces:
                stamps, _, sound = decode(messages.of(self.topic), self.topic, self._shape)
                found = np.concatenate([found, stamps[sound]])
                if len(found) > 1:
                    break
        return bool(found[:2].any()) or not len(found)


class _Join:
    """Rows that wait until poses and accelerations around their time have come."""

    def __init__(self, streams: dict[str, _Stream], samples: Samples, layout: Layout) -> None:
        self._streams, self._samples, self._layout = streams, samples, layout
        array = main_channel(layout)
        self._name, width = ("wrench", 6) if array is None else (array.name, array.size)
        self._block, self._held = rows_at_once(BLOCK, width), rows_at_once(HELD, width, 8 * NUMBERS)
        offsets = {"pose": layout.offset, "acceleration": 0.0}
        self._tracks = {role: PoseTrack(offset, layout.max_gap) for role, offset in offsets.items() if role in streams}
        self._time, self._values = list[np.ndarray](), list[np.ndarray]()  # of rows that wait
        self._fresh = self.rows = self._lost = 0

    def take(self, messages: Messages) -> Iterator[Recording]:
        """Some more messages, and the rows that can now be answered."""
        for role, track in self._tracks.items():
            time, values = self._streams[role].read(messages)
            if role == "pose":
                track.add(time, values[:, 3:], values[:, :3])
            else:  # what runs straight between its readings is a position too
                track.add(time, np.tile([0.0, 0.0, 0.0, 1.0], (len(time), 1)), values)
        time, values = self._streams["main"].read(messages)
        self._time.append(time)
        self._values.append(values)
        self._fresh += len(time)
        if self._fresh >= self._block:
            self._fresh = 0
            yield from self._release(complete=False)

    def finish(self) -> Iterator[Recording]:
        """The rows that are left, once there are no more messages."""
        for track in self._tracks.values():
            track.complete()
        if self._time:
            yield from self._release(complete=True)

    def notes(self) -> tuple[str, ...]:
        """What was odd, one sentence each."""
        said = [note for stream in self._streams.values() for note in stream.notes()]
        if "pose" in self._streams and self._layout.orientation_topic is None:
            name = self._streams["pose"].topic.name
            said.insert(0, f"the orientation is taken from {name!r}, the only topic of poses")
        said += [note for track in self._tracks.values() for note in track.notes()]
        if self._lost:
            said.append(f"{self._lost} samples have no pose: none of their time had come {self._held} rows later")
        return tuple(dict.fromkeys((*said, *self._samples.notes())))

    def _release(self, *, complete: bool) -> Iterator[Recording]:
        time, values = _joined(self._time), _joined(self._values)
        ready = min((track.answerable(time) for track in self._tracks.values()), default=len(time))
        if not complete and len(time) - ready > self._held:
            self._lost += len(time) - self._held - ready
            ready = len(time) - self._held
        waits = ready < len(time)
        self._time, self._values = ([time[ready:]], [values[ready:]]) if waits else ([], [])
        for start in range(0, ready, self._block):
            piece = slice(start, min(start + self._block, ready))
            self.rows += len(time[piece])
            yield self._samples.block(time[piece], {self._name: values[piece], **self._others(time[piece])})
        oldest = float(np.min(time, initial=np.inf, where=np.isfinite(time)))
        for track in self._tracks.values() if np.isfinite(oldest) else ():
            track.forget(oldest)

    def _others(self, time: Float[np.ndarray, " n"]) -> dict[str, Float[np.ndarray, "n _"]]:
        found: dict[str, np.ndarray] = {}
        for role, track in self._tracks.items():
            quaternion, position = track.at(time)
            found |= {ORIENTATION: quaternion, POSITION: position} if role == "pose" else {ACCELERATION: position}
        return found


def _joined(pieces: list[np.ndarray]) -> np.ndarray:
    return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
