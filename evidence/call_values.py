"""Valid calls made from annotations alone, of callables that take arrays, numbers and values that these make."""

from __future__ import annotations

import inspect
import sys
import time
import typing
import warnings
from types import UnionType
from typing import Any

import numpy as np

from evidence.call_walk import Call, Known

__all__ = ["generated"]

LENGTH = 6  # of every named axis, which suits three-vectors in pairs and square matrices
ROUNDS = 3  # of making values from values


def generated(known: list[Known], calls: dict[str, Call]) -> dict[str, Call]:
    """The calls that are there, and one of each other callable that can be called with what its annotations say."""
    calls, pool = dict(calls), dict[type, Any]()
    for call in calls.values():
        if "self" in call.bound.arguments:
            pool.setdefault(type(call.bound.arguments["self"]), call.bound.arguments["self"])
    for _ in range(ROUNDS):
        for each in known:
            if each.name not in calls:
                _try(each, calls, pool)
    return calls


def _try(known: Known, calls: dict[str, Call], pool: dict[type, Any]) -> None:
    made = known.owner if known.attribute == "__init__" and known.owner is not None else known.made
    try:
        signature = inspect.signature(made)
        given = {name: _value(name, each, known, pool) for name, each in signature.parameters.items() if _due(each)}
        bound = (
            signature.bind(**{name: value for name, value in given.items() if name not in ("self", "cls")})
            if (not {"self", "cls"} & given.keys())
            else inspect.BoundArguments(signature, given)
        )
        begun = time.perf_counter()
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            answer = getattr(made, "unwatched", made)(*bound.args, **bound.kwargs)
    except Exception:  # it cannot be called so
        return
    calls[known.name] = Call(known, bound, time.perf_counter() - begun)
    if known.owner is not None and isinstance(answer, known.owner):
        pool.setdefault(known.owner, answer)


def _due(parameter: inspect.Parameter) -> bool:
    """Whether it must be given, or takes arrays."""
    if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
        return False
    return parameter.default is parameter.empty or "np.ndarray" in str(parameter.annotation)


def _value(name: str, parameter: inspect.Parameter, known: Known, pool: dict[type, Any]) -> Any:
    if name in ("self", "cls"):
        return (
            known.owner if name == "cls" else next(v for k, v in pool.items() if issubclass(k, known.owner or object))
        )
    annotation: Any = parameter.annotation
    if isinstance(annotation, str):
        annotation = eval(annotation, vars(sys.modules[known.made.__module__]))
    options = typing.get_args(annotation) if isinstance(annotation, UnionType) else (annotation,)
    for option in options:
        if hasattr(option, "dim_str"):
            return _array(name, option)
        if option in (float, int, bool, str):
            return {float: 0.5, int: 2, bool: True, str: "a"}[option]
        for kind, value in pool.items():
            if isinstance(option, type) and issubclass(kind, option):
                return value
    if "ArrayLike" in str(parameter.annotation):
        return np.array([0.1, 0.2, 0.3])
    raise LookupError(name)


def _array(name: str, annotation: Any) -> np.ndarray:
    """Numbers of the shape and kind that is annotated, as its name wants them."""
    shape = tuple(int(axis) if axis.isdigit() else LENGTH for axis in annotation.dim_str.split())
    kind, rng = annotation.dtype.__name__, np.random.default_rng(len(name))
    if kind == "Bool":
        return rng.random(shape) < 0.7
    if kind != "Float":
        return (
            (np.arange(np.prod(shape, dtype=int)) % 3).reshape(shape).astype({"Int": "int64"}.get(kind, kind.lower()))
        )
    if shape[-2:] == (3, 3) and name.startswith(("rotation", "turn", "axes", "frame")):
        return np.broadcast_to(np.eye(3), shape).copy()
    if len(shape) > 1 and shape[-1] == shape[-2]:
        return np.broadcast_to(0.1 * np.eye(shape[-1]), shape).copy()
    if len(shape) == 1 and shape[0] == LENGTH:
        return 0.1 * np.arange(1.0, 1.0 + LENGTH)
    values = rng.normal(size=shape)
    unit = name.startswith(("quaternion", "normal", "direction", "heading", "axis", "way"))
    return values / np.linalg.norm(values, axis=-1, keepdims=True) if unit else values
