"""Values on one line for a person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Sized
from dataclasses import fields, is_dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import takes_arrays

_NUMBERS = 6  # of an array that are printed; of a larger one, its shape
_DECIMALS = 6  # behind the point, at most
_LONGEST = 40  # characters of a string


@takes_arrays
def vector(values: ArrayLike, digits: int = 3) -> str:
    """Format numbers (n,) as text in brackets, with `digits` digits behind the point.

    Raises:
        InputError: `digits` is negative, or the values are not (n,) numbers.
    """
    if digits < 0:
        raise InputError(f"digits must be 0 or more, not {digits}.")
    return "(" + ", ".join(f"{value:z.{digits}f}" for value in shaped(values, (None,), "values")) + ")"


def rounded(value: float, deviation: float, most: int = _DECIMALS) -> str:
    """Format a value to two digits of its standard deviation, at most `most` decimals; with two if it is unknown."""
    digits = 2
    if 0.0 < deviation < np.inf:
        digits = min(max(0, 1 - int(f"{deviation:.1e}".partition("e")[2])), most)
    return f"{value:z.{digits}f}"


def uncertain(value: float, deviation: float, most: int = _DECIMALS) -> str:
    """Format "value ± standard deviation", both as by `rounded`; the value alone if the deviation is unknown."""
    known = 0.0 < deviation < np.inf
    return rounded(value, deviation, most) + (f" ± {rounded(deviation, deviation, most)}" if known else "")


def three_digits(value: float) -> str:
    """Format a value to three digits, a large one to the unit, with at most six decimals."""
    return rounded(value, abs(value) / 10)


def one_line(value: object) -> str:
    """Format a dataclass's class and fields that are not empty on one line: large arrays by their shape.

    Raises:
        TypeError: the value is no instance of a dataclass.
    """
    if not is_dataclass(value) or isinstance(value, type):
        raise TypeError(f"{type(value).__name__} has no fields to print")
    shown = ((each.name, getattr(value, each.name)) for each in fields(value) if not each.name.startswith("_"))
    said = (f"{name}={_short(content)}" for name, content in shown if not _empty(content))
    return f"{type(value).__name__}({', '.join(said)})"


def _empty(content: object) -> bool:
    return content is None or (isinstance(content, Sized) and len(content) == 0)


def _short(content: Any) -> str:
    if isinstance(content, np.ndarray):
        return _array(cast("np.ndarray[Any, Any]", content))
    if isinstance(content, float | np.floating):
        return f"{content:g}"
    if isinstance(content, Mapping):
        return "{" + ", ".join(str(key) for key in cast("Mapping[Any, Any]", content)) + "}"
    if isinstance(content, str):
        return repr(content if len(content) <= _LONGEST else f"{content[: _LONGEST - 3]}...")
    said = repr(content)
    if len(said) <= _LONGEST:
        return said
    if isinstance(content, Sequence):
        return f"<{len(cast('Sequence[Any]', content))}>"
    return f"{type(content).__name__}(...)"


def _array(values: np.ndarray) -> str:
    if values.size > _NUMBERS or values.dtype.kind not in "fiub":
        return f"<{' x '.join(map(str, values.shape))}>"
    return "[" + ", ".join(f"{value:g}" for value in values.ravel()) + "]"
