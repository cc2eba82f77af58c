"""Compute live poses of a link that joints move, from messages of joint states, and of an IMU on a link."""

from __future__ import annotations

import numpy as np

from palpate.files.logs.composed_poses import imu_orientations
from palpate.files.logs.joints import joint_positions
from palpate.files.messages import MessageBlock
from palpate.files.urdf import Kinematics
from palpate.live.poses import LivePoses


class JointEdge:
    """An edge of a tree of live poses, which joint states move: from the kinematics' base to its link.

    States that lack a joint which moves the link are left out, as in a log.

    Args:
        kinematics: of the link in the base.
        base: name of the base in the tree.
        poses: the tree, to which the edge is added.
        child: name of the link in the tree.
    """

    def __init__(self, kinematics: Kinematics, base: str, poses: LivePoses, child: str) -> None:
        self._kinematics, self._edge, self._poses = kinematics, (base, child), poses

    def add(self, messages: MessageBlock) -> None:
        """Add messages of joint states; the time of sending replaces a stamp of 0.

        Raises:
            InputError: positions of joints seem to be in degrees.
        """
        if not len(messages.time):
            return
        topic, joints = next(iter(messages.topics.values())), self._kinematics.joints
        stamps, values, sound, concerned = joint_positions(messages, topic, joints)
        good = sound & concerned & np.isfinite(values).all(axis=1)
        lacks = np.flatnonzero(np.isnan(values[sound & concerned]).any(axis=0))
        if len(lacks):
            names = ", ".join(joints[k] for k in lacks)
            self._poses.note(f"some states on {topic.name!r} have no position of {names}, and are left out")
        self._kinematics.require_radians(values[good], topic.name)
        quaternion, position = self._kinematics.poses(values[good])
        stamps = np.where(stamps == 0, messages.time, stamps)[good]
        moved = np.column_stack([position[:, 0], quaternion[:, 0]])
        self._poses.grow(self._edge, stamps, moved, unread=int(np.count_nonzero(~sound)))


class ImuEdge:
    """An edge of a tree of live poses from the world of an IMU's orientation to the link on which the IMU is.

    Args:
        poses: the tree.
        world: name of the world in the tree.
        link: name of the link.
    """

    def __init__(self, poses: LivePoses, world: str, link: str) -> None:
        self._poses, self._edge = poses, (world, link)

    def add(self, messages: MessageBlock) -> None:
        """Add messages of the IMU; the time of sending replaces a stamp of 0."""
        if not len(messages.time):
            return
        topic = next(iter(messages.topics.values()))
        stamps, quaternion, good = imu_orientations(messages, topic)
        if not good.all():
            self._poses.note(f"some messages of {topic.name!r} have no orientation, and are left out")
        stamps = np.where(stamps == 0, messages.time, stamps)[good]
        self._poses.grow(self._edge, stamps, np.column_stack([np.zeros((len(stamps), 3)), quaternion[good]]))
