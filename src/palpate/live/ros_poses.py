"""Poses of the sensor from topics of ROS 2, for samples from anywhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from palpate.errors import InputError
from palpate.files.logs.decoding import role
from palpate.files.logs.log import Topic
from palpate.files.logs.topics import NONE, POSE_KINDS
from palpate.files.units import near
from palpate.live.dds import DdsNode, DdsReader, ros_name
from palpate.live.poses import LivePoses, Posed
from palpate.setup.source import RigSource
from palpate.setup.tables import RigOrientation

__all__ = ["RosPoses"]

_TREE = (("/tf", False), ("/tf_static", True))
_STATIC = 1000  # transforms of so many publishers are waited for


class RosPoses:
    """Hears the topic of poses, or /tf and /tf_static, that the [orientation] of a rig names.

    Args:
        orientation: that table; it names a topic, or base and sensor.
        node: of the domain; opened and closed by whoever made it.
        patience: [s] to wait for the topic to be announced.
    """

    def __init__(self, orientation: RigOrientation, node: DdsNode, patience: float = 3.0) -> None:
        self._table, self._node, self._patience = orientation, node, patience
        self._readers: list[DdsReader] = []
        self._own: DdsNode | None = None
        self._said: list[str] = []
        self.poses = LivePoses(orientation.frames(), orientation.offset, orientation.max_gap)

    @classmethod
    def of(cls, orientation: RigOrientation, source: RigSource | None) -> RosPoses | None:
        """Return poses with a node of its own; None where the rig names nothing to hear.

        Args:
            orientation: the table.
            source: whose domain is joined.

        Raises:
            InputError: the rig wants poses of joint states, which are not read live.
        """
        if not wanted(orientation):
            return None
        node = DdsNode(*((0, "") if source is None else (source.domain, source.interface)))
        made = cls(orientation, node)
        made._own = node
        return made

    def open(self) -> None:
        """Begin to listen.

        Raises:
            InputError: the domain cannot be joined, nobody publishes the topic, or it holds something else.
        """
        if self._own is not None and (said := self._own.open()):
            self._said.append(said)
        if self._table.frames() is not None:
            self._readers = [
                self._node.reader(name, "tf2_msgs/TFMessage", reliable=True, latched=latched, depth=_STATIC)
                for name, latched in _TREE
            ]
            return
        try:
            self._readers = [self._named()]
        except InputError:
            self.close()
            raise

    def at(self, stamp: Int[np.ndarray, " n"]) -> Posed:
        """At times [ns] of samples, with every message that has come."""
        for reader in reversed(self._readers):  # what holds comes first
            self.poses.add(reader.take())
        return self.poses.at(stamp)

    def events(self) -> list[str]:
        """What happened since this was last asked, one sentence each."""
        said, self._said = [*self._said, *self.poses.events()], []
        return said

    def close(self) -> None:
        """Stop; may be called twice."""
        self._readers = []
        if self._own is not None:
            self._own.close()

    def _named(self) -> DdsReader:
        name = ros_name(self._table.topic or "")
        topic = published(name, self._node.settled(self._patience, [name]), self._node.where)
        if role(topic.kind) != "pose":
            raise InputError(f"topic {name!r} holds {topic.kind}.", where=self._node.where, hint=POSE_KINDS)
        return self._node.reader(name, topic.kind)


def wanted(orientation: RigOrientation) -> bool:
    """Whether a rig names poses that are heard live.

    Raises:
        InputError: it wants poses of joint states.
    """
    if orientation.urdf is not None:
        raise InputError(
            "joint states are not read live.",
            where="orientation.urdf",
            hint="Name base and sensor alone: robot_state_publisher puts them on /tf.",
        )
    return orientation.frames() is not None or orientation.topic not in (None, NONE)


def published(name: str, there: Sequence[Topic], where: str) -> Topic:
    """The topic of this name.

    Raises:
        InputError: nobody publishes it.
    """
    found = next((topic for topic in there if topic.name == name), None)
    if found is None:
        seen = ", ".join(f"{topic.name} ({topic.kind})" for topic in there[:12]) or "no topic at all"
        hint = f"Seen: {seen}. {near(name, (topic.name for topic in there)) if there else ''}".strip()
        raise InputError(f"nobody publishes {name!r}.", where=where, hint=hint)
    return found
