"""Which topics of a log are read: those that the rig names, else the only ones of their kind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from palpate.errors import InputError
from palpate.io.logs.layout import Layout
from palpate.io.logs.messages import ARRAYS, KINDS, Source, Topic
from palpate.io.units import near

__all__ = ["READ", "choose", "sentence"]

_READ = {**KINDS, **ARRAYS}
_ENCODINGS = ("cdr", "ros1")
_SHOWN = 12  # topics in a sentence


def choose(source: Source, layout: Layout, path: Path) -> dict[str, Topic]:
    """What "wrench" (or "voltage", where load cells are read), "pose" and "acceleration" are taken from.

    The last two as far as they are there.

    Raises:
        InputError: a topic that is named is not there or holds something else, or several could be meant.
    """
    topics = source.topics()
    role = "voltage" if layout.voltages else "wrench"
    name = layout.voltage_topic if layout.voltages else layout.wrench_topic
    wrench = _named(topics, role, name, path) or _only(topics, role, path)
    if wrench is None:
        listed = ", ".join(f"{t.name} ({t.kind or 'of no type'}, {t.count:,})" for t in topics[:_SHOWN])
        raise InputError(
            f"no topic holds {_MANY[role]}; {f'there is {listed}' if listed else 'there is no topic at all'}.",
            where=str(path),
            mend=sentence(source.torn) or READ[role],
        )
    pose = _named(topics, "pose", layout.orientation_topic, path) or _only(topics, "pose", path)
    acceleration = _named(topics, "acceleration", layout.acceleration_topic, path)  # an accelerometer may sit anywhere
    chosen = {role: wrench, "pose": pose, "acceleration": acceleration}
    return {role: topic for role, topic in chosen.items() if topic is not None}


def sentence(torn: str) -> str:
    """As a sentence of its own."""
    return torn and f"{torn[0].upper()}{torn[1:]}."


def _named(topics: Sequence[Topic], role: str, name: str | None, path: Path) -> Topic | None:
    """The topic that the rig names."""
    if name is None:
        return None
    found = [topic for topic in topics if topic.name == name]
    if not found:
        raise InputError(f"there is no topic {name!r}.", where=str(path), mend=near(name, (t.name for t in topics)))
    fitting = [topic for topic in found if _fits(topic, role)]
    if not fitting:
        raise InputError(
            f"topic {name!r} holds {found[0].kind or 'messages of no type'} ({found[0].encoding or 'no encoding'}).",
            where=str(path),
            mend=READ[role],
        )
    return fitting[0]


def _only(topics: Sequence[Topic], role: str, path: Path) -> Topic | None:
    """The only topic with messages of a fitting type."""
    fitting = [topic for topic in topics if _fits(topic, role) and topic.count]
    if len(fitting) > 1:
        raise InputError(
            f"{len(fitting)} topics hold a {role}: {', '.join(topic.name for topic in fitting)}.",
            where=str(path),
            mend=f"Name one in the rig, as topic in [{_TABLES[role]}].",
        )
    return fitting[0] if fitting else None


def _fits(topic: Topic, role: str) -> bool:
    return topic.kind in _READ and _READ[topic.kind].role == role and topic.encoding in _ENCODINGS


def _kinds(role: str) -> str:
    return ", ".join(name.split("/")[1] for name, kind in _READ.items() if kind.role == role)


_MANY = {"wrench": "wrenches", "voltage": "voltages"}
_TABLES = {"wrench": "force_torque", "pose": "orientation", "acceleration": "acceleration", "voltage": "load_cells"}
READ = {
    "wrench": f"Wrenches are read from {_kinds('wrench')}.",
    "pose": f"Poses are read from {_kinds('pose')}; not from the tree of /tf, so record the sensor's pose on a topic.",
    "acceleration": f"Accelerations are read from {_kinds('acceleration')}.",
    "voltage": f"Voltages of load cells are read from {_kinds('voltage')}, three a cell.",
}
