"""Compute live poses of the sensor from messages of a topic of poses, or of the tree of /tf."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.files.logs.decoding import decode, seconds
from palpate.files.logs.transforms import TREES, transforms
from palpate.files.messages import MessageBlock, Topic
from palpate.live.source import SILENT, Batch, drained
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.frames import FramePath, FrameTree
from palpate.spatial.live_track import LiveTrack
from palpate.spatial.pose import Pose
from palpate.spatial.pose_track import sound_quaternions

_KEPT = 2.0  # s of poses kept beyond max_gap, because samples may be late too


@takes_arrays
class Posed(NamedTuple):
    """Poses of the sensor in the base at times of samples.

    Attributes:
        quaternion: (n, 4) x, y, z, w; NaN if the pose is not known.
        position: (n, 3) [m].
        age: (n,) [s] age of the latest pose before the sample; 0 between two poses.
        turned: (n,) [rad] rms error of the orientation because of its age, see `LiveTrack`.
    """

    quaternion: Float[np.ndarray, "n 4"]
    position: Float[np.ndarray, "n 3"]
    age: Float[np.ndarray, " n"]
    turned: Float[np.ndarray, " n"]

    def into(self, batch: Batch) -> None:
        """Write the poses to the first n samples of a batch, with unknown `turned` of 0."""
        count = len(self.age)
        batch.orientation[:count], batch.position[:count] = self.quaternion, self.position
        batch.turned[:count] = np.nan_to_num(self.turned)


class LivePoses:
    """Poses of the sensor, which grow with each message.

    Transforms of /tf are composed edge by edge: each is interpolated in time, or extrapolated as by `LiveTrack`; those
    of /tf_static are constant. The age is that of the oldest edge; the squared errors of the angles are added.

    Args:
        frames: base and sensor in the tree of /tf; None: messages are poses of the sensor in the base.
        offset: [s] added to the stamps of the poses, to put them on the samples' clock.
        max_gap: [s] largest age of a pose, and largest gap between poses, at which it is used.
        called: name of the tree in events.
    """

    def __init__(
        self,
        frames: tuple[str, str] | None = None,
        offset: float = 0.0,
        max_gap: float = 0.25,
        called: str = "the tree of /tf",
    ) -> None:
        self._frames = None if frames is None else (frames[0].removeprefix("/"), frames[1].removeprefix("/"))
        self._offset, self._max_gap, self._called = offset, max_gap, called
        self._origin: int | None = None  # ns: doubles of seconds since then are good to 1e-12 s, since 1970 to 2e-7 s
        self._track = LiveTrack(offset, max_gap)  # of a topic of poses
        self._edges: dict[tuple[str, str], LiveTrack] = {}
        self._tree = FrameTree()
        self._path = None if frames else FramePath(("base", "sensor"), ((self._track, False),))
        self._needed = frozenset[str]()
        self._names: dict[str, int] = {}
        self._problem = ""
        self._unread = 0
        self._silent: float | None = None  # since when samples have had no pose
        self._told: set[str] = set()
        self._pending: list[str] = []

    def add(self, messages: MessageBlock) -> None:
        """Add messages of one topic, poses or transforms; the time of sending replaces a stamp of 0.

        Messages that cannot be read are ignored and reported.
        """
        if not len(messages.time):
            return
        topic = next(iter(messages.topics.values()))
        if topic.kind in TREES:
            self._add_transforms(messages, topic)
        else:
            stamps, values, sound = decode(messages, topic)
            self._unread += int(np.count_nonzero(~sound))
            stamps, values = np.where(stamps == 0, messages.time, stamps)[sound], values[sound]
            self._grow(self._track, stamps, values)

    @takes_arrays
    def grow(
        self, edge: tuple[str, str], stamps: Int[np.ndarray, " k"], values: Float[np.ndarray, "k 7"], unread: int = 0
    ) -> None:
        """Add poses of one frame in another to the tree.

        Args:
            edge: names of the two, parent and child.
            stamps: (k,) [ns].
            values: (k, 7) position [m], then quaternion x, y, z, w.
            unread: number of messages that could not be read.

        Raises:
            InputError: arrays of other shapes.
        """
        self._unread += unread
        if edge not in self._edges:
            self._edges[edge] = LiveTrack(self._offset, self._max_gap)
            self._tree.add(*edge, self._edges[edge])
            self._path = None
        self._grow(self._edges[edge], stamps, values)

    def note(self, sentence: str) -> None:
        """Report a sentence once, as an event."""
        self._once(sentence, sentence)

    @takes_arrays
    def at(self, stamp: Int[np.ndarray, " n"]) -> Posed:
        """Return the sensor's poses at times (n,) [ns] of samples; NaN where they are not known.

        Raises:
            InputError: stamp has another shape.
        """
        if (path := self._way()) is None:
            nothing = np.full((len(stamp), 9), np.nan)
            self._watch(found=False)
            return Posed(nothing[:, :4], nothing[:, 4:7], nothing[:, 7], nothing[:, 8])
        asked = seconds(stamp - (self._origin or 0))
        quaternion, position = path.at(asked)
        age, square = np.zeros((2, len(stamp)))
        for track in (each for each in path.tracks if isinstance(each, LiveTrack)):
            older, turned = track.lag(asked)
            age = np.maximum(age, older)
            square += turned**2
        turned = np.where(np.isnan(quaternion[:, 0]), np.nan, np.sqrt(square))
        self._watch(found=not len(stamp) or not np.isnan(quaternion[-1, 0]), age=float(age[-1]) if len(stamp) else 0.0)
        return Posed(quaternion, position, age, turned)

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each: no poses, unreadable messages, a clock set back."""
        if self._silent is not None and time.monotonic() - self._silent > SILENT:
            self._once("silent", self._problem or "there are no poses yet: the sensor's orientation is not known")
        if self._unread:
            self._once("unread", "some messages of poses are incomplete or of another type, and are ignored")
        edges = {f" of {child!r} in {parent!r}": track for (parent, child), track in self._edges.items()}
        for name, track in {"": self._track, **edges}.items():
            if track.restarts:
                again = f"the clock of the poses{name} went back; earlier poses are discarded"
                self._once(f"{name} {track.restarts}", again)
        return drained(self._pending)

    def _once(self, key: str, sentence: str) -> None:
        if key not in self._told:
            self._told.add(key)
            self._pending.append(sentence)

    def _grow(self, track: LiveTrack, stamps: Int[np.ndarray, " k"], values: Float[np.ndarray, "k 7"]) -> None:
        if self._origin is None and len(stamps):
            self._origin = int(stamps[0])
        track.add(seconds(stamps - (self._origin or 0)), values[:, 3:], values[:, :3])
        track.forget(track.newest - (self._max_gap + _KEPT))

    def _add_transforms(self, messages: MessageBlock, topic: Topic) -> None:
        rows, sound = transforms(messages, topic, self._names)
        self._unread += int(np.count_nonzero(~sound))
        called = list(self._names)
        for parent, child, which in rows.edges():
            edge = (called[parent], called[child])
            if topic.name.endswith("tf_static"):
                self._hold(edge, rows.values[which])
                continue
            if edge in self._edges and self._path is not None and not self._needed.issuperset(edge):
                continue  # the rest of a robot, which may be large
            stamps = rows.stamp[which]
            stamps = np.where(stamps == 0, messages.time[rows.message[which]], stamps)
            self.grow(edge, stamps, rows.values[which])

    def _hold(self, edge: tuple[str, str], values: Float[np.ndarray, "k 7"]) -> None:
        """Set an edge to the last valid transform of /tf_static, unless /tf has the edge too."""
        sound = values[sound_quaternions(values[:, 3:]) & np.isfinite(values).all(axis=1)]
        if len(sound) and edge not in self._edges:
            self._tree.add(*edge, Pose.from_quaternion(sound[-1, 3:], sound[-1, :3]))
            self._path = None

    def _way(self) -> FramePath | None:
        """Return the path from base to sensor in the tree; None if nothing connects them yet."""
        if self._path is None and self._frames is not None and self._tree.frames:
            try:
                self._path = self._tree.path(*self._frames)
            except InputError as problem:
                self._problem = f"{problem.what} {problem.hint} The sensor's orientation is not known"
                return None
            self._needed = frozenset(self._path.frames)  # of a tree: two of them that are joined are neighbours
            way = " -> ".join(self._path.frames)
            self._once(way, f"the sensor's pose is taken from {way} in {self._called}")
        return self._path

    def _watch(self, *, found: bool, age: float = 0.0) -> None:
        """Note since when samples have no poses, and report when they have some again."""
        if found:
            if self._silent is not None and "silent" in self._told:
                self._pending.append("samples have poses again")
            self._told.discard("silent")
            self._silent = None
            return
        if np.isfinite(age) and age > 0:
            late = f"the newest pose is {age:.3g} s older than the samples"
            self._problem = f"{late}: the sensor's orientation is not known"
        if self._silent is None:
            self._silent = time.monotonic()
