"""Arrays are checked in the first call of each function in each test: a loop's hundredth call shows no more.

Functions that neither take nor return arrays are left to pyright, which reads the source in full strictness.
jaxtyping binds every call to two signatures, which costs more than most of what it checks. And a function's check is
made at its first call: making all of them cost each worker a third of the time in which it collects the tests.
"""

import functools
import re
import sys
from collections.abc import Callable
from types import CodeType, FunctionType, ModuleType
from typing import Any
from unittest import mock

import jaxtyping
import jaxtyping._decorator as decorator
import jaxtyping._import_hook as hook
import numpy as np
from jaxtyping import AbstractArray

PLACED = "palpate.files.", "palpate.setup."
UNPLACED = re.compile("/|link must|unknown unit|neither|unit bel|the rig has|no (topic|samp)|(fou|con).*must|there ")
CALLS = 1  # of a function in a test: with 20, the checks were a quarter of the time of all tests
_until = [CALLS]  # of a function's count of checked calls: each test adds `CALLS`
_counts: dict[CodeType, list[int]] = {}  # checked calls of a function, those of earlier tests taken for made


def cache_apart() -> None:
    """Only a checked module has bytecode of its own.

    While jaxtyping's loader runs a module, what that imports is cached under the name of the checked ones too: a fresh
    clone would compile NumPy and all the others once more.
    """
    loader: Any = hook._JaxtypingLoader
    loaded = loader.get_code

    def get_code(self: Any, fullname: str) -> Any:
        cached = functools.partial(hook._optimized_cache_from_source, self._typechecker.get_hash())
        with mock.patch("importlib._bootstrap_external.cache_from_source", cached):
            return loaded(self, fullname)

    def exec_module(self: Any, module: ModuleType) -> None:
        exec(self.get_code(module.__name__), vars(module))
        if vars(module).get("np") is np:
            vars(module)["np"] = _NUMPY

    loader.get_code, loader.exec_module = get_code, exec_module


def _spoilt(make: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """Arrays that hold no answer until one is written: not that of an array which had their memory before."""

    def made(*args: Any, **options: Any) -> np.ndarray:
        array = make(*args, **options)
        if array.dtype.kind in "fciu":
            array.fill(np.nan if array.dtype.kind in "fc" else 77)
        return array

    return made


_NUMPY = ModuleType("numpy")  # as checked modules know it
vars(_NUMPY).update(vars(np) | {name: _spoilt(getattr(np, name)) for name in ("empty", "empty_like")})


def require_places() -> None:
    """From now on, an `InputError` of a file or a rig names its place, but for some in `UNPLACED`."""
    from palpate.errors import InputError  # here, as modules that are imported before the hook are not checked

    made = InputError.__init__

    def placed(self: InputError, what: str, *, where: str = "", hint: str = "") -> None:
        files = sys._getframe(1).f_globals["__name__"].startswith(PLACED)
        assert where or not files or UNPLACED.match(what), f"an error without a place: {what}"
        made(self, what, where=where, hint=hint)

    InputError.__init__ = placed


def start_counting() -> None:
    """A test begins."""
    _until[0] += CALLS


def check_first_calls() -> None:
    """From now on, what `jaxtyping.jaxtyped` decorates is checked so."""
    original = decorator.jaxtyped

    def jaxtyped(function: Any = None, *, typechecker: Any) -> Any:
        if function is None:
            return functools.partial(jaxtyped, typechecker=typechecker)
        checked = functools.partial(original, function, typechecker=typechecker)
        if not isinstance(function, FunctionType):
            return checked()
        return _first(checked, function) if _of_arrays(function) else function

    jaxtyping.jaxtyped = decorator.jaxtyped = jaxtyped


def _of_arrays(function: FunctionType) -> bool:
    """Whether it takes or returns arrays, by their own name or one of the module's for a shape."""
    words = set(re.findall(r"\w+", " ".join(map(str, function.__annotations__.values()))))
    named = (function.__globals__.get(word) for word in words)
    return "ndarray" in words or any(isinstance(each, type) and issubclass(each, AbstractArray) for each in named)


def _first(made: Callable[[], Callable[..., Any]], plain: FunctionType) -> Callable[..., Any]:
    """`plain` with its check, as `made` returns it, for the first calls, then `plain` alone.

    A function in a function is another one at each call of the outer, whose check takes milliseconds to make: all of
    them count as one.
    """
    count, until = _counts.setdefault(plain.__code__, [0]), _until
    checked: Callable[..., Any] | None = None

    @functools.wraps(plain)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal checked
        if count[0] >= until[0]:
            return plain(*args, **kwargs)
        count[0] = max(count[0], until[0] - CALLS) + 1
        if checked is None:
            checked = made()
        try:
            return checked(*args, **kwargs)
        except TypeError as problem:
            if type(problem) is not TypeError:  # an annotation does not hold
                raise
            return plain(*args, **kwargs)  # arguments that do not fit its signature: in its own words

    return call
