"""Does a log look like frames of a sheet of taxels, and how are they read?"""

from __future__ import annotations

import math
from pathlib import Path

from palpate.io.logs import LogContents, topic_shapes
from palpate.io.logs.guess import guess_orientation, guess_position, guess_time, guess_wrench
from palpate.io.logs.layout import ArrayChannel, Layout
from palpate.io.rig.kind import Guess
from palpate.io.rig.words import orientation_table, pose_table, quoted, time_table, topics_of
from palpate.sensors.recording import CELLS

__all__ = ["guess_skin"]

RATE = 100.0  # Hz
FEWEST = 16  # cells: fewer columns of numbers can be anything
_TEXT = """\
[skin]
map = "skin_map.toml"                # written by: palpate map skin MESH --sheet {rows}x{columns} ...
rows = {rows}
columns = {columns}
bits = {bits}                             # of a whole-number reading; 0: readings are floats
# intensity = "intensity.toml"       # written by: palpate calibrate intensity; without it a count is taken for 1 N
{where}# tare = 1.0                         # s: the log starts so long untouched

[contacts]
on = 6.0                             # a touch begins where a cell stands so many deviations of its noise above its rest
off = 3.0                            # and reaches as far as cells that stand so many above

"""


def guess_skin(log: Path, contents: LogContents, mesh: Path | None) -> Guess | None:
    """Images, arrays of frames, or many columns of numbers beside a time."""
    del mesh
    if contents.topics:
        return _of_topic(log, contents)
    frames = [(name, shape) for name, shape in contents.names.items() if math.prod(shape) >= FEWEST]
    if frames:
        name, shape = frames[0]
        return _of_array(name, _sheet(shape))
    there = list(contents.names)
    time = guess_time(there)
    known = {time, *(guess_orientation(there) or ()), *(guess_position(there) or ())}
    cells = tuple(name for name in there if name not in known)
    if time is None or len(cells) < FEWEST or guess_wrench(there) is not None:
        return None
    shape = _sheet((len(cells),))
    orientation, _ = orientation_table(there)
    named = "" if len(known) == 1 else f"cells = {quoted(cells)}\n"
    layout = Layout(time=time, wrench=None, arrays=(ArrayChannel(CELLS, shape, cells, table="skin"),))
    why = f"{len(cells)} columns beside the time look like cells"
    return _guess(shape, why, layout, named, (time_table(time, "s"), orientation))


def _of_array(name: str, shape: tuple[int, int]) -> Guess:
    array = ArrayChannel(CELLS, shape, table="skin")
    layout = Layout(wrench=None, arrays=(array,), rate=RATE)
    where = f"rate = {RATE:g}                        # Hz, of frames without times: it is not known, correct it\n"
    return _guess(shape, f"array {name!r} holds frames", layout, where, ("", ""))


def _of_topic(log: Path, contents: LogContents) -> Guess | None:
    fitting = {name: shape for name, shape in topic_shapes(log).items() if math.prod(shape) >= FEWEST}
    if not fitting:
        return None
    (topic, size), *_ = fitting.items()
    shape, poses = _sheet(size), topics_of(contents, "pose")
    layout = Layout(wrench=None, arrays=(ArrayChannel(CELLS, shape, None, topic, table="skin"),))
    why = f"topic {topic!r} holds {'images' if len(size) == 2 else 'arrays'} of {' x '.join(map(str, size))} numbers"
    return _guess(shape, why, layout, f"topic = {quoted(topic)}\n", ("", pose_table(poses)))


def _guess(shape: tuple[int, int], why: str, layout: Layout, where: str, around: tuple[str, str]) -> Guess:
    rows, columns = shape
    text = around[0] + _TEXT.format(rows=rows, columns=columns, bits=8, where=where) + around[1]
    return Guess(
        why, layout, text, (f"check the sheet's {rows} rows and {columns} columns, and the bits of a reading",)
    )


def _sheet(shape: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns; of so many numbers in a row, as near to a square as can be."""
    if len(shape) == 2:
        return shape[0], shape[1]
    count = math.prod(shape)
    rows = next(k for k in range(int(count**0.5), 0, -1) if count % k == 0)
    return rows, count // rows
