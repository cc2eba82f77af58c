"""Choose the topics of a log to read: those that the rig names, else the only ones of their kind."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.errors import InputError
from palpate.files.logs.decoding import ARRAYS, FIXED, IMAGE, role
from palpate.files.logs.image_messages import IMAGES
from palpate.files.logs.layout import ArrayChannel, ImageChannel, LogLayout
from palpate.files.logs.log import LogContents
from palpate.files.logs.message_fields import field_of
from palpate.files.messages import Topic
from palpate.files.units import near

_ENCODINGS = ("cdr", "ros1")
_SHOWN = 12  # topics in a sentence
_DOUBLES = "std_msgs/Float64MultiArray"
LIVE = "/palpate/live/"  # prefix of topics of a live record
LIVE_BOTH = f"{LIVE}cells_and_wrench"  # a row a frame: its numbers, the wrench, of how many readings that is the mean
LIVE_POSE, LIVE_ACCELERATION = f"{LIVE}pose", f"{LIVE}acceleration"  # one of these stands beside each reading


@dataclass(frozen=True)
class _Wanted:
    """A topic to look for, the array it must hold, and the table of the rig that may name it."""

    role: str
    table: str
    read: str
    array: ArrayChannel | None = None

    @property
    def called(self) -> str:
        return self.role if self.array is None else self.array.name

    def fits(self, topic: Topic) -> bool:
        if self.role == "image":
            return topic.encoding in _ENCODINGS and topic.kind in IMAGES
        if self.array is not None and isinstance(self.array.columns, str) and topic.kind not in ARRAYS:
            return topic.encoding in _ENCODINGS and field_of(topic, self.array.columns, self.array.axes) is not None
        flat = self.array is not None and (len(self.array.shape) != 2 or bool(self.array.axes))
        return topic.encoding in _ENCODINGS and role(topic.kind) == self.role and not (flat and topic.kind == IMAGE)


def _kinds(of: str) -> str:
    return ", ".join(name.split("/")[1] for name, kind in FIXED.items() if kind.role == of)


NONE = "none"
POSE_KINDS = (
    f"Poses are read from {_kinds('pose')}; and from the tree of /tf if the rig's [orientation] names two frames, base "
    "and sensor."
)
_WRENCH = _Wanted("wrench", "force_torque", f"Wrenches are read from {_kinds('wrench')}.")
_POSE = _Wanted("pose", "orientation", POSE_KINDS)
_TEMPERATURE = _Wanted("temperature", "drift", f"Temperatures are read from {_kinds('temperature')}.")
_ACCELERATION = _Wanted("acceleration", "acceleration", f"Accelerations are read from {_kinds('acceleration')}.")


def main_channel(layout: LogLayout) -> ArrayChannel | None:
    """Return the channel whose messages are the rows of a log of topics: the array; None if only wrenches are read.

    Raises:
        InputError: the layout requests several arrays, whose messages have different times, or nothing, or images.
    """
    asked = [*([None] if layout.wrench is not None else []), *layout.arrays]
    if layout.images is None and asked and len(layout.arrays) <= 1:
        return asked[-1]
    said = ["wrench" if array is None else array.name for array in asked] + ["image"] * (layout.images is not None)
    names = " and ".join(said) or "nothing"
    hint = "Write them as a table with one row per time: samples of several topics are not joined."
    raise InputError(f"{names} cannot be read from one log of topics.", where="layout", hint=hint)


def choose(there: LogContents, layout: LogLayout) -> dict[str, Topic]:
    """Return role -> topic: "main" (wrench or array), "wrench" next to an array, "pose" and others.

    "both" replaces the first two if a live record has array and wrench in one message. "pose", "acceleration" and
    "temperature" may be missing; "pose" is if several topics hold poses and none is named.

    Raises:
        InputError: a named topic does not exist or has another type; no topic or several could be "main" or "wrench";
            or the layout requests several arrays, nothing, or images.
    """
    array = main_channel(layout)
    own = layout.wrench_topic if array is None else array.topic
    beside, pushed = array is not None and layout.wrench is not None, _recorded(there, LIVE_ACCELERATION, own)
    if beside and (both := _recorded(there, LIVE_BOTH, own)) is not None:
        chosen = {"both": both, "pose": _recorded(there, LIVE_POSE, both.name), "acceleration": pushed}
    else:
        main = _required(there, _WRENCH if array is None else _wanted(array), own)
        chosen = {
            "main": main,
            "pose": _pose(there, layout, main.name),
            "acceleration": pushed or _named(there, _ACCELERATION, layout.acceleration_topic),  # it may sit anywhere
            "temperature": _named(there, _TEMPERATURE, layout.temperature),
            "wrench": _required(there, _WRENCH, layout.wrench_topic) if beside else None,
        }
    return {role: topic for role, topic in chosen.items() if topic is not None}


def choose_images(there: LogContents, channel: ImageChannel) -> Topic:
    """Return the topic of images that the channel names, or the only one.

    Raises:
        InputError: the named topic does not exist or holds no images; or none is named, and not exactly one does.
    """
    kinds = ", ".join(name.split("/")[1] for name in IMAGES)
    return _required(there, _Wanted("image", channel.table, f"Images are read from {kinds}."), channel.topic)


def _required(there: LogContents, wanted: _Wanted, name: str | None) -> Topic:
    """Return the topic called `name`, or the only one of its kind."""
    found = _named(there, wanted, name) or _only(there, wanted)
    if found is None:
        listed = ", ".join(f"{t.name} ({t.kind or 'of no type'}, {t.count:,})" for t in there.topics[:_SHOWN])
        held = wanted.called if wanted.array is not None else f"{wanted.called}{'es' if wanted is _WRENCH else 's'}"
        what = f"no topic holds {held}; the log has {listed or 'no topics'}."
        raise InputError(what, where=str(there.path), hint=sentence(there.torn) or wanted.read)
    return found


def _pose(there: LogContents, layout: LogLayout, main: str) -> Topic | None:
    if layout.orientation_topic == NONE:
        return None
    if (recorded := _recorded(there, LIVE_POSE, main)) is not None or layout.frames is not None:
        return recorded
    named = _named(there, _POSE, layout.orientation_topic)
    return named if named is not None or doubtful(there, layout) else _only(there, _POSE)


def doubtful(there: LogContents, layout: LogLayout) -> list[str]:
    """Return the names of topics of poses of which none is used, as none of several is named; else []."""
    if layout.orientation_topic is not None or layout.frames is not None or _recorded(there, LIVE_POSE, None):
        return []
    fitting = [topic.name for topic in there.topics if _meant(topic, _POSE)]
    return fitting if len(fitting) > 1 else []


def sentence(torn: str) -> str:
    """Return a remark as a sentence, with a capital letter and a full stop; "" stays ""."""
    return torn and f"{torn[0].upper()}{torn[1:]}."


def _wanted(array: ArrayChannel) -> _Wanted:
    kinds = ", ".join(name.split("/")[1] for name in ARRAYS)
    image = ", or an Image of one channel" if len(array.shape) == 2 and not array.axes else ""
    read = f"Arrays are read from {kinds}{image}, of {array.described} numbers each."
    return _Wanted("array", array.table, read, array)


def _named(there: LogContents, wanted: _Wanted, name: str | None) -> Topic | None:
    """Return the topic that the rig names; None if it names none."""
    if name is None:
        return None
    found = [topic for topic in there.topics if topic.name == name]
    if not found:
        hint = near(name, (topic.name for topic in there.topics))
        raise InputError(f"there is no topic {name!r}.", where=str(there.path), hint=hint)
    fitting = next((topic for topic in found if wanted.fits(topic)), None)
    if fitting is None:
        kind, encoding = found[0].kind or "messages of no type", found[0].encoding or "no encoding"
        what = f"topic {name!r} holds {kind} ({encoding}), which does not fit."
        raise InputError(what, where=str(there.path), hint=wanted.read)
    return fitting


def _only(there: LogContents, wanted: _Wanted) -> Topic | None:
    """Return the only fitting topic, or None; live records and lists of doubles are preferred."""
    fitting = [topic for topic in there.topics if _meant(topic, wanted)]
    fitting = [topic for topic in fitting if topic.name.startswith(LIVE)] or fitting
    if wanted.array is not None and len(wanted.array.shape) == 1:
        fitting = [topic for topic in fitting if topic.kind == _DOUBLES] or fitting
    if len(fitting) > 1:
        what = f"{len(fitting)} topics hold a {wanted.called}: {', '.join(topic.name for topic in fitting)}."
        hint = f"Name one in the rig, as topic in [{wanted.table}], or with --topic."
        raise InputError(what, where=str(there.path), hint=hint)
    return fitting[0] if fitting else None


def _meant(topic: Topic, wanted: _Wanted) -> bool:
    """Check whether a topic may be used where none is named."""
    own = topic.name.startswith((f"{LIVE_POSE}/", f"{LIVE_ACCELERATION}/"))  # of one sensor of a robot
    return wanted.fits(topic) and topic.count > 0 and not own and not is_result(topic.name)


def _recorded(there: LogContents, name: str, of: str | None) -> Topic | None:
    """Return a topic of a live record: `name`, or with the name of the sensor's own topic, `of`, after it."""
    names = (name, f"{name}{of}")
    return next((topic for topic in there.topics if topic.name in names and topic.count), None)


def is_result(name: str) -> bool:
    """Return whether a topic of this name is of contacts: a result, not readings."""
    return name.startswith("/palpate/") and not name.startswith(LIVE)
