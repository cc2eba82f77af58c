"""Values for the arguments of public callables: such as were seen in other calls, and such as annotations alone say."""

import inspect
import sys
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any

import numpy as np

LENGTH = 6  # of every named axis, which suits three-vectors in pairs and square matrices
DEPTH = 3  # of values in values that were seen
SINGLE = {"time", "row", "column", "frequency"}  # arguments that may be one number
SIXES = {"wrench", "reading", "q", "vector"}
THREES = {"positions", "normals", "points"}
PLAIN = {float: 0.5, int: 2, bool: True, str: "a", bytes: b"a"}


class Seen:
    """What calls were given and answered: by the name and annotation of an argument, and by class."""

    def __init__(self) -> None:
        self.given = dict[tuple[str, str], Any]()
        self.values = dict[type, Any]()

    def call(self, bound: inspect.BoundArguments) -> None:
        for name, value in bound.arguments.items():
            annotation = str(bound.signature.parameters[name].annotation)
            if name == "self" or isinstance(value, Iterator):  # a constructor may not be done with it
                continue
            self.given.setdefault((name, annotation), value)
            self.given.setdefault(("", annotation), value)
            self.value(value)

    def value(self, value: Any, depth: int = 0) -> None:
        """Keep a value of a class of Palpate, and those that it has."""
        if isinstance(value, list | tuple) and depth < DEPTH:
            for each in value[:3]:
                self.value(each, depth + 1)
        kind = type(value)
        if not kind.__module__.startswith("palpate") or kind in self.values:
            return
        self.values[kind] = value
        if depth < DEPTH and hasattr(value, "__dict__"):
            for each in list(vars(value).values()):
                self.value(each, depth + 1)

    def of(self, kind: type) -> Any:
        """Return a value of a class, or of one that is as good."""
        if kind in self.values:
            return self.values[kind]
        for other, value in self.values.items():
            if issubclass(other, kind):
                return value
        raise LookupError(kind)


def attempts(called: Callable[..., Any], owner: type | None, seen: Seen) -> Iterator[inspect.BoundArguments]:
    """Arguments with which something may be callable: arrays as annotated, arrays as seen, all arguments or the due."""
    signature = inspect.signature(called)
    for length, prefer in ((LENGTH, False), (LENGTH, True), (3, False)):
        for every in (True, False):
            given = dict[str, Any]()
            try:
                for name, parameter in signature.parameters.items():
                    if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
                        continue
                    if name in ("self", "cls"):
                        given[name] = owner if name == "cls" else seen.of(owner or object)
                    elif parameter.default is parameter.empty or (every and "np.ndarray" in str(parameter.annotation)):
                        given[name] = _value(name, parameter, called, seen, length, prefer=prefer)
            except (LookupError, NameError, TypeError, AttributeError):
                continue
            yield inspect.BoundArguments(signature, typing.cast("Any", given))


def _value(
    name: str, parameter: inspect.Parameter, called: Callable[..., Any], seen: Seen, length: int, *, prefer: bool
) -> Any:
    annotation: Any = parameter.annotation
    if isinstance(annotation, typing.ForwardRef):  # of a NamedTuple
        annotation = annotation.__forward_arg__
    stated = str(annotation)
    array = "np.ndarray" in stated or stated.startswith("ArrayLike")
    if stated.startswith("ArrayLike") and not (prefer and (name, stated) in seen.given):
        return _numbers(name, length)
    if (prefer or not array) and (name, stated) in seen.given:
        return seen.given[name, stated]
    if isinstance(annotation, str):
        annotation = eval(annotation, _names(called))
    try:
        return _made(name, annotation, seen, length)
    except LookupError:
        return seen.given["", stated]


@cache
def _of_palpate() -> dict[str, Any]:
    import collections.abc

    import palpate

    names = {**vars(typing), **vars(collections.abc), **{n: getattr(palpate, n) for n in palpate.__all__}}
    for module in [m for n, m in list(sys.modules.items()) if n.startswith("palpate") and m is not None]:
        for key, value in vars(module).items():
            if isinstance(value, type):
                names.setdefault(key, value)
    return names


def _names(called: Any) -> dict[str, Any]:
    """What the annotations of a module may say, with what it imports for type checkers only."""
    names = _of_palpate()
    plain = called
    while hasattr(plain, "__wrapped__"):
        plain = plain.__wrapped__
    return {**names, **vars(sys.modules[plain.__module__])}


def _made(name: str, annotation: Any, seen: Seen, length: int) -> Any:
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin in (typing.Union, UnionType):
        for option in sorted(parts, key=lambda each: each is NoneType):
            try:
                return _made(name, option, seen, length)
            except LookupError:
                continue
        raise LookupError(name)
    if hasattr(annotation, "dim_str"):
        return _array(name, annotation, length)
    if annotation is NoneType or annotation is None:
        return None
    if annotation in PLAIN:
        return PLAIN[annotation]
    if origin is typing.Literal:
        return parts[0]
    if origin is tuple:
        inner = parts[:1] * 3 if parts[-1] is ... else parts
        return tuple(_made(name, each, seen, length) for each in inner)
    if origin is list or (isinstance(origin, type) and issubclass(origin, Iterable) and len(parts) == 1):
        made = [_made(name, parts[0], seen, length) for _ in range(2)]
        return tuple(made) if origin is not list and issubclass(origin, Sequence) else made
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {_made(name, parts[0], seen, length): _made(name, parts[1], seen, length)}
    if isinstance(annotation, type):
        if issubclass(annotation, Enum):
            return next(iter(annotation))
        if annotation is Path:
            return Path("made_up")
        if annotation is object:
            return None
        if annotation.__module__.startswith("palpate"):
            return seen.of(annotation)
    if annotation is np.ndarray:
        return _numbers(name, length)
    raise LookupError(name)


def _numbers(name: str, length: int) -> Any:
    if name in SINGLE:
        return 0.5
    if name in THREES:
        return np.random.default_rng(len(name)).normal(size=(length, 3))
    if name in SIXES:
        return 0.1 * np.arange(1.0, 7.0)
    return np.array([0.1, 0.2, 0.3])


def _array(name: str, annotation: Any, length: int) -> np.ndarray:
    """Numbers of the shape and kind that is annotated, as its name wants them."""
    shape = tuple(int(axis) if axis.isdigit() else length for axis in annotation.dim_str.split())
    kind, rng = annotation.dtype.__name__, np.random.default_rng(len(name))
    if kind == "Bool":
        return rng.random(shape) < 0.7
    if kind != "Float":
        whole = (np.arange(np.prod(shape, dtype=int)) % 3).reshape(shape)
        return whole.astype({"Int": "int64", "UInt8": "uint8"}.get(kind, kind.lower()))
    if shape[-2:] == (3, 3) and name.startswith(("rotation", "turn", "axes", "frame")):
        return np.broadcast_to(np.eye(3), shape).copy()
    if len(shape) > 1 and shape[-1] == shape[-2]:
        return np.broadcast_to(0.1 * np.eye(shape[-1]), shape).copy()
    if len(shape) == 1 and shape[0] == length:
        return 0.1 * np.arange(1.0, 1.0 + length)
    values = rng.normal(size=shape)
    unit = name.startswith(("quaternion", "normal", "direction", "heading", "axis", "way"))
    return values / np.linalg.norm(values, axis=-1, keepdims=True) if unit else values
