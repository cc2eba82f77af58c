"""Read live samples, and the sensor's pose, from topics of ROS 2."""

from __future__ import annotations

import time
from dataclasses import replace
from math import prod
from pathlib import Path

import numpy as np
from jaxtyping import Int
from numpy.typing import DTypeLike

from palpate.errors import InputError
from palpate.files.logs.decoding import ARRAYS, decode, has_header, shape_of
from palpate.files.logs.image_messages import image_messages
from palpate.files.logs.layout import ImageChannel, LogLayout
from palpate.files.logs.log import LogContents
from palpate.files.logs.numbering import stated_order
from palpate.files.logs.topics import NONE, choose, choose_images, main_channel
from palpate.files.messages import MessageBlock, Topic
from palpate.live.dds import DEPTH, DdsNode, DdsReader, ros_name
from palpate.live.ros_poses import RosPoses, published, wanted
from palpate.live.source import SILENT, Batch, drained
from palpate.opencv import opencv
from palpate.setup.setup import Setup
from palpate.setup.source import RigSource

_OWN = "/palpate/"  # topics of Palpate's own, never taken for a sensor's
_MEMORY = 2**26  # bytes of messages that wait, at most
_IMAGES = 16  # that wait, at most
_JUMP = 2.0  # s
_WRENCH = "geometry_msgs/WrenchStamped"
_PLAIN = 0x100  # the bytes 0 and 1: CDR, little-endian


class RosTopics:
    """A topic of ROS 2 as a `Source`: wrenches, arrays or images, as the rig's sensor reads them.

    Times are the stamps of the headers; without them, or with stamps of 0, the times of sending.

    Args:
        layout: layout of a log of the same rig, which may name the topic.
        node: node in the domain, which is opened and closed with the source.
        poses: reader of the sensor's poses; None: the rig names none.
        patience: [s] to wait for topics to be announced, and for the first image.

    Attributes:
        topic: the topic that is read, once open.

    Raises:
        InputError: the sensor reads several arrays.
    """

    def __init__(self, layout: LogLayout, node: DdsNode, poses: RosPoses | None = None, patience: float = 3.0) -> None:
        self._layout, self._node, self._poses, self._patience = layout, node, poses, patience
        self._array = None if layout.images is not None else main_channel(layout)
        self.shape: tuple[int, ...] = () if layout.images else (6,) if self._array is None else self._array.shape
        self.dtype: DTypeLike = np.uint8 if layout.images else np.float64
        self.poses = poses is not None
        self.topic = Topic("", "", "cdr")
        self._reader: DdsReader | None = None
        self._said: list[str] = []
        self._stamped: bool | None = None  # whether headers have stamps; None: not known yet
        self._held: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # a first message whose stamp is 0
        self._missed = 0
        self._unread = False
        self._alike: _Alike | None = None
        self._order: list[int] | None = None  # of the numbers, as the layout of the first array states it
        self._ordered = False  # once it is known
        self._last: tuple[int, int] | None = None  # stamp of the newest sample, and when [ns] it came
        self._heard, self._quiet = 0.0, False

    @classmethod
    def of(cls, stated: RigSource, setup: Setup) -> RosTopics:
        """Return the `RosTopics` of a rig's sensor, in the domain that its [source] names, not opened yet.

        Raises:
            InputError: the rig takes joints from columns of a table, or the sensor reads several arrays.
        """
        node = DdsNode(stated.domain, stated.interface)
        own = wanted(setup.orientation)
        poses = RosPoses(setup.orientation, node, folder=setup.link.folder) if own else None
        return cls(setup.layout(), node, poses)

    def open(self) -> None:
        """Join the domain, find the topic and begin to listen.

        Raises:
            InputError: cyclonedds or, for images, OpenCV is not installed, the domain cannot be joined, nobody
                publishes the topic, it has another type, several topics fit, or no image came.
        """
        if said := self._node.open():
            self._said.append(said)
        try:
            self._begin()
        except InputError:
            self.close()
            raise
        self._heard = time.monotonic()

    def receive(self, batch: Batch, timeout: float) -> int:
        """Fill a batch with waiting samples and the sensor's poses; return how many samples came.

        Wait up to `timeout` [s] for the first.
        """
        if self._reader is None or not self._reader.wait(timeout):
            self._listen()
            return 0
        held = 0 if self._held is None else len(self._held[0])
        messages = self._reader.take(len(batch) - held)
        stamp, values = self._timed(*self._decoded(messages))
        count = len(stamp)
        self._missed += self._reader.lost()
        if not count:
            return 0
        self._hear()
        batch.stamp[:count], batch.values[:count], batch.lost[:count] = stamp, values, 0
        batch.arrive(count, time.time_ns())
        batch.lost[0], self._missed = self._missed, 0
        if self._poses is not None:
            self._poses.at(stamp).into(batch)
        if count < len(batch) and (jumped := self._jumped(int(stamp[-1]))):
            self._said.append(f"the stamps of {self.topic.name!r} jumped by {jumped:+.3g} s")
        return count

    def events(self) -> list[str]:
        """Return the events of topic and poses since the last call, one sentence each."""
        said = drained(self._said)
        return said if self._poses is None else [*said, *self._poses.events()]

    def close(self) -> None:
        """Leave the domain; may be called again."""
        if self._poses is not None:
            self._poses.close()
        self._reader = None
        self._node.close()

    def _begin(self) -> None:
        self.topic = self._chosen()
        if self.topic.count > 1:
            self._said.append(f"{self.topic.count} nodes publish {self.topic.name!r}: their samples are mixed")
        depth = min(DEPTH, max(_IMAGES, _MEMORY // (8 * prod(self.shape)))) if self.shape else _IMAGES
        self._reader = self._node.reader(self.topic.name, self.topic.kind, depth=depth)
        self._stamped = None if self._layout.images or has_header(self.topic.kind) else False
        if self._stamped is False:
            self._say_unstamped()
        if self._poses is not None:
            self._poses.open()
        if self._layout.images is not None:
            self._first_image(self._reader)

    def _chosen(self) -> Topic:
        channel = self._layout.images or self._array
        named = self._layout.wrench_topic if channel is None else channel.topic
        there = self._node.settled(self._patience, [] if named is None else [ros_name(named)])
        if named is not None:
            named = ros_name(named)
            there = [published(named, there, self._node.where)]
        else:
            there = [topic for topic in there if not topic.name.startswith(_OWN)]
        contents = LogContents(Path(self._node.where), {}, tuple(there))
        if self._layout.images is not None:
            return choose_images(contents, ImageChannel(named, self._layout.images.table))
        alone = replace(
            self._layout,
            wrench_topic=named,
            arrays=tuple(replace(array, topic=named) for array in self._layout.arrays),
            orientation_topic=NONE,
            frames=None,
            acceleration_topic=None,
        )
        return choose(contents, alone)["main"]

    def _first_image(self, reader: DdsReader) -> None:
        """Wait for the first image, which gives the size of all, or raise InputError."""
        deadline = time.monotonic() + self._patience
        cv2 = opencv()
        while (left := deadline - time.monotonic()) > 0:
            if reader.wait(left):
                for message in image_messages(reader.take(1), self.topic):
                    if (image := message.image(cv2)) is not None:
                        self.shape = image.shape
                        return
        what = f"no readable image came on {self.topic.name!r} within {self._patience:g} s."
        hint = "Check that the camera is running: the size of its images is needed to begin."
        raise InputError(what, where=self._node.where, hint=hint)

    def _decoded(self, messages: MessageBlock) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (stamps of headers [ns], times of sending [ns], values) of readable messages."""
        if self._layout.images is not None:
            stamps, values, sound = self._images(messages)
        elif self._alike is not None and (quick := self._alike.read(messages)) is not None:
            return quick[0], messages.time, quick[1]
        else:
            stamps, values, sound = decode(messages, self.topic, self.shape)
            values = self._in_order(messages, values).reshape(-1, *self.shape)
            if sound.any() and self.topic.kind == _WRENCH:
                self._alike = _Alike(messages.data[int(messages.start[sound][0]) :])
        if not sound.all():
            self._missed += int(np.count_nonzero(~sound))
            if not self._unread:
                self._unread = True
                made = " x ".join(map(str, self.shape))
                self._said.append(f"messages of {self.topic.name!r} that do not contain {made} numbers are ignored")
            return stamps[sound], messages.time[sound], values[sound]
        return stamps, messages.time, values

    def _in_order(self, messages: MessageBlock, values: np.ndarray) -> np.ndarray:
        """Return the numbers of arrays in the order of the channel; the first array states their order."""
        if self._array is not None and self.topic.kind in ARRAYS and not self._ordered and len(values):
            stated, self._ordered = shape_of(messages, self.topic) or (), True
            self._order = stated_order(self._array, stated, self.topic.name, Path(self._node.where))
        return values if self._order is None else values[:, self._order]

    def _images(self, messages: MessageBlock) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        count = len(messages.time)
        values, stamps = np.zeros((count, *self.shape), dtype=np.uint8), np.zeros(count, dtype=np.int64)
        sound = np.zeros(count, dtype=bool)
        for k, message in enumerate(image_messages(messages, self.topic)):
            image = message.image(opencv())
            if image is not None and image.shape == self.shape:
                values[k], stamps[k], sound[k] = image, message.stamp or 0, True
        return stamps, values, sound

    def _timed(
        self, stamp: Int[np.ndarray, " n"], sent: Int[np.ndarray, " n"], values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (times [ns], values); a first stamp of 0 waits for the next one."""
        if self._stamped is None:
            if self._held is not None:
                both = zip(self._held, (stamp, sent, values), strict=True)
                stamp, sent, values = (np.concatenate(pair) for pair in both)
            if len(stamp) < 2 and not stamp.any():
                self._held = (stamp, sent, values) if len(stamp) else self._held
                return stamp[:0], values[:0]
            self._held = None
            self._stamped = bool(stamp.any())
            if not self._stamped:
                self._say_unstamped()
        return (stamp if self._stamped else sent), values

    def _say_unstamped(self) -> None:
        self._said.append(f"messages of {self.topic.name!r} have no stamps: the times at which they were sent are used")

    def _listen(self) -> None:
        if self._reader is not None and not self._quiet and time.monotonic() - self._heard > SILENT:
            self._quiet = True
            who = self._reader.publishers
            end = f"{who} publish it" if who > 1 else "one node publishes it" if who else "nobody publishes it now"
            self._said.append(f"no message on {self.topic.name!r} for {SILENT:g} s; {end}")

    def _hear(self) -> None:
        now = time.monotonic()
        if self._quiet:
            self._quiet = False
            self._said.append(f"messages on {self.topic.name!r} again, after {now - self._heard:.1f} s")
        self._heard = now

    def _jumped(self, stamp: int) -> float:
        """Return the jump [s] of the stamps against this machine's clock; 0.0 if it is small."""
        now = time.monotonic_ns()
        before, then = self._last or (stamp, now)
        self._last = stamp, now
        jump = (stamp - before - (now - then)) / 1e9
        return jump if abs(jump) > _JUMP else 0.0


class _Alike:
    """A quick decoder of wrenches that differ from a first message in stamp and numbers only."""

    def __init__(self, message: bytes) -> None:
        self._named = int.from_bytes(message[12:16], "little")
        frame = f"V{self._named + -(12 + self._named) % 8}"  # its name, and the gap before the numbers
        head = [("form", "<u2"), ("options", "<u2"), ("sec", "<i4"), ("nanosec", "<u4"), ("named", "<u4")]
        self._layout = np.dtype([*head, ("frame", frame), ("values", "<f8", 6)])

    def read(self, messages: MessageBlock) -> tuple[np.ndarray, np.ndarray] | None:
        """Return stamps (n,) [ns] and values (n, 6); None if a message differs otherwise."""
        if not (messages.length == self._layout.itemsize).all():
            return None
        rows = np.frombuffer(messages.data, dtype=self._layout)
        if not ((rows["form"] == _PLAIN) & (rows["named"] == self._named)).all():
            return None
        values = rows["values"].copy()
        values[np.isnan(values)] = np.nan  # the quiet NaN, which arithmetic does not warn of
        return rows["sec"].astype(np.int64) * 10**9 + rows["nanosec"], values
