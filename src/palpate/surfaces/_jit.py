"""How loops are compiled here, once for all kernels."""

# pyright: basic
from __future__ import annotations

import gc
import hashlib
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, cast

from numba import njit, types
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import overload

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

from palpate.waiting import waiting

__all__ = ["COMPILER", "STAMP", "chosen_for", "entry", "inlined", "inner", "on_disk", "released"]


def _stamp() -> str:
    """A digest of every private module of the package, the kernels among them."""
    files = sorted(Path(__file__).parents[1].rglob("_*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


STAMP = _stamp()


# a * b + c stays two instructions. Left to the compiler it is one or two as a function happens to be compiled into
# another, and the process that compiles has other last bits than those that read its machine code; it was no faster.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False}


@dataclass
class Compiler:
    """How long this process compiled, or waited for another that did [s], and how many functions it is inside of."""

    seconds: float = 0.0
    depth: int = 0


COMPILER = Compiler()


def entry(function):
    """Decorates a compiled function that Python calls.

    Division by zero gives inf as in NumPy; NaN and inf keep their meaning.
    Machine code is kept on disk, so that only the first process ever waits for the compiler. numba forgets it when the
    function's own file changes but not when a file that it calls into does, so the stamp of all kernels takes the place
    of the file's. Processes that start together do not compile the same function each: the others wait for the first.
    """
    return _kept(njit(cache=True, **_OPTIONS)(function))


def released(function):
    """As `entry`, for a loop over many samples: other threads of Python go on meanwhile."""
    return _kept(njit(cache=True, nogil=True, **_OPTIONS)(function))


def on_disk(made: Any) -> bool:
    """Whether this version's machine code of an entry is there, for any types."""
    return bool(made._cache._cache_file._load_index())


def _kept(made):
    """Its machine code goes by the stamp of all kernels, and one process compiles it."""
    dispatcher = cast(Any, made)
    dispatcher._cache._cache_file._source_stamp = STAMP
    dispatcher.compile = _by_one_process(dispatcher)
    return _once_for_constants(dispatcher)


def _once_for_constants(dispatcher):
    """Calls from compiled code with a constant are calls with its type: numba would compile anew for each constant."""
    template = dispatcher.get_call_template

    def get_call_template(args, kws):
        return template(tuple(map(types.unliteral, args)), {name: types.unliteral(kind) for name, kind in kws.items()})

    dispatcher.get_call_template = get_call_template
    return dispatcher


def _by_one_process(dispatcher):
    """Its `compile`, behind a lock on a file beside the machine code; a process that is killed holds none."""
    compiles, cache = dispatcher.compile, dispatcher._cache
    file = Path(cache.cache_path) / f"{cache._impl.filename_base}.lock"
    held = 0

    def compile(signature):
        nonlocal held
        with ExitStack() as stack:
            stack.enter_context(cast(Any, global_compiler_lock))  # first, or two threads could wait for each other
            begin, hits = perf_counter(), sum(dispatcher.stats.cache_hits.values())
            if not COMPILER.depth:
                stack.enter_context(waiting("compiling, once; it takes about a minute"))
            if not held and fcntl is not None:
                with suppress(OSError):  # a folder that cannot be written keeps no machine code either
                    cache._impl.locator.ensure_cache_path()
                    fcntl.flock(stack.enter_context(file.open("w")), fcntl.LOCK_EX)
            ready = perf_counter()
            held, COMPILER.depth = held + 1, COMPILER.depth + 1
            collects = gc.isenabled()
            gc.disable()  # a tenth of the compiler's time: it makes many objects that live until it is done
            try:
                return compiles(signature)
            finally:
                held, COMPILER.depth = held - 1, COMPILER.depth - 1
                if collects:
                    gc.enable()
                if not COMPILER.depth:  # reading machine code from the disk is no compiling, waiting for it is
                    read = sum(dispatcher.stats.cache_hits.values()) > hits
                    COMPILER.seconds += (ready if read else perf_counter()) - begin

    return compile


def inner(function):
    """Decorates a function that only compiled code calls: no wrapper for Python, which halves the compiler's work."""
    made = cast(Any, njit)(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS)(function)
    return _once_for_constants(made)


def inlined(function):
    """Decorates one of the few inner functions that must not become a call."""
    return njit(inline="always", **_OPTIONS)(function)


def chosen_for(function):
    """Decorates what returns the function that compiled code calls, given the types of the arguments."""
    return cast(Any, overload)(function, jit_options=_OPTIONS)
