"""Read joint commands or positions from a log of columns or topics."""

from __future__ import annotations

from dataclasses import replace
from math import prod
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.files.logs.joints import JOINTS
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.files.logs.numbering import matching
from palpate.files.logs.opening import contents, read_recording, survey, topic_fields, topic_shapes
from palpate.files.logs.topics import NONE
from palpate.files.units import near
from palpate.signals.recording import Recording

JOINT_VALUES = "joints"  # channel of the recording, (n, k) rad or m


def read_joint_motion(path: Path, source: str) -> tuple[Recording, tuple[str, ...]]:
    """Return a `Recording` with the channel `JOINT_VALUES`, and the names of its joints, () where there are none.

    Args:
        path: of the log.
        source: pattern of columns in which * is any text, such as "command_*", an array or column of lists; or a topic
            of joint states or arrays, or with a field path, such as "/arm:points[0].positions".

    Raises:
        InputError: the log cannot be read, or has no such columns, topic or field.
    """
    there, names, topic = contents(path), tuple[str, ...](), None
    field: str | tuple[str, ...] = source
    if there.names:
        shape = there.names.get(source, ())
        field = source if shape else tuple(matching(source, there.names))
        count = prod(shape) if shape else len(field)
    else:
        topic, _, field = source.partition(":")
        kinds = {each.name: each.kind for each in there.topics}
        if kinds.get(topic) == JOINTS:
            found, field = survey(path), "position"
            names = tuple(found.joints.get(topic, ())) if found else ()
            count = len(names)
        else:
            count = prod(topic_shapes(path).get(topic, (0,))) or topic_fields(path).get((topic, field), 0)
    if not count:
        hint = near(source, there.names or [each.name for each in there.topics])
        raise InputError(f"has no columns or topic {source!r} of joints.", where=str(path), hint=hint)
    channel = ArrayChannel(JOINT_VALUES, (count,), columns=field or None, topic=topic)
    recording = read_recording(path, LogLayout(wrench=None, arrays=(channel,), orientation_topic=NONE))
    values = recording.channels[JOINT_VALUES]
    known = np.isfinite(recording.time) & np.isfinite(values).all(axis=1)
    return replace(recording, time=recording.time[known], channels={JOINT_VALUES: values[known]}), names
