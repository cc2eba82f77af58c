"""Does a log look like frames of a sheet of taxels, and how are they read?"""

from __future__ import annotations

from pathlib import Path

from palpate.io.logs.contents import LogContents
from palpate.io.logs.guess import guess_orientation, guess_position, guess_time, guess_wrench
from palpate.io.logs.layout import ArrayChannel, Layout
from palpate.io.rig.kind import Guess
from palpate.io.rig.words import orientation_table, pose_table, quoted, time_table
from palpate.sensors.recording import CELLS

__all__ = ["guess_skin"]

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
    """Images, arrays, or many columns of numbers beside a time."""
    del log, mesh
    if contents.topics:
        return _of_topic(contents)
    if (shape := contents.frame_shape()) is not None:
        return _guess(shape, "an array of frames of {} x {} cells", "", "", Layout(wrench=None))
    time = guess_time(contents.names)
    known = {time, *(guess_orientation(contents.names) or ()), *(guess_position(contents.names) or ())}
    cells = tuple(name for name in contents.names if name not in known)
    if time is None or len(cells) < FEWEST or guess_wrench(contents.names) is not None:
        return None
    rows, columns = _squarest(len(cells))
    orientation, _ = orientation_table(contents.names)
    named = "" if len(known) == 1 else f"cells = {quoted(cells)}\n"
    array = ArrayChannel(CELLS, (rows, columns), cells, table="skin")
    layout = Layout(time=time, wrench=None, arrays=(array,))
    return _guess((rows, columns), f"{len(cells)} columns beside the time look like cells, here {{}} x {{}}", named,
                  time_table(time, "s"), layout, orientation)  # fmt: skip


def _of_topic(contents: LogContents) -> Guess | None:
    image = contents.image()
    found = image or contents.several(range(FEWEST, 1 << 16))
    if found is None:
        return None
    topic, size = found
    shape = size if isinstance(size, tuple) else _squarest(size)
    what = f"topic {topic!r} holds {'images' if image else 'arrays'} of {{}} x {{}} cells"
    layout = Layout(wrench=None, arrays=(ArrayChannel(CELLS, shape, None, topic, table="skin"),))
    return _guess(shape, what, f"topic = {quoted(topic)}\n", "", layout, pose_table(contents.poses()))


def _guess(
    shape: tuple[int, int], why: str, where: str, before: str, layout: Layout, after: str = ""
) -> Guess:
    rows, columns = shape
    text = before + _TEXT.format(rows=rows, columns=columns, bits=8, where=where) + after
    return Guess(why.format(rows, columns), layout, text, ("check rows and columns of the sheet, and the bits of a reading",))


def _squarest(count: int) -> tuple[int, int]:
    """Rows and columns of a sheet of so many cells, as near to a square as can be."""
    rows = next(k for k in range(int(count**0.5), 0, -1) if count % k == 0)
    return rows, count // rows
