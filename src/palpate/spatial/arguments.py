"""Conversion of the arguments of public functions to what their annotations require."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, wraps
from inspect import Parameter, isfunction, signature, unwrap
from operator import is_
from types import MethodType, NoneType
from typing import Any, ForwardRef, NamedTuple, TypeVar, cast, dataclass_transform, get_args, get_origin, overload

import numpy as np

from palpate.calls import evaluated, options
from palpate.errors import InputError
from palpate.spatial._arrays import LARGEST, form_of, shaped

_Made = TypeVar("_Made", bound=Callable[..., Any])
_Class = TypeVar("_Class", bound=type[Any])
_KEPT = 64  # forms of arguments of a function
_PUBLIC = ("__init__", "__call__")  # methods, for all their underscores; of a NamedTuple `__new__`, too
_WRITTEN = {"out", "out_covariance", "out_total"}  # a copy of these arguments would be of no use
_MISFITS = re.compile(  # NumPy's words, and those of LAPACK, SciPy and matplotlib
    "broadcast|mismatch|did not match|reshape|out.of.bounds|out of range|cannot assign|same length|same first dimension"
    "|not finite|invalid entry|too big|allowed size|one unknown dimension|negative values"
    "|Singular matrix|positive definite|did not converge"
)
_DTYPES = {"Float": np.dtype(np.float64), "Int": np.dtype(np.int64), "Bool": np.dtype(np.bool_)}


class _Size(NamedTuple):
    """Length of a named axis, or lengths of several (`*batch`), and the argument that has it."""

    length: int | tuple[int, ...]
    argument: str


class _Wanted(NamedTuple):
    """Requirements of an annotation on an argument; by default, a number.

    Attributes:
        optional: None is allowed, too.
        others: classes of which it may be instead.
        dtype: of an array; None: a number, or numbers of any type.
        axes: of an array, as jaxtyping writes them.
        whole: the number must be whole.
        any: any array of real numbers, which the function converts itself.
        parts: of a tuple of numbers: for each, whether it must be whole.
        many: place of the axis that stands for any number of axes; -1: none does.
    """

    name: str
    optional: bool = False
    others: tuple[type, ...] = ()
    dtype: np.dtype[Any] | None = None
    axes: tuple[str, ...] = ()
    whole: bool = False
    any: bool = False
    parts: tuple[bool, ...] = ()
    many: int = -1


def takes_arrays(made: _Made) -> _Made:
    """Decorate a function, or a class for its constructor and its public methods, that is annotated by jaxtyping.

    Arguments annotated as arrays may then be lists, tuples or anything that NumPy converts to an array of real numbers:
    the function gets an array of the annotated type, contiguous by rows, and the given one if it is that already. Axes
    of one name have one length in all arguments. Arguments named `out`, `out_covariance` and `out_total`, and `counts`
    in a function with `out`, are written into, and are not converted.

    Raises:
        InputError: by the decorated call: an argument has another shape or no real numbers; or NumPy or LAPACK cannot
            compute with the numbers, in which case the message names an argument that is empty or not finite.
    """
    return cast("_Made", _class(made) if isinstance(made, type) else _function(made, unwrap(made).__module__))


def unchecked(function: _Made) -> _Made:
    """Return a function or method without the checks of `takes_arrays`, for a loop that makes the arrays itself."""
    plain, owner = unwrap(function), getattr(function, "__self__", None)
    return cast("_Made", plain if owner is None or plain is function else MethodType(plain, owner))


@overload
@dataclass_transform(frozen_default=True, eq_default=False)
def frozen_value(made: _Class, /) -> _Class: ...
@overload
@dataclass_transform(frozen_default=True, eq_default=False)
def frozen_value(**options: bool) -> Callable[[_Class], _Class]: ...
def frozen_value(made: type[Any] | None = None, /, **options: bool) -> Any:
    """Decorate a class as a frozen dataclass that `takes_arrays`; values are equal only to themselves, unless `eq`.

    Args:
        made: the class.
        options: of `dataclasses.dataclass`.
    """
    if made is None:
        return partial(frozen_value, **options)
    return takes_arrays(dataclass(**{"frozen": True, "eq": False, **options})(made))


def _class(made: type[Any]) -> type[Any]:
    for name, value in list(vars(made).items()):
        if name.startswith("_") and name not in _PUBLIC and not (name == "__new__" and hasattr(made, "_fields")):
            continue
        if isinstance(value, classmethod | staticmethod):
            kind, plain = cast("Any", type(cast("Any", value))), cast("Any", value).__func__
            setattr(made, name, kind(_function(plain, made.__module__)))
        elif isfunction(value):
            setattr(made, name, _function(value, made.__module__))
    return made


def _function(function: Callable[..., Any], module: str) -> Callable[..., Any]:
    code = unwrap(function).__code__  # its names cost a tenth of what `signature` does, of a thousand functions
    taken = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    if not set(taken) - {"self", "cls"}:
        return function
    names = taken[: code.co_argcount]
    plan: dict[str, _Wanted] | None = None
    places: list[tuple[int, _Wanted]] = []
    fitting: set[tuple[Any, ...]] = set()  # forms of arguments that were taken as they are

    @wraps(function)
    def taking(*args: Any, **kwargs: Any) -> Any:
        nonlocal plan, places
        if plan is None:  # not earlier: annotations may name what its module defines later
            made = _plan(function, vars(sys.modules[module]))
            places = [(place, made[name]) for place, name in enumerate(names) if name in made]
            plan = made  # last, as another thread may look
        given = args
        form = form_of(args) if not kwargs else (*form_of(args), *kwargs, *form_of(kwargs.values()))
        if form not in fitting:
            sizes: dict[str, _Size] = {}
            given = list(args)
            for place, wanted in places:
                if place < len(args):
                    given[place] = _taken(wanted, args[place], sizes)
            named = {name: _taken(plan[name], kwargs[name], sizes) if name in plan else kwargs[name] for name in kwargs}
            if all(map(is_, (*given, *named.values()), (*args, *kwargs.values()))):
                if len(fitting) == _KEPT:
                    fitting.clear()
                fitting.add(form)
            kwargs = named
        try:
            return function(*given, **kwargs)
        except (ValueError, IndexError, ArithmeticError) as problem:
            unusable = _unusable({**dict(zip(names, given, strict=False)), **kwargs}, plan, problem)
            if not unusable:
                raise
            raise InputError(unusable) from problem

    vars(taking)["takes_arrays"] = True
    return taking


def _plan(function: Callable[..., Any], known: dict[str, Any]) -> dict[str, _Wanted]:
    """Return the requirements on arrays and numbers by the name of the argument."""
    made: dict[str, _Wanted] = {}
    parameters = signature(function).parameters
    written = _WRITTEN | {"counts"} if "out" in parameters else _WRITTEN
    for name, parameter in parameters.items():
        if name in written or parameter.kind in (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD):
            continue
        annotation = parameter.annotation
        if isinstance(annotation, ForwardRef):  # of a NamedTuple
            annotation = annotation.__forward_arg__
        stated = str(annotation)
        if stated.removesuffix(" | None") in ("ArrayLike", "np.ndarray"):
            wanted = _Wanted(name, stated.endswith("None"), any=True)
        else:
            wanted = _wanted(name, evaluated(annotation, known))
        if wanted is not None:
            made[name] = wanted
    return made


def _wanted(name: str, annotation: Any) -> _Wanted | None:
    stated = options(annotation)
    arrays = [option for option in stated if hasattr(option, "dim_str")]
    kinds = [option for option in stated if option in (float, int)]
    others = tuple(option for option in stated if isinstance(option, type) and option not in (*arrays, *kinds))
    optional = NoneType in others
    tuples = [get_args(option) for option in stated if get_origin(option) is tuple]
    if len(tuples) == 1 and len(tuples) + optional == len(stated) and set(tuples[0]) <= {int, float}:
        return _Wanted(name, optional, parts=tuple(part is int for part in tuples[0]))
    if len(arrays) > 1 and len(arrays) + optional == len(stated):  # of several types
        return _Wanted(name, optional, any=True)
    if len(arrays) + bool(kinds) != 1 or len(others) + len(arrays) + len(kinds) != len(stated):
        return None  # none of both, or what cannot be told from its class
    others = tuple(other for other in others if other is not NoneType)
    if not arrays:
        return _Wanted(name, optional, others, whole=float not in kinds)
    (array,) = arrays
    kind = array.dtype.__name__
    dtype = _DTYPES.get(kind) or np.dtype(kind.lower())
    axes = tuple(array.dim_str.split())
    many = next((place for place, axis in enumerate(axes) if axis == "..." or axis.startswith("*")), -1)
    return _Wanted(name, optional, others, dtype, axes, many=many)


def _taken(wanted: _Wanted, value: Any, sizes: dict[str, _Size]) -> Any:
    if (value is None and wanted.optional) or isinstance(value, wanted.others):
        return value
    if wanted.parts:
        return _tuple(wanted, value)
    if wanted.any:
        real = type(value) is np.ndarray and value.dtype.kind in "biuf" and value.flags.c_contiguous
        return value if real else _real(value, wanted.name)
    if wanted.dtype is None:
        plain = type(value) is int and -LARGEST < value < LARGEST if wanted.whole else type(value) is float
        return value if plain else _number(value, wanted)
    array = value
    if type(array) is not np.ndarray or array.dtype != wanted.dtype or not array.flags.c_contiguous:
        array = shaped(cast("Any", value), (...,), wanted.name, wanted.dtype)
    if not _bound(array.shape, wanted, sizes):
        raise InputError(f"{wanted.name} must have shape {_said(wanted.axes, sizes)}, not {array.shape}.")
    return array


def number(value: Any, name: str) -> float:
    """Return a number of any class as a float.

    Raises:
        InputError: it is no number.
    """
    return float(_number(value, _Wanted(name)))


def integer(value: Any, name: str) -> int:
    """Return a whole number of any class as an int.

    Raises:
        InputError: it is no whole number, or not below 2^62.
    """
    if type(value) is int and abs(value) < LARGEST:
        return value
    return int(_number(value, _Wanted(name, whole=True)))


def _tuple(wanted: _Wanted, values: Any) -> tuple[Any, ...]:
    array = shaped(values, (len(wanted.parts),), wanted.name)
    kinds = [_Wanted(f"{wanted.name}[{place}]", whole=whole) for place, whole in enumerate(wanted.parts)]
    return tuple(_number(value, kind) for value, kind in zip(array.tolist(), kinds, strict=True))


def _real(values: Any, name: str) -> np.ndarray:
    """Return an array of real numbers, of their type."""
    try:
        array = np.asarray(values, order="C")
    except (ValueError, TypeError):  # lists of different lengths, for one
        array = np.array([None])
    return array if array.dtype.kind in "biuf" else shaped(values, (...,), name)


def _number(value: Any, wanted: _Wanted) -> Any:
    """Return a number of any class as an int or a float; raise an InputError if it is none."""
    if isinstance(value, bool):
        return value
    array = shaped(value, (...,), wanted.name) if not isinstance(value, str) else np.zeros(0)
    if array.ndim or (wanted.whole and not (array == np.round(array) and abs(array) < LARGEST)):
        kind = "a whole number" if wanted.whole else "a number"
        raise InputError(f"{wanted.name} must be {kind}, not {value!r:.60}.")
    return int(array) if wanted.whole else float(array)


def _bound(shape: tuple[int, ...], wanted: _Wanted, sizes: dict[str, _Size]) -> bool:
    """Return whether a shape fits the axes and their lengths so far, to which it adds its own."""
    axes, many = wanted.axes, wanted.many
    if many < 0:
        fits = len(shape) == len(axes)
        for axis, length in zip(axes, shape, strict=False):
            fits = fits and _same(axis, length, wanted.name, sizes)
        return fits
    behind = len(axes) - many - 1
    if len(shape) < many + behind:
        return False
    end = len(shape) - behind
    single = zip((*axes[:many], *axes[many + 1 :]), (*shape[:many], *shape[end:]), strict=True)
    return all(_same(axis, length, wanted.name, sizes) for axis, length in single) and _same(
        axes[many].removeprefix("*"), shape[many:end], wanted.name, sizes
    )


def _same(axis: str, length: int | tuple[int, ...], argument: str, sizes: dict[str, _Size]) -> bool:
    """Return whether axes have the length noted for their name."""
    if axis.isdigit():
        return length == int(axis)
    if axis in ("_", "..."):
        return True
    name = axis.removeprefix("#")
    known = sizes.setdefault(name, _Size(length, argument)).length
    if known == length or name == axis:
        return known == length
    try:
        both = np.broadcast_shapes(cast("tuple[int, ...]", known), cast("tuple[int, ...]", length))
    except ValueError:
        return False
    sizes[name] = _Size(both, argument)
    return True


def _said(axes: tuple[str, ...], sizes: dict[str, _Size]) -> str:
    """Format a shape with the lengths that other arguments have."""
    words = [axis.lstrip("*#") for axis in axes]
    known = [sizes[word].length if word in sizes else word for word in words]
    flat = [str(part) for each in known for part in (each if isinstance(each, tuple) else (each,))]
    because = [f"{word} as in {sizes[word].argument}" for word in words if word in sizes]
    return f"({', '.join(flat)}{',' * (len(flat) == 1)})" + (f" ({', '.join(because)})" if because else "")


def _unusable(given: dict[str, Any], plan: dict[str, _Wanted], problem: Exception) -> str:
    """Return a sentence on the argument with which the function cannot compute; "" if none is known."""
    for name in plan:
        value = given.get(name)
        if isinstance(value, np.ndarray):
            array = cast("np.ndarray", value)
            if not array.size:
                return f"{name} is empty."
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                first = np.argwhere(~np.isfinite(array))[0].tolist()
                return f"{name} must be finite, and is {array[tuple(first)]} at {first}."
        elif isinstance(value, float) and not math.isfinite(value):
            return f"{name} must be finite, not {value}."
        elif isinstance(problem, ZeroDivisionError) and isinstance(value, float | int) and value == 0:
            return f"{name} must not be zero."
    if _MISFITS.search(str(problem)):
        shapes = [f"{name} {cast('np.ndarray', given[name]).shape}" for name in plan if _is_array(given.get(name))]
        numbers = [f"{name} {given[name]}" for name in plan if isinstance(given.get(name), float | int | tuple)]
        return f"{', '.join(shapes + numbers)} cannot be used: {problem}." if shapes + numbers else ""
    return ""


def _is_array(value: Any) -> bool:
    return isinstance(value, np.ndarray)
