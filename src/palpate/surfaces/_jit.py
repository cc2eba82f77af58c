"""Compile loops: ahead of time into the extension module of this version, or by numba where it has none.

A kernel is a plain Python function with one of the decorators below. numba is imported when the first of them has to be
compiled, which is never where the extension module (`native_build.py`) contains the called function.
"""

# pyright: basic
from __future__ import annotations

import gc
import hashlib
import logging
import os
import platform
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache, cached_property, update_wrapper
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from time import perf_counter
from typing import Any, cast

from palpate.errors import not_loaded
from palpate.spatial._arrays import form_of
from palpate.surfaces._arguments import Argument, forms, require
from palpate.waiting import waiting

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

PACKAGE = Path(__file__).parents[1]
LABORATORY = PACKAGE.with_name("palpate_lab")  # the other package of the wheel
CONSTANTS = ("_arguments.py", "_edges.py", "_patches.py", "_settings.py")  # of signatures, and of numbers in kernels
CPUINFO = Path("/proc/cpuinfo")
V3 = frozenset(["avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"])  # flags of x86-64-v3 in /proc/cpuinfo


def kernel_files() -> list[Path]:
    """Return the files that compiled code is made of, in order."""
    every = (file for folder in (PACKAGE, LABORATORY) for file in sorted(folder.rglob("_[a-z]*.py")))
    private = [file for file in every if file.name != "_jit.py"]
    return [file for file in private if file.name in CONSTANTS or b"surfaces._jit import" in file.read_bytes()]


def _stamp() -> str:
    """Return a digest of the kernels, and of how they are compiled."""
    digest = hashlib.sha256(repr(OPTIONS).encode())
    for file in kernel_files():
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


# a * b + c stays two instructions. Left to the compiler it is one or two as a function happens to be compiled into
# another, and the process that compiles has other last bits than those that read its machine code; it was no faster.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False}
STAMP = _stamp()
ENTRIES: dict[str, Entry] = {}  # every compiled function that Python calls, by its module and name
KEPT = 256  # forms of arguments that an entry remembers
PARTS = ("sensors", "mesh", "equation", "basics")  # of the extension module, compiled side by side, longest first
_CHOICES: list[tuple[Callable[..., Any], Callable[..., Any]]] = []
_MAKING = threading.RLock()


class _Compiling:
    """Time that the compiler has taken, from the first function to the last of those that it compiles for it."""

    def __init__(self) -> None:
        self.seconds, self._depth, self._begin = 0.0, 0, 0.0

    def __enter__(self) -> None:
        self._begin = self._begin if self._depth else perf_counter()
        self._depth += 1

    def __exit__(self, *_: object) -> None:
        self._depth -= 1
        self.seconds += 0.0 if self._depth else perf_counter() - self._begin


_COMPILING = _Compiling()


def compile_seconds() -> float:
    """Return how long this process has compiled so far [s]."""
    return _COMPILING.seconds


class Kernel:
    """A function that is compiled when compiled code first calls it; a call from Python runs the Python source."""

    def __init__(self, function: Callable[..., Any], **options: Any) -> None:
        self.py_func, self.options = function, {"_nrt": True, **options}  # a caller without it would pass that on
        update_wrapper(self, function)

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's compiler of this function, made when first needed."""
        with _MAKING:
            if "dispatcher" not in vars(self):
                vars(self)["dispatcher"] = _dispatcher(self.py_func, self.options)
            return vars(self)["dispatcher"]

    @property
    def _numba_type_(self) -> Any:
        return self.dispatcher._numba_type_

    @property
    def targetoptions(self) -> Any:
        """Numba's options, which its inliner reads."""
        return self.dispatcher.targetoptions

    def __call__(self, *given: Any) -> Any:
        return self.py_func(*given)


class Entry(Kernel):
    """A compiled function that Python calls: every call checks its arguments first.

    Attributes:
        name: by which the extension module exports it.
        ways: its arguments, for each way in which it can be called.
    """

    def __init__(self, function: Callable[..., Any], stated: str, **options: Any) -> None:
        super().__init__(function, cache=True, **options)
        names = function.__code__.co_varnames[: function.__code__.co_argcount]
        self.ways: tuple[tuple[Argument, ...], ...] = forms(stated, names)
        self.name = f"{function.__module__.removeprefix('palpate.')}.{function.__name__}".replace(".", "_")
        self._compiled: dict[int, Callable[..., Any]] = {}
        self._fitting: dict[tuple[Any, ...], Callable[..., Any]] = {}  # forms of arguments that were seen to fit
        ENTRIES[self.name] = self

    def __call__(self, *given: Any) -> Any:
        return self.compiled_for(*given)(*given)

    def compiled_for(self, *given: Any) -> Callable[..., Any]:
        """Return the compiled function for arguments like these; its own calls check nothing.

        For loops whose arrays are made once and stay; new arrays from a caller are checked where they come in.

        Raises:
            InputError: an argument has another type, shape or layout than compiled code reads.
        """
        form = form_of(given)
        compiled = self._fitting.get(form)
        if compiled is None:
            compiled = self._of(require(self.py_func, self.ways, given))
            if len(self._fitting) >= KEPT:
                self._fitting.clear()
            self._fitting[form] = compiled
        return compiled

    @property
    def unchecked(self) -> Callable[..., Any]:
        """The compiled function itself, where there is one way to call it."""
        (_,) = self.ways
        return self._of(0)

    def _of(self, way: int) -> Callable[..., Any]:
        """Return the compiled function of a way: of the extension module, or numba's."""
        compiled = self._compiled.get(way)
        if compiled is None:
            compiled = self._compiled[way] = _native().get(self.symbol(way)) or self.dispatcher
        return compiled

    def symbol(self, way: int) -> str:
        """Return the name of the function for a way of calling it in the extension module."""
        return f"{self.name}_{way}"

    def __reduce__(self) -> str:  # by its name in its module
        return self.py_func.__name__


class FixedEntry:
    """An entry whose arguments from a place on are made once and stay: a call gives the others, and checks only these.

    Args:
        entry: the compiled function.
        place: of the first fixed argument.
        fixed: these arguments.
    """

    def __init__(self, entry: Entry, place: int, fixed: tuple[Any, ...]) -> None:
        self._made, self._place, self.fixed = entry, place, fixed
        self._fitting: dict[tuple[Any, ...], Callable[..., Any]] = {}

    def __call__(self, *given: Any) -> Any:
        every, form = (*given[: self._place], *self.fixed, *given[self._place :]), form_of(given)
        compiled = self._fitting.get(form)
        if compiled is None:
            if len(self._fitting) >= KEPT:
                self._fitting.clear()
            compiled = self._fitting[form] = self._made.compiled_for(*every)
        return compiled(*every)

    def __reduce__(self) -> tuple[Any, ...]:
        return FixedEntry, (self._made, self._place, self.fixed)


def entry(stated: str) -> Callable[[Callable[..., Any]], Entry]:
    """Return a decorator of a compiled function that Python calls; its arguments are stated as `forms` reads them.

    Division by zero gives inf as in NumPy; NaN and inf keep their meaning.
    """
    return lambda function: Entry(function, stated)


def released(stated: str) -> Callable[[Callable[..., Any]], Entry]:
    """Return a decorator as `entry` does, for a loop over many samples: other threads of Python go on meanwhile."""
    return lambda function: Entry(function, stated, nogil=True)


def inner(function: Callable[..., Any]) -> Kernel:
    """Decorate a function that only compiled code calls: no wrapper for Python, which halves the compiler's work."""
    return Kernel(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=False)


def uncounted(function: Callable[..., Any]) -> Kernel:
    """Decorate an inner function that neither makes nor returns an array: it need not count who holds its views.

    Counting them is atomic, and took a quarter of the time of a frame of taxels.
    """
    return Kernel(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=False, _nrt=False)


def inlined(function: Callable[..., Any]) -> Kernel:
    """Decorate one of the few inner functions that must not become a call: LLVM inlines it, whatever its size."""
    return Kernel(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True)


def chosen_for(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a decorator of a function that returns the function to compile, given the types of the arguments."""

    def decorate(choice: Callable[..., Any]) -> Callable[..., Any]:
        _CHOICES.append((function, choice))
        return choice

    return decorate


def register_choices() -> None:
    """Register the functions chosen by types with numba, before anything is compiled."""
    from numba.extending import overload

    while _CHOICES:
        function, choice = _CHOICES.pop()
        cast(Any, overload)(function, jit_options=OPTIONS)(choice)


def level() -> str:
    """Return the processor's instructions that compiled code may use: x86-64-v3, or the machine's name."""
    machine = platform.machine()
    if machine != "x86_64":
        return machine
    with suppress(OSError), CPUINFO.open(encoding="ascii", errors="replace") as file:
        flags = next((line for line in file if line.startswith("flags")), "")
        if set(flags.split()) >= V3:
            return "x86-64-v3"
    return "x86-64"


def native_file(level: str, part: str) -> Path:
    """Return the path of the extension module of these kernels, for a level and this Python."""
    return PACKAGE / "_native" / f"{level}-{STAMP}-{part}{EXTENSION_SUFFIXES[0]}"


@cache
def _native() -> dict[str, Callable[..., Any]]:
    """Return the functions of the extension module; none where it does not exist, or PALPATE_NATIVE is 0."""
    if os.environ.get("PALPATE_NATIVE") == "0":
        return {}
    found: dict[str, Callable[..., Any]] = {}
    for part in PARTS:
        files = [file for name in (level(), level().removesuffix("-v3")) if (file := native_file(name, part)).exists()]
        if files:
            name = f"palpate_native_{part}"
            spec = cast(Any, spec_from_file_location(name, files[0], loader=ExtensionFileLoader(name, str(files[0]))))
            try:
                functions = vars(module_from_spec(spec))
            except ImportError as problem:  # another C library than it was built with, or a torn file
                logging.getLogger("palpate").error("palpate: %s cannot be loaded (%s)", files[0], problem)
                continue
            for function in functions.values():
                if callable(function):
                    function.__module__ = __name__  # where a pickle finds it, by `__getattr__`
                    found[function.__name__] = function
    return found


def __getattr__(name: str) -> Callable[..., Any]:
    """Return a function of the extension module."""
    function = None if name.startswith("_") else _native().get(name)
    if function is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return function


def _dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return numba's compiler of a function; the machine code of an entry is kept on disk where that can be written."""
    try:
        from numba import njit
    except ImportError as problem:
        what = "this kernel was not compiled ahead of time, which needs numba"
        raise not_loaded(problem, what, "compile") from problem
    register_choices()
    try:
        made = cast(Any, njit)(**options, **OPTIONS)(function)
    except RuntimeError:  # neither the package nor a home can be written
        _warn_once()
        made = cast(Any, njit)(**{**options, "cache": False}, **OPTIONS)(function)
        made.compile = _announced(made.compile)
        return _once_for_constants(made)
    return _once_for_constants(_kept(made) if options.get("cache") else made)


@cache
def _warn_once() -> None:
    logging.getLogger("palpate").error(
        "palpate: compiling in every process: no folder for machine code can be written (NUMBA_CACHE_DIR names one)"
    )


def _announced(compiles: Callable[..., Any]) -> Callable[..., Any]:
    """Return a dispatcher's `compile` that counts its time, and announces the wait."""

    def compile(signature):
        with _COMPILING, waiting("compiling, once; it takes about a minute"):
            return compiles(signature)

    return compile


def _kept(dispatcher: Any) -> Any:
    """Keep machine code by the stamp of all kernels; numba's goes by the function's own file, not by what it calls.

    Processes that start together do not compile the same function each: the others wait for the first.
    """
    dispatcher._cache._cache_file._source_stamp = STAMP
    dispatcher.compile = _announced(_by_one_process(dispatcher))
    return dispatcher


def _once_for_constants(dispatcher: Any) -> Any:
    """Take calls from compiled code with a constant as calls with its type, or each constant is compiled anew."""
    from numba import types

    template = dispatcher.get_call_template

    def get_call_template(args, kws):
        return template(tuple(map(types.unliteral, args)), {name: types.unliteral(kind) for name, kind in kws.items()})

    dispatcher.get_call_template = get_call_template
    return dispatcher


def _by_one_process(dispatcher: Any) -> Callable[..., Any]:
    """Return its `compile` behind a lock on a file next to the machine code; a killed process releases the lock."""
    from numba.core.compiler_lock import global_compiler_lock

    compiles, cache = dispatcher.compile, dispatcher._cache
    file = Path(cache.cache_path) / f"{cache._impl.filename_base}.lock"
    held = 0

    def compile(signature):
        nonlocal held
        with ExitStack() as stack:
            stack.enter_context(cast(Any, global_compiler_lock))  # first, or two threads could wait for each other
            if not held and fcntl is not None:
                with suppress(OSError):  # a folder that cannot be written keeps no machine code either
                    cache._impl.locator.ensure_cache_path()
                    fcntl.flock(stack.enter_context(file.open("w")), fcntl.LOCK_EX)
            held += 1
            collects = gc.isenabled()
            gc.disable()  # a tenth of the compiler's time: it makes many objects that live until it is done
            try:
                return compiles(signature)
            finally:
                held -= 1
                if collects:
                    gc.enable()

    return compile
