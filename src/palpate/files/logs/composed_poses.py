"""Compose the pose of a link that joints move, in a frame above the robot's base, whose -z is down."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.files.logs.cursor import Cursor
from palpate.files.logs.decoding import seconds
from palpate.files.logs.joints import JointPoses
from palpate.files.logs.transforms import TransformTree, TreePoses
from palpate.files.messages import MessageBlock, MessageFile, Topic
from palpate.files.units import near
from palpate.files.urdf import Urdf
from palpate.spatial.frames import FramePath
from palpate.spatial.pose_track import PoseTrack

IMU = "sensor_msgs/Imu"


class ImuPoses:
    """The orientation of an IMU over time, as its messages state it; its position is taken for the origin.

    Args:
        topic: of the IMU.
        track: receives the poses.
        source: file of the messages.
    """

    def __init__(self, topic: Topic, track: PoseTrack, source: MessageFile) -> None:
        self.topics, self.track = (topic,), track
        self._stamped = source.has_stamps(topic, lambda messages: Cursor(messages, topic.encoding).stamp())
        self._count = self._without = 0

    def add(self, messages: MessageBlock) -> None:
        """Add the orientations in a block of messages to the track."""
        topic = self.topics[0]
        own = messages.of(topic)
        stamp, quaternion, good = imu_orientations(own, topic)
        self._count += len(stamp)
        self._without += int(np.count_nonzero(~good))
        time = seconds(stamp if self._stamped else own.time)[good]
        self.track.add(time, quaternion[good], np.zeros((len(time), 3)))

    def notes(self) -> tuple[str, ...]:
        """Return notes, one sentence each: what is missing."""
        name = self.topics[0].name
        said = [f"gravity is taken from the orientation of the IMU on {name!r}"]
        if self._without:
            said.append(f"{self._without} of {self._count} messages of {name!r} have no orientation")
        return (*said, *self.track.notes())


def imu_orientations(
    messages: MessageBlock, topic: Topic
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 4"], Bool[np.ndarray, " n"]]:
    """Return stamps (n,) [ns] and quaternions x, y, z, w (n, 4) of messages of an IMU, and which have them, (n,)."""
    cursor = Cursor(messages, topic.encoding)
    stamp, numbers = cursor.stamp(), cursor.numbers("f8", 5)
    return stamp, numbers[:, :4], cursor.sound & (numbers[:, 4] != -1) & numbers[:, :4].any(axis=1)


def imu_topic(source: MessageFile, name: str, where: str) -> Topic:
    """Return the topic of an IMU.

    Raises:
        InputError: there is no such topic in the log `where`, or its messages are not those of an IMU.
    """
    there = [topic for topic in source.topics() if topic.kind == IMU and topic.encoding in ("cdr", "ros1")]
    topic = next((each for each in there if each.name == name), None)
    if topic is None:
        hint = near(name, [each.name for each in there])
        raise InputError(f"there is no topic {name!r} of an IMU ({IMU}).", where=where, hint=hint)
    return topic


def linked_frame(frames: TransformTree, urdf: Urdf, base: str, sensor: str, where: str) -> str:
    """Return the link that /tf joins with the frame `base`: the root above the sensor, or else the first of all links.

    Raises:
        InputError: /tf has no such frame, or joins it with no link.
    """
    tree = frames.tree()
    known = tree.frames
    if base not in known:
        what = f"there is no frame {base!r} in /tf and no such link in the URDF."
        raise InputError(what, where=where, hint=near(base, [*known, *urdf.links]))
    for link in (urdf.root(sensor), *urdf.links):
        if link in known and tree.up(link)[-1] == tree.up(base)[-1]:
            return link
    raise InputError(f"/tf joins the frame {base!r} with no link of the URDF.", where=where, hint="Record it.")


class ComposedPoses:
    """The pose of a link that joints move, in the frame in which another source gives the pose of the base.

    Args:
        above: poses of the base.
        joints: poses of the link in the base.
        frames: names of the frame, the base and the link.
    """

    def __init__(self, above: TreePoses | ImuPoses, joints: JointPoses, frames: tuple[str, str, str]) -> None:
        self._above, self._joints = above, joints
        self.topics = (*above.topics, *joints.topics)
        path = above.track
        if isinstance(path, PoseTrack):
            path = FramePath(frames[:2], ((path, False),))
        self.track = FramePath((*path.frames, frames[2]), (*path.steps, (joints.track, False)))

    def add(self, messages: MessageBlock) -> None:
        """Add the poses in a block of messages to both tracks.

        Raises:
            InputError: positions of joints seem to be in degrees.
        """
        self._above.add(messages)
        self._joints.add(messages)

    def notes(self) -> tuple[str, ...]:
        """Return the notes of both sources, one sentence each."""
        return (*self._above.notes(), *self._joints.notes())
