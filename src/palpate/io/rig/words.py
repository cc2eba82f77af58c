"""Pieces of a rig's text that every kind of sensor needs: time, orientation, names in quotes, the unit of a mesh."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.io.logs import LogContents
from palpate.io.logs.decoding import role
from palpate.io.logs.guess import guess_orientation, guess_position
from palpate.io.logs.layout import ORIENTATION_COLUMNS
from palpate.surfaces.mesh import UNITS, Mesh

__all__ = ["mesh_size", "orientation_table", "pose_table", "quoted", "time_table", "time_unit", "topics_of"]

_PLAUSIBLE = (2e-3, 5.0)  # m: from a fingertip to a robot's link
_EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # times of day above these cannot be seconds


def quoted(value: str | Sequence[str]) -> str:
    """Text or a list of texts; JSON's strings are TOML's, but for DEL."""
    return json.dumps(value if isinstance(value, str) else list(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def topics_of(contents: LogContents, wanted: str) -> list[str]:
    """Names of topics with messages that hold "wrench", "pose", "acceleration" or "array"."""
    return [topic.name for topic in contents.topics if topic.count and role(topic.kind) == wanted]


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
    quaternion, position = guess_orientation(names), guess_position(names)
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
