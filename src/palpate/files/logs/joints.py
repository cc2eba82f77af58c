"""Convert sensor_msgs/JointState messages to the pose of one link in another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.files.logs.cursor import Cursor, taken
from palpate.files.logs.decoding import seconds
from palpate.files.messages import MessageBlock, Topic
from palpate.files.urdf import Kinematics
from palpate.spatial.pose_track import PoseTrack

JOINTS = "sensor_msgs/JointState"
_LAYOUTS = 64  # distinct lists of joint names in a block of messages; a robot has fewer
_MOST = 1000  # joints of a message

Read = tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n k"], Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]


def joint_positions(messages: MessageBlock, topic: Topic, wanted: Sequence[str]) -> Read:
    """Return stamps and positions of the wanted joints in messages of joint states.

    Returns:
        Stamps (n,) [ns]; positions (n, k) [rad, m], NaN where there is none; masks (n,), True where a message can be
            read,
        and where it names a wanted joint (or none is wanted).
    """
    cursor = Cursor(messages, topic.encoding)
    stamp, count = cursor.stamp(), cursor.number()
    values = np.full((len(stamp), len(wanted)), np.nan)
    sound, concerned = np.zeros((2, len(stamp)), dtype=bool)
    left = np.flatnonzero(cursor.sound & (count <= _MOST))
    end = messages.start + messages.length
    for _ in range(_LAYOUTS):
        if not len(left):
            break
        first = left[0]
        names, size = _listed(cursor.picked(left[:1]), int(count[first]))
        fits = (count[left] == count[first]) & (cursor.at[left] + size <= end[left])
        block = taken(cursor.data, cursor.at[left], size, fits)
        same = fits & (block == block[0]).all(axis=1)
        same &= names is not None
        same[0] = True  # the first one is done, even if it is malformed
        rows, left = left[same], left[~same]
        if names is None:
            continue
        own = cursor.picked(rows)
        own.at = own.at + size
        held = own.number()
        own.sound &= held >= len(names)
        found = own.numbers("f8", len(names))
        found[np.isnan(found)] = np.nan
        sound[rows] = own.sound
        for k, name in enumerate(wanted):
            if name in names:
                values[rows, k] = found[:, names.index(name)]
                concerned[rows] = True
    return stamp, values, sound, concerned | (sound if not wanted else False)


def joint_stamps(messages: MessageBlock, topic: Topic) -> Int[np.ndarray, " n"]:
    """Return the stamps [ns] of those messages of a topic, (k,), that can be read."""
    stamp, _, sound, _ = joint_positions(messages, topic, ())
    return stamp[sound]


def joint_names(messages: MessageBlock, topic: Topic) -> list[str]:
    """Return the names of the joints in the first readable message; [] if no message is readable."""
    cursor = Cursor(messages, topic.encoding)
    cursor.stamp()
    count = cursor.number()
    for k in np.flatnonzero(cursor.sound & (count <= _MOST)):
        if (names := _listed(cursor.picked(np.array([k])), int(count[k]))[0]) is not None:
            return names
    return []


def _listed(cursor: Cursor, count: int) -> tuple[list[str] | None, int]:
    """Return the joint names in a cursor's one message and their bytes; None if it is cut."""
    names, start = list[str](), int(cursor.at[0])
    for _ in range(count):
        (at,), (length,) = cursor.text()
        if not cursor.sound[0]:
            return None, 0
        names.append(cursor.data[at : at + length].rstrip(b"\0").decode(errors="replace"))
    return names, int(cursor.at[0]) - start


class JointPoses:
    """The pose of one link in another over time, computed from joint states.

    Args:
        topic: of joint states.
        kinematics: of the two links.
        track: receives the poses.
        stamped: take the headers' times, not the recorder's.
    """

    def __init__(self, topic: Topic, kinematics: Kinematics, track: PoseTrack, *, stamped: bool) -> None:
        self.topics, self.track = (topic,), track
        self._kinematics, self._stamped = kinematics, stamped
        self._count = self._unread = self._lacking = self._used = 0
        self._lacks = dict[str, None]()

    def add(self, messages: MessageBlock) -> None:
        """Add the poses in a block of messages to the track.

        Raises:
            InputError: most positions of a limited revolute joint exceed a turn: they seem to be in degrees.
        """
        topic, joints = self.topics[0], self._kinematics.joints
        own = messages.of(topic)
        stamp, values, sound, concerned = joint_positions(own, topic, joints)
        self._count += len(sound)
        self._unread += int(np.count_nonzero(~sound))
        known = np.isfinite(values).all(axis=1)
        absent = concerned & sound & ~known
        lacks = np.flatnonzero(~np.isfinite(values[absent]).all(axis=0))
        self._lacks |= dict.fromkeys(joints[k] for k in lacks.tolist())
        self._lacking += int(np.count_nonzero(absent))
        good = np.flatnonzero(sound & concerned & known)
        self._kinematics.require_radians(values[good], topic.name)
        self._used += len(good)
        if len(good):
            time = seconds(stamp if self._stamped else own.time)[good]
            quaternion, position = self._kinematics.poses(values[good])
            self.track.add(time, quaternion[:, 0], position[:, 0])

    def notes(self) -> tuple[str, ...]:
        """Return notes, one sentence each: where the pose is from, and which messages lack joints."""
        name, joints = self.topics[0].name, self._kinematics.joints
        said = [f"the sensor's pose is computed from the URDF and the joint states on {name!r}"]
        if not self._used and self._count:
            said.append(f"no message of {name!r} has all of the joints {', '.join(joints)}, so there is no pose")
        elif self._lacking:
            said.append(
                f"{self._lacking} of {self._count} messages of {name!r} have no position of {', '.join(self._lacks)}, "
                "and were left out"
            )
        if self._unread:
            said.append(f"{self._unread} of {self._count} messages of {name!r} are cut short, or are not {JOINTS}")
        if not self._stamped:
            said.append(f"messages of {name!r} have no stamps: the times at which they were recorded are used")
        return (*said, *self.track.notes())


def joint_topic(topics: Sequence[Topic], name: str | None, where: str) -> Topic:
    """Return the topic of joint states called `name`, or the only one if that is None.

    Raises:
        InputError: there is no such topic in the log `where`, or there are several.
    """
    fitting = [topic for topic in topics if topic.kind == JOINTS and topic.encoding in ("cdr", "ros1")]
    found = [topic for topic in fitting if topic.name == name] if name is not None else fitting
    if len(found) == 1:
        return found[0]
    listed = ", ".join(topic.name for topic in fitting) or "none"
    what = f"{len(found)} topics hold" if name is None else f"there is no topic {name!r} of"
    hint = f"Name one as joints in the rig's [orientation]; topics of joint states in the log: {listed}."
    raise InputError(f"{what} joint states.", where=where, hint=hint)
