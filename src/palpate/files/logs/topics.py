"""Which topics of a log are read: those that the rig names, else the only ones of their kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from palpate.errors import InputError
from palpate.files.logs.decoding import ARRAYS, FIXED, IMAGE, role
from palpate.files.logs.image_messages import IMAGES
from palpate.files.logs.layout import ArrayChannel, ImageChannel, LogLayout
from palpate.files.logs.log import LogContents, Topic
from palpate.files.units import near

__all__ = [
    "LIVE",
    "LIVE_ACCELERATION",
    "LIVE_BOTH",
    "LIVE_POSE",
    "NONE",
    "POSE_KINDS",
    "RESULTS",
    "choose",
    "choose_images",
    "doubtful",
    "main_channel",
    "sentence",
]

_ENCODINGS = ("cdr", "ros1")
_SHOWN = 12  # topics in a sentence
_DOUBLES = "std_msgs/Float64MultiArray"
RESULTS = "/palpate/contact/"  # what topics of contacts begin with: they are what was made of readings, and none
LIVE = "/palpate/live/"  # what topics of a live record begin with
LIVE_BOTH = f"{LIVE}cells_and_wrench"  # a row a frame: its numbers, the wrench, of how many readings that is the mean
LIVE_POSE, LIVE_ACCELERATION = f"{LIVE}pose", f"{LIVE}acceleration"  # one of these stands beside each reading


@dataclass(frozen=True)
class _Wanted:
    """A topic that is looked for: for what role, for which array, and the table of the rig that may name it."""

    role: str
    table: str
    read: str
    array: ArrayChannel | None = None

    @property
    def called(self) -> str:
        """What messages hold, in a sentence."""
        return self.role if self.array is None else self.array.name

    def fits(self, topic: Topic) -> bool:
        """Whether its messages can be read for it; an image is two-dimensional."""
        if self.role == "image":
            return topic.encoding in _ENCODINGS and topic.kind in IMAGES
        flat = self.array is not None and len(self.array.shape) != 2
        return topic.encoding in _ENCODINGS and role(topic.kind) == self.role and not (flat and topic.kind == IMAGE)


def _kinds(of: str) -> str:
    return ", ".join(name.split("/")[1] for name, kind in FIXED.items() if kind.role == of)


NONE = "none"
POSE_KINDS = (
    f"Poses are read from {_kinds('pose')}; from the tree of /tf where the rig's [orientation] names two frames, base "
    "and sensor."
)
_WRENCH = _Wanted("wrench", "force_torque", f"Wrenches are read from {_kinds('wrench')}.")
_POSE = _Wanted("pose", "orientation", POSE_KINDS)
_TEMPERATURE = _Wanted("temperature", "drift", f"Temperatures are read from {_kinds('temperature')}.")
_ACCELERATION = _Wanted("acceleration", "acceleration", f"Accelerations are read from {_kinds('acceleration')}.")


def main_channel(layout: LogLayout) -> ArrayChannel | None:
    """What each row of a log of topics is made of: an array, beside which wrenches may stand; or None, the wrench.

    Raises:
        InputError: the layout asks for several arrays, whose messages come at times of their own, or for nothing.
    """
    asked = [*([None] if layout.wrench is not None else []), *layout.arrays]
    if layout.images is None and asked and len(layout.arrays) <= 1:
        return asked[-1]
    said = ["wrench" if array is None else array.name for array in asked] + ["image"] * (layout.images is not None)
    names = " and ".join(said) or "nothing"
    raise InputError(
        f"{names} cannot be read from one log of topics.",
        where="layout",
        hint="Samples of several topics are not joined: write them as a table, a row a time.",
    )


def choose(there: LogContents, layout: LogLayout) -> dict[str, Topic]:
    """What "main" (wrench or array), "wrench" beside an array, "pose", "acceleration", "temperature" are taken from.

    "both": an array with the wrench beside it in one message, as a live record has them.

    The last three as far as they are there; none of several topics of poses, as long as none is named (`doubtful`).

    Raises:
        InputError: a topic that is named is not there or holds something else, or several of wrenches could be meant.
    """
    array, topics, path = main_channel(layout), there.topics, there.path
    if array is not None and layout.wrench is not None and (both := _recorded(topics, LIVE_BOTH)) is not None:
        pose, pushed = _recorded(topics, LIVE_POSE), _recorded(topics, LIVE_ACCELERATION)
        return {"both": both} | ({"pose": pose} if pose else {}) | ({"acceleration": pushed} if pushed else {})
    main = _WRENCH if array is None else _wanted(array)
    rows = _required(there, main, layout.wrench_topic if array is None else array.topic)
    pose = _pose(topics, layout, path)
    acceleration = _recorded(topics, LIVE_ACCELERATION) or _named(
        topics, _ACCELERATION, layout.acceleration_topic, path
    )  # an accelerometer may sit anywhere
    temperature = _named(topics, _TEMPERATURE, layout.temperature, path)
    beside = _required(there, _WRENCH, layout.wrench_topic) if array is not None and layout.wrench is not None else None
    chosen = {"main": rows, "wrench": beside, "pose": pose, "acceleration": acceleration, "temperature": temperature}
    return {role: topic for role, topic in chosen.items() if topic is not None}


def choose_images(there: LogContents, channel: ImageChannel) -> Topic:
    """The topic of images.

    Raises:
        InputError: a topic that is named is not there or holds something else, or none or several could be meant.
    """
    kinds = ", ".join(name.split("/")[1] for name in IMAGES)
    return _required(there, _Wanted("image", channel.table, f"Images are read from {kinds}."), channel.topic)


def _required(there: LogContents, wanted: _Wanted, name: str | None) -> Topic:
    """The topic that is named, or the only one of its kind."""
    topics, path = there.topics, there.path
    found = _named(topics, wanted, name, path) or _only(topics, wanted, path)
    if found is None:
        listed = ", ".join(f"{t.name} ({t.kind or 'of no type'}, {t.count:,})" for t in topics[:_SHOWN])
        held = wanted.called if wanted.array is not None else f"{wanted.called}{'es' if wanted is _WRENCH else 's'}"
        raise InputError(
            f"no topic holds {held}; there is {listed or 'no topic at all'}.",
            where=str(path),
            hint=sentence(there.torn) or wanted.read,
        )
    return found


def _pose(topics: Sequence[Topic], layout: LogLayout, path: Path) -> Topic | None:
    if layout.orientation_topic == NONE:
        return None
    if (recorded := _recorded(topics, LIVE_POSE)) is not None or layout.frames is not None:
        return recorded
    named = _named(topics, _POSE, layout.orientation_topic, path)
    return named if named is not None or doubtful(topics, layout) else _only(topics, _POSE, path)


def doubtful(topics: Sequence[Topic], layout: LogLayout) -> list[str]:
    """Topics of poses none of which is taken, because there are several and none is named."""
    if layout.orientation_topic is not None or layout.frames is not None or _recorded(topics, LIVE_POSE):
        return []
    fitting = [topic.name for topic in topics if _meant(topic, _POSE)]
    return fitting if len(fitting) > 1 else []


def sentence(torn: str) -> str:
    """As a sentence of its own."""
    return torn and f"{torn[0].upper()}{torn[1:]}."


def _wanted(array: ArrayChannel) -> _Wanted:
    kinds = ", ".join(name.split("/")[1] for name in ARRAYS)
    image = ", or an Image of one channel" if len(array.shape) == 2 else ""
    read = f"It is read from {kinds}{image}, of {array.described} numbers each."
    return _Wanted("array", array.table, read, array)


def _named(topics: Sequence[Topic], wanted: _Wanted, name: str | None, path: Path) -> Topic | None:
    """The topic that the rig names."""
    if name is None:
        return None
    found = [topic for topic in topics if topic.name == name]
    if not found:
        raise InputError(f"there is no topic {name!r}.", where=str(path), hint=near(name, (t.name for t in topics)))
    fitting = [topic for topic in found if wanted.fits(topic)]
    if not fitting:
        raise InputError(
            f"topic {name!r} holds {found[0].kind or 'messages of no type'} ({found[0].encoding or 'no encoding'}).",
            where=str(path),
            hint=wanted.read,
        )
    return fitting[0]


def _only(topics: Sequence[Topic], wanted: _Wanted, path: Path) -> Topic | None:
    """The only topic with messages of a fitting type; a list of numbers is one of doubles where there is one.

    A live record's own comes before others.
    """
    fitting = [topic for topic in topics if _meant(topic, wanted)]
    fitting = [topic for topic in fitting if topic.name.startswith(LIVE)] or fitting
    if wanted.array is not None and len(wanted.array.shape) == 1:
        fitting = [topic for topic in fitting if topic.kind == _DOUBLES] or fitting
    if len(fitting) > 1:
        raise InputError(
            f"{len(fitting)} topics hold a {wanted.called}: {', '.join(topic.name for topic in fitting)}.",
            where=str(path),
            hint=f"Name one in the rig, as topic in [{wanted.table}], or with --topic.",
        )
    return fitting[0] if fitting else None


def _meant(topic: Topic, wanted: _Wanted) -> bool:
    """Whether it may be meant where no topic is named."""
    return wanted.fits(topic) and topic.count > 0 and not topic.name.startswith(RESULTS)


def _recorded(topics: Sequence[Topic], name: str) -> Topic | None:
    """What a live record holds beside its readings: it comes before what a rig names for other logs."""
    return next((topic for topic in topics if topic.name == name and topic.count), None)
