"""Tables of named objects, imported on first use, to which other packages add by entry points."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar, cast

from palpate.calls import by_name
from palpate.errors import InputError

Row = TypeVar("Row")


class Registry(Mapping[str, Row]):
    """A mapping from names to objects, in a fixed order; `registry[name]` imports an object on first use.

    Args:
        rows: name -> dotted name of the object ("palpate.sensors.taxels.section.SKIN").
        kind: class of the objects.
        group: entry points of other packages, `name = "module:THING"`; searched for names that are not in the rows.
        first: put the rows of other packages before the others.
    """

    def __init__(self, rows: Mapping[str, str], kind: type[Row], group: str, *, first: bool = False) -> None:
        self._rows: dict[str, str | EntryPoint | Row] = dict(rows)
        self._kind, self._group, self._first, self._complete = kind, group, first, False

    def among(self, names: Collection[str]) -> Iterator[Row]:
        """Return an iterator over the objects of those of the names that exist, in the order of the registry.

        Raises:
            InputError: an object of another package cannot be imported, or is of another class.
        """
        rows = self._rows if set(names) <= set(self._rows) else self._all()
        return (self[name] for name in list(rows) if name in names)

    def __getitem__(self, name: str) -> Row:
        row = self._rows[name] if name in self._rows else self._all()[name]
        if isinstance(row, EntryPoint):
            row = self._rows[name] = self._loaded(row)
        elif isinstance(row, str):
            row = self._rows[name] = cast("Row", by_name(row))
        return row

    def __contains__(self, name: object) -> bool:
        return name in self._rows or name in self._all()

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def _all(self) -> dict[str, str | EntryPoint | Row]:
        if not self._complete:
            found = {each.name: each for each in entry_points(group=self._group) if each.name not in self._rows}
            self._rows = {**found, **self._rows} if self._first else {**self._rows, **found}
            self._complete = True
        return self._rows

    def _loaded(self, entry: EntryPoint) -> Row:
        """Return the object of an entry point.

        Raises:
            InputError: it cannot be imported, or is something else.
        """
        package = "of an unknown package" if entry.dist is None else f"of the package {entry.dist.name}"
        try:
            row: Any = entry.load()
            name: Any = entry.name if isinstance(row, type) else getattr(row, "name", entry.name)
            problem = "" if isinstance(row, self._kind) else f"is {type(row).__name__}, not {self._kind.__name__}"
            problem = problem or ("" if name == entry.name else f"has the name {name!r}")
        except Exception as failed:  # whatever another package raises
            row, problem = None, f"cannot be imported: {failed}"
        if problem:
            where = f"entry point {entry.name!r} of {self._group}, {package}"
            raise InputError(f"{entry.value} {problem}.", where=where, hint="Correct that package, or remove it.")
        return cast("Row", row)
