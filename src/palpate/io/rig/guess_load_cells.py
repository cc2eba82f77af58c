"""Does a log look like voltages of 3-axis load cells, and how are they read?"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from palpate.io.logs import LogContents, topic_shapes
from palpate.io.logs.guess import guess_time, guess_wrench
from palpate.io.logs.layout import ArrayChannel, Layout
from palpate.io.rig.kind import Guess
from palpate.io.rig.words import orientation_table, pose_table, quoted, time_table, topics_of
from palpate.sensors.recording import VOLTAGE

__all__ = ["guess_load_cells"]

_CELL = re.compile(r"^(?P<head>u|v|ch|cell|volt(?:age)?s?|ai)[\W_]*\d+[\W_]*[xyz]?$", re.IGNORECASE)
_MOST = 36  # channels: twelve cells; more are a skin
_TEXT = """\
[load_cells]
{where}
units = "V"                          # of the voltages: V, mV, uV
# model = "load_cells.toml"          # written by: palpate calibrate load-cells
# positions = [[0, 0, 0], ...]       # m, of each cell in the surface's frame, as far as they are known
# range = 5.0                        # V: a reading at it is saturated

"""


def guess_load_cells(log: Path, contents: LogContents, mesh: Path | None) -> Guess | None:
    """Three columns a cell of three or more, or arrays of so many numbers."""
    del mesh
    if contents.topics:
        return _of_topic(log, contents)
    there = list(contents.names)
    names, time = voltage_columns(there), guess_time(there)
    if names is None or time is None or guess_wrench(there) is not None:
        return None
    text = time_table(time, "s") + _TEXT.format(where=f"columns = {quoted(names)}")
    orientation, remarks = orientation_table(there)
    why = f"{len(names)} columns {names[0]} to {names[-1]} look like three voltages for each of {len(names) // 3} cells"
    layout = Layout(time=time, wrench=None, arrays=(ArrayChannel(VOLTAGE, (len(names),), names, table="load_cells"),))
    return Guess(why, layout, text + orientation, (*remarks, _ORDER))


_ORDER = "columns must be x, y, z of cell 1, then of cell 2, and so on, as they were calibrated"


def voltage_columns(names: Sequence[str]) -> tuple[str, ...] | None:
    """Columns named like voltages of cells, three each of at least three; None where there are none."""
    heads: dict[str, list[str]] = {}
    for name in names:
        if match := _CELL.match(name):
            heads.setdefault(match["head"].lower(), []).append(name)
    found = max(heads.values(), key=len, default=list[str]())
    return tuple(found) if 9 <= len(found) <= _MOST and len(found) % 3 == 0 else None


def _of_topic(log: Path, contents: LogContents) -> Guess | None:
    shapes = {name: shape[0] for name, shape in topic_shapes(log).items() if len(shape) == 1}
    fitting = {name: count for name, count in shapes.items() if 9 <= count <= _MOST and count % 3 == 0}
    if not fitting:
        return None
    (topic, count), *_ = fitting.items()
    text = _TEXT.format(where=f"topic = {quoted(topic)}") + pose_table(topics_of(contents, "pose"))
    why = f"topic {topic!r} holds arrays of {count} numbers, three for each of {count // 3} cells"
    array = ArrayChannel(VOLTAGE, (count,), None, topic, table="load_cells")
    return Guess(why, Layout(wrench=None, arrays=(array,)), text, (_ORDER,))
