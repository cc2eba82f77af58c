"""Annotations are checked in the first calls of each function in each test: a loop's hundredth call shows no more.

jaxtyping binds every call to two signatures, which costs more than most of what it checks. And a function's check is
made at its first call: making all of them cost each worker a third of the time in which it collects the tests.
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
        checked = functools.partial(original, function, typechecker=typechecker)
        return _first(checked, function) if isinstance(function, FunctionType) else checked()

    jaxtyping.jaxtyped = decorator.jaxtyped = jaxtyped


def _first(made: Callable[[], Callable[..., Any]], plain: Callable[..., Any]) -> Callable[..., Any]:
    """`plain` with its check, as `made` returns it, for the first calls, then `plain` alone."""
    count, counted = 0, 0
    checked: Callable[..., Any] | None = None

    @functools.wraps(plain)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal count, counted, checked
        if counted != _test[0]:
            count, counted = 0, _test[0]
        if count >= CALLS:
            return plain(*args, **kwargs)
        count += 1
        if checked is None:
            checked = made()
        return checked(*args, **kwargs)

    return call
