"""Annotations are checked in the first calls of each function in each test: a loop's hundredth call shows no more.

jaxtyping binds every call to two signatures, which costs more than most of what it checks.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from types import FunctionType
from typing import Any

import jaxtyping
import jaxtyping._decorator as decorator

__all__ = ["check_first_calls", "start_counting"]

CALLS = 20  # of a function in a test
_test = [0]  # how many have begun


def start_counting() -> None:
    """A test begins."""
    _test[0] += 1


def check_first_calls() -> None:
    """From now on, what `jaxtyping.jaxtyped` decorates is checked so."""
    original = decorator.jaxtyped

    def jaxtyped(function: Any = None, *, typechecker: Any) -> Any:
        if function is None:
            return functools.partial(jaxtyped, typechecker=typechecker)
        made = original(function, typechecker=typechecker)  # a class or a property comes back here with its functions
        return _first(made, function) if isinstance(function, FunctionType) else made

    jaxtyping.jaxtyped = decorator.jaxtyped = jaxtyped


def _first(checked: Callable[..., Any], plain: Callable[..., Any]) -> Callable[..., Any]:
    """`checked` for the first calls, then `plain`."""
    count, counted = 0, 0

    @functools.wraps(plain)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal count, counted
        if counted != _test[0]:
            count, counted = 0, _test[0]
        if count >= CALLS:
            return plain(*args, **kwargs)
        count += 1
        return checked(*args, **kwargs)

    return call
