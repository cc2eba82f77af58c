"""Make the messages of a live record: readings, contacts and events."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Int

from palpate.files.contacts.mcap import LATEST, POSE_FIELDS, WRENCH_FIELDS, ContactMessages, topics
from palpate.files.logs.topics import LIVE, LIVE_ACCELERATION, LIVE_POSE
from palpate.files.mcap.rows import ChannelRows, Fields, made, stamped
from palpate.files.mcap.writer import WrittenTopic
from palpate.files.message_types import described, written_topic
from palpate.live.stream_buffer import SlotForm

__all__ = ["EVENTS", "READINGS", "event", "record_topics"]

READINGS, EVENTS, POSE, ACCELERATION = 4, 5, 6, 7  # channels behind those of the contacts
_INFO, _WARN = 20, 30
_BASE, _SENSOR = "base", "sensor"  # names of frames
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


def record_topics(form: SlotForm) -> tuple[WrittenTopic, ...]:
    """Return the topics of a record: contacts, readings, events, and with poses also poses and accelerations."""
    if form.images:
        name, kind = "image", "sensor_msgs/Image"
    elif form.wrenches:
        name, kind = "wrench", "geometry_msgs/WrenchStamped"
    else:
        name, kind = "readings", "std_msgs/Float64MultiArray"
    readings = written_topic(form.topic or f"{LIVE}{name}", kind)
    events = WrittenTopic(f"{LIVE}events", "rcl_interfaces/msg/Log", described(_LOG, ["builtin_interfaces/Time"]))
    poses = {LIVE_POSE: "geometry_msgs/PoseStamped", LIVE_ACCELERATION: "geometry_msgs/Vector3Stamped"}
    return (*topics(form.features), readings, events, *(written_topic(*each) for each in poses.items() if form.poses))


class RecordMessages:
    """An encoder of a ring's slots as MCAP messages.

    Sequence numbers are those of samples and sentences, modulo 2^32; a sentence on lost samples has the number 0.

    Args:
        form: description of the ring's samples and contacts.
    """

    def __init__(self, form: SlotForm) -> None:
        self._form, self._contacts = form, ContactMessages(form.frame, form.features)
        self._readings = ChannelRows(READINGS, *_fields(form))
        self._pose = ChannelRows(POSE, *stamped(_BASE, POSE_FIELDS))
        self._acceleration = ChannelRows(ACCELERATION, *stamped(_SENSOR, (("vector", "<f8", (3,)),)))

    def of(self, slots: np.ndarray, first: int) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the bytes (uint8) of all messages of some samples, and a structured view of them for each channel.

        Args:
            slots: (n,) slots of the ring, in order.
            first: number of the first sample.
        """
        contacts = self._form.contacts(slots)
        times = slots["stamp"].clip(0, LATEST)
        answers, views = self._contacts.of(contacts, times[contacts.sample - first])
        posed = np.isfinite(slots["orientation"]).all(axis=1) & self._form.poses
        moved = np.isfinite(slots["acceleration"]).all(axis=1) & self._form.poses
        stamps = [times[which] for which in (slice(None), posed, moved)]
        raw, (readings, pose, acceleration) = made([self._readings, self._pose, self._acceleration], stamps)
        readings["sequence"] = (first + np.arange(len(slots))) % 2**32
        if self._form.wrenches:
            readings["force"], readings["torque"] = slots["values"][:, :3], slots["values"][:, 3:]
        else:
            readings["data"] = slots["values"].reshape(len(slots), -1)
        pose["position"], pose["orientation"] = slots["position"][posed], slots["orientation"][posed]
        acceleration["vector"] = slots["acceleration"][moved]
        parts, views = [answers, raw], [*views, readings, pose, acceleration]
        if len(gaps := np.flatnonzero(slots["lost"])):
            warned, view = event(int(times[gaps[0]]), _missing(slots["lost"], gaps, first), 0, _WARN)
            parts, views = [*parts, warned], [*views, view]
        return np.concatenate(parts), views


def event(stamp: int, sentence: str, number: int, level: int = _INFO) -> tuple[np.ndarray, np.ndarray]:
    """Return the message of a sentence as bytes (uint8), and a structured view of them, (1,).

    Args:
        stamp: [ns] time of the sentence.
        sentence: the sentence.
        number: its number from 1, or 0.
        level: level of rcl_interfaces/Log: 20 for information, 30 for a warning.
    """
    texts, said = _texts({"name": "palpate live", "msg": sentence, "file": "", "function": ""})
    fields: Fields = (("sec", "<i4", ()), ("nanosec", "<u4", ()), ("level", "u1", ()), *texts, ("line", "<u4", ()))
    raw, views = made([ChannelRows(EVENTS, fields, {"level": level, **said})], [np.array([stamp], dtype=np.int64)])
    views[0]["sequence"] = number % 2**32
    return raw, views[0]


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
