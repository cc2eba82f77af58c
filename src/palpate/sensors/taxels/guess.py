"""Guess a skin from a log: which numbers are taxels, in which order, unit and time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from palpate.files.logs import LogContents, open_log
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.files.logs.numbering import (
    AXES,
    USUAL,
    NumberedColumns,
    axes_of,
    is_taxel,
    numbered_alike,
    shortened,
    single_cells,
)
from palpate.files.units import CELL_UNITS, FORCE_UNITS, known_unit
from palpate.setup import guess
from palpate.setup.body import GivenBody
from palpate.setup.built import Guess
from palpate.setup.guess_time import guess_time
from palpate.setup.makers import named_pose, pose_columns
from palpate.setup.names import made_up, time_column, wrench_columns
from palpate.signals.recording import CELLS

_FEWEST = 16  # cells: fewer numbers can be anything
_CERTAIN = 4  # cells whose names are those of taxels
_WORDS = ("taxel", "tactile", "sensel", "skin", "pillar")
_OTHERS = (  # many numbers, and no skin
    *("jacob", "joint", "tau", "covariance", "inertia", "action", "state", "image", "rgb", "depth"),
)
_THREE_AXES = ("xela", "uskin")  # makers of taxels with three axes, in types of messages
_OF_THREE = ", of taxels with three axes"
_BITS = (8, 10, 12, 14, 16)
_PITCH = 0.005  # m, of a flat sheet where nothing states it
_TEXT = """\
[skin]
{places}
rows = {rows}
columns = {columns}
{cells}{bits:<36} # of a whole-number reading; 0: readings are floats
# intensity = "intensity.toml"       # written by: palpate calibrate intensity; without it a count is taken for 1 N
# tare = 1.0                         # s: the log starts so long untouched
# falling = true                     # readings fall under load; without it found in the log

[contacts]
on = 6.0                             # a touch begins where a cell stands so many deviations of its noise above its rest
off = 3.0                            # and reaches as far as cells that stand so many above
# unequal = 0.02                     # share by which a cell's gain may be off from its curve: it widens the ellipses

"""


@dataclass(frozen=True)
class _Cells:
    """The numbers of a log that are taken for taxels.

    Attributes:
        shape: (rows, columns), or (count,), without axes.
        why: what in the log looks like taxels.
        columns: names of columns in the order of taxels; or the array that holds them.
        path: the field path of a rig that finds the same, or the names; "": none is needed.
        topic: that holds them; None: the log is a table.
        unit: that the log states, as the tables of units spell it; "": none.
        remarks: what the reader should check, one sentence each.
        axes: names of the three numbers of a taxel; (): there is one.
    """

    shape: tuple[int, ...]
    why: str
    columns: tuple[str, ...] | str | None = None
    path: tuple[str, ...] | str = ""
    topic: str | None = None
    unit: str = ""
    remarks: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()

    @property
    def sheet(self) -> tuple[int, int]:
        """Rows and columns; numbers in one row are arranged as nearly square as possible."""
        if len(self.shape) == 2:
            return self.shape[0], self.shape[1]
        count = prod(self.shape)
        rows = next(k for k in range(int(count**0.5), 0, -1) if count % k == 0)
        return rows, count // rows

    def layout(self, **time: Any) -> LogLayout:
        """Return the layout by which the log is read, with these settings of its time."""
        shape = (*self.sheet, 3) if self.axes else self.sheet
        array = ArrayChannel(CELLS, shape, self.columns, self.topic, table="skin", axes=self.axes)
        return LogLayout(wrench=None, arrays=(array,), **time)

    def text(self, bits: int, pitch: float | None, *, mapped: bool) -> str:
        """Return the tables of a rig: of a map that is to be made, or of a flat sheet with a pitch [m]."""
        rows, columns = self.sheet
        mesh = f'map = "skin_map.toml"                # written by: palpate map skin MESH --sheet {rows}x{columns} ...'
        flat = f"pitch = {pitch or _PITCH:g}"
        flat = f"{flat:<36} # m between the cells of a flat sheet; on a body: map, written by palpate map skin"
        lines = [
            f"{key} = {guess.quoted(value)}\n"
            for key, value in (("cells", self.path), ("topic", self.topic), ("axes", self.axes))
            if value
        ]
        lines += [f'unit = "{self.unit}"\n'] if self.unit else []
        places, cells = mesh if mapped else flat, "".join(lines)
        return _TEXT.format(places=places, rows=rows, columns=columns, cells=cells, bits=f"bits = {bits}")


def guess_skin(log: Path, contents: LogContents, body: GivenBody | None) -> Guess | None:
    """Return the `Guess` of a skin: images, arrays of frames, or many columns of numbers; None: there are none.

    Raises:
        InputError: the log cannot be read, or has a few single-axis cells.
    """
    cells = _of_topics(log, contents) if contents.topics else _of_arrays(contents) or _of_columns(log, contents)
    if cells is None:
        return None
    if contents.topics:
        poses = guess.pose_table(guess.topics_of(contents, "pose"))
        return _guessed(log, cells, contents, body, ("", poses))
    named = (cells.columns,) if isinstance(cells.columns, str) else cells.columns or ()
    time, doubts = guess_time(contents, named), list[str]()
    if time.column and not time.unit:
        unit, doubts = guess.time_unit(log, time.column)
        time = replace(time, unit=unit)
    (orientation, _) = guess.orientation_table(named_pose(list(contents.names)))
    layout = {"time": time.column or "time", "time_unit": time.unit or None, "rate": time.rate}
    found = _guessed(log, cells, contents, body, (time.text(), orientation), **layout)
    return replace(found, remarks=(*doubts, *time.remarks, *found.remarks), lacking=time.lacking)


def guess_with_wrench(log: Path, contents: LogContents) -> Guess | None:
    """Return the `Guess` of a skin in a log with wrenches, an array topic or columns numbered alike; None: no skin.

    Raises:
        InputError: the log cannot be read.
    """
    if contents.topics:
        arrays = tuple(topic for topic in contents.topics if topic.kind.endswith("MultiArray"))
        cells = _of_topics(log, replace(contents, topics=arrays)) if arrays else None
    else:
        there = list(contents.names)
        named = not made_up(there) and wrench_columns(there) is not None
        cells = _numbered(_free(there), contents) if named else None
    return None if cells is None else _guessed(log, cells, contents, None, ("", ""))


def _guessed(
    log: Path, cells: _Cells, contents: LogContents, body: GivenBody | None, around: tuple[str, str], **time: Any
) -> Guess:
    layout = cells.layout(**time)
    bits = 0 if cells.unit else _bits(log, layout)
    text = around[0] + cells.text(bits, contents.stated.pitch, mapped=body is not None) + around[1]
    rows, columns = cells.sheet
    remark = f"check the sheet's {rows} rows and {columns} columns, and the bits of a reading"
    if rows == 3 and not cells.axes:
        remark += f"; if its rows are three axes of a taxel, write axes = {guess.quoted(AXES[0])}"
    if len(cells.shape) < 2:
        remark = f"nothing states the sheet's rows and columns: {rows} x {columns} is a guess, correct it"
    return Guess(cells.why, layout, text, (*cells.remarks, remark))


def _bits(log: Path, layout: LogLayout) -> int:
    """Return the fewest usual bits that hold all readings of a log; 0 if they are no counts."""
    most = 0.0
    for _, frames in open_log(log, replace(layout, time="", rate=1.0)).stored():  # whatever the times are
        known = frames[np.isfinite(frames)]
        if (known < 0).any() or (known % 1 != 0).any():
            return 0
        most = max(most, float(known.max(initial=0)))
    return next((bits for bits in _BITS if most < 2**bits), 0)


def _of_arrays(contents: LogContents) -> _Cells | None:
    """Return the array of frames, by its name or as the first that is large enough; None if there is none."""
    arrays = {name: shape for name, shape in contents.names.items() if prod(shape) >= _FEWEST and _may_be(name)}
    name = next((name for name in arrays if _is_skin(name) or name in USUAL), next(iter(arrays), None))
    if name is None:
        return None
    shape = arrays[name]
    others = [other for other in arrays if other != name]
    remarks = (f"the arrays {shortened(others)} are not used",) if others else ()
    sides, axes = _sides(shape)
    unit, why = _unit([name], contents), f"array {name!r} holds frames{_OF_THREE if axes else ''}"
    return _Cells(sides, why, name, name, unit=unit, remarks=remarks, axes=axes)


def _sides(shape: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return the shape of an array without a side of three axes, and their names; 3 x n is a sheet of three rows."""
    sides, axes = tuple(side for side in shape if side != 1), tuple[str, ...]()
    if sides[1:] and (sides[-1] == 3 or (sides[0] == 3 and len(sides) > 2)):
        sides, axes = sides[:-1] if sides[-1] == 3 else sides[1:], AXES[0]
    return sides if len(sides) < 3 else (prod(sides),), axes


def _of_columns(log: Path, contents: LogContents) -> _Cells | None:
    """Return columns that are numbered alike; else all that are not named otherwise; None if these are few."""
    there = [name for name, shape in contents.names.items() if not shape]
    if wrench_columns(there) is not None:
        return None
    names = _free(there)
    if made_up(there):
        names = names[1:] if _counts(log, names[0]) else names
    if (found := _numbered(names, contents)) is not None:
        return found
    groups = [each for each in numbered_alike(names) if 3 <= len(each.names) < _FEWEST]
    few = [each for each in groups if _unit(each.names, contents) in FORCE_UNITS]
    if few:
        raise single_cells(log, few[0].names)
    cells = tuple(name for name in names if is_taxel(name))
    if len(cells) < _FEWEST:
        return None
    why = f"{len(cells)} columns in addition to the time look like cells"
    return _Cells((len(cells),), why, cells, cells, unit=_unit(cells, contents), remarks=_aside(there, cells))


def _numbered(names: Sequence[str], contents: LogContents) -> _Cells | None:
    """Return the largest group of columns that are numbered alike, if it is large enough or named as taxels.

    Three groups that differ in their axis alone are one.
    """
    groups = numbered_alike(names)
    axes = next(iter(axes_of(groups).values()), dict[str, NumberedColumns]())
    three = [each for each in axes.values() if _may_be(each.pattern)]
    found = [each for each in groups if _may_be(each.pattern) and each not in three][:1]
    alike = len({frozenset(each.numbers) for each in three}) == 1
    if alike and (not found or 3 * len(three[0].names) > len(found[0].names)):
        found = three
    count = sum(len(each.names) for each in found)
    if not found or count < (_CERTAIN if _is_skin(found[0].pattern) else _FEWEST):
        return None
    group = found[0]
    columns = tuple(name for taxel in zip(*(each.ordered() for each in found), strict=True) for name in taxel)
    called = ", ".join(each.pattern for each in found)
    why = f"{count} columns that are numbered alike ({called}) look like cells{_OF_THREE if found is three else ''}"
    remarks = list(_aside(list(contents.names), columns))
    if columns != tuple(name for name in contents.names if name in set(columns)):
        remarks.insert(0, "the cells are in the order of the numbers in their names, not in that of the log")
    if group.grid and not group.sure:
        remarks.append('the first number of a name is taken for the row: if it is the column, write order = "columns"')
    unit = _unit(columns, contents)
    path, names = ("", tuple(axes)) if found is three else (group.pattern, ())
    return _Cells(group.shape(), why, columns, path, unit=unit, remarks=tuple(remarks), axes=names)


def _is_skin(name: str) -> bool:
    return any(word in name.lower() for word in _WORDS)


def _may_be(name: str) -> bool:
    return _is_skin(name) or not any(word in name.lower() for word in _OTHERS)


def _aside(there: Sequence[str], cells: Sequence[str]) -> tuple[str, ...]:
    """Return a remark on the columns that are not taken, in a tuple; () if there are none but the time's."""
    taken = set(cells)
    other = [name for name in _free(there) if name not in taken]
    return (f"not taken for cells: {shortened(other)}",) if other else ()


def _free(there: Sequence[str]) -> list[str]:
    """Return the names that are not those of a time, a pose or a wrench."""
    named = {time_column(there), *pose_columns(there), *(wrench_columns(there) or ())}
    return [name for name in there if name not in named]


def _unit(columns: Sequence[str], contents: LogContents) -> str:
    """Return the unit of force or pressure that a log states for columns, alike for all; else ""."""
    stated = {known_unit(contents.stated.unit(name), CELL_UNITS) or "" for name in columns}
    return stated.pop() if len(stated) == 1 else ""


def _counts(log: Path, column: str) -> bool:
    """Return whether the first numbers of a column grow from row to row, as a time or a counter does."""
    block = next(open_log(log, LogLayout(time=column, time_unit="s", wrench=None)).blocks(), None)
    return block is not None and bool((np.diff(block.time) > 0).all())


def _of_topics(log: Path, contents: LogContents) -> _Cells | None:
    """Return the first topic of arrays or images that are large enough; None if there is none."""
    found = guess.array_topic(log, contents, lambda shape: prod(shape) >= _FEWEST)
    if found is None:
        return _of_fields(log, contents)
    topic, size = found
    kind = next(each.kind for each in contents.topics if each.name == topic)
    arrays = kind.endswith("MultiArray")
    sides, axes = _sides(size) if arrays else (size, ())
    why = f"topic {topic!r} holds {'arrays' if arrays else 'images'} of {' x '.join(map(str, size))} numbers"
    return _Cells(sides, f"{why}{_OF_THREE if axes else ''}", topic=topic, axes=axes)


def _of_fields(log: Path, contents: LogContents) -> _Cells | None:
    """Return the longest list of numbers in messages of a type that the log defines; None if there is none."""
    found = guess.field_topic(log, contents, lambda count: count >= _CERTAIN)
    if found is None:
        return None
    topic, found_paths, count = found
    paths = [path for path in found_paths if is_taxel(path.rpartition(".")[2])]
    kind = next(each.kind for each in contents.topics if each.name == topic)
    lists = {path.rpartition("[].")[0] for path in paths}
    of_axes = [(each, axes) for each in lists for axes in AXES if {f"{each}[].{axis}" for axis in axes} <= {*paths}]
    path, axes = (f"{of_axes[0][0]}[]", of_axes[0][1]) if of_axes else (next(iter(paths), ""), ())
    if not axes and count % 3 == 0 and any(maker in kind.lower() for maker in _THREE_AXES):
        count, axes = count // 3, AXES[0]
    if not paths or (count * (len(axes) or 1) < _FEWEST and not _is_skin(f"{kind}{topic}")):
        return None
    why = f"field {path!r} of {kind} in topic {topic!r} holds {count} {'taxels' if axes else 'numbers'}"
    others = [other for other in paths if other.partition("[].")[0] != path.partition("[]")[0]]
    remarks = (f"the fields {shortened(others)} are not used",) if others else ()
    return _Cells((count,), f"{why}{_OF_THREE if axes else ''}", path, path, topic, remarks=remarks, axes=axes)
