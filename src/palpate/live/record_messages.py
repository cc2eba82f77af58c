"""Make the messages of a live record: readings, contacts and events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Int

from palpate.contact.origins import Origin
from palpate.files.contacts.mcap import LATEST, POSE_FIELDS, WRENCH_FIELDS, ContactMessages, topics
from palpate.files.logs.joints import JOINTS
from palpate.files.logs.topics import LIVE, LIVE_ACCELERATION, LIVE_POSE
from palpate.files.mcap.rows import ChannelRows, Fields, made, stamped
from palpate.files.mcap.writer import WrittenTopic
from palpate.files.message_types import described, written_topic
from palpate.live.stream_buffer import SlotForm

__all__ = ["event", "event_channels", "record_topics"]

READINGS, EVENTS, POSE, ACCELERATION = 4, 5, 6, 7  # channels of a stream, behind those of its contacts
_INFO, _WARN = 20, 30
_BASE, _SENSOR = "base", "sensor"  # names of frames
_EVENTS = f"{LIVE}events"
_LOG = """uint8 DEBUG=10
uint8 INFO=20
uint8 WARN=30
uint8 ERROR=40
uint8 FATAL=50
builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line
"""


def record_topics(form: SlotForm, features: tuple[str, ...] | None = None) -> tuple[WrittenTopic, ...]:
    """Return the topics of a stream: contacts, readings, events, and with poses also poses and accelerations.

    Those of a robot's sensor have its name. Joint states have no contacts.

    Args:
        form: description of the samples and contacts.
        features: names of the features of all streams of a robot; None: those of `form`.
    """
    if form.joints:
        name, kind = "joint_states", JOINTS
    elif form.images:
        name, kind = "image", "sensor_msgs/Image"
    elif form.wrenches:
        name, kind = "wrench", "geometry_msgs/WrenchStamped"
    else:
        name, kind = "readings", "std_msgs/Float64MultiArray"
    sensor = form.origin[0]
    readings = written_topic(form.topic or f"{LIVE}{sensor or name}", kind)
    own = f"/{sensor or name}" if sensor or form.joints else ""
    said = WrittenTopic(f"{_EVENTS}{own}", "rcl_interfaces/msg/Log", described(_LOG, ["builtin_interfaces/Time"]))
    poses = {LIVE_POSE: "geometry_msgs/PoseStamped", LIVE_ACCELERATION: "geometry_msgs/Vector3Stamped"}
    beside = [
        written_topic(f"{name}{readings.name if sensor else ''}", kind) for name, kind in poses.items() if form.poses
    ]
    origins = (Origin(*form.origin),) if sensor else ()
    contacts = () if form.joints else topics(form.features if features is None else features, origins)
    return (*contacts, readings, said, *beside)


def event_channels(topics: Sequence[WrittenTopic]) -> list[int]:
    """Return the channels of events, one for each stream of a record; that of its readings is the one before."""
    return [channel for channel, topic in enumerate(topics, 1) if topic.name.startswith(_EVENTS)]


class RecordMessages:
    """An encoder of a ring's slots as MCAP messages.

    Sequence numbers are those of samples and sentences, modulo 2^32; a sentence on lost samples has the number 0.

    Args:
        form: description of the ring's samples and contacts.
        events: channel of its events, among all of the record.
        features: names of the features of all streams of a robot; None: those of `form`.
    """

    def __init__(self, form: SlotForm, events: int = EVENTS, features: tuple[str, ...] | None = None) -> None:
        features, frame = form.features if features is None else features, form.frame
        frames = {Origin(*form.origin): frame} if form.origin[0] else frame
        before, self._events, self._form = events - EVENTS, events, form
        self._contacts = None if form.joints else ContactMessages(frames, features, before + 1)
        self._readings = ChannelRows(before + READINGS, *_fields(form))
        self._pose = ChannelRows(before + POSE, *stamped(_BASE, POSE_FIELDS))
        self._acceleration = ChannelRows(before + ACCELERATION, *stamped(_SENSOR, (("vector", "<f8", (3,)),)))

    def of(self, slots: np.ndarray, first: int) -> list[np.ndarray]:
        """Return all messages of some samples, a structured array for each channel.

        Args:
            slots: (n,) slots of the ring, in order.
            first: number of the first sample.
        """
        times = slots["stamp"].clip(0, LATEST)
        messages = list[np.ndarray]()
        if self._contacts is not None:
            contacts = self._form.contacts(slots)
            messages = self._contacts.of(contacts, times[contacts.sample - first])
        posed = np.isfinite(slots["orientation"]).all(axis=1) & self._form.poses
        moved = np.isfinite(slots["acceleration"]).all(axis=1) & self._form.poses
        stamps = [times[which] for which in (slice(None), posed, moved)]
        readings, pose, acceleration = made([self._readings, self._pose, self._acceleration], stamps)
        readings["sequence"] = (first + np.arange(len(slots))) % 2**32
        if self._form.wrenches:
            readings["force"], readings["torque"] = slots["values"][:, :3], slots["values"][:, 3:]
        else:
            data = "position" if self._form.joints else "data"
            readings[data] = slots["values"].reshape(len(slots), -1)
        pose["position"], pose["orientation"] = slots["position"][posed], slots["orientation"][posed]
        acceleration["vector"] = slots["acceleration"][moved]
        messages += [readings, pose, acceleration]
        if len(gaps := np.flatnonzero(slots["lost"])):
            missing = _missing(slots["lost"], gaps, first)
            messages.append(event(int(times[gaps[0]]), missing, 0, self._events, _WARN))
        return messages


def event(stamp: int, sentence: str, number: int, channel: int = EVENTS, level: int = _INFO) -> np.ndarray:
    """Return the message of a sentence, (1,) structured.

    Args:
        stamp: [ns] time of the sentence.
        sentence: the sentence.
        number: its number from 1, or 0.
        channel: channel of the events.
        level: level of rcl_interfaces/Log: 20 for information, 30 for a warning.
    """
    texts, said = _texts({"name": "palpate live", "msg": sentence, "file": "", "function": ""})
    fields: Fields = (("sec", "<i4", ()), ("nanosec", "<u4", ()), ("level", "u1", ()), *texts, ("line", "<u4", ()))
    (message,) = made([ChannelRows(channel, fields, {"level": level, **said})], [np.array([stamp], dtype=np.int64)])
    message["sequence"] = number % 2**32
    return message


def _missing(lost: Int[np.ndarray, " n"], gaps: Int[np.ndarray, " k"], first: int) -> str:
    """Return a sentence, such as "3 samples are missing before sample 1200"."""
    count, here = int(lost.sum()), first + int(gaps[0])
    where = f"before sample {here}" if len(gaps) == 1 else f"at {len(gaps)} places from sample {here} on"
    return f"{count} {'sample is' if count == 1 else 'samples are'} missing {where}"


def _texts(texts: Mapping[str, str]) -> tuple[Fields, Mapping[str, object]]:
    """Return the fields of strings, each after its length, and their values."""
    fields: Fields = ()
    values = dict[str, object]()
    for name, text in texts.items():
        raw = text.encode() + b"\0"
        fields = (*fields, (f"{name} length", "<u4", ()), (name, f"S{len(raw)}", ()))
        values |= {f"{name} length": len(raw), name: raw}
    return fields, values


def _fields(form: SlotForm) -> tuple[Fields, Mapping[str, object]]:
    """Return the fields of a message of readings, and the values that all share."""
    if form.wrenches:
        return stamped(_SENSOR, WRENCH_FIELDS)
    size = int(np.prod(form.shape))
    if form.joints:
        return _joints(form.joints)
    if not form.images:
        return _array(form.shape, size)
    height, width, *channels = form.shape
    encoding, said = _texts({"pixels": "bgr8" if channels else "mono8"})
    fields, common = stamped(
        _SENSOR,
        (
            ("height", "<u4", ()),
            ("width", "<u4", ()),
            *encoding,
            ("is_bigendian", "u1", ()),
            ("step", "<u4", ()),
            ("size", "<u4", ()),
            ("data", "u1", (size,)),
        ),
    )
    return fields, {**common, **said, "height": height, "width": width, "step": size // height, "size": size}


def _joints(names: tuple[str, ...]) -> tuple[Fields, Mapping[str, object]]:
    """Return the fields of a JointState with positions alone, and the values that all share."""
    fields, common = stamped(_BASE, (("names", "<u4", ()),))
    for k, name in enumerate(names):
        text, said = _texts({f"name {k}": name})
        fields, common = (*fields, *text), {**common, **said}
    numbers: Fields = (("count", "<u4", ()), ("position", "<f8", (len(names),)), ("others", "<u4", (2,)))
    return (*fields, *numbers), {**common, "names": len(names), "count": len(names)}


def _array(shape: tuple[int, ...], size: int) -> tuple[Fields, Mapping[str, object]]:
    """Return the fields of a Float64MultiArray, and the values that all share."""
    names = ["row", "column"] if len(shape) == 2 else [f"axis{k}" for k in range(len(shape))]
    fields: Fields = (("dimensions", "<u4", ()),)
    common: dict[str, object] = {"dimensions": len(shape), "count": size}
    for k, (name, length) in enumerate(zip(names, shape, strict=True)):
        label, said = _texts({f"label {k}": name})
        fields = (*fields, *label, (f"size {k}", "<u4", ()), (f"stride {k}", "<u4", ()))
        common |= {**said, f"size {k}": length, f"stride {k}": int(np.prod(shape[k:]))}
    return (*fields, ("offset", "<u4", ()), ("count", "<u4", ()), ("data", "<f8", (size,))), common
