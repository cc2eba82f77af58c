"""Read poses of the sensor from topics of ROS 2, for samples of any source."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from palpate.errors import InputError
from palpate.files.logs.decoding import role
from palpate.files.logs.topics import NONE, POSE_KINDS
from palpate.files.messages import Topic
from palpate.files.units import near
from palpate.live.dds import DdsNode, DdsReader, ros_name
from palpate.live.poses import LivePoses, Posed
from palpate.live.source import drained
from palpate.setup.source import RigSource
from palpate.setup.tables import RigOrientation

__all__ = ["RosPoses"]

_STATIC = 1000  # messages of transforms that a reader keeps


class RosPoses:
    """A reader of the topic of poses, or of /tf and /tf_static, that a rig's [orientation] names.

    Args:
        orientation: the [orientation], with a topic, or base and sensor.
        node: node in the domain, which its owner opens and closes.
        patience: [s] to wait for the topic to be announced.

    Attributes:
        poses: the poses received so far.
    """

    def __init__(self, orientation: RigOrientation, node: DdsNode, patience: float = 3.0) -> None:
        self._table, self._node, self._patience = orientation, node, patience
        self._readers: list[DdsReader] = []
        self._own: DdsNode | None = None
        self._said: list[str] = []
        self.poses = LivePoses(orientation.frames(), orientation.offset, orientation.max_gap)

    @classmethod
    def of(cls, orientation: RigOrientation, source: RigSource | None) -> RosPoses | None:
        """Return a `RosPoses` with its own node; None if the rig names no topic or frames.

        Args:
            orientation: the rig's [orientation].
            source: the rig's [source], whose domain is joined; None: domain 0 on this machine.

        Raises:
            InputError: the rig takes poses from joint states.
        """
        if not wanted(orientation):
            return None
        made = cls(orientation, DdsNode() if source is None else DdsNode(source.domain, source.interface))
        made._own = made._node
        return made

    def open(self) -> None:
        """Begin to listen to the topics.

        Raises:
            InputError: cyclonedds is not installed, the domain cannot be joined, nobody publishes the topic, or it has
                messages of another type.
        """
        if self._own is not None and (said := self._own.open()):
            self._said.append(said)
        if self._table.frames() is not None:
            self._readers = [
                self._node.reader(name, "tf2_msgs/TFMessage", reliable=True, latched=latched, depth=_STATIC)
                for name, latched in (("/tf", False), ("/tf_static", True))
            ]
            return
        try:
            self._readers = [self._named()]
        except InputError:
            self.close()
            raise

    def at(self, stamp: Int[np.ndarray, " n"]) -> Posed:
        """Return the sensor's poses at times (n,) [ns] of samples, from all messages received so far."""
        for reader in reversed(self._readers):  # static transforms first
            self.poses.add(reader.take())
        return self.poses.at(stamp)

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each, such as poses that are too old."""
        return [*drained(self._said), *self.poses.events()]

    def close(self) -> None:
        """Stop listening; may be called again."""
        self._readers = []
        if self._own is not None:
            self._own.close()

    def _named(self) -> DdsReader:
        name = ros_name(self._table.topic or "")
        topic = published(name, self._node.settled(self._patience, [name]), self._node.where)
        if role(topic.kind) != "pose":
            what = f"topic {name!r} has messages of {topic.kind}, which is not a pose."
            raise InputError(what, where=self._node.where, hint=POSE_KINDS)
        return self._node.reader(name, topic.kind)


def wanted(orientation: RigOrientation) -> bool:
    """Return whether a rig's [orientation] names a topic of poses or frames.

    Raises:
        InputError: it takes poses from joint states, which are not read live.
    """
    if orientation.urdf is not None:
        hint = "Remove urdf, and name only base and sensor, which robot_state_publisher puts on /tf."
        raise InputError("joint states cannot be read live.", where="orientation.urdf", hint=hint)
    return orientation.frames() is not None or orientation.topic not in (None, NONE)


def published(name: str, there: Sequence[Topic], where: str) -> Topic:
    """Return the topic of this name among the published topics `there`.

    Raises:
        InputError: nobody publishes it; the place is `where`.
    """
    found = next((topic for topic in there if topic.name == name), None)
    if found is None:
        seen = ", ".join(f"{topic.name} ({topic.kind})" for topic in there[:12]) or "none"
        hint = f"Topics that exist: {seen}. {near(name, (topic.name for topic in there)) if there else ''}".strip()
        raise InputError(f"no node publishes {name!r}.", where=where, hint=hint)
    return found
