"""Read a Parquet log in pieces."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from math import prod

import numpy as np
import polars as pl
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs.columns import ColumnLog, Columns
from palpate.files.logs.log import LogContents
from palpate.files.logs.samples import NUMBERS, rows_at_once
from palpate.files.tables.lines import open_input
from palpate.files.tables.stated import Stated
from palpate.forks import require_polars_threads
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
            shapes = _shapes(pl.scan_parquet(self.path, glob=False))
            return LogContents(self.path, shapes, stated=Stated.of_names(shapes))

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
        kinds, shapes = frame.collect_schema(), _shapes(frame)
        self._columns = columns = Columns(self._layout, self.path, shapes, poses=self.poses)
        arrays = list(dict.fromkeys(columns.places[name][0] for name in columns.names))
        for name in arrays:
            kind = _inner(kinds[name])
            if not (kind.is_numeric() or kind == pl.Null or isinstance(kind, pl.Datetime)):
                raise InputError(f"column {name!r} holds {kind}, not numbers.", where=str(self.path))
        wanted = frame.select(_number(name, kinds[name]) for name in arrays)
        total = int(frame.select(pl.len()).collect().item())
        piece = rows_at_once(PIECE, len(columns.names), 4 * NUMBERS)
        for done in range(0, total, piece):
            rows = wanted.slice(done, piece).collect()
            read = {name: _numbers(rows[name], shapes[name]) for name in arrays}
            yield from self._cut(columns, read, done, total)
        yield from columns.finish()
        if not total:
            raise InputError("has columns, but no rows.", where=str(self.path))


def _inner(kind: pl.DataType) -> pl.DataType:
    """Return the type of the numbers in lists, however nested; any other type as it is."""
    while isinstance(kind, pl.List | pl.Array):
        kind = kind.inner if isinstance(kind.inner, pl.DataType) else kind.inner()
    return kind


def _listed(kind: pl.DataType) -> pl.DataType:
    """Return the type with lists of any length in place of arrays."""
    return pl.List(_listed(kind.inner)) if isinstance(kind, pl.List | pl.Array) else pl.Float64()


def _shapes(frame: pl.LazyFrame) -> dict[str, tuple[int, ...]]:
    """Return column -> (), or the shape of its first list."""
    kinds = frame.collect_schema()
    lists = [name for name, kind in kinds.items() if isinstance(kind, pl.List | pl.Array)]
    first = frame.select(lists).head(1).collect() if lists else pl.DataFrame()
    found = {name: np.shape(first[name].to_list()[0]) for name in lists if len(first)}
    return {name: found.get(name, ()) for name in kinds.names()}


def _number(name: str, kind: pl.DataType) -> pl.Expr:
    if isinstance(kind, pl.List | pl.Array):
        return pl.col(name)
    date = isinstance(kind, pl.Datetime)
    column = pl.col(name).dt.epoch("ns").cast(pl.Float64) / 1e9 if date else pl.col(name).cast(pl.Float64)
    return column.fill_null(np.nan)


def _numbers(column: pl.Series, shape: tuple[int, ...]) -> Float[np.ndarray, "n k"]:
    """Return numbers (n, 1), or lists (n, k), NaN where a row has another count."""
    if not shape:
        return column.to_numpy()[:, None]
    count = prod(shape)
    flat = column.cast(_listed(column.dtype))
    for _ in shape[1:]:
        flat = flat.list.eval(pl.element().explode())
    whole = (flat.list.len() == count).fill_null(value=False)
    values = np.full((len(column), count), np.nan)
    values[whole.to_numpy()] = flat.filter(whole).explode().cast(pl.Float64).to_numpy().reshape(-1, count)
    return values
