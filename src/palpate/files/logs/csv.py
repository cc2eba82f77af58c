"""Read a CSV log in pieces of a few megabytes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from os import SEEK_END
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.files.inputs import open_input
from palpate.files.logs.columns import ColumnLog, Columns, Read
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.log import LogContents
from palpate.files.tables.fields import Fields, RowCount
from palpate.files.tables.stated import Stated
from palpate.files.tables.table import TextTable, tables
from palpate.signals.recording import Recording

PIECE = 1 << 21  # bytes
HEAD = 1 << 16  # bytes, in which the header is looked for


class CsvLog(ColumnLog):
    """A log in delimited text, whose dialect `palpate.files.tables.dialect` determines."""

    def __init__(self, path: Path, layout: LogLayout) -> None:
        super().__init__(path, layout)
        self._rows = RowCount()

    def contents(self) -> LogContents:
        """Return the names, units and dialect of the table, from its header.

        Raises:
            InputError: the file cannot be read, or is no table of text.
        """
        with open_input(self.path) as file:
            table = next(tables(file, self.path, HEAD))
        stated = Stated.of_dialect(table.dialect)
        return LogContents(self.path, _shapes(table), stated=stated, written=table.dialect.described())

    def blocks(self) -> Iterator[Recording]:
        """Yield the rows as recordings in SI.

        Raises:
            InputError: the file cannot be read, is no table, or has no rows that fit its header or a column without
                numbers; or the layout does not fit.
        """
        self._rows, self._columns, self.torn = RowCount(), None, ""
        shapes: dict[str, tuple[int, ...]] = {}
        with open_input(self.path, pipe=True) as file:
            for table in tables(file, self.path, PIECE):
                self.position = file.tell() if file.seekable() else 0
                if self._columns is None:
                    shapes, stated = _shapes(table), Stated.of_dialect(table.dialect)
                    self._columns = Columns(self._layout, self.path, shapes, stated, self.pose_log)
                table.counted(self._rows)
                if len(table):
                    yield from self._columns.blocks(self._reader(table, self._columns, shapes))
            if self._rows.cut and file.seekable():
                file.seek(-1, SEEK_END)
                if file.read(1) not in b"\r\n":
                    self.torn = "the file is torn: its last line ends within a row"
        self._rows.require(self.path)
        if self._columns is not None:
            yield from self._columns.finish()

    def _reader(self, table: TextTable, columns: Columns, shapes: Mapping[str, tuple[int, ...]]) -> Read:
        """Return the function that reads columns of a table, and those that are lists in one of its columns."""
        lists = {name: shape[0] for name, shape in shapes.items() if shape}

        def read(names: Sequence[str], fields: Fields) -> Float[np.ndarray, "n k"]:
            of = {columns.places[name][0] for name in names}
            if not of & lists.keys():
                return table.read(names, fields)
            read_one = {name: table.list_numbers(name, lists[name]) for name in of & lists.keys()}
            read_one |= {name: table.read([name], fields) for name in of - lists.keys()}
            return columns.taken(read_one, int(table.lines[0]) - 1, names, fields)

        return read if lists else table.read

    def notes(self) -> tuple[str, ...]:
        """Return notes on the rows read so far, one sentence each."""
        return tuple(dict.fromkeys((*self._rows.notes(), *super().notes())))


def _shapes(table: TextTable) -> dict[str, tuple[int, ...]]:
    """Return column -> (), or the shape of its lists."""
    return {**dict.fromkeys(table.names, ()), **table.lists()}
