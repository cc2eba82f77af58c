"""A log in NumPy's files: an .npz of arrays with a row a sample, or the one array of an .npy. No pickle is opened."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from math import prod
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile
from zlib import error as ZlibError

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.io.logs.columns import SINGLE, Columns, flattened
from palpate.io.logs.layout import Layout
from palpate.io.logs.log import LogContents
from palpate.io.logs.samples import rows_at_once
from palpate.io.tables.fields import Fields
from palpate.io.tables.lines import open_input
from palpate.sensors.recording import Recording

__all__ = ["ArrayLog"]

BLOCK = 1 << 13  # rows
_MAGIC = b"\x93NUMPY"
_DAMAGED = (
    OSError,
    ValueError,
    EOFError,
    KeyError,
    SyntaxError,
    MemoryError,
    NotImplementedError,
    RuntimeError,
    BadZipFile,
    ZlibError,
)


class ArrayLog:
    """As many samples as the arrays have rows."""

    torn = ""  # such a file is whole or none

    def __init__(self, path: Path, layout: Layout) -> None:
        self.path, self._layout = path, layout
        self.position, self.size = 0, path.stat().st_size
        self._columns: Columns | None = None

    def contents(self) -> LogContents:
        """See `palpate.io.logs.log.Log`."""
        with self._reading(), open_input(self.path) as file:
            if file.read(len(_MAGIC)) == _MAGIC:
                file.seek(0)
                heads = {SINGLE: _head(file)}
            else:
                with ZipFile(file) as archive:
                    names = [name for name in archive.namelist() if name.endswith(".npy")]
                    heads = {name.removesuffix(".npy"): _opened_head(archive, name) for name in names}
        return LogContents(self.path, {name: _sample(shape) for name, shape in heads.items() if shape})

    def blocks(self) -> Iterator[Recording]:
        """See `palpate.io.logs.log.Log`."""
        shapes = self.contents().names
        if self._layout.rate is None and self._layout.time not in shapes:
            raise InputError(
                f"has no times ({self._layout.time!r}).",
                where=str(self.path),
                hint="Give the rate [Hz] of the samples in the rig, or write an .npz with the time as an array.",
            )
        self._columns = columns = Columns(self._layout, self.path, shapes)
        places = flattened(shapes)
        names = list(dict.fromkeys(places[column][0] for column in columns.names))
        arrays = self._arrays(names)
        count = len(arrays[names[0]])
        block = rows_at_once(BLOCK, len(columns.names))
        for start in range(0, count, block):
            self.position = self.size * min(start + block, count) // count
            rows = {name: values[start : start + block] for name, values in arrays.items()}
            yield columns.block(_Piece(rows, places, start).read)

    def notes(self) -> tuple[str, ...]:
        """See `palpate.io.logs.log.Log`."""
        return () if self._columns is None else tuple(dict.fromkeys(self._columns.notes()))

    def _arrays(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Those that are read, (n, k) each, row for row."""
        with self._reading(), open_input(self.path) as file:
            loaded: Any = np.load(file, allow_pickle=False)
            alone = isinstance(loaded, np.ndarray)
            arrays: dict[str, np.ndarray] = {SINGLE: loaded} if alone else {name: loaded[name] for name in names}
        first = names[0]
        for name, values in arrays.items():
            if not (np.issubdtype(values.dtype, np.integer) or np.issubdtype(values.dtype, np.floating)):
                raise InputError(f"{name} holds {values.dtype}, not numbers.", where=str(self.path))
            if len(values) != len(arrays[first]):
                raise InputError(
                    f"has {len(arrays[first])} rows of {first} for {len(values)} of {name}.", where=str(self.path)
                )
        if not len(arrays[first]):
            raise InputError("holds no samples.", where=str(self.path))
        return {name: values.reshape(len(values), -1) for name, values in arrays.items()}

    @contextmanager
    def _reading(self) -> Generator[None]:
        try:
            yield
        except _DAMAGED as problem:
            raise InputError(f"is no NumPy file that can be read ({problem}).", where=str(self.path)) from problem


def _opened_head(archive: ZipFile, name: str) -> tuple[int, ...]:
    with archive.open(name) as file:
        return _head(file)


def _head(file: Any) -> tuple[int, ...]:
    """The shape of an array in a file."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = read(file)
    if kind.hasobject:
        raise ValueError("it holds Python objects")
    return shape


def _sample(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Of one row, () for one number."""
    return shape[1:] if prod(shape[1:]) != 1 else ()


class _Piece:
    """Some rows of the arrays."""

    def __init__(self, arrays: dict[str, np.ndarray], places: dict[str, tuple[str, int]], before: int) -> None:
        self._arrays, self._places, self._before = arrays, places, before

    def read(self, names: Sequence[str], fields: Fields) -> Float[np.ndarray, "n k"]:
        parts: list[np.ndarray] = []
        for array, group in groupby(map(self._places.__getitem__, names), key=lambda place: place[0]):
            values, columns = self._arrays[array], [k for _, k in group]
            parts.append(values if columns == list(range(values.shape[1])) else values.take(columns, axis=1))
        found = (parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)).astype(np.float64, order="C")
        fields.count(found, lambda row: f"row {self._before + row + 1}")
        return found
