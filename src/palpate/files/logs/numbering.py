"""Determine which number of a log is which taxel: by a field path, by the numbers in names, by shapes of arrays."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path

from palpate.errors import InputError
from palpate.files.logs.layout import ArrayChannel
from palpate.files.tables.stated import Stated
from palpate.files.units import CELL_UNITS, FORCE_UNITS, known_unit, near, split_unit
from palpate.signals.recording import CELLS

Shapes = Mapping[str, tuple[int, ...]]
SINGLE = "array"  # what the one array of an .npy is called
USUAL = (CELLS, "frames", SINGLE)
"""Names of arrays of frames."""
_NUMBER = re.compile(r"\d+")
_JOIN = r"(?:\W|_)*"
_ROW_FIRST = re.compile(rf"(?:^|[^a-z])(?:r|row|y){_JOIN}\*{_JOIN}(?:c|col|column|x){_JOIN}\*", re.IGNORECASE)
_COLUMN_FIRST = re.compile(rf"(?:^|[^a-z])(?:c|col|column|x){_JOIN}\*{_JOIN}(?:r|row|y){_JOIN}\*", re.IGNORECASE)
_GRID = re.compile(rf"\*{_JOIN}\*", re.IGNORECASE)
_LOAD_CELL = re.compile(r"(?:lc|load[\W_]*cell)", re.IGNORECASE)
AXES = ("x", "y", "z"), ("fx", "fy", "fz")
"""Usual names of the three numbers of a taxel."""
_BESIDE = re.compile(  # names of columns that sit next to taxels and are none
    r"(?:.*[\W_])?(?:frames?|frame_?id|seq|sequence|samples?|index|idx|counter|count|packet|no|nr|sum|total|max|min|"
    r"mean|avg|average|temp\w*|label|class|phase|state|event|status|mode|type|id|board_?id|sensor_?id|cop\w*|"
    r"center_of_pressure\w*|ref|f_[nt])|unnamed.*",
    re.IGNORECASE,
)


def is_taxel(name: str) -> bool:
    """Return whether a name can be a taxel's, and is not that of a counter, a sum, a label or the like."""
    return not _BESIDE.fullmatch(split_unit(name)[0].strip())


@dataclass(frozen=True)
class NumberedColumns:
    """Columns whose names differ in their numbers alone.

    Attributes:
        pattern: the name, with * in place of each number that varies.
        names: of the columns.
        numbers: of each, those that vary; row and column, in this order, if `sure`.
        grid: whether the two numbers are those of a row and a column, of each of which there is one.
        sure: whether letters state which of them is the row.
    """

    pattern: str
    names: tuple[str, ...]
    numbers: tuple[tuple[int, ...], ...]
    grid: bool
    sure: bool

    def shape(self, order: str = "rows") -> tuple[int, ...]:
        """Return (rows, columns) of a grid, or (count,)."""
        if not self.grid:
            return (len(self.names),)
        rows, columns = (len({number[k] for number in self.numbers}) for k in (0, 1))
        return (columns, rows) if order == "columns" and not self.sure else (rows, columns)

    def ordered(self, order: str = "rows") -> tuple[str, ...]:
        """Return the names by their numbers; row by row, or column by column if `order` is "columns"."""
        turned = self.grid and self.sure and order == "columns"
        keys = [number[::-1] for number in self.numbers] if turned else self.numbers
        return tuple(name for _, name in sorted(zip(keys, self.names, strict=True)))

    def of(self, ids: Sequence[int]) -> tuple[str, ...]:
        """Return the names of taxels by their ids, or by rank where both count without a gap; () if they do not fit."""
        if any(len(number) != 1 for number in self.numbers):
            return self.ordered() if len(ids) == len(self.names) and _gapless(ids) else ()
        named = dict(zip((number[0] for number in self.numbers), self.names, strict=True))
        if named.keys() >= set(ids):
            return tuple(named[each] for each in ids)
        same = len(named) == len(ids) and _gapless(ids) and _gapless(named)
        return tuple(named[key] for key in sorted(named)) if same else ()


def _gapless(numbers: Iterable[int]) -> bool:
    there = set(numbers)
    return max(there) - min(there) + 1 == len(there)


def numbered_alike(names: Iterable[str]) -> list[NumberedColumns]:
    """Return the columns that are numbered alike, the largest group first; a number that occurs twice makes none."""
    groups: dict[str, dict[tuple[int, ...], str]] = {}
    shown: dict[str, str] = {}
    twice = set[str]()
    for name in names:
        bare = split_unit(name)[0].strip()
        if numbers := tuple(map(int, _NUMBER.findall(bare))):
            pattern = _NUMBER.sub("*", bare)
            key = pattern.lower()
            shown.setdefault(key, pattern)
            group = groups.setdefault(key, {})
            twice |= {key} if numbers in group else set()
            group[numbers] = name
    found = [_group(shown[key], group) for key, group in groups.items() if key not in twice]
    return sorted(found, key=lambda each: -len(each.names))


def _group(pattern: str, group: Mapping[tuple[int, ...], str]) -> NumberedColumns:
    places = list(zip(*group, strict=True))
    varying = [k for k, place in enumerate(places) if len({*place}) > 1]
    parts = pattern.split("*")
    text = parts[0] + "".join(("*" if k in varying else str(place[0])) + parts[k + 1] for k, place in enumerate(places))
    numbers = [tuple(number[k] for k in varying) for number in group]
    grid, sure = False, False
    if len(varying) == 2:
        first, turned = bool(_ROW_FIRST.search(text)), bool(_COLUMN_FIRST.search(text))
        full = len({a for a, _ in numbers}) * len({b for _, b in numbers}) == len(numbers)
        grid, sure = full and (first or turned or bool(_GRID.search(text))), first or turned
        numbers = [number[::-1] for number in numbers] if turned else numbers
    return NumberedColumns(text, tuple(group.values()), tuple(numbers), grid, sure)


def axes_of(groups: Sequence[NumberedColumns], axes: tuple[str, ...] = ()) -> dict[str, dict[str, NumberedColumns]]:
    """Return groups that differ in the names of axes alone: the field path of all -> name of an axis -> its group.

    Args:
        groups: columns that are numbered alike.
        axes: the names; (): x, y, z, or fx, fy, fz.
    """
    for names in (axes,) if axes else AXES:
        axis = re.compile(rf"(?<![a-z])(?:{'|'.join(map(re.escape, names))})(?![a-z])", re.IGNORECASE)
        alike: dict[str, dict[str, NumberedColumns]] = {}
        for group in groups:
            for match in axis.finditer(group.pattern):
                path = f"{group.pattern[: match.start()]}*{group.pattern[match.end() :]}"
                alike.setdefault(path.lower(), {})[match[0].lower()] = group
        whole = {path: found for path, found in alike.items() if len(found) == len(names)}
        if whole:
            return {path: {name: found[name.lower()] for name in names} for path, found in whole.items()}
    return {}


def three_axes(path: Path, what: str, axes: Sequence[str] = AXES[0], one: str = "") -> InputError:
    """Return the error of a log with three numbers a taxel; `one` is the field path of a single axis."""
    hint = f"Write axes = {json.dumps([*axes])} in [skin]."
    hint = f'{hint[:-1]}, or cells = "{one}" to use the normal axis alone.' if one else hint
    what = f"has three axes a taxel ({what}), but the skin of the rig has one."
    return InputError(what, where=str(path), hint=hint)


def single_cells(path: Path, names: Sequence[str]) -> InputError:
    """Return the error of a log with the forces of a few load cells."""
    what = f"has {len(names)} single-axis cells ({shortened(names)}), as under a plate, not taxels."
    hint = 'Name them in [load_cells] of a rig: axes = ["z"], columns = [...], positions = [[x, y, z], ...] in m.'
    return InputError(what, where=str(path), hint=hint)


def require_units(array: ArrayChannel, columns: Sequence[str], stated: Stated, path: Path) -> None:
    """Check that a log states no other unit of a channel's numbers than that in which they are read.

    Args:
        array: the channel, whose `unit` is not None.
        columns: of the channel.
        stated: units that the log `path` states.
        path: of the log.

    Raises:
        InputError: it does, or names and unit are those of load cells.
    """
    for name in columns:
        said = stated.unit(name) or stated.unit(name.partition("[")[0])
        known, read = known_unit(said, CELL_UNITS), known_unit(array.unit or "N", CELL_UNITS)
        if known in FORCE_UNITS and _LOAD_CELL.match(name):
            raise single_cells(path, columns)
        if said and known != read and (known or array.unit):
            what = f"the log states that {name!r} is in {said!r}, but it is read in {array.unit or 'counts'!r}."
            raise InputError(what, where=str(path), hint=f'Write unit = "{known or said}" in [{array.table}].')


def array_columns(array: ArrayChannel, shapes: Shapes, names: Sequence[str], path: Path) -> Sequence[str]:
    """Return the columns of an array channel, in the order in which they are recorded.

    Args:
        array: the channel; its columns, if it has some, are not a tuple of names.
        shapes: name -> () of a column, or the shape of one sample of an array.
        names: of the log's columns that are not used otherwise, with those of arrays.
        path: of the log.

    Raises:
        InputError: several arrays or groups of columns could be meant, or none; the number of columns or the rows and
            columns that names state are others than the channel's; or taxels have three axes.
    """
    made = {name: shape for name, shape in shapes.items() if shape and f"{name}[0]" in names}
    plain = [name for name in names if name in shapes]
    name = _array(array, made, path)
    if name is not None:
        return [f"{name}[{k}]" for k in arranged(array, made[name], f"array {name!r} holds n x", path)]
    if made and not plain:
        wanted = array.columns if isinstance(array.columns, str) else "frames" if array.name == CELLS else array.name
        raise InputError(f"has no array {wanted!r}.", where=str(path), hint=near(wanted, made))
    return _by_names(array, plain, path)


def _array(array: ArrayChannel, made: Shapes, path: Path) -> str | None:
    """Return the name of the array that holds a channel; None if there is none."""
    if isinstance(array.columns, str):
        return array.columns if array.columns in made else None
    names = USUAL if array.name == CELLS else (array.name, SINGLE)
    usual = next((name for name in names if name in made), None)
    sizes = (array.size, prod(array.taxels), 3 * prod(array.taxels))
    fitting = [name for name, shape in made.items() if prod(shape) in sizes]
    if usual is None and len(fitting) > 1:
        raise _several(array, fitting, path)
    return usual or next(iter(fitting), None)


def arranged(array: ArrayChannel, shape: tuple[int, ...], called: str, path: Path) -> Sequence[int]:
    """Return the index of each number of a channel in an array of a log, whose axes may be the first side or the last.

    Args:
        array: the channel.
        shape: of the log's array.
        called: the array and a verb, for messages.
        path: of the log.

    Raises:
        InputError: the array has another shape than the channel.
    """
    there, wanted, taxels = (
        tuple(side for side in sides if side != 1)
        for sides in (shape, array.recorded, array.recorded[: len(array.taxels)])
    )
    alike = taxels, (prod(taxels),)
    if there in (wanted, (array.size,)):
        return range(array.size)
    in_rows = len(taxels) == 1 and prod(there) == array.size  # of a sheet, whose taxels the rig lists
    if array.axes and there[-1:] == (3,) and (in_rows or there[:-1] in alike):
        return range(array.size)
    if array.axes and there[:1] == (3,) and (in_rows or there[1:] in alike):
        return [taxel + axis * prod(taxels) for taxel in range(prod(taxels)) for axis in range(3)]
    what = f"{called} {' x '.join(map(str, shape))} numbers"
    if array.name == CELLS and not array.axes and prod(shape) == 3 * array.size and 3 in (there[0], there[-1]):
        raise three_axes(path, what)
    if array.axes and prod(shape) == prod(taxels):
        raise one_axis(array, path, f"{what}, one a taxel")
    raise InputError(f"{what}, not {' x '.join(map(str, array.recorded))}.", where=str(path), hint=array.mend)


def stated_order(array: ArrayChannel, shape: tuple[int, ...], topic: str, path: Path) -> list[int] | None:
    """Return the index of each number in a message whose layout states a shape; None: they are in order.

    Raises:
        InputError: the shape is another than the channel's.
    """
    listed = len(array.shape) == 1 and prod(shape) == array.size
    if len(shape) < 2 or listed or prod(shape) not in (array.size, prod(array.taxels), 3 * array.size):
        return None  # messages of other sizes cannot be read, and are counted
    order = arranged(array, shape, f"the layout of {topic!r} states", path)
    return None if isinstance(order, range) else [*order]


def _by_names(array: ArrayChannel, names: Sequence[str], path: Path) -> Sequence[str]:
    """Return the columns that are numbered alike, by their numbers; else all, in the order of the log."""
    stated = array.columns if isinstance(array.columns, str) else None
    names = names if stated is None else matching(stated, names)
    groups = numbered_alike(names)
    axes = axes_of(groups, array.axes)
    if array.axes and axes:
        return _by_axes(array, axes, path)
    first = next(iter(axes.values()), dict[str, NumberedColumns]())
    triple = [*first.values()]
    fitting = [group for group in groups if group not in triple and len(group.names) >= array.size]
    fitting = [group for group in fitting if array.ids is not None or len(group.names) == array.size]
    if triple and not fitting and array.size in (len(triple[0].names), 3 * len(triple[0].names)):
        raise three_axes(path, ", ".join(each.pattern for each in triple), [*first], triple[2].pattern)
    if array.axes and not fitting and (alone := [each for each in groups if len(each.names) >= prod(array.taxels)]):
        raise one_axis(array, path, f"has one column a taxel ({alone[0].pattern})")
    if len(fitting) > 1:
        raise _several(array, [group.pattern for group in fitting], path)
    if fitting:
        return _numbered(array, fitting[0], path)
    taxels = [name for name in names if is_taxel(name)]
    return array.sized(taxels if len(taxels) == array.size else names, path)


def _by_axes(array: ArrayChannel, found: Mapping[str, Mapping[str, NumberedColumns]], path: Path) -> Sequence[str]:
    """Return columns of several axes, taxel by taxel; raise InputError if there are too few, too many or several."""
    if len(found) > 1:
        raise _several(array, [*found], path)
    (axes,) = found.values()
    every = set[tuple[int, ...]]().union(*(group.numbers for group in axes.values()))
    for axis, group in axes.items():
        if lacking := sorted(every.difference(group.numbers)):
            what = f"has no axis {axis!r} ({group.pattern}) of taxel {' '.join(map(str, lacking[0]))}."
            raise InputError(what, where=str(path), hint="Each taxel needs a column of every axis.")
    one = replace(array, shape=array.taxels, axes=())
    each = [_numbered(one, group, path) for group in axes.values()]
    return array.sized([name for taxel in zip(*each, strict=True) for name in taxel], path)


def one_axis(array: ArrayChannel, path: Path, what: str) -> InputError:
    """Return the error of a log with one number a taxel, for which a rig names axes."""
    names = ", ".join(f"1_{axis}" for axis in array.axes)
    hint = f"Remove axes from [{array.table}], or name the columns with their axes, such as {names}."
    return InputError(f"{what}, but the rig names axes {', '.join(array.axes)}.", where=str(path), hint=hint)


def _numbered(array: ArrayChannel, group: NumberedColumns, path: Path) -> Sequence[str]:
    """Return the columns of a group by ids or numbers; raise InputError if these are not those of the channel."""
    if array.ids is not None:
        if found := group.of(array.ids):
            return found
        what = f"the numbers of {group.pattern!r} are {_listed(group)}, but the taxels' ids are {shortened(array.ids)}."
        hint = "Give the columns and the places the same ids, or list the columns: cells = [...] in [skin]."
        raise InputError(what, where=str(path), hint=hint)
    shape = group.shape(array.order)
    if len(shape) == 2 and len(array.shape) == 2 and shape != array.shape:
        what = f"the names {group.pattern!r} state {shape[0]} x {shape[1]} {array.name}, not {array.described}."
        turned = ' If their first number is the column, write order = "columns" in [skin].' if not group.sure else ""
        raise InputError(what, where=str(path), hint=f"{array.mend}{turned}")
    return group.ordered(array.order)


def matching(path: str, names: Iterable[str]) -> list[str]:
    """Return the names that fit a field path, in which * is any text, and [] any index."""
    parts = (re.escape(part) for part in re.split(r"(\*|\[\])", path))
    text = re.compile("".join({r"\*": ".*", r"\[\]": r"\[\d+\]"}.get(part, part) for part in parts), re.IGNORECASE)
    return [name for name in names if text.fullmatch(name) or text.fullmatch(split_unit(name)[0].strip())]


def _several(array: ArrayChannel, found: Sequence[str], path: Path) -> InputError:
    what = f"{len(found)} could be the {array.name}: {', '.join(found[:6])}."
    return InputError(what, where=str(path), hint=f'Name one, as cells = "{found[0]}" in [{array.table}].')


def _listed(group: NumberedColumns) -> str:
    return shortened([number[0] if len(number) == 1 else number for number in sorted(group.numbers)])


def shortened(values: Sequence[object]) -> str:
    """Return values as a list in words, without the middle of a long one."""
    listed = [str(value) for value in values]
    return ", ".join(listed if len(listed) < 7 else [*listed[:3], "...", *listed[-2:]])
