"""Arrays that compiled loops can take, or that nobody can change afterwards."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from types import EllipsisType, MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from palpate.errors import InputError

Shape = tuple[int | EllipsisType | None, ...]  # first, None: any length, or ...: any leading axes

LARGEST = 2**62  # integers are smaller than this in magnitude
_KINDS = {"f": "biuf", "i": "iu", "u": "iu", "b": "b"}  # of numbers that arrays of a kind are made from
FLOAT, INT8, INT64 = np.dtype(np.float64), np.dtype(np.int8), np.dtype(np.int64)


def shaped(values: ArrayLike, shape: Shape, name: str, dtype: np.dtype[Any] = FLOAT) -> np.ndarray:
    """Return `values` as compiled loops take them: of this shape and type, contiguous, aligned and writable.

    The array itself if it is all that, else a copy: loops are compiled again for another layout, and read beyond an
    array of another shape.

    Args:
        values: numbers.
        shape: required; None in front is any length, ... any leading axes.
        name: of the argument, for the message.
        dtype: float64, bool or one of integers.

    Raises:
        InputError: another shape, or numbers that the type cannot hold.
    """
    array = values
    if type(array) is not np.ndarray or array.dtype != dtype or not array.flags.carray:
        array = _converted(values, shape, name, dtype)
    require_shape(array, shape, name)
    return array


def require_shape(array: np.ndarray, shape: Shape, name: str) -> None:
    """Require a shape, written as for `shaped`.

    Raises:
        InputError: the array has another.
    """
    if not _fits(array.shape, shape):
        raise InputError(f"{name} must have shape {_said(shape)}, not {array.shape}.")


def require_finite(array: np.ndarray, name: str) -> None:
    """Require finite numbers: with others LAPACK's least squares would never end.

    Raises:
        InputError: a number is NaN or infinite.
    """
    if not np.isfinite(array).all():
        raise InputError(f"{name} must be finite.")


def require_complete(complete: np.ndarray) -> None:
    """Require that at least one row is complete.

    Args:
        complete: (n,) whether each row has no missing value.

    Raises:
        InputError: no row is.
    """
    if not complete.any():
        what = f"none of the {len(complete)} rows is complete: each has a missing value."
        raise InputError(what, hint="Find the column that is empty.")


def require_batch(array: np.ndarray, batch: tuple[int, ...], name: str) -> None:
    """Require matrices (..., 6, 6) that can be broadcast to one for each of a batch.

    Raises:
        InputError: they cannot.
    """
    try:
        np.broadcast_to(array, (*batch, *array.shape[-2:]))
    except ValueError as problem:
        shapes = f"{(*batch, *array.shape[-2:])} or {array.shape[-2:]}"
        raise InputError(f"{name} must have shape {shapes}, not {array.shape}.") from problem


def require_out(out: np.ndarray, shape: Shape, name: str = "out", dtype: np.dtype[Any] = FLOAT) -> None:
    """Require an array that a compiled loop can write into.

    Raises:
        InputError: `out` is not an array of this type and shape, contiguous, aligned and writable.
    """
    if type(out) is np.ndarray and out.dtype == dtype and out.flags.carray:
        if _fits(out.shape, shape):
            return
        raise InputError(f"{name} must have shape {_said(shape)}, not {out.shape}.")
    seen = [f"{each} {getattr(out, each)}" for each in ("dtype", "shape", "strides") if hasattr(out, each)]
    raise InputError(
        f"{name} must be a writable, contiguous array of {dtype} and shape {_said(shape)}, "
        f"not {type(out).__name__} {', '.join(seen)}."
    )


def frozen(
    values: ArrayLike, *, tail: tuple[int, ...] = (), name: str = "array", dtype: np.dtype[Any] = FLOAT
) -> np.ndarray:
    """Return a read-only copy of `values` in C order, of this type, whose last axes are `tail`.

    Raises:
        InputError: the last axes are not `tail`, or the type cannot hold the numbers.
    """
    array = _converted(values, (..., *tail), name, dtype)
    require_shape(array, (..., *tail), name)
    array.flags.writeable = False
    return array


class Value:
    """A frozen dataclass with arrays: copying it returns itself, and unpickling builds and freezes it anew."""

    def __copy__(self) -> Any:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        names = [field.name for field in fields(cast("Any", self)) if field.init]
        return _built, (type(self), {name: _picklable(getattr(self, name)) for name in names})


def _built(kind: type[Any], given: dict[str, Any]) -> Any:
    return kind(**given)


def _picklable(value: Any) -> Any:
    """Return a read-only view of a dict as a dict, and another value as it is."""
    return dict(cast("Mapping[str, Any]", value)) if isinstance(value, MappingProxyType) else value


def _converted(values: ArrayLike, shape: Shape, name: str, dtype: np.dtype[Any]) -> np.ndarray:
    def unlike(given: str) -> InputError:
        return InputError(f"{name} must be {dtype} of shape {_said(shape)}{given}.")

    try:
        given = np.asarray(values)
    except (ValueError, TypeError) as problem:  # lists of different lengths, for one
        raise unlike(f": {problem}") from problem
    if given.size and given.dtype.kind not in _KINDS[dtype.kind]:
        raise unlike(f", not {given.dtype} of shape {given.shape}")
    array = np.array(given, dtype=dtype, order="C", subok=False)
    if dtype != FLOAT and not np.array_equal(array, given):
        raise unlike(f"; some of the given {given.dtype} numbers do not fit into it")
    return array


def _fits(seen: tuple[int, ...], wanted: Shape) -> bool:
    if seen == wanted or not wanted:
        return seen == wanted
    rest = wanted[1:]
    if wanted[0] is None:
        return len(seen) == len(wanted) and seen[1:] == rest
    return wanted[0] is ... and len(seen) >= len(rest) and seen[len(seen) - len(rest) :] == rest


def _said(shape: Shape) -> str:
    """Format a shape, with n for any length."""
    axes = ["..." if axis is ... else "n" if axis is None else str(axis) for axis in shape]
    return f"({', '.join(axes)}{',' * (len(axes) == 1)})"


def form_of(given: Iterable[Any]) -> tuple[Any, ...]:
    """Return the properties that decide whether arguments fit: type, shape and layout of arrays, else the class."""
    return tuple(
        [
            (value.dtype, value.shape, value.flags.num)
            if type(value) is np.ndarray
            else -LARGEST < value < LARGEST
            if type(value) is int
            else form_of(cast("tuple[Any, ...]", value))
            if type(value) is tuple
            else type(value)
            for value in given
        ]
    )
