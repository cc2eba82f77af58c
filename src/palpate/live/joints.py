"""Receive the joint states of a robot, for its record and its page."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.files.logs.joints import JOINTS, joint_names, joint_positions, joint_topic
from palpate.files.logs.opening import messages_of
from palpate.files.logs.robot_motion import TF
from palpate.files.messages import MessageBlock, Topic
from palpate.live.dds import DdsNode, DdsReader, ros_name
from palpate.live.ros_poses import published
from palpate.live.stream_buffer import SlotForm
from palpate.setup.robot import Robot
from palpate.setup.source import RigSource

NAME = "joints"
"""Name of the stream of joint states, which is no sensor's."""


def joint_source(robot: Robot, sensors: tuple[str, ...] | None = None) -> JointSource | None:
    """Return the source of a robot's joint states, not opened yet: that of its first sensor on ROS 2 or in a log.

    None if [robot] names no topic of joint states, or no such sensor has a source.

    Raises:
        InputError: the robot has no sensor of a name.
    """
    topic = robot.table.joints
    stated = [each.rig.source for each in robot.picked(sensors)]
    usable = [each for each in stated if each is not None and each.kind in ("ros2", "replay")]
    if not isinstance(topic, str) or topic == TF or not usable:
        return None
    return JointSource(usable[0], topic, robot.path.parent)


class JointSource:
    """A topic of joint states, of ROS 2 or in a log, at the times of the messages.

    Args:
        stated: the [source] of a rig.
        topic: name of the topic.
        folder: from which the path of a log starts.
        patience: [s] to wait for the first message on ROS 2.

    Attributes:
        joints: names of the joints, those of the first message; known once open.
        ended: whether a log is at its end.
        patient: whether the messages of a log wait until they are received.
    """

    def __init__(self, stated: RigSource, topic: str, folder: Path, patience: float = 3.0) -> None:
        self._stated, self._named, self._folder, self._patience = stated, topic, folder, patience
        self._node: DdsNode | None = None
        self._reader: DdsReader | None = None
        self._topic = Topic(topic, JOINTS, "cdr")
        self._blocks: Iterator[MessageBlock] = iter(())
        self._held = np.zeros(0, dtype=np.int64), np.zeros((0, 0))
        self._begun: tuple[float, int] | None = None  # when the first message came, and its stamp [ns]
        self._last = np.zeros(0)
        self.joints = tuple[str, ...]()
        self.ended, self.patient = False, stated.kind == "replay" and not stated.speed

    def open(self) -> None:
        """Connect, and read the names of the joints from the first message.

        Raises:
            InputError: the log or the domain cannot be read, or has no joint states of that name.
        """
        first = self._log() if self._stated.kind == "replay" else self._domain()
        self.joints = tuple(joint_names(first, self._topic))
        if not self.joints:
            raise InputError(f"{self._named!r} has no joint states.", where="[robot] joints")
        self._last = np.full(len(self.joints), np.nan)
        self._held = self._read(first)

    @property
    def topic(self) -> str:
        """Name of the topic."""
        return self._topic.name

    def receive(self, timeout: float) -> tuple[np.ndarray, np.ndarray]:
        """Return stamps (n,) [ns] and positions (n, joints) of waiting messages; wait up to `timeout` [s] for one.

        A joint that a message does not name keeps its last position; until all are known, there are none.

        Raises:
            InputError: the log cannot be read on.
        """
        if not len(self._held[0]):
            self._held = self._more(timeout)
        stamps, values = self._held
        count = self._due(stamps, timeout)
        self._held = stamps[count:], values[count:]
        return stamps[:count], values[:count]

    def close(self) -> None:
        """Disconnect; may be called again."""
        self._reader, self._blocks = None, iter(())
        if self._node is not None:
            self._node.close()

    def _log(self) -> MessageBlock:
        path = self._folder / self._stated.address
        source = messages_of(path)
        if source is None:
            raise InputError("has no topic of joint states.", where=str(path))
        self._topic = joint_topic(source.topics(), self._named, str(path))
        self._blocks = source.messages([self._topic.name])
        for block in self._blocks:
            if len((own := block.of(self._topic)).time):
                return own
        raise InputError(f"has no messages on {self._named!r}.", where=str(path))

    def _domain(self) -> MessageBlock:
        node = self._node = DdsNode(self._stated.domain, self._stated.interface)
        node.open()
        name = ros_name(self._named)
        self._topic = published(name, node.settled(self._patience, [name]), node.where)
        if self._topic.kind != JOINTS:
            raise InputError(f"topic {name!r} has messages of {self._topic.kind}, not of {JOINTS}.", where=node.where)
        self._reader = node.reader(name, JOINTS)
        if not self._reader.wait(self._patience):
            raise InputError(f"no message came on {name!r} within {self._patience:g} s.", where=node.where)
        return self._reader.take()

    def _more(self, timeout: float) -> tuple[np.ndarray, np.ndarray]:
        if self._reader is not None:
            return self._read(self._reader.take()) if self._reader.wait(timeout) else self._held
        block = next(self._blocks, None)
        if block is None:
            again, self._begun = self._stated.loop, None
            self.ended = not again
            return self._read(self._log()) if again else self._held
        return self._read(block.of(self._topic))

    def _read(self, messages: MessageBlock) -> tuple[np.ndarray, np.ndarray]:
        stamps, values, sound, concerned = joint_positions(messages, self._topic, self.joints)
        stamps = np.where(stamps == 0, messages.time, stamps)[sound & concerned]
        values = values[sound & concerned]
        for row in values:
            row[:] = self._last = np.where(np.isnan(row), self._last, row)
        known = np.isfinite(values).all(axis=1)
        return stamps[known], values[known]

    def _due(self, stamps: np.ndarray, timeout: float) -> int:
        """Return how many messages are due: of a log played at a speed, those whose time has come."""
        speed = self._stated.speed if self._stated.kind == "replay" else 0.0
        if not speed or not len(stamps):
            time.sleep(timeout if self.ended else 0.0)
            return len(stamps)
        at, first = self._begun = self._begun or (time.monotonic(), int(stamps[0]))
        wait = 1e-9 * int(stamps[0] - first) / speed - (time.monotonic() - at)
        time.sleep(min(max(wait, 0.0), timeout))
        now = first + int(1e9 * speed * (time.monotonic() - at))
        return int(np.searchsorted(stamps, now, side="right"))


def joint_form(source: JointSource, rig: str) -> SlotForm:
    """Return the description of the joint states in a ring."""
    topic = source.topic
    return SlotForm(
        JOINTS, (len(source.joints),), False, (), width=1, max_contacts=1, rig=rig, topic=topic, joints=source.joints
    )
