"""Read a Parquet log in pieces."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import contextmanager

import numpy as np
import polars as pl

from palpate.errors import InputError
from palpate.files.inputs import open_input
from palpate.files.logs.columns import ColumnLog, Columns
from palpate.files.logs.log import LogContents
from palpate.files.logs.samples import NUMBERS, rows_at_once
from palpate.files.tables.stated import Stated
from palpate.processes import require_polars_threads
from palpate.signals.recording import Recording

PIECE = 1 << 17  # rows: each piece reads the file's own group of rows again, so few


class ParquetLog(ColumnLog):
    """A log in a Parquet file."""

    def contents(self) -> LogContents:
        """Return the names of the columns and the units in them.

        Raises:
            InputError: the file does not exist or is damaged.
        """
        open_input(self.path).close()
        with self._reading():
            names = pl.scan_parquet(self.path, glob=False).collect_schema().names()
            return LogContents(self.path, dict.fromkeys(names, ()), stated=Stated.of_names(names))

    def blocks(self) -> Iterator[Recording]:
        """Yield the rows as recordings in SI.

        Raises:
            InputError: the file does not exist, is damaged or has no rows; a column is not numbers or dates; or the
                layout does not fit.
        """
        open_input(self.path).close()
        with self._reading():
            yield from self._blocks()

    @contextmanager
    def _reading(self) -> Generator[None]:
        try:
            yield
        except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as problem:
            what = f"cannot be read as Parquet ({str(problem).splitlines()[0]})."
            hint = "Copy it again: a Parquet file that was cut cannot be repaired, as its index is at its end."
            raise InputError(what, where=str(self.path), hint=hint) from problem

    def _blocks(self) -> Iterator[Recording]:
        require_polars_threads()
        frame = pl.scan_parquet(self.path, glob=False)
        kinds = frame.collect_schema()
        self._columns = columns = Columns(self._layout, self.path, dict.fromkeys(kinds.names(), ()), poses=self.poses)
        for name in columns.names:
            if not (kinds[name].is_numeric() or kinds[name] == pl.Null or isinstance(kinds[name], pl.Datetime)):
                raise InputError(f"column {name!r} holds {kinds[name]}, not numbers.", where=str(self.path))
        dates = {name for name in columns.names if isinstance(kinds[name], pl.Datetime)}
        wanted = frame.select(_number(name, date=name in dates) for name in columns.names)
        total = int(frame.select(pl.len()).collect().item())
        piece = rows_at_once(PIECE, len(columns.names), 4 * NUMBERS)
        for done in range(0, total, piece):
            rows = wanted.slice(done, piece).collect()
            yield from self._cut(columns, {name: rows[name].to_numpy()[:, None] for name in columns.names}, done, total)
        yield from columns.finish()
        if not total:
            raise InputError("has columns, but no rows.", where=str(self.path))


def _number(name: str, *, date: bool) -> pl.Expr:
    column = pl.col(name).dt.epoch("ns").cast(pl.Float64) / 1e9 if date else pl.col(name).cast(pl.Float64)
    return column.fill_null(np.nan)
