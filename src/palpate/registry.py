"""Tables of named things that are imported when first asked for, which other packages add to by entry points."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, MutableMapping
from pathlib import Path
from typing import Generic, TypeVar, cast

from palpate.calls import by_name

__all__ = ["Registry"]

Row = TypeVar("Row")


class Registry(MutableMapping[str, Row], Generic[Row]):
    """Name -> what bears it, in a fixed order.

    Rows of other packages come first. They are looked for when a name is asked for that is not in the rows, or when all
    are.

    Args:
        rows: by name the thing, or where it is defined ("palpate.io.rig.skin.SKIN"), which is imported when it is first
            asked for.
        group: of entry points of other packages: `name = "module:THING"`.
    """

    def __init__(self, rows: dict[str, str | Row], group: str) -> None:
        self._rows, self._group, self._complete = rows, group, False

    def among(self, names: Collection[str]) -> Iterator[Row]:
        """Yield the rows of these names, in order; other names are left out."""
        rows = self._rows if set(names) <= set(self._rows) else self._all()
        return (self[name] for name in list(rows) if name in names)

    def __getitem__(self, name: str) -> Row:
        row = self._rows[name] if name in self._rows else self._all()[name]
        if isinstance(row, str):
            row = self._rows[name] = cast("Row", by_name(row))
        return row

    def __setitem__(self, name: str, row: Row) -> None:
        self._rows[name] = row

    def __delitem__(self, name: str) -> None:
        del self._rows[name]

    def __contains__(self, name: object) -> bool:
        return name in self._rows or name in self._all()

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def _all(self) -> dict[str, str | Row]:
        if not self._complete:
            self._rows = {name: row for name, row in self._outside().items() if name not in self._rows} | self._rows
            self._complete = True
        return self._rows

    def _outside(self) -> dict[str, str]:
        """Return what other packages bring."""
        files = (file for folder in sys.path for file in Path(folder).glob("*.dist-info/entry_points.txt"))
        if not any(self._group in file.read_text(encoding="utf-8", errors="replace") for file in files):
            return {}  # importlib.metadata takes ten times as long to import as these files to read
        from importlib.metadata import entry_points

        return {each.name: each.value.replace(":", ".") for each in entry_points(group=self._group)}
