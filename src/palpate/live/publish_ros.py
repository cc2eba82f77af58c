"""Publish contacts to ROS 2: a pose, a wrench, markers for viewers, and a message with all values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from palpate.contact.contacts import Contacts
from palpate.files.contacts.mcap import ContactMessages
from palpate.files.mcap.writer import MESSAGE
from palpate.live.dds import DdsNode, DdsReader, Writer
from palpate.live.ros_messages import Cdr
from palpate.live.source import drained
from palpate.live.stream_buffer import SlotForm
from palpate.spatial.pose import quaternion_from_rotation

__all__ = ["TARE", "TOPICS", "RosPublisher"]

TARE = "/palpate/tare"
TOPICS = {
    "/palpate/contact/pose": "geometry_msgs/PoseWithCovarianceStamped",
    "/palpate/contact/wrench": "geometry_msgs/WrenchStamped",
    "/palpate/contact/markers": "visualization_msgs/MarkerArray",
    "/palpate/contact/contacts": "palpate_msgs/ContactArray",
}
_POSE, _WRENCH, _MARKERS, _CONTACTS = TOPICS
_ROOM, _TOGETHER = "/palpate/contact/", "together"
_DRAWN = 30.0  # Hz of markers: viewers need no more
_BACK = 1.0  # s: stamps that go back by more are another clock
_HEADER = 16  # bytes of a message before the name of its frame
_ARROW, _SPHERE, _ADD, _DELETE_ALL = 0, 2, 0, 3
_ORANGE, _BLUE = (0.84, 0.37, 0.0, 1.0), (0.0, 0.45, 0.7, 0.5)
_LENGTH = 0.01  # m per N of an arrow
_LONGEST = 0.2  # m
_SMALLEST, _LARGEST = 0.002, 0.05  # m: diameters of an ellipsoid that can be seen
_DEVIATIONS = 2.796  # of a 95 % ellipsoid in three dimensions
_LIFE = 500_000_000  # ns after which a viewer forgets a marker, if nobody renews it


class RosPublisher:
    """A publisher of contacts to topics of ROS 2, at a limited rate.

    `/palpate/contact/pose` (PoseWithCovarianceStamped: the strongest contact, z along its outward normal; covariance of
    the point, and 0 for the rotation's, which is not known) and `/palpate/contact/wrench` (WrenchStamped: its force on
    the body and its torque about the normal, at that point) are silent while no contact is located.
    `/palpate/contact/contacts` (palpate_msgs/ContactArray) has every row of a sample; `/palpate/contact/markers` is for
    viewers, 30 times a second. A message on `/palpate/tare` (std_msgs/Empty) requests a tare.

    The topics of a robot's sensor begin with `/palpate/SENSOR/`; `/palpate/contact/contacts` then has the newest
    contacts of all sensors, without their features, each in the frame of its own header.

    Args:
        form: description of the ring's samples and contacts.
        rate: [Hz] of messages at most, by the contacts' times.
        domain: number of the domain.
        interface: network interface, see `DdsNode`.
        partner: publisher of another sensor of the robot, which owns the node.
    """

    # The tare is no service: a client of Fast DDS finds its answer by the "related sample identity" of a message, which
    # cyclonedds neither shows for a request nor writes to an answer.
    def __init__(
        self,
        form: SlotForm,
        rate: float = 100.0,
        domain: int = 0,
        interface: str = "",
        partner: RosPublisher | None = None,
    ) -> None:
        self._form, self._messages = form, ContactMessages(form.frame, form.features)
        self._sensor, self._first = form.origin[0], partner or self
        self._node = DdsNode(domain, interface) if partner is None else partner._node
        self._newest, self._all_due = dict[str, list[_Contact]](), _Due(rate)  # of all sensors: used of the first
        self._due, self._drawn = _Due(rate), _Due(min(rate, _DRAWN))
        self._writers: dict[str, Writer] = {}
        self._tare: DdsReader | None = None
        self._dropped = 0
        self._said: list[str] = []

    def open(self) -> None:
        """Join the domain and announce the topics.

        Raises:
            InputError: cyclonedds is not installed, or the domain cannot be joined.
        """
        room = f"/palpate/{self._sensor}/" if self._sensor else _ROOM
        if self._first is self:
            if said := self._node.open():
                self._said.append(said)
            self._tare = self._node.reader(TARE, "std_msgs/Empty", reliable=True, depth=10)
        self._writers = {
            name: self._node.writer(name.replace(_ROOM, room), kind, depth=10) for name, kind in TOPICS.items()
        }
        if self._sensor and self._first is self:
            self._writers[_TOGETHER] = self._node.writer(_CONTACTS, TOPICS[_CONTACTS], depth=10)

    def publish(self, slots: np.ndarray) -> list[int]:
        """Publish those of the next slots (n,) of a ring, in order, that are due, and return their samples' numbers."""
        contacts = self._form.contacts(slots)
        first = np.flatnonzero(np.diff(contacts.sample, prepend=contacts.sample[:1] - 1))
        due = self._due.of(contacts.time[first])
        ends = np.append(first[1:], len(contacts))
        for k in np.flatnonzero(due).tolist():
            self._publish(contacts[first[k] : ends[k]])
        return contacts.sample[first[due]].tolist()

    def tare_requested(self) -> bool:
        """Return whether a message on `/palpate/tare` has come since the last call."""
        return self._tare is not None and len(self._tare.take().time) > 0

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each, such as dropped messages."""
        if self._dropped:
            self._said.append(f"{self._dropped} messages to ROS 2 were dropped: a reader is too slow")
            self._dropped = 0
        return drained(self._said)

    def close(self) -> None:
        """Leave the domain; may be called again."""
        self._writers, self._tare = {}, None
        if self._first is self:
            self._node.close()

    def _publish(self, rows: Contacts) -> None:
        everything, poses, wrenches = self._messages.of(rows)
        found, nothing = self._contacts(everything), np.full(len(rows), np.nan)
        values = np.array([rows.features.get(name, nothing) for name in self._form.features]).T.ravel().tolist()
        self._write(_CONTACTS, _array(found, self._form.features, values))
        self._publish_all(found, rows.time[:1])
        strongest = int(rows.strongest()[0])
        if rows.answered[strongest] and rows.located[strongest]:
            which = int(np.count_nonzero(rows.located[:strongest]))
            spread = np.zeros((6, 6))
            spread[:3, :3] = np.nan_to_num(rows.covariance[strongest])  # 0 is "not known" to others, NaN breaks them
            self._write(_POSE, _payload(poses[which : which + 1]) + spread.astype("<f8").tobytes())
            self._write(_WRENCH, _payload(wrenches[which : which + 1]))
        if self._drawn.of(rows.time[:1])[0]:
            stamp = int(everything["sec"][0]) * 10**9 + int(everything["nanosec"][0])
            self._write(_MARKERS, markers(rows, stamp, self._form.frame))

    def _write(self, topic: str, data: bytes) -> None:
        if not self._writers[topic].write(data):
            self._dropped += 1

    def _publish_all(self, found: list[_Contact], time: Float[np.ndarray, "1"]) -> None:
        """Publish the newest contacts of all sensors of a robot, if they are due."""
        first = self._first
        if self._sensor:
            first._newest[self._sensor] = found
            if first._all_due.of(time)[0]:
                first._write(_TOGETHER, _array([each for own in first._newest.values() for each in own]))

    def _contacts(self, everything: np.ndarray) -> list[_Contact]:
        """Return the parts of each message of a file of contacts that a ContactArray has."""
        start = _HEADER + int(everything["named"][0])
        fields = start + -(start - 4) % 8
        payloads = [_payload(everything[k : k + 1]) for k in range(len(everything))]
        size = len(payloads[0]) - fields - 8 * len(self._form.features) - 1
        return [_Contact(each[4:start], each[fields : fields + size], each[-1:]) for each in payloads]


class _Contact(NamedTuple):
    """Bytes of a contact in a message: its header, its numbers and its status."""

    head: bytes
    numbers: bytes
    status: bytes


def _array(contacts: Sequence[_Contact], features: tuple[str, ...] = (), values: Sequence[float] = ()) -> bytes:
    """Return a ContactArray (bytes, CDR): each contact as in a file, then all features."""
    message = Cdr().raw(contacts[0].head).numbers("I", len(contacts))
    for each in contacts:
        message.align(4).raw(each.head).align(8).raw(each.numbers).raw(each.status)
    message.numbers("I", len(features))
    for name in features:
        message.text(name)
    return message.numbers("I", len(values)).numbers("d", *values).done()


class _Due:
    def __init__(self, rate: float) -> None:
        self._period, self._next = 1.0 / rate, -np.inf

    def of(self, time: Float[np.ndarray, " n"]) -> np.ndarray:
        """Return (n,) whether each of the times [s], in increasing order, is due."""
        due = np.zeros(len(time), dtype=bool)
        for k, at in enumerate(time.tolist()):
            if at >= self._next - 1e-3 * self._period or at < self._next - self._period - _BACK:
                due[k] = True
                follows = self._next + self._period
                self._next = follows if at < follows <= at + self._period else at + self._period
        return due


def markers(contacts: Contacts, stamp: int, frame_id: str) -> bytes:
    """Return a MarkerArray (bytes, CDR) that replaces earlier markers: an arrow and a 95 % ellipsoid a contact.

    Args:
        contacts: rows of one sample; answered contacts with a place and a finite force are drawn.
        stamp: [ns] of the headers.
        frame_id: frame of the contacts.
    """
    shown = np.flatnonzero(contacts.answered & contacts.located & np.isfinite(contacts.force).all(axis=1))
    message = Cdr().numbers("I", 1 + 2 * len(shown))
    head, nothing = (stamp, frame_id), np.zeros(3)
    _marker(message, head, "", (0, _ARROW, _DELETE_ALL), (nothing, None, nothing), _BLUE)
    for row in shown.tolist():
        identity = int(contacts.identity[row]) % 2**31
        tip, force = contacts.point[row], contacts.force[row]
        length = float(np.linalg.norm(force))
        shaft = force * (min(_LENGTH, _LONGEST / length) if length else 0.0)
        arrow = (nothing, None, np.array([0.004, 0.01, 0.0]))
        ball = (tip, *_ellipsoid(contacts.covariance[row]))
        _marker(message, head, "force", (identity, _ARROW, _ADD), arrow, _ORANGE, np.stack([tip - shaft, tip]))
        _marker(message, head, "point", (identity, _SPHERE, _ADD), ball, _BLUE)
    return message.done()


def _marker(
    message: Cdr,
    head: tuple[int, str],
    space: str,
    what: tuple[int, int, int],
    where: tuple[np.ndarray, np.ndarray | None, np.ndarray],
    colour: tuple[float, ...],
    points: np.ndarray | None = None,
) -> None:
    """Append a Marker: stamp [ns] and frame; id, type, action; position, quaternion, scale; colour; points."""
    position, quaternion, scale = where
    turn = (0.0, 0.0, 0.0, 1.0) if quaternion is None else tuple(quaternion.tolist())
    message.align(4).header(*head).text(space).numbers("i", *what).numbers(
        "d", *position.tolist(), *turn, *scale.tolist()
    )
    message.numbers("f", *colour).numbers("i", 0).numbers("I", _LIFE).numbers("B", 0)
    message.numbers("I", 0 if points is None else len(points))
    if points is not None:
        message.numbers("d", *points.ravel().tolist())
    message.numbers("I", 0).text("")  # colours of points; texture
    message.header(0, "").text("").numbers("I", 0)  # an image as a texture
    message.numbers("I", 0).text("").text("")  # places in it; text; mesh
    message.text("").numbers("I", 0).numbers("B", 0)


def _ellipsoid(covariance: Float[np.ndarray, "3 3"]) -> tuple[Float[np.ndarray, "4"], Float[np.ndarray, "3"]]:
    """Return quaternion (4,) x, y, z, w and diameters (3,) [m] of the 95 % ellipsoid; a small ball if unknown."""
    if not np.isfinite(covariance).all():
        return np.array([0.0, 0.0, 0.0, 1.0]), np.full(3, _SMALLEST)
    variance, axes = np.linalg.eigh(covariance)
    axes = axes * np.linalg.det(axes)
    diameters = 2.0 * _DEVIATIONS * np.sqrt(variance.clip(min=0.0))
    return quaternion_from_rotation(axes), diameters.clip(_SMALLEST, _LARGEST)


def _payload(record: np.ndarray) -> bytes:
    return record.tobytes()[MESSAGE.itemsize :]
