"""TOML tables into frozen dataclasses; what does not fit is named, with its place and the nearest fit."""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from math import inf
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.io.units import near

__all__ = ["INFINITE", "covariance_matrix", "parse"]

Model = TypeVar("Model")
INFINITE: Mapping[str, bool] = {"infinite": True}  # metadata of a field that may be inf
_NAMES: Mapping[Any, str] = {
    str: "text in quotes",
    bool: "true or false",
    float: "a number",
    int: "a whole number",
    Mapping: "a table",
}
_LARGEST = 1e18  # no quantity here is larger in SI, nor the variance of one, and powers of it stay finite
_ROUNDING = 1e-6  # of a correlation that a file states in seven digits


def parse(table: Mapping[str, Any], model: type[Model], *, file: str, key: str = "") -> Model:
    """A `model` from a table of TOML; nested dataclasses are nested tables, tuples are lists.

    Args:
        table: as tomllib gives it.
        model: a dataclass of str, bool, int, float, tuples of these, Mapping, other dataclasses, and unions with None.
            A float is finite, unless the metadata of its field are `INFINITE`.
        file: for messages.
        key: dotted path of this table in the file.

    Raises:
        InputError: a key is unknown or missing, or its value is of another kind.
    """
    hints = get_type_hints(model)
    known = {field.name: field for field in fields(cast("Any", model))}
    for name in table:
        if name not in known:
            raise InputError(f"unknown key {name!r}{_in(key)}.", where=file, mend=near(name, known))
    for name, field in known.items():
        if name not in table and field.default is MISSING and field.default_factory is MISSING:
            raise InputError(f"{_dotted(key, name)} is missing.", where=file)
    values = {
        name: _value(value, hints[name], file=file, key=_dotted(key, name), infinite="infinite" in known[name].metadata)
        for name, value in table.items()
    }
    try:
        return model(**values)
    except ValueError as problem:
        raise InputError(f"{problem}.", where=f"{file}: {key}" if key else file) from problem


def covariance_matrix(rows: Sequence[Sequence[float]], size: int, name: str) -> Float[np.ndarray, "size size"]:
    """A matrix that can be a covariance, up to rounding.

    Raises:
        ValueError: another shape, not symmetric, or a variance is negative; `name` says which.
    """
    if [len(row) for row in rows] != [size] * size:
        raise ValueError(f"{name} must be {size} x {size} numbers")
    matrix = np.asarray(rows, dtype=np.float64)
    largest = np.abs(matrix).max()
    # as correlations, so that N and m weigh alike; what is known exactly has a variance of rounding only
    spread = np.sqrt(np.maximum(np.diag(matrix), 1e-9 * largest)) if largest > 0 else np.ones(size)
    matrix_of_one = matrix / spread / spread[:, None]
    if np.abs(matrix_of_one - matrix_of_one.T).max() > _ROUNDING:
        raise ValueError(f"{name} must be symmetric")
    if np.linalg.eigvalsh(matrix_of_one).min() < -_ROUNDING:
        raise ValueError(f"{name} must be positive semidefinite: some variance in it is negative")
    return matrix


def _value(value: Any, hint: Any, *, file: str, key: str, infinite: bool = False) -> Any:
    """`value` as `hint` asks, or the sentence that says what was expected."""
    for option in _options(hint):
        if is_dataclass(option) and isinstance(value, dict):
            return parse(cast("dict[str, Any]", value), cast("type[Any]", option), file=file, key=key)
        if get_origin(option) is tuple and isinstance(value, list):
            return _tuple(cast("list[Any]", value), option, file=file, key=key)
        if option is float and type(value) in (int, float):
            return _number(value, file=file, key=key, infinite=infinite)
        if type(value) is option or (get_origin(option) is Mapping and isinstance(value, Mapping)):
            return cast("Any", value)
    expected = " or ".join(_named(option) for option in _options(hint))
    raise InputError(f"{key} must be {expected}, not {_shown(value)}.", where=file)


def _number(value: int | float, *, file: str, key: str, infinite: bool) -> float:
    """As float64, for which an integer may be too large."""
    if abs(value) <= _LARGEST or (infinite and value in (inf, -inf)):
        return float(value)
    raise InputError(f"{key} must be a finite number, not {_shown(value)}.", where=file)


def _shown(value: Any) -> str:
    if isinstance(value, (list, dict)):
        return "a list" if isinstance(value, list) else "a table"
    return "one so large" if isinstance(value, int) and abs(value) > _LARGEST else repr(value)


def _tuple(values: list[Any], hint: Any, *, file: str, key: str) -> tuple[Any, ...]:
    kinds = get_args(hint)
    if kinds[-1] is Ellipsis:
        kinds = (kinds[0],) * len(values)
    if len(values) != len(kinds):
        raise InputError(f"{key} must be {_named(hint)}, not {len(values)} values.", where=file)
    return tuple(
        _value(value, kind, file=file, key=f"{key}[{k}]")
        for k, (value, kind) in enumerate(zip(values, kinds, strict=True))
    )


def _options(hint: Any) -> tuple[Any, ...]:
    if get_origin(hint) in (Union, types.UnionType):
        return tuple(option for option in get_args(hint) if option is not type(None))
    return (hint,)


def _named(option: Any) -> str:
    if is_dataclass(option):
        return f"a table of {', '.join(field.name for field in fields(option))}"
    if get_origin(option) is tuple:
        kinds = get_args(option)
        count = "" if kinds[-1] is Ellipsis else f"{len(kinds)} "
        inner = "lists" if get_origin(kinds[0]) is tuple else "texts" if kinds[0] is str else "numbers"
        return f"a list of {count}{inner}"
    return _NAMES.get(get_origin(option) or option, str(option))


def _dotted(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _in(key: str) -> str:
    return f" in [{key}]" if key else ""
