"""A Parquet log, read in pieces."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float

from palpate.errors import InputError
from palpate.io.logs.columns import Columns
from palpate.io.logs.layout import Layout
from palpate.io.logs.log import LogContents
from palpate.io.logs.samples import NUMBERS, rows_at_once
from palpate.io.tables.fields import Fields
from palpate.io.tables.lines import open_input
from palpate.sensors.recording import Recording

__all__ = ["ParquetLog"]

PIECE = 1 << 17  # rows: each piece reads the file's own group of rows again, so few
BLOCK = 1 << 13  # rows handed on at a time


class ParquetLog:
    """As many samples as the file has rows, in their order; what is null is NaN and noted."""

    torn = ""  # a Parquet file is whole or none

    def __init__(self, path: Path, layout: Layout, piece: int = PIECE) -> None:
        self.path, self._layout, self._piece = path, layout, piece
        self.size = path.stat().st_size
        self.position = 0
        self._columns: Columns | None = None

    def contents(self) -> LogContents:
        """See `palpate.io.logs.log.Log`."""
        open_input(self.path).close()
        with self._reading():
            return LogContents(self.path, dict.fromkeys(pl.scan_parquet(self.path, glob=False).collect_schema(), ()))

    def blocks(self) -> Iterator[Recording]:
        """See `palpate.io.logs.log.Log`."""
        open_input(self.path).close()
        with self._reading():
            yield from self._blocks()

    @contextmanager
    def _reading(self) -> Generator[None]:
        try:
            yield
        except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as problem:
            raise InputError(
                f"cannot be read as Parquet ({str(problem).splitlines()[0]}).",
                where=str(self.path),
                hint="A Parquet file that was cut cannot be mended: its index is at the end.",
            ) from problem

    def _blocks(self) -> Iterator[Recording]:
        frame = pl.scan_parquet(self.path, glob=False)
        kinds = frame.collect_schema()
        self._columns = columns = Columns(self._layout, self.path, dict.fromkeys(kinds.names(), ()))
        for name in columns.names:
            if not (kinds[name].is_numeric() or kinds[name] == pl.Null or isinstance(kinds[name], pl.Datetime)):
                raise InputError(f"column {name!r} holds no numbers but {kinds[name]}.", where=str(self.path))
        dates = {name for name in columns.names if isinstance(kinds[name], pl.Datetime)}
        wanted = frame.select(_number(name, date=name in dates) for name in columns.names)
        total = int(frame.select(pl.len()).collect().item())
        width = len(columns.names)
        piece, block = rows_at_once(self._piece, width, 4 * NUMBERS), rows_at_once(BLOCK, width)
        for done in range(0, total, piece):
            rows = wanted.slice(done, piece).collect()
            for start in range(0, len(rows), block):  # what follows needs far more memory than what is read
                self.position = self.size * min(done + start + block, total) // total
                yield columns.block(_Piece(rows.slice(start, block), done + start).read)
        if not total:
            raise InputError("there are columns, but no rows.", where=str(self.path))

    def notes(self) -> tuple[str, ...]:
        """See `palpate.io.logs.log.Log`."""
        return () if self._columns is None else tuple(dict.fromkeys(self._columns.notes()))


def _number(name: str, *, date: bool) -> pl.Expr:
    """A column as numbers; a date with a time as seconds since 1970, to the nearest double."""
    column = pl.col(name).dt.epoch("ns").cast(pl.Float64) / 1e9 if date else pl.col(name).cast(pl.Float64)
    return column.fill_null(np.nan)


class _Piece:
    """Some rows of the file."""

    def __init__(self, frame: pl.DataFrame, before: int) -> None:
        self._frame, self._before = frame, before

    def read(self, names: Sequence[str], fields: Fields) -> Float[np.ndarray, "n k"]:
        values = np.empty((len(self._frame), len(names)))  # by rows; stacking would leave columns
        for k, name in enumerate(names):
            values[:, k] = self._frame[name].to_numpy()
        fields.count(values, lambda row: f"row {self._before + row + 1}")
        return values
