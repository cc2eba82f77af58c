"""What a log looks like, by the names of its columns, and the pieces of a rig's text that follow for any sensor."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.io.logs import LogContents, topic_shapes
from palpate.io.logs.decoding import role
from palpate.io.logs.layout import ORIENTATION_COLUMNS, POSITION_COLUMNS, WRENCH_COLUMNS
from palpate.surfaces.mesh import UNITS, Mesh

__all__ = [
    "array_topic",
    "mesh_size",
    "orientation_columns",
    "orientation_table",
    "pose_table",
    "position_columns",
    "quoted",
    "time_column",
    "time_table",
    "time_unit",
    "topics_of",
    "wrench_columns",
]

_FORCE = re.compile(r"^(?P<head>.*?)(?:force|f)[\W_]*(?P<axis>[xyz])(?P<tail>(?:[^a-z].*)?)$", re.IGNORECASE)
_TORQUE = re.compile(
    r"^(?P<head>.*?)(?:torque|moment|tau|t|m)[\W_]*(?P<axis>[xyz])(?P<tail>(?:[^a-z].*)?)$", re.IGNORECASE
)
_QUATERNION = re.compile(
    r"^(?P<head>.*?)(?:orientation|rotation|quaternion|quat|rot|q)[\W_]*(?P<axis>[xyzw])(?P<tail>(?:[^a-z].*)?)$",
    re.IGNORECASE,
)
_POSITION = re.compile(
    r"^(?P<head>.*?)(?:position|translation|pos|p)[\W_]*(?P<axis>[xyz])(?P<tail>(?:[^a-z].*)?)$", re.IGNORECASE
)
_TIME = ("time", "timestamp", "t", "stamp", "time_s", "seconds", "sec", "s")
_PLAUSIBLE = (2e-3, 5.0)  # m: from a fingertip to a robot's link
_EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # times of day above these cannot be seconds


def wrench_columns(names: Sequence[str]) -> tuple[str, ...] | None:
    """Six columns, force first, of the first sensor that has all six; None where there is none."""
    if set(WRENCH_COLUMNS) <= set(names):
        return WRENCH_COLUMNS
    forces, torques = _groups(names, _FORCE, "xyz"), _groups(names, _TORQUE, "xyz")
    for head, force in forces.items():
        if head in torques:
            return (*force, *torques[head])
    return None


def time_column(names: Sequence[str]) -> str | None:
    """The column of the time, None where no name says so."""
    lower = {name.lower(): name for name in reversed(names)}
    for usual in _TIME:
        if usual in lower:
            return lower[usual]
    return next((name for name in names if "time" in name.lower() or "stamp" in name.lower()), None)


def orientation_columns(names: Sequence[str]) -> tuple[str, ...] | None:
    """Four columns x, y, z, w of a quaternion."""
    if set(ORIENTATION_COLUMNS) <= set(names):
        return ORIENTATION_COLUMNS
    return next(iter(_groups(names, _QUATERNION, "xyzw").values()), None)


def position_columns(names: Sequence[str]) -> tuple[str, ...] | None:
    """Three columns of a position."""
    if set(POSITION_COLUMNS) <= set(names):
        return POSITION_COLUMNS
    return next(iter(_groups(names, _POSITION, "xyz").values()), None)


def quoted(value: str | Sequence[str]) -> str:
    """Text or a list of texts; JSON's strings are TOML's, but for DEL."""
    return json.dumps(value if isinstance(value, str) else list(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def topics_of(contents: LogContents, wanted: str) -> list[str]:
    """Names of topics with messages that hold "wrench", "pose", "acceleration" or "array"."""
    return [topic.name for topic in contents.topics if topic.count and role(topic.kind) == wanted]


def array_topic(
    log: Path, contents: LogContents, fits: Callable[[tuple[int, ...]], bool]
) -> tuple[str, tuple[int, ...]] | None:
    """The first topic of arrays or images that have a fitting shape, of those that are considered, and that shape."""
    there = {topic.name for topic in contents.topics}
    return next(((name, shape) for name, shape in topic_shapes(log).items() if name in there and fits(shape)), None)


def time_table(column: str, unit: str) -> str:
    """[time]."""
    return f'[time]\ncolumn = {quoted(column)}\nunit = "{unit}"                         # s, ms, us, ns\n\n'


def time_unit(time: Float[np.ndarray, " n"]) -> str:
    """Times of day in finer units are too large for seconds."""
    largest = np.nanmax(np.abs(time), initial=0.0)
    return next((unit for limit, unit in _EPOCHS if largest > limit), "s")


def pose_table(topics: Sequence[str]) -> str:
    """[orientation] from a topic of poses; a comment where there is none."""
    lines = [
        "[orientation]",
        f"topic = {quoted(topics[0] if topics else '/pose')}   # poses of the sensor in the base",
        "offset = 0.0                         # s added to their stamps; written by `palpate calibrate clock`",
    ]
    return "".join(f"{'' if topics else '# '}{line}\n" for line in lines)


def orientation_table(names: Sequence[str]) -> tuple[str, list[str]]:
    """[orientation] from columns, as a comment where only their names are like it; and what to check."""
    quaternion, position = orientation_columns(names), position_columns(names)
    if quaternion is None:
        return '# [orientation]\n# columns = ["qx", "qy", "qz", "qw"]   # sensor in base: a payload needs it\n', []
    lines = ["[orientation]", f"columns = {quoted(quaternion)}   # sensor in base: x, y, z, w"]
    if position is not None:
        lines.append(f"position = {quoted(position)}   # sensor in base [m]: only for --frame base")
    if quaternion == ORIENTATION_COLUMNS:
        return "\n".join(lines) + "\n", []
    remark = f"{quaternion[0]!r} ... may be the sensor's orientation: it stands in the rig as a comment"
    return "\n".join(f"# {line}" for line in lines) + "\n", [remark]


def mesh_size(path: Path) -> tuple[str, float]:
    """The unit that makes the body as large as a body is, millimetres before others, and its size [m]."""
    raw = Mesh.load(path, unit="m").size
    for unit in ("mm", "m", "cm", "um"):
        if _PLAUSIBLE[0] <= raw * UNITS[unit] <= (2.0 if unit == "mm" else _PLAUSIBLE[1]):
            return unit, raw * UNITS[unit]
    return "m", raw


def _groups(names: Iterable[str], pattern: re.Pattern[str], axes: str) -> dict[str, tuple[str, ...]]:
    """What comes before the word -> its columns in the order of the axes, where all axes are there."""
    found: dict[str, dict[str, str]] = {}
    for name in names:
        if match := pattern.match(name):
            found.setdefault(match["head"].lower(), {}).setdefault(match["axis"].lower(), name)
    return {head: tuple(group[axis] for axis in axes) for head, group in found.items() if set(axes) <= set(group)}
