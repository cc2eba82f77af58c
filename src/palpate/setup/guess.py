"""Write the parts of a rig's text that follow from a log for any sensor."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from palpate.files.logs import LogContents, open_log, topic_fields, topic_shapes
from palpate.files.logs.decoding import role
from palpate.files.logs.layout import ORIENTATION_COLUMNS, LogLayout
from palpate.files.logs.topics import is_result
from palpate.setup.makers import NamedPose
from palpate.surfaces.collada import ColladaAsset
from palpate.surfaces.mesh import UNITS, Mesh, plausible_size, unit_named

__all__ = [
    "array_topic",
    "field_topic",
    "frames_table",
    "imu_topics",
    "mesh_size",
    "orientation_table",
    "pose_table",
    "quoted",
    "time_table",
    "time_unit",
    "topics_of",
]

_OFFSET = "offset = 0.0                         # s added to their stamps; written by `palpate calibrate clock`"


def quoted(value: str | Sequence[str]) -> str:
    """Return a text, or a list of texts, as TOML: JSON's strings are TOML's, except for DEL."""
    return json.dumps(value if isinstance(value, str) else list(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def topics_of(contents: LogContents, wanted: str) -> list[str]:
    """Return the names of the topics with messages of a role, without Palpate's own results.

    `wanted` is the role: "wrench", "pose", "acceleration", "array" or "image".
    """
    there = [topic for topic in contents.topics if topic.count and role(topic.kind) == wanted]
    return [topic.name for topic in there if not is_result(topic.name)]


def imu_topics(contents: LogContents) -> list[str]:
    """Return the names of the topics with messages of an IMU."""
    return [topic.name for topic in contents.topics if topic.count and topic.kind == "sensor_msgs/Imu"]


def array_topic(
    log: Path, contents: LogContents, fits: Callable[[tuple[int, ...]], bool]
) -> tuple[str, tuple[int, ...]] | None:
    """Return (name, shape) of the first topic in `contents` whose arrays or images have a shape that fits; else None.

    Raises:
        InputError: the log cannot be read.
    """
    there = {topic.name for topic in contents.topics}
    return next(((name, shape) for name, shape in topic_shapes(log).items() if name in there and fits(shape)), None)


def field_topic(
    log: Path, contents: LogContents, fits: Callable[[int], bool]
) -> tuple[str, tuple[str, ...], int] | None:
    """Return (topic, field paths, count) of the longest lists of numbers in messages of types that the log defines.

    None if no count fits; the paths are those of lists with the same count.

    Raises:
        InputError: the log cannot be read.
    """
    there = {topic.name for topic in contents.topics}
    found = {key: count for key, count in topic_fields(log).items() if key[0] in there and fits(count)}
    if not found:
        return None
    topic, count = max(((key[0], count) for key, count in found.items()), key=lambda each: each[1])
    return topic, tuple(path for (name, path), each in found.items() if (name, each) == (topic, count)), count


def commented(line: str, comment: str) -> str:
    """Return a line of a rig with a comment that begins in column 38."""
    return f"{line:<36} # {comment}"


def time_table(column: str, unit: str = "s", rate: float | None = None) -> str:
    """Return the [time] of a rig as TOML; without a column ("") the samples come at the rate [Hz]."""
    lines = [f"column = {quoted(column)}", commented(f'unit = "{unit}"', "s, ms, us, ns, samples")] if column else []
    if rate is not None:
        lines.append(commented(f"rate = {rate:.15g}", "Hz of the samples"))
    return "\n".join(["[time]", *lines]) + "\n\n"


def time_unit(log: Path, column: str) -> tuple[str, list[str]]:
    """Return the unit in which the times in a column of a log are read, and a list of remarks on it.

    Raises:
        InputError: the log cannot be read, or states an unknown unit of the times.
    """
    times = open_log(log, LogLayout(time=column, wrench=None))
    next(times.blocks(), None)
    unit, doubt = times.time_unit
    return unit or "s", [doubt] if doubt else []


def frames_table(base: str, sensor: str, what: str, more: str = "") -> str:
    """Return the [orientation] of a rig for two frames as TOML, with the comment `what` and the lines `more`."""
    return f"[orientation]\nbase = {quoted(base)}\nsensor = {quoted(sensor)}   # {what}\n{more}{_OFFSET}\n"


def pose_table(topics: Sequence[str]) -> str:
    """Return the [orientation] of a rig for the first topic as TOML; commented out without topics."""
    lines = [
        "[orientation]",
        f"topic = {quoted(topics[0] if topics else '/pose')}   # poses of the sensor in the base",
        _OFFSET,
    ]
    return "".join(f"{'' if topics else '# '}{line}\n" for line in lines)


def orientation_table(found: NamedPose | None, *more: str) -> tuple[str, list[str]]:
    """Return the [orientation] of a rig for the columns of a pose as TOML text, and a list of remarks to check.

    `more` are lines of the table, such as of the file that has the columns.
    It is commented out unless the columns are named qx, qy, qz, qw, or as a maker names them, or the numbers show it.
    """
    if found is None:
        return '# [orientation]\n# columns = ["qx", "qy", "qz", "qw"]   # sensor in base: a payload needs it\n', []
    quaternion = found.form == "quaternion"
    order = ": x, y, z, w" * quaternion
    lines = ["[orientation]", *more, f"columns = {quoted(found.orientation)}   # sensor in base{order}"]
    lines += [] if quaternion else [f"form = {quoted(found.form)}"]
    lines += ["inverse = true"] if found.inverse else []
    remarks = [found.remark] if found.remark else []
    if found.position and re.search(r"[\[(_ ](?:mm|cm|um|in)[\])]?$", found.position[0]):
        remarks.append(f"{found.position[0]!r} ... are not read: positions must be in metres")
    elif found.position:
        lines.append(f"position = {quoted(found.position)}   # sensor in base [m]: only for --frame base")
    if found.proven or found.orientation == ORIENTATION_COLUMNS or (found.sure and not quaternion):
        return "\n".join(lines) + "\n", remarks
    remark = f"{found.orientation[0]!r} ... may be the sensor's orientation: it is in the rig as a comment"
    if not found.ordered:
        remark += (
            ", as x, y, z, w, which is assumed: no weight in the force shows the order; for w, x, y, z write "
            'form = "quaternion_wxyz" in [orientation]'
        )
    return "\n".join(f"# {line}" for line in lines) + "\n", [remark, *remarks]


def mesh_size(path: Path) -> tuple[str, float]:
    """Return the unit in which a mesh has a plausible size, "mm" first and "m" if none does, and that size [m].

    A unit that the file states is not guessed.

    Raises:
        InputError: the file is missing or is not a mesh.
        GeometryError: the file has no usable surface.
    """
    if (own := ColladaAsset.of(path).metres) is not None:
        return unit_named(own), Mesh.load(path).size
    raw = Mesh.load(path, unit="m").size
    for unit in ("mm", "m", "cm", "um"):
        size = raw * UNITS[unit]
        if plausible_size(size) and not (unit == "mm" and size > 2.0):
            return unit, size
    return "m", raw
