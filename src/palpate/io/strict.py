"""TOML tables into frozen dataclasses; what does not fit is named, with its place and the nearest fit."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from palpate.errors import InputError
from palpate.io.units import near

__all__ = ["parse"]

Model = TypeVar("Model")
_NAMES: Mapping[Any, str] = {str: "text in quotes", bool: "true or false", float: "a number", int: "a whole number"}


def parse(table: Mapping[str, Any], model: type[Model], *, file: str, key: str = "") -> Model:
    """A `model` from a table of TOML; nested dataclasses are nested tables, tuples are lists.

    Args:
        table: as tomllib gives it.
        model: a dataclass of str, bool, int, float, tuples of these, other dataclasses, and unions with None.
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
    values = {name: _value(value, hints[name], file=file, key=_dotted(key, name)) for name, value in table.items()}
    try:
        return model(**values)
    except ValueError as problem:
        raise InputError(f"{problem}.", where=f"{file}: {key}") from problem


def _value(value: Any, hint: Any, *, file: str, key: str) -> Any:
    """`value` as `hint` asks, or the sentence that says what was expected."""
    for option in _options(hint):
        if is_dataclass(option) and isinstance(value, dict):
            return parse(cast("dict[str, Any]", value), cast("type[Any]", option), file=file, key=key)
        if get_origin(option) is tuple and isinstance(value, list):
            return _tuple(cast("list[Any]", value), option, file=file, key=key)
        if option is float and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
        if isinstance(option, type) and type(value) is option:
            return value
    expected = " or ".join(_named(option) for option in _options(hint))
    raise InputError(f"{key} must be {expected}, not {value!r}.", where=file)


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
    return _NAMES.get(option, str(option))


def _dotted(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _in(key: str) -> str:
    return f" in [{key}]" if key else ""
