"""Give the samples of any source the accelerations of an IMU on the sensor, from a topic of ROS 2."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs.decoding import decode, role, seconds
from palpate.files.messages import MessageBlock
from palpate.live.dds import DdsNode, DdsReader, ros_name
from palpate.live.ros_poses import published
from palpate.live.source import Batch, Source, drained, source_of
from palpate.live.waiting_source import WaitingSource
from palpate.setup.setup import Setup
from palpate.setup.source import RigSource
from palpate.setup.tables import RigAcceleration, RigOrientation
from palpate.spatial.pose_track import PoseTrack

_PATIENCE = 3.0  # s to wait for the topic to be announced


class ImuSource(WaitingSource):
    """A source of samples with accelerations, interpolated between messages of a topic as in a log.

    A sample waits for a message as new as itself, up to 0.1 s; without one, or in a gap of the messages, its
    acceleration is NaN: nothing is extrapolated.

    Args:
        samples: source of the samples, without accelerations.
        topic: name of the topic of accelerations, stamped by the same clock.
        node: node in the domain, which is opened and closed with the source.
        max_gap: [s] between messages, beyond which there is no acceleration between them.
    """

    def __init__(self, samples: Source, topic: str, node: DdsNode, max_gap: float = 0.25) -> None:
        name = ros_name(topic)
        check = f"check that the IMU publishes {name!r}, and that its clock is that of the samples"
        super().__init__(samples, ("acceleration has the time of a sample", check, "samples have accelerations"))
        self._name, self._node = name, node
        self._reader: DdsReader | None = None
        self._track = PoseTrack(0.0, max_gap)  # of positions in place of accelerations
        self._unread = False

    @classmethod
    def of(cls, stated: RigSource, setup: Setup) -> ImuSource:
        """Return the source of a rig with the topic that its [acceleration] names, not opened yet.

        Raises:
            InputError: the [source] does not fit the sensor.
        """
        bare = replace(setup, orientation=RigOrientation(), acceleration=RigAcceleration())  # poses come beside it
        node = DdsNode(stated.domain, stated.interface)
        return cls(source_of(stated, bare), setup.acceleration.topic or "", node, setup.orientation.max_gap)

    def open(self) -> None:
        """Join the domain, find the topic, and connect to the device of the samples.

        Raises:
            InputError: cyclonedds is not installed, nobody publishes the topic, it has messages of another type, or the
                device cannot be opened.
        """
        if said := self._node.open():
            self._said.append(said)
        try:
            topic = published(self._name, self._node.settled(_PATIENCE, [self._name]), self._node.where)
            if role(topic.kind) != "acceleration":
                what = f"topic {self._name!r} has messages of {topic.kind}, which is not an acceleration."
                raise InputError(what, where=self._node.where, hint="Correct topic in the rig's [acceleration].")
            self._reader = self._node.reader(self._name, topic.kind)
            super().open()
        except InputError:
            self.close()
            raise

    def close(self) -> None:
        """Leave the domain, and disconnect from the device of the samples; may be called again."""
        super().close()
        self._reader = None
        self._node.close()

    def add(self, messages: MessageBlock) -> None:
        """Add messages of the topic; the time of sending replaces a stamp of 0."""
        if not len(messages.time):
            return
        stamps, values, sound = decode(messages, next(iter(messages.topics.values())))
        if not sound.all() and not self._unread:
            self._unread = True
            self._said.append(f"some messages of {self._name!r} are incomplete, and are ignored")
        time = seconds(np.where(stamps == 0, messages.time, stamps)[sound])
        self._track.add(time, np.tile([0.0, 0.0, 0.0, 1.0], (len(time), 1)), values[sound])

    def events(self) -> list[str]:
        """Return the events of topic and device since the last call, one sentence each."""
        return [*drained(self._said), *super().events()]

    def _listen(self) -> None:
        if self._reader is not None:
            self.add(self._reader.take())

    def _answerable(self, time: Float[np.ndarray, " n"]) -> int:
        return self._track.answerable(time)

    def _join(self, batch: Batch, time: Float[np.ndarray, " n"], values: np.ndarray) -> bool:
        _, felt = self._track.at(time)
        self._track.forget(float(time[-1]))
        batch.values[: len(time)], batch.acceleration[: len(time)] = values, felt
        return bool(np.isfinite(felt).all(axis=1).any())
