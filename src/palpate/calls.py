"""Explain a wrong argument of a public call with the line to write, and import by name from higher layers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from importlib import import_module
from inspect import Signature, getattr_static, signature, unwrap
from os import PathLike
from types import FunctionType, NoneType, UnionType
from typing import Any, TypeVar, Union, cast, get_args, get_origin

import numpy as np

from palpate.errors import InputError

_Made = TypeVar("_Made", bound=Callable[..., Any])
_KINDS: dict[Any, str] = {
    str: "text",
    float: "a number",
    int: "a whole number",
    bool: "True or False",
    PathLike: "a path",
    NoneType: "None",
    Mapping: "a mapping",
    Sequence: "a list",
}


class _Numbers:
    """Marker that stands for NumPy's ArrayLike in an annotation."""


def by_name(dotted: str) -> Any:
    """Import and return an object of a module, for values to save or draw and for tables of classes.

    Args:
        dotted: module and name, "palpate.files.contacts.read_contacts".

    Raises:
        ImportError: there is no such module.
        AttributeError: the module has no such name.
        ValueError: `dotted` has no dot.
    """
    module, _, name = dotted.rpartition(".")
    return getattr(import_module(module), name)


def called_as(line: str, **lines: str) -> Callable[[_Made], _Made]:
    """Return a decorator of a function or class, whose calls with a wrong argument then say what to write.

    Arguments are checked only after a call has failed. If an argument is missing, unknown or of another kind than its
    annotation, or the error is about its shape, the call raises `InputError` with the line; else the error as it was.
    An attribute that a class does not have raises `AttributeError` with its line, or with the attributes that exist.

    Args:
        line: a call as a user writes it.
        lines: name -> call, for methods of the class, and for arguments and attributes that do not exist.
    """

    def decorated(made: Any) -> Any:
        if not isinstance(made, type):
            return _explained(made, made.__qualname__, line, lines)
        for name, written in {"__init__": line, **lines}.items():
            method: Any = getattr_static(made, name, None)
            of_class, where = type(method) is classmethod, f"{made.__qualname__}.{name}".partition(".__")[0]
            if of_class or type(method) is FunctionType:
                plain = _explained(getattr(method, "__func__", method), where, written, {})
                setattr(made, name, classmethod(plain) if of_class else plain)
        cast("Any", made).__getattr__ = _answering(lines)
        return made

    return cast("Callable[[_Made], _Made]", decorated)


def _answering(lines: Mapping[str, str]) -> Callable[[object, str], Any]:
    """Return the `__getattr__` of a class."""

    def answer(value: object, name: str) -> Any:
        if hasattr(type(value), name):  # a property that has failed: as it did
            return object.__getattribute__(value, name)
        known = [each for each in dir(value) if not each.startswith("_")]
        hint = f"Write {lines[name]}" if name in lines else f"It has {', '.join(known)}"
        what = f"{type(value).__name__!r} object has no attribute {name!r}"
        raise AttributeError(f"{what}. {hint}.", name=name, obj=value)

    return answer


def _explained(function: Any, where: str, line: str, lines: Mapping[str, str]) -> Any:
    @wraps(function)
    def explaining(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except Exception as problem:
            wrong = _wrong(function, args, kwargs) or _unfit(function, problem)
            if not wrong:
                raise
            meant = next((lines[name] for name in kwargs if name in lines), line)
            raise InputError(wrong, where=where, hint=f"Write {meant}.") from problem

    return explaining


def _wrong(function: Any, args: tuple[Any, ...], kwargs: Mapping[str, Any]) -> str:
    """Return a sentence about the first argument that is missing, unknown or of another kind, or ""."""
    stated = signature(function)
    try:
        given = stated.bind(*args, **kwargs).arguments
    except TypeError as problem:
        names = [name for name in stated.parameters if name not in ("self", "cls")]
        return f"{problem}; the arguments are {', '.join(names)}."
    for name, kinds in _taken(function, stated).items():
        if name in given and kinds and not any(_fits(kind, given[name]) for kind in kinds):
            *others, last = dict.fromkeys(_named(kind) for kind in kinds)
            words = f"{', '.join(others)} or {last}" if others else last
            return f"{name} must be {words}, not {_described(given[name])}."
    return ""


def _unfit(function: Any, problem: Exception) -> str:
    """Return the sentence of an error about an argument, such as its shape, that has no hint yet, or ""."""
    if not isinstance(problem, InputError) or problem.where or problem.hint:
        return ""
    return problem.what if problem.what.split()[0] in signature(function).parameters else ""


def _taken(function: Any, stated: Signature) -> dict[str, tuple[Any, ...]]:
    """Return name of an argument -> kinds of its annotation, without names that only type checkers import."""
    names = {**getattr(unwrap(function), "__globals__", {}), "ArrayLike": _Numbers}
    kinds = {
        name: evaluated(each.annotation, names)
        for name, each in stated.parameters.items()
        if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD) and each.annotation is not each.empty
    }
    return {name: options(kind) for name, kind in kinds.items() if kind is not None}


def evaluated(annotation: Any, names: dict[str, Any]) -> Any:
    """Return an annotation, one in quotes by these names; None if it has a name that only type checkers import."""
    try:
        return eval(annotation, names) if isinstance(annotation, str) else annotation
    except (NameError, AttributeError, TypeError):
        return None


def options(annotation: Any) -> tuple[Any, ...]:
    """Return the members of a union, and another annotation alone."""
    return get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)


def _fits(option: Any, value: Any) -> bool:
    """Return whether a value is of a kind; True for unknown kinds."""
    if option is _Numbers or hasattr(option, "dim_str"):
        return _is_numbers(value)
    if option in (float, int):
        return _is_numbers(value, "biuf" if option is float else "biu") and np.ndim(value) == 0
    kind: Any = get_origin(option) or option or NoneType
    if kind is Sequence:
        return isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    return isinstance(value, kind) if isinstance(kind, type) and kind is not Any else True


def _is_numbers(value: Any, kinds: str = "biuf") -> bool:
    try:
        return np.asarray(value).dtype.kind in kinds
    except Exception:  # whatever an object of another library raises
        return False


def _named(option: Any) -> str:
    """Return the words for a kind of argument."""
    if option is _Numbers or hasattr(option, "dim_str"):
        axes = ["..." if axis.startswith("*") else axis for axis in getattr(option, "dim_str", "").split()]
        return f"numbers of shape ({', '.join(axes)}{',' * (len(axes) == 1)})" if axes else "numbers"
    kind: Any = get_origin(option) or option or NoneType
    return _KINDS.get(kind) or _one(kind)


def _described(value: Any) -> str:
    """Return the words for an argument that was given."""
    if isinstance(value, float | int | str | PathLike | None):
        return f"{value!r:.60}"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, list | tuple):
        try:
            return f"a list of {np.asarray(cast('Any', value)).dtype}"
        except (ValueError, TypeError):
            return "lists of more than one shape"
    shape, kind = getattr(value, "shape", None), getattr(value, "dtype", None)
    parts = [f"shape {shape}"] if isinstance(shape, tuple) else []
    parts += [] if kind is None else [str(kind)]
    return " of ".join([_one(cast("Any", type(value))), *parts])


def _one(kind: type[Any]) -> str:
    name = kind.__name__.replace("ndarray", "array")
    return f"{'an' if name[0] in 'aeiouAEIOU' else 'a'} {name}"
