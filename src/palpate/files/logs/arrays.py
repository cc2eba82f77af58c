"""Read a log of arrays with one row per sample, from an .npz, an .npy or memory; Python objects are never loaded."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from lzma import LZMAError
from math import prod
from pathlib import Path
from tokenize import TokenError
from typing import Any, Protocol, runtime_checkable
from zipfile import BadZipFile, ZipFile
from zlib import error as ZlibError

import numpy as np

from palpate.errors import InputError
from palpate.files.inputs import open_input
from palpate.files.logs.columns import SINGLE, ColumnLog, Columns
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.log import LogContents
from palpate.files.tables.stated import Stated
from palpate.signals.recording import Recording

_MAGIC = b"\x93NUMPY"
_DAMAGED = (
    TypeError,
    OSError,
    ValueError,
    EOFError,
    KeyError,
    SyntaxError,
    MemoryError,
    RuntimeError,
    BadZipFile,
    ZlibError,
    LZMAError,
    TokenError,
)


class ArrayLog(ColumnLog):
    """A log in a NumPy file, with as many samples as the arrays have rows."""

    def contents(self) -> LogContents:
        """Return the names and sample shapes of the arrays, from their headers.

        Raises:
            InputError: the file does not exist, is damaged, or holds Python objects.
        """
        with self._reading(), open_input(self.path) as file:
            if file.read(len(_MAGIC)) == _MAGIC:
                file.seek(0)
                heads = {SINGLE: _head(file)}
            else:
                with ZipFile(file) as archive:
                    names = [name for name in archive.namelist() if name.endswith(".npy")]
                    heads = {name.removesuffix(".npy"): _head(archive.open(name)) for name in names}
        names = {name: _sample(shape) for name, shape in heads.items() if shape}
        return LogContents(self.path, names, stated=Stated.of_names(names))

    def blocks(self) -> Iterator[Recording]:
        """Yield the rows as recordings in SI.

        Raises:
            InputError: the layout does not fit the arrays; they differ in length, are empty or no numbers; or the file
                does not exist or is damaged.
        """
        there = self.contents()
        shapes = there.names
        if self._layout.rate is None and self._layout.time not in shapes:
            what = f"has no array of times, {self._layout.time!r}."
            hint = "Write the rate [Hz] of the samples in the rig, as rate in [time], or add the times as an array."
            raise InputError(what, where=str(self.path), hint=hint)
        self._columns = columns = Columns(self._layout, self.path, shapes, there.stated, self.pose_log)
        arrays = self._arrays(list(dict.fromkeys(columns.places[column][0] for column in columns.names)))
        yield from self._cut(columns, arrays, 0, len(next(iter(arrays.values()))))
        yield from columns.finish()

    def _loaded(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        with self._reading(), open_input(self.path) as file:
            loaded: Any = np.load(file, allow_pickle=False)
            alone = isinstance(loaded, np.ndarray)
            return {SINGLE: loaded} if alone else {name: loaded[name] for name in names}

    def _arrays(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Return the arrays, (n, k) each with the same n."""
        arrays, first = self._loaded(names), names[0]
        for name, values in arrays.items():
            if not (np.issubdtype(values.dtype, np.integer) or np.issubdtype(values.dtype, np.floating)):
                raise InputError(f"array {name} holds {values.dtype}, not numbers.", where=str(self.path))
            if len(values) != len(arrays[first]):
                what = f"has {len(arrays[first])} rows of {first} and {len(values)} rows of {name}: they must agree."
                raise InputError(what, where=str(self.path))
        if not len(arrays[first]):
            raise InputError("holds no samples.", where=str(self.path))
        return {name: values.reshape(len(values), -1) for name, values in arrays.items()}

    @contextmanager
    def _reading(self) -> Generator[None]:
        try:
            yield
        except _DAMAGED as problem:
            raise InputError(f"is not a NumPy file that can be read ({problem}).", where=str(self.path)) from problem


@runtime_checkable
class DataFrame(Protocol):
    """A table of polars or pandas."""

    @property
    def columns(self) -> Any:
        """Names of the columns."""

    def __getitem__(self, name: Any, /) -> Any:
        """Return the column of this name."""


def arrays_of(log: DataFrame | Mapping[str, Any] | np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of a table, or the given arrays, by name; dates become seconds since 1970.

    A single array is called "array".
    """
    if isinstance(log, np.ndarray):
        return {SINGLE: log}
    names = log if isinstance(log, Mapping) else log.columns
    return {str(name): _seconds(np.asarray(log[name])) for name in names}


def _seconds(values: np.ndarray) -> np.ndarray:
    return values.astype("datetime64[ns]").astype(np.int64) / 1e9 if values.dtype.kind == "M" else values


class HeldLog(ArrayLog):
    """A log of arrays in memory, given by name."""

    def __init__(self, arrays: Mapping[str, np.ndarray], layout: LogLayout) -> None:
        super().__init__(Path("the log"), layout)
        self._held = arrays

    def contents(self) -> LogContents:
        """Return the names and sample shapes of the arrays.

        Raises:
            InputError: there is no array, or one is a single number.
        """
        single = [name for name, values in self._held.items() if not values.ndim]
        if single or not self._held:
            what = f"{single[0]!r} is a single number" if single else "there is no column"
            raise InputError(f"{what}, and one row per sample is needed.", where=str(self.path))
        names = {name: _sample(values.shape) for name, values in self._held.items()}
        return LogContents(self.path, names, stated=Stated.of_names(names))

    def _loaded(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        return {name: self._held[name] for name in names}


def _head(file: Any) -> tuple[int, ...]:
    """Return the shape of an array from its header; raise a ValueError if it holds Python objects."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = read(file)
    if kind.hasobject:
        raise ValueError("it holds Python objects")
    return shape


def _sample(shape: tuple[int, ...]) -> tuple[int, ...]:
    return shape[1:] if prod(shape[1:]) != 1 else ()
