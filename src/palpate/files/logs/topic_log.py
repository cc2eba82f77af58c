"""Read a log of topics: wrenches or arrays row by row, with poses and other topics at their times."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.files.logs.composed_poses import ComposedPoses, ImuPoses, imu_topic, linked_frame
from palpate.files.logs.decoding import ARRAYS, decode, decode_array, has_header, seconds, shape_of
from palpate.files.logs.joints import JointPoses, joint_stamps, joint_topic
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.files.logs.log import Log, LogContents, Stored
from palpate.files.logs.message_fields import field_of
from palpate.files.logs.numbering import stated_order
from palpate.files.logs.pose_table import PoseTable, converted
from palpate.files.logs.samples import NUMBERS, WRENCH, SampleReader, rows_at_once
from palpate.files.logs.survey import frame_named
from palpate.files.logs.topics import (
    LIVE_ACCELERATION,
    LIVE_POSE,
    NONE,
    POSE_KINDS,
    choose,
    doubtful,
    main_channel,
    sentence,
)
from palpate.files.logs.transforms import TransformTree, TreePoses, read_frames, tree_topics
from palpate.files.logs.wrench_means import WrenchMeans
from palpate.files.messages import MessageBlock, MessageFile, Topic
from palpate.files.urdf import Kinematics, Urdf
from palpate.signals.recording import ACCELERATION, AVERAGED, ORIENTATION, POSITION, TEMPERATURE, Recording
from palpate.spatial.pose_track import PoseTrack

BESIDE = 7  # numbers behind an array in a live record: the wrench, and of how many readings it is the mean
TEMPERATURE_GAP = 60.0  # s: it changes slowly
HELD = 1 << 16  # rows that wait for a pose; a topic that fell silent must not hold the others for ever


class TopicLog(Log):
    """A log of topics: one sample per wrench or array, in the order of the file, at the stamps of the headers."""

    def __init__(self, path: Path, layout: LogLayout, source: MessageFile) -> None:
        super().__init__(path, source.size)
        self._layout, self._source = layout, source
        self._join: _Join | None = None
        self._main: _Stream | None = None
        self._frames: TransformTree | None = None
        self._unsure = list[str]()  # topics of poses, none of which was named

    def blocks(self) -> Iterator[Recording]:
        """Yield the samples as recordings in SI.

        Raises:
            InputError: the file cannot be read; a topic is missing or empty, or several could be meant; or poses lack
                frames, a URDF or pinocchio.
        """
        join, wanted = self._started()
        for messages in self._pieces(wanted):
            yield from join.take(messages)
        yield from self._ended(join)

    def stored(self) -> Iterator[Stored]:
        """Yield times (n,) [s] and frames (n, k) of taxels, in their stored type where possible.

        Raises:
            InputError: the file cannot be read, or lacks something that the layout requests.
            KeyError: the layout requests no taxels.
        """
        main = self._as_stored()
        if main is None:
            yield from super().stored()
            return
        for messages in self._pieces([main.topic.name]):
            yield main.stored(messages)

    def merged_with(self, frames: Log) -> Iterator[Recording | Stored]:
        """Yield the `blocks` of this log and the `stored` of `frames`, the same file in another layout.

        Items are recordings, or pairs of times (n,) [s] and frames (n, k); they alternate if one pass is possible.

        Raises:
            InputError: the file cannot be read, or lacks something that one of the layouts requests.
        """
        main = frames._as_stored() if isinstance(frames, TopicLog) else None
        if main is None:
            yield from super().merged_with(frames)
            return
        join, wanted = self._started()
        for messages in self._pieces([*wanted, main.topic.name]):
            yield from join.take(messages)
            yield main.stored(messages)
        yield from self._ended(join)

    def _pieces(self, names: Collection[str]) -> Iterator[MessageBlock]:
        for messages in self._source.messages(names):
            self.position = self._source.position
            yield messages
        self.torn = self._source.torn

    def _as_stored(self) -> _Stream | None:
        """Return the stream of the array if its stored numbers need no conversion, else None."""
        array, topic = main_channel(self._layout), self._chosen().get("main")
        if array is None or topic is None or topic.kind not in ARRAYS or array != array.as_recorded():
            return None
        self._main = _Stream(topic, self._source, array)
        return self._main

    def _started(self) -> tuple[_Join, set[str]]:
        """Return a new join, and the names of the topics that it needs."""
        layout, array, chosen = self._layout, main_channel(self._layout), self._chosen()
        if "both" in chosen and array is not None:
            array = replace(array, shape=(array.size + BESIDE,), axes=())
        main = _Stream(chosen.get("both") or chosen["main"], self._source, array)
        poses = self._poses(chosen, layout.offset)
        sources: dict[str, _Source] = {} if poses is None else {"pose": poses}
        if (topic := chosen.get("acceleration")) is not None:
            gap = 0.0 if topic.name.startswith(LIVE_ACCELERATION) else layout.max_gap
            sources["acceleration"] = self._tracked(topic, PoseTrack(0.0, gap))
        if (topic := chosen.get("temperature")) is not None:
            sources["temperature"] = self._tracked(topic, PoseTrack(0.0, TEMPERATURE_GAP))
        table = None if self.pose_log is None else PoseTable(self.pose_log, layout)
        samples = SampleReader(layout if table is None else converted(layout), self.path)
        if (topic := chosen.get("wrench")) is not None:
            limits = None if layout.wrench_range is None else samples.recorded(layout.wrench_range)
            sources["wrench"] = self._tracked(topic, WrenchMeans(layout.max_gap, limits))
        self._join = join = _Join(main, sources, samples, layout, table, (self.block_rows, self.block_bytes))
        return join, {main.topic.name, *(topic.name for source in sources.values() for topic in source.topics)}

    @property
    def posed(self) -> bool:
        """True if this is a live record with the poses that its samples had."""
        return any(topic.name.startswith(LIVE_POSE) and topic.count for topic in self._source.topics())

    def _tracked(self, topic: Topic, track: PoseTrack | WrenchMeans) -> _Tracked:
        return _Tracked(_Stream(topic, self._source), track)

    def _ended(self, join: _Join) -> Iterator[Recording]:
        yield from join.finish()
        if not join.rows:
            what = f"topic {join.main.topic.name!r} has no messages."
            raise InputError(what, where=str(self.path), hint=sentence(self.torn))

    def poses(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k 7"]]:
        """Return stamps (k,) [s] without the layout's offset, and poses (k, 7): position [m], quaternion x, y, z, w.

        From /tf they are taken at the stamps of the most frequent transform.

        Raises:
            InputError: the file cannot be read, no topic holds poses, or they lack frames, a URDF or pinocchio.
        """
        poses = self._poses(self._chosen(), 0.0)
        if poses is None:
            raise InputError("no topic holds poses.", where=str(self.path), hint=POSE_KINDS)
        names = [topic.name for topic in poses.topics]
        pieces = self._source.messages(names) if names else ()
        if isinstance(poses, _Tracked):  # every one, whatever its stamp
            read = [poses.stream.read(messages) for messages in pieces]
            times, values = [piece[0] for piece in read], [piece[1] for piece in read]
            return np.concatenate([np.zeros(0), *times]), np.concatenate([np.zeros((0, 7)), *values])
        for messages in pieces:
            poses.add(messages)
        time = poses.track.stamps
        quaternion, position = poses.track.at(time)
        known = np.isfinite(quaternion).all(axis=1)
        return time[known], np.concatenate([position, quaternion], axis=1)[known]

    def contents(self) -> LogContents:
        """Return the topics of the log, its duration and any damage.

        Raises:
            InputError: the file cannot be read.
        """
        topics = tuple(self._source.topics())
        return LogContents(self.path, {}, topics, self._source.torn, self._source.duration)

    def notes(self) -> tuple[str, ...]:
        """Return notes on the file, its topics and the samples read so far, one sentence each."""
        unsure, said = self._unsure, list(self._source.notes())
        if unsure:
            listed = ", ".join(unsure)
            said.append(f"{len(unsure)} topics hold poses, and none is used: {listed}; name one in [orientation]")
        return (*said, *(note for part in (self._join, self._main) if part is not None for note in part.notes()))

    def _chosen(self) -> dict[str, Topic]:
        there, layout = self.contents(), self._layout
        layout = layout if self.pose_log is None else replace(layout, orientation_topic=NONE)
        self._unsure = doubtful(there, layout)
        return choose(there, layout)

    def _poses(self, chosen: dict[str, Topic], offset: float) -> _Source | None:
        layout, where, track = self._layout, str(self.path), PoseTrack(offset, self._layout.max_gap)
        pose = chosen.get("pose")
        if pose is not None and pose.name.startswith(LIVE_POSE):  # at the readings' own stamps, and nowhere between
            return self._tracked(pose, PoseTrack(0.0, 0.0))
        if layout.frames is None:
            return None if pose is None else self._tracked(pose, track)
        if layout.urdf is not None:
            return self._jointed(Urdf(layout.urdf), track, layout.frames)
        return TreePoses(self._transforms(), *layout.frames, offset, layout.max_gap, where)

    def _jointed(self, urdf: Urdf, track: PoseTrack, frames: tuple[str, str]) -> JointPoses | ComposedPoses:
        """Return the poses of a link that joints move, in a link, or in the frame of an IMU or of /tf above it."""
        layout, where, (base, sensor) = self._layout, str(self.path), frames
        if layout.joints:
            hint = "Write the name of the topic of joint states."
            raise InputError("has topics, but the rig names columns as joints.", where=where, hint=hint)
        link, imu = base, None
        if layout.imu_topic is not None:
            imu = imu_topic(self._source, layout.imu_topic, where)
            named = frame_named(self._source, imu)
            link = named if named in urdf.links else base
        elif base not in urdf.links:
            link = linked_frame(self._transforms(), urdf, base, sensor, where)
        topic = joint_topic(self._source.topics(), layout.joints_topic, where)
        stamped = self._source.has_stamps(topic, lambda messages: joint_stamps(messages, topic))
        joints = JointPoses(topic, Kinematics(urdf, link, sensor), track, stamped=stamped)
        if imu is not None:
            above = ImuPoses(imu, PoseTrack(track.offset, track.max_gap), self._source)
        elif link != base:
            above = TreePoses(self._transforms(), base, link, track.offset, track.max_gap, where)
        else:
            return joints
        return ComposedPoses(above, joints, (base, link, sensor))

    def _transforms(self) -> TransformTree:
        """Return the tree of /tf, read once."""
        if self._frames is None:
            self._frames = read_frames(self._source, tree_topics(self._source.topics()))
        if not self._frames.edges:
            what = f"the log has no transforms (/tf), in which {(self._layout.frames or ('',))[0]!r} is looked for."
            hint = 'Name a topic of poses in [orientation]; of a robot, write gravity = "fixed" if its base is upright.'
            raise InputError(what, where=str(self.path), hint=hint)
        return self._frames


class _Stream:
    """The times and numbers of one topic."""

    def __init__(self, topic: Topic, source: MessageFile, array: ArrayChannel | None = None) -> None:
        self.topic, self._array = topic, array
        self._shape = () if array is None else array.recorded
        self.count = self.unread = 0
        path = None if array is None or topic.kind in ARRAYS or not isinstance(array.columns, str) else array.columns
        self._field = None if path is None or array is None else field_of(topic, path, array.axes)
        self._order = None
        if array is not None and topic.kind in ARRAYS:
            stated = source.first(topic, lambda messages: shape_of(messages, topic)) or ()
            self._order = stated_order(array, stated, topic.name, source.path)
        headed = has_header(topic.kind) if self._field is None else self._field.stamped
        self._stamped = headed and source.has_stamps(topic, self._stamps)

    def read(self, messages: MessageBlock) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n k"]]:
        """Return times (n,) [s] and numbers (n, k); NaN where a message is unreadable."""
        messages = messages.of(self.topic)
        stamps, values, sound = decode(messages, self.topic, self._shape, self._field)
        self.count += len(sound)
        self.unread += int(np.count_nonzero(~sound))
        values = values if self._order is None else values[:, self._order]
        if not self._stamped:
            return seconds(messages.time), values
        return np.where(sound, seconds(stamps), np.nan), values

    def stored(self, messages: MessageBlock) -> tuple[Float[np.ndarray, " n"], np.ndarray]:
        """Return times [s] and stored numbers of the messages that can be read."""
        messages = messages.of(self.topic)
        values, sound = decode_array(messages, self.topic, self._shape)
        self.count += len(sound)
        self.unread += int(np.count_nonzero(~sound))
        values = values if self._order is None else values[:, self._order]
        return seconds(messages.time[sound]), values if sound.all() else values[sound]

    def notes(self) -> tuple[str, ...]:
        name, unread, array = repr(self.topic.name), self.unread, self._array
        made = f"are not {self.topic.kind}" if array is None else f"do not hold {array.described} numbers"
        said = (
            (unread, f"{unread} of {self.count} messages of {name} are cut short, or {made}"),
            (not self._stamped, f"messages of {name} have no stamps: the times at which they were recorded are used"),
        )
        return tuple(sentence for there, sentence in said if there)

    def _stamps(self, messages: MessageBlock) -> Int[np.ndarray, " n"]:
        stamps, _, sound = decode(messages, self.topic, self._shape, self._field)
        return stamps[sound]


class _Tracked:
    """The poses, accelerations, temperatures or wrenches of one topic."""

    def __init__(self, stream: _Stream, track: PoseTrack | WrenchMeans) -> None:
        self.stream, self.track, self.topics = stream, track, (stream.topic,)

    def add(self, messages: MessageBlock) -> None:
        time, values = self.stream.read(messages)
        if isinstance(self.track, WrenchMeans):
            self.track.add(time, values)
        elif values.shape[1] == 7:
            self.track.add(time, values[:, 3:], values[:, :3])
        else:  # as positions, which are interpolated linearly
            three = np.broadcast_to(values, (len(time), 3))
            self.track.add(time, np.tile([0.0, 0.0, 0.0, 1.0], (len(time), 1)), three)

    def notes(self) -> tuple[str, ...]:
        return (*self.stream.notes(), *self.track.notes())


_Source = _Tracked | JointPoses | TreePoses | ComposedPoses


class _Join:
    """A join that delays rows until everything around their time has arrived."""

    def __init__(
        self,
        main: _Stream,
        sources: Mapping[str, _Source],
        samples: SampleReader,
        layout: LogLayout,
        table: PoseTable | None,
        most: tuple[int, float],
    ) -> None:
        self.main, self._sources, self._samples, self._layout, self._table = main, sources, samples, layout, table
        array = main_channel(layout)
        self._name, self._width = ("wrench", 6) if array is None else (array.name, array.size)
        width = self._width
        self._block, self._held = rows_at_once(most[0], width), rows_at_once(HELD, width, 8 * NUMBERS)
        self._stretch, self._passed = most[1], 0  # bytes
        self._time, self._values = list[np.ndarray](), list[np.ndarray]()  # of rows that wait
        self._fresh = self.rows = self._lost = 0

    def take(self, messages: MessageBlock) -> Iterator[Recording]:
        """Add a block of messages, and yield the rows that are complete."""
        for source in self._sources.values():
            source.add(messages)
        time, values = self.main.read(messages)
        self._time.append(time)
        self._values.append(values)
        self._fresh += len(time)
        self._passed += len(messages.data)
        full = self._fresh >= self._block
        if self._passed >= self._stretch:
            full, self._passed = True, 0
        if full and self._fresh:
            self._fresh = 0
            yield from self._release(complete=False)

    def finish(self) -> Iterator[Recording]:
        for source in self._sources.values():
            source.track.complete()
        if self._time:
            yield from self._release(complete=True)
        if self._table is not None:
            self._table.require_overlap()
        yield from self._samples.rest()

    def notes(self) -> tuple[str, ...]:
        said = [note for source in (self.main, *self._sources.values()) for note in source.notes()]
        pose = self._sources.get("pose")
        if isinstance(pose, _Tracked) and self._layout.orientation_topic is None:
            said.insert(0, f"the orientation is taken from {pose.stream.topic.name!r}, the only topic of poses")
        if self._table is not None:
            said[:0] = [f"the orientation is taken from {self._table.described}", *self._table.notes()]
        if self._lost:
            said.append(f"{self._lost} samples have no pose: none for their time had arrived {self._held} rows later")
        return tuple(dict.fromkeys((*said, *self._samples.notes())))

    def _release(self, *, complete: bool) -> Iterator[Recording]:
        time, values = np.concatenate(self._time), np.concatenate(self._values)
        ready = min((source.track.answerable(time) for source in self._sources.values()), default=len(time))
        if not complete and len(time) - ready > self._held:
            self._lost += len(time) - self._held - ready
            ready = len(time) - self._held
        waits = ready < len(time)
        self._time, self._values = ([time[ready:]], [values[ready:]]) if waits else ([], [])
        for start in range(0, ready, self._block):
            piece = slice(start, min(start + self._block, ready))
            self.rows += len(time[piece])
            yield from self._samples.blocks(time[piece], {**self._rows(values[piece]), **self._others(time[piece])})
        oldest = float(np.min(time, initial=np.inf, where=np.isfinite(time)))
        for source in self._sources.values() if np.isfinite(oldest) else ():
            source.track.forget(oldest)

    def _rows(self, values: Float[np.ndarray, "n k"]) -> dict[str, np.ndarray]:
        if values.shape[1] != self._width + BESIDE:
            return {self._name: values}
        ends = (self._width, self._width + 6)
        return dict(zip((self._name, WRENCH, AVERAGED), np.split(values, ends, axis=1), strict=True))

    def _others(self, time: Float[np.ndarray, " n"]) -> dict[str, Float[np.ndarray, "n _"]]:
        found = {} if self._table is None else dict(self._table.at(time))
        for role, source in self._sources.items():
            if isinstance(source.track, WrenchMeans):
                found[WRENCH], found[AVERAGED] = source.track.means(time)
                continue
            quaternion, position = source.track.at(time)
            if role == "pose":
                found |= {ORIENTATION: quaternion, POSITION: position}
            else:
                found |= {ACCELERATION: position} if role == "acceleration" else {TEMPERATURE: position[:, :1].copy()}
        return found
