"""Read a log of columns in blocks: assign columns to channels, and count what cannot be read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, groupby
from math import prod
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs.layout import POSE_COLUMNS, LogLayout, require_stated, stated_layout
from palpate.files.logs.log import Log
from palpate.files.logs.numbering import SINGLE, array_columns, require_units, shortened
from palpate.files.logs.pose_table import PoseTable, converted
from palpate.files.logs.samples import WRENCH, SampleReader, rows_at_once
from palpate.files.tables.fields import Fields
from palpate.files.tables.stated import Stated, judged_unit, stated_unit
from palpate.files.units import SAMPLES, TIME_UNITS, near, to_si
from palpate.signals.recording import ACCELERATION, FORCE, TEMPERATURE, TORQUE, Recording

__all__ = ["SINGLE", "ColumnLog", "Columns", "Read", "plan"]

BLOCK = 1 << 13  # rows handed on at a time
Read = Callable[[Sequence[str], Fields], Float[np.ndarray, "n k"]]
Shapes = Mapping[str, tuple[int, ...]]
_TIME = "time"
_IMAGES = "Name a video, a folder of frames, an MCAP file or a bag."


class Columns:
    """Builder of the recordings of a log from its columns.

    Args:
        layout: of the log.
        path: of the log.
        shapes: name -> () of a column, or the shape of one sample of an array, whose columns are named by `flattened`.
        stated: units that the log states; None: those in the names.
        poses: table of the poses at other times, as the layout's `pose_file` names it; None: the log has them.

    Attributes:
        places: column -> its array, and its index in a sample of this.
        time_unit: unit of the times; "": the first block of samples will decide.
        doubt: remark on a unit that was judged from the times; "" if there is none.

    Raises:
        InputError: the layout is invalid, a column that it names is missing, or the log states other units, or one of
            the time that is not known.
    """

    def __init__(
        self, layout: LogLayout, path: Path, shapes: Shapes, stated: Stated | None = None, poses: Log | None = None
    ) -> None:
        stated = Stated.of_names(shapes) if stated is None else stated
        layout = stated_layout(layout, shapes, stated)
        require_stated(layout, stated, path)
        self._poses = None if poses is None else PoseTable(poses, layout)
        self._samples = SampleReader(layout if poses is None else converted(layout), path)
        self._path, self._layout = path, layout
        self._groups = plan(layout, shapes, path)
        for array in (each for each in layout.arrays if each.unit is not None):
            require_units(array, self._groups[array.name], stated, path)
        self._found = _found(layout, self._groups, shapes)
        self.time_unit = layout.time_unit or (stated_unit(layout.time, stated, path) if _TIME in self._groups else "s")
        self.doubt, self._per_second = "", _per_second(self.time_unit or "s", layout.rate)
        self.places = flattened(shapes)
        self._fields = {group: Fields() for group in self._groups}
        self._count = 0

    @property
    def names(self) -> list[str]:
        """Names of all columns that are read."""
        return list(dict.fromkeys(chain.from_iterable(self._groups.values())))

    def blocks(self, read: Read) -> Iterator[Recording]:
        """Yield the next samples in SI; `read` returns the numbers of given columns, (n, k)."""
        values = {group: read(columns, self._fields[group]) for group, columns in self._groups.items()}
        if _TIME in values:  # 235 / 1e3 is 0.235, 235 * 1e-3 is not
            time = self._seconds(values.pop(_TIME)[:, 0])
        else:
            count = len(next(iter(values.values())))
            time = (self._count + np.arange(count)) / (self._layout.rate or 1.0)
        self._count += len(time)
        if self._poses is not None:
            values |= self._poses.at(time)
        yield from self._samples.blocks(time, values)

    def _seconds(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return times as recorded in seconds; the first ones decide the unit if nothing states it."""
        stamped = bool(self._fields[_TIME].stamped)
        if stamped or not self.time_unit:
            self.time_unit, self.doubt = ("s", "") if stamped else judged_unit(time, self._layout.time)
            self._per_second = _per_second(self.time_unit, self._layout.rate)
        return time / self._per_second

    def taken(
        self, arrays: Mapping[str, np.ndarray], before: int, names: Sequence[str], fields: Fields
    ) -> Float[np.ndarray, "n k"]:
        """Return columns (n, k) of n rows of arrays, and count them; `before` rows precede them in the log."""
        parts: list[np.ndarray] = []
        for array, group in groupby(map(self.places.__getitem__, names), key=lambda place: place[0]):
            values, columns = arrays[array], [k for _, k in group]
            parts.append(values if columns == list(range(values.shape[1])) else values.take(columns, axis=1))
        found = (parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)).astype(np.float64, order="C")
        fields.count(found, lambda row: f"row {before + row + 1}")
        return found

    def finish(self) -> Iterator[Recording]:
        """Yield the last samples, and check that no column has text and not a single number.

        Raises:
            InputError: one does, or no row has a pose of the second table.
        """
        if self._poses is not None:
            self._poses.require_overlap()
        yield from self._samples.rest()
        for fields in self._fields.values():
            fields.require_numbers(self._path)

    def notes(self) -> tuple[str, ...]:
        """Return notes on the blocks so far, one sentence each: unreadable fields, odd times, no times."""
        said = tuple(note for fields in self._fields.values() for note in fields.notes()) + self._samples.notes()
        said = (*filter(None, [self.doubt]), *self._found, *said, *(() if self._poses is None else self._poses.notes()))
        if _TIME not in self._groups:
            return (f"samples have no times: a rate of {self._layout.rate:g} Hz is assumed", *said)
        return said


class ColumnLog(Log):
    """Base class of the logs of columns: one sample per row, in order; what cannot be read is NaN and noted."""

    def __init__(self, path: Path, layout: LogLayout) -> None:
        super().__init__(path, path.stat().st_size if path.exists() else 0)
        self._layout = layout
        self._columns: Columns | None = None

    @property
    def time_unit(self) -> tuple[str, str]:
        """Unit in which the times were read, and a remark if it was judged from them; "" before the first block."""
        return ("", "") if self._columns is None else (self._columns.time_unit, self._columns.doubt)

    def notes(self) -> tuple[str, ...]:
        """Return notes on the columns read so far, one sentence each."""
        return () if self._columns is None else tuple(dict.fromkeys(self._columns.notes()))

    def _cut(self, columns: Columns, arrays: Mapping[str, np.ndarray], before: int, total: int) -> Iterator[Recording]:
        """Yield rows of arrays, (n, k) each, in blocks; `before` of `total` precede them in the file."""
        count, block = len(next(iter(arrays.values()))), rows_at_once(BLOCK, len(columns.names))
        for start in range(0, count, block):  # what follows needs far more memory than what is read
            self.position = self.size * (before + min(start + block, count)) // total
            rows = {name: values[start : start + block] for name, values in arrays.items()}
            yield from columns.blocks(partial(columns.taken, rows, before + start))


def plan(layout: LogLayout, shapes: Shapes, path: Path) -> dict[str, Sequence[str]]:
    """Return the names of the columns of "time", `WRENCH` and each channel of a layout.

    `shapes` has the sample shapes of the columns and arrays in the log `path`.

    Raises:
        InputError: a column is missing, an array has the wrong size, or images are requested.
    """
    if layout.images is not None:
        raise InputError("holds no images.", where=str(path), hint=_IMAGES)
    layout = _by_arrays(layout, shapes)
    names = flattened(shapes)
    timed = layout.rate is None or layout.time in names
    groups: dict[str, Sequence[str]] = {_TIME: (layout.time,)} if timed else {}
    if layout.wrench is not None:
        groups[WRENCH] = layout.wrench
    for array in layout.arrays:
        if isinstance(array.columns, tuple) and (set(array.columns) <= names.keys() or not any(shapes.values())):
            groups[array.name] = array.sized(array.columns, path)
    _require_known(list(chain.from_iterable(groups.values())), names, path)
    for channel, usual in POSE_COLUMNS.items():
        if layout.pose_file is not None and channel != ACCELERATION:
            continue  # of another table
        declared: tuple[str, ...] | None = getattr(layout, channel)
        if columns := declared or (usual if names.keys() >= set(usual) else ()):
            _require_known(columns, names, path)
            groups[channel] = columns
    if layout.temperature is not None:
        _require_known((layout.temperature,), names, path)
        groups[TEMPERATURE] = (layout.temperature,)
    for array in layout.arrays:
        if array.name not in groups:
            used = set(chain.from_iterable(groups.values()))
            free = [name for name in names if name not in used]
            groups[array.name] = array_columns(array, shapes, free, path)
    return groups


def flattened(shapes: Shapes) -> dict[str, tuple[str, int]]:
    """Return column -> (its array, its index in a sample); an array's columns are `force[0]`, ..."""
    return {column: (name, k) for name, shape in shapes.items() for k, column in enumerate(_columns(name, shape))}


def _per_second(unit: str, rate: float | None) -> float:
    if unit == SAMPLES:
        return rate or 1.0
    return float(round(1 / to_si(unit, TIME_UNITS, where="time_unit")))


def _columns(name: str, shape: tuple[int, ...]) -> tuple[str, ...]:
    return tuple(f"{name}[{k}]" for k in range(prod(shape))) if shape else (name,)


def _by_arrays(layout: LogLayout, shapes: Shapes) -> LogLayout:
    """Return the layout with arrays that are named as channels in place of missing columns."""
    made = {name: _columns(name, shape) for name, shape in shapes.items() if shape}
    if not made:
        return layout
    changes: dict[str, object] = {}
    if layout.wrench is not None and not set(layout.wrench) <= shapes.keys():
        for names in ((FORCE, TORQUE), (WRENCH,), (SINGLE,)):
            columns = tuple(chain.from_iterable(made.get(name, ()) for name in names))
            if len(columns) == 6:
                changes["wrench"] = columns
    for channel, usual in POSE_COLUMNS.items():
        if getattr(layout, channel) is None and len(made.get(channel, ())) == len(usual):
            changes[channel] = made[channel]
    return replace(layout, **changes)


def _found(layout: LogLayout, groups: Mapping[str, Sequence[str]], shapes: Shapes) -> tuple[str, ...]:
    """Return sentences on columns that are not taken for a channel that found its own, and on their order."""
    said, used = list[str](), set(chain.from_iterable(groups.values()))
    other = [name for name in shapes if not shapes[name] and name not in used]
    for array in layout.arrays:
        columns = list(groups[array.name])
        if isinstance(array.columns, tuple) or not shapes.keys() >= (own := set(columns)):
            continue
        if other:
            said.append(f"not taken for {array.name}: {shortened(other)}")
        if columns != [name for name in shapes if name in own]:
            said.append(f"columns of {array.name} are taken by the numbers in their names, not in the log's order")
    return tuple(said)


def _require_known(wanted: Sequence[str], names: Mapping[str, object], path: Path) -> None:
    missing = [name for name in wanted if name not in names]
    if missing:
        what = f"there is no column {', '.join(map(repr, missing))}."
        hint = f"{near(missing[0], names)} Name the columns in a rig; `palpate rig new` guesses them.".strip()
        raise InputError(what, where=str(path), hint=hint)
