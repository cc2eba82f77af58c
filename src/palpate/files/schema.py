"""Convert TOML tables to values, driven by annotations; errors name the key and suggest the nearest known name."""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from inspect import Parameter, signature
from math import copysign, inf, isnan, nan
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from jaxtyping import AbstractArray, Float

from palpate.calls import options
from palpate.errors import GeometryError, InputError, NotIdentifiable
from palpate.files.units import near
from palpate.spatial.arguments import takes_arrays

__all__ = ["INFINITE", "Key", "TableForm", "parse"]

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
_hints, _signature = cache(get_type_hints), cache(signature)  # a model may have hundreds of tables of one class


@dataclass(frozen=True)
class Key:
    """Constraints and the comment of a key in a file.

    Args:
        comment: text written next to the key, with the unit.
        least: smallest value allowed for its numbers.
        infinite: its numbers may be inf, which 1e18 and more mean too.
        unknown: its numbers may be NaN (not known); an empty row of a matrix is a row of NaN.
        required: the key must be present although it has a default.
    """

    comment: str = ""
    least: float = -inf
    infinite: bool = False
    unknown: bool = False
    required: bool = False


@dataclass(frozen=True)
class TableForm:
    """The form in which values of a class are written to a file.

    Args:
        keys: name -> constraints and comment, in the order of the file; other keys follow.
        build: annotated function from the keys to a value; None: the class. `**rest` takes those of `keys` that are
            fields of the class.
        spell: function from a value to the keys that are not its fields, or not as they are; None: there are none. Keys
            without a value (None) are not written.
        called: field -> its key, where they differ.
    """

    keys: Mapping[str, Key]
    build: Callable[..., Any] | None = None
    spell: Callable[[Any], Mapping[str, Any]] | None = None
    called: Mapping[str, str] = field(default_factory=dict[str, str])


def parse(
    table: Mapping[str, Any],
    model: type[Model],
    *,
    file: str,
    key: str = "",
    forms: Mapping[type, TableForm] = types.MappingProxyType({}),
) -> Model:
    """Return a `model` made from a TOML table; nested dataclasses are nested tables, tuples and arrays are lists.

    Args:
        table: as tomllib returns it.
        model: a dataclass of str, bool, int, float, tuples of these, arrays annotated with their shape, Mapping, other
            dataclasses, and unions with None. Equal letters in the shapes of a table are equal sizes; a square array is
            a covariance; floats are finite, unless `INFINITE` or `Key` allow more.
        file: path of the file, for messages.
        key: dotted path of this table in the file.
        forms: class -> form, where files hold more than the annotations.

    Raises:
        InputError: a key is unknown or missing, its value has the wrong type, shape or range, or the class refuses it.
    """
    form = forms.get(model, TableForm({}))
    build = form.build or model
    hints = _hints(build)  # of a class its fields: other parameters of its constructor are not keys
    parameters = {name: each for name, each in _signature(build).parameters.items() if name in hints or name == "rest"}
    if "rest" in parameters:
        own = _signature(model).parameters
        parameters = {name: parameters.get(name) or own[name] for name in (*parameters, *form.keys) if name != "rest"}
        hints = _hints(model) | hints
    names = {form.called.get(name, name): name for name in parameters}
    for name in table:
        if name not in names:
            raise InputError(f"unknown key {name!r}{_in(key)}.", where=file, hint=near(name, names))
    keys = _stated(model) | dict(form.keys)
    sizes: dict[str, int] = {}
    values: dict[str, Any] = {}
    for name, of in names.items():
        said, parameter = keys.get(name, Key()), parameters[of]
        if name in table:
            reader = _Reader(file, said, forms, sizes)
            values[of] = reader.value(table[name], hints[of], _dotted(key, name))
        elif said.required or parameter.default is Parameter.empty:
            raise InputError(f"{_dotted(key, name)} is missing.", where=file)
    place = f"{file}: {key}" if key else file
    try:
        return build(**values)
    except InputError as problem:  # it does not know its file
        raise InputError(problem.what, where=place, hint=problem.hint) from problem
    except (GeometryError, NotIdentifiable, ValueError) as problem:
        raise InputError(f"{str(problem).removesuffix('.')}.", where=place) from problem


@takes_arrays
def covariance_matrix(
    rows: Sequence[Sequence[float]] | Float[np.ndarray, "n k"], size: int, name: str
) -> Float[np.ndarray, "size size"]:
    """Return `rows` as an array (size, size), checked to be a covariance up to rounding.

    Raises:
        InputError: rows has another shape.
        ValueError: it is not `size` x `size`, symmetric and positive semidefinite; the message calls it `name`.
    """
    if [len(row) for row in rows] != [size] * size:
        raise ValueError(f"{name} must be {size} x {size} numbers")
    matrix = np.asarray(rows, dtype=np.float64)
    largest = np.abs(matrix).max(initial=0.0)
    # as correlations, so that N and m weigh alike; what is known exactly has a variance of rounding only
    spread = np.sqrt(np.maximum(np.diag(matrix), 1e-9 * largest)) if largest > 0 else np.ones(size)
    matrix_of_one = matrix / spread / spread[:, None]
    if np.abs(matrix_of_one - matrix_of_one.T).max(initial=0.0) > _ROUNDING:
        raise ValueError(f"{name} must be symmetric")
    if np.linalg.eigvalsh(matrix_of_one).min(initial=0.0) < -_ROUNDING:
        raise ValueError(f"{name} must be positive semidefinite: a variance in it is negative")
    return matrix


@dataclass(frozen=True)
class _Reader:
    """Reader of one key; `sizes` maps letters in the shapes of its table to sizes."""

    file: str
    said: Key
    forms: Mapping[type, TableForm]
    sizes: dict[str, int]

    def value(self, value: Any, hint: Any, key: str) -> Any:
        for option in _options(hint):
            if is_dataclass(option) and isinstance(value, dict):
                table, kind = cast("dict[str, Any]", value), cast("type[Any]", option)
                return parse(table, kind, file=self.file, key=key, forms=self.forms)
            read = self._array if _is_array(option) else self._tuple if get_origin(option) is tuple else None
            if read is not None and isinstance(value, list):
                items = cast("list[Any]", value)
                alike = [each for each in _options(hint) if _is_array(each) or get_origin(each) is tuple]
                fitting = [each for each in alike if _nested(each) == any(isinstance(item, list) for item in items)]
                return read(items, (fitting or alike)[0], key)
            if option is float and type(value) in (int, float):
                return self._number(value, key)
            if option is int and type(value) is int:
                return int(self._number(value, key))
            if type(value) is option:
                return value
            if get_origin(option) is Mapping and isinstance(value, Mapping):
                texts = get_args(option)[1] is str
                table = cast("Mapping[str, Any]", value)
                return {name: str(said) if texts else said for name, said in table.items()}
        expected = " or ".join(_named(option) for option in _options(hint))
        raise InputError(f"{key} must be {expected}, not {_shown(value)}.", where=self.file)

    def _number(self, value: int | float, key: str) -> float:
        if self.said.infinite and abs(value) >= _LARGEST:
            return copysign(inf, value)
        if abs(value) <= _LARGEST:
            if value < self.said.least:
                bound = "negative" if self.said.least == 0 else f"below {self.said.least:g}"
                raise InputError(f"{key} must not be {bound}, but is {value:g}.", where=self.file)
            return float(value)
        if self.said.unknown and isnan(value):
            return nan
        raise InputError(f"{key} must be a finite number, not {_shown(value)}.", where=self.file)

    def _tuple(self, values: list[Any], hint: Any, key: str) -> tuple[Any, ...]:
        kinds = get_args(hint)
        if kinds[-1] is Ellipsis:
            kinds = (kinds[0],) * len(values)
        if len(values) != len(kinds):
            raise InputError(f"{key} must be {_named(hint)}, not {len(values)} values.", where=self.file)
        least = self.said.least
        if {*kinds} == {float} and all(type(each) is float and least <= each < _LARGEST > -each for each in values):
            return tuple(values)  # as below, without a call for each: a model may have thousands
        return tuple(
            self.value(value, kind, f"{key}[{k}]") for k, (value, kind) in enumerate(zip(values, kinds, strict=True))
        )

    def _array(self, values: list[Any], hint: type[AbstractArray], key: str) -> np.ndarray[Any, np.dtype[Any]]:
        kind, names = _leaf(hint), hint.dim_str.split()
        if len(names) == 1:
            rows = self._tuple(values, tuple[kind, ...], key)
            shape: tuple[int, ...] = (len(rows),)
        else:
            rows = self._tuple(values, tuple[tuple[kind, ...], ...], key)
            widths = {len(row) for row in rows} - ({0} if self.said.unknown else set())
            width = widths.pop() if len(widths) == 1 else int(names[1]) if names[1].isdigit() else 0
            rows = tuple(row or (nan,) * width for row in rows) if self.said.unknown else rows
            shape = (len(rows), -1 if widths else width)  # -1: of different lengths
        wanted = tuple(
            int(name) if name.isdigit() else self.sizes.setdefault(name, size)
            for name, size in zip(names, shape, strict=True)
        )
        if shape != wanted or -1 in wanted:
            size = " x ".join("any" if number < 0 else str(number) for number in wanted)
            said = f"a list of {size} numbers, not {shape[0]} values" if len(names) == 1 else f"{size} numbers"
            raise InputError(f"{key} must be {said}.", where=self.file)
        array = np.array(rows, dtype=cast("Any", kind)).reshape(shape)
        if len(names) == 2 and names[0] == names[1]:
            try:
                covariance_matrix(array, len(array), key)
            except ValueError as problem:
                raise InputError(f"{problem}.", where=self.file) from problem
        return array


def _stated(model: Any) -> dict[str, Key]:
    known = fields(model) if is_dataclass(model) else ()
    return {field.name: Key(infinite=True) for field in known if "infinite" in field.metadata}


def _is_array(option: Any) -> bool:
    return isinstance(option, type) and issubclass(option, AbstractArray)


def _nested(hint: Any) -> bool:
    """Check whether an annotation is an array of two axes or a tuple of tuples."""
    return len(hint.dim_str.split()) == 2 if _is_array(hint) else get_origin(get_args(hint)[0]) is tuple


def _leaf(hint: type[AbstractArray]) -> type:
    """Return the element type of an array: bool, int or float."""
    first = str(next(iter(hint.dtypes)))
    return bool if first.startswith("bool") else int if first.startswith("int") else float


def _shown(value: Any) -> str:
    if isinstance(value, (list, dict)):
        return "a list" if isinstance(value, list) else "a table"
    return "an integer that is too large" if isinstance(value, int) and abs(value) > _LARGEST else repr(value)


def _options(hint: Any) -> tuple[Any, ...]:
    return tuple(option for option in options(hint) if option is not types.NoneType)


def _named(option: Any) -> str:
    if is_dataclass(option):
        return f"a table of {', '.join(field.name for field in fields(option))}"
    if _is_array(option):
        return "a list of lists" if _nested(option) else "a list of numbers"
    if get_origin(option) is tuple:
        kinds = get_args(option)
        count = "" if kinds[-1] is Ellipsis else f"{len(kinds)} "
        inner = "lists" if _nested(option) else "texts" if kinds[0] is str else "numbers"
        return f"a list of {count}{inner}"
    return _NAMES.get(get_origin(option) or option, str(option))


def _dotted(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _in(key: str) -> str:
    return f" in [{key}]" if key else ""
