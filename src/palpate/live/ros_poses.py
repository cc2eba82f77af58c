"""Read poses of the sensor from topics of ROS 2, for samples of any source: poses, /tf, joint states, an IMU."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Int

from palpate.errors import InputError
from palpate.files.logs.composed_poses import IMU
from palpate.files.logs.decoding import role
from palpate.files.logs.joints import JOINTS
from palpate.files.logs.survey import frame_in
from palpate.files.logs.topics import NONE, POSE_KINDS
from palpate.files.messages import MessageBlock, Topic
from palpate.files.units import near
from palpate.files.urdf import Kinematics, Urdf
from palpate.live.dds import DdsNode, DdsReader, ros_name
from palpate.live.joint_edge import ImuEdge, JointEdge
from palpate.live.poses import LivePoses, Posed
from palpate.live.source import drained
from palpate.setup.source import RigSource
from palpate.setup.tables import RigOrientation

__all__ = ["RosPoses"]

_STATIC = 1000  # messages of transforms that a reader keeps
_WORLD, _SENSOR = "the IMU's world", "the sensor"  # in a tree that joint states move; links have no such names

_Reader = tuple[DdsReader, Callable[[MessageBlock], None]]


class RosPoses:
    """A reader of the topics that a rig's [orientation] names: of poses, of /tf, or of joint states and of an IMU.

    Above the links that joint states move, a base in /tf is joined at the root of the URDF.

    Args:
        orientation: the [orientation], with a topic, or base and sensor.
        node: node in the domain, which its owner opens and closes.
        patience: [s] to wait for the topics to be announced, and for the first message of an IMU.
        folder: in which the path of the URDF starts.

    Attributes:
        poses: the poses received so far.
    """

    def __init__(
        self, orientation: RigOrientation, node: DdsNode, patience: float = 3.0, folder: Path | None = None
    ) -> None:
        self._table, self._node, self._patience = orientation, node, patience
        self._readers: list[_Reader] = []
        self._own: DdsNode | None = None
        self._said: list[str] = []
        self._urdf = None if orientation.urdf is None else Urdf((folder or Path()) / orientation.urdf)
        frames, called = orientation.frames(), "the tree of /tf"
        if frames is not None and self._urdf is not None:
            frames, called = (_WORLD if orientation.imu else frames[0], _SENSOR), "the URDF, moved by joint states"
        self.poses = LivePoses(frames, orientation.offset, orientation.max_gap, called)

    @classmethod
    def of(cls, orientation: RigOrientation, source: RigSource | None, folder: Path | None = None) -> RosPoses | None:
        """Return a `RosPoses` with its own node; None if the rig names no topic or frames.

        Args:
            orientation: the rig's [orientation].
            source: the rig's [source], whose domain is joined; None: domain 0 on this machine.
            folder: in which the path of a URDF starts.

        Raises:
            InputError: the rig takes joints from columns of a table, or its URDF cannot be read.
        """
        if not wanted(orientation):
            return None
        node = DdsNode() if source is None else DdsNode(source.domain, source.interface)
        made = cls(orientation, node, folder=folder)
        made._own = made._node
        return made

    def open(self) -> None:
        """Begin to listen to the topics.

        Raises:
            InputError: cyclonedds is not installed, the domain cannot be joined, nobody publishes a topic, it has
                messages of another type, no message of an IMU comes; or pinocchio cannot read the URDF.
        """
        if self._own is not None and (said := self._own.open()):
            self._said.append(said)
        try:
            if self._urdf is not None:
                self._readers = self._jointed(self._urdf)
            elif self._table.frames() is not None:
                self._readers = self._transforms()
            else:
                reader = self._reader(self._table.topic or "", "pose", "a pose", POSE_KINDS)
                self._readers = [(reader, self.poses.add)]
        except InputError:
            self.close()
            raise

    def at(self, stamp: Int[np.ndarray, " n"]) -> Posed:
        """Return the sensor's poses at times (n,) [ns] of samples, from all messages received so far.

        Raises:
            InputError: positions of joints seem to be in degrees.
        """
        for reader, add in reversed(self._readers):  # static transforms first
            add(reader.take())
        return self.poses.at(stamp)

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each, such as poses that are too old."""
        return [*drained(self._said), *self.poses.events()]

    def close(self) -> None:
        """Stop listening; may be called again."""
        self._readers = []
        if self._own is not None:
            self._own.close()

    def _transforms(self) -> list[_Reader]:
        topics = ("/tf", False), ("/tf_static", True)
        kind = "tf2_msgs/TFMessage"
        return [
            (self._node.reader(name, kind, reliable=True, latched=latched, depth=_STATIC), self.poses.add)
            for name, latched in topics
        ]

    def _jointed(self, urdf: Urdf) -> list[_Reader]:
        """Return the readers of joint states, and of the IMU or the transforms that move the robot's base."""
        (base, sensor), stated = self._table.frames() or ("", ""), self._table.joints
        topic = stated if isinstance(stated, str) else "joint_states"
        joints = self._reader(topic, JOINTS, "a joint state", f"Joint states are of {JOINTS}.")
        link, above = base, list[_Reader]()
        if self._table.imu is not None:
            imu = self._reader(self._table.imu, IMU, "that of an IMU", f"Those of an IMU are of {IMU}.")
            if not imu.wait(self._patience):
                what = f"no message came on {self._table.imu!r} within {self._patience:g} s."
                raise InputError(what, where=self._node.where)
            first = imu.take()
            named = frame_in(first, next(iter(first.topics.values())))
            link = named if named in urdf.links else base
            above = [(imu, ImuEdge(self.poses, _WORLD, link).add)]
        elif base not in urdf.links:
            link, above = urdf.root(sensor), self._transforms()
        edge = JointEdge(Kinematics(urdf, link, sensor), link, self.poses, _SENSOR)
        return [*above, (joints, edge.add)]

    def _reader(self, topic: str, kind: str, called: str, hint: str) -> DdsReader:
        """Return a reader of a topic that is published, with messages of a type or role `kind`."""
        name = ros_name(topic)
        found = published(name, self._node.settled(self._patience, [name]), self._node.where)
        if kind not in (found.kind, role(found.kind)):
            what = f"topic {name!r} has messages of {found.kind}, which is not {called}."
            raise InputError(what, where=self._node.where, hint=hint)
        return self._node.reader(name, found.kind)


def wanted(orientation: RigOrientation) -> bool:
    """Return whether a rig's [orientation] names a topic of poses, frames, or links that joint states move.

    Raises:
        InputError: it takes the positions of joints from columns of a table, which a stream does not have.
    """
    if isinstance(orientation.joints, Mapping):
        what = "columns of joints are those of a table, which a stream does not have."
        raise InputError(what, where="orientation.joints", hint="Write the name of the topic of joint states.")
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
