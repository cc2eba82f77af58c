"""Compile the kernels ahead of time, into the extension module that `palpate.surfaces._jit` loads.

`python native_build.py [LEVEL]...` builds it for processor levels, "x86-64-v3" and "x86-64" of x86-64 and the machine's
name elsewhere; without one, for this processor. `--first` builds what a six-axis log on a mesh needs, and leaves the
other parts. It needs numba, setuptools, a C compiler and Python's headers. The module consists of parts, compiled side
by side by a process each; its files bear a digest of all kernels in their names, and one of other kernels is never
loaded.
"""

from __future__ import annotations

import gc
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any

ROOT = Path(__file__).parent
SOURCE = ROOT / "src"
PACKAGE = SOURCE / "palpate"
LEVELS = ("x86-64-v3", "x86-64")  # of x86-64 processors
FIRST = ("mesh", "basics")  # parts that a six-axis log on a mesh needs
LOCATING = (
    "contact__kernel_",
    "sensors_force_torque__live_",
    "sensors_load_cells__live_",
)  # by a mesh in the first way of calling them
BASICS = ("surfaces__topology_", "surfaces__bvh_", "surfaces__nearest_", "surfaces__rays_", "signals__filters_")
BASICS += ("sensors_force_torque__kernels_", "files_mcap__")


def part_of(symbol: str) -> str:
    """Return the part that has an exported function."""
    if symbol.startswith(LOCATING):
        return "mesh" if symbol.endswith("_0") else "equation"
    return "basics" if symbol.startswith(BASICS) else "sensors"


def main(levels: Sequence[str] = (), parts: Sequence[str] = ()) -> list[Path]:
    """Build the parts that are not there yet, and return all that are wanted; none where they cannot be built."""
    jit = _kernels()
    wanted = [(level, part) for part in parts or jit.PARTS for level in levels or [jit.level()]]
    files = [jit.native_file(*one) for one in wanted]
    missing = [one for one, file in zip(wanted, files, strict=True) if not file.exists()]
    if not missing:
        return files
    lacking = _lacking()
    if not lacking:
        begin = perf_counter()
        _say(f"compiling kernels ahead of time, once for this version: {', '.join(part for _, part in missing)}")
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
            running = [pool.submit(_compiled, one) for one in missing]
            while wait(running, timeout=1.0).not_done:
                if sys.stderr.isatty():
                    _say(f"{perf_counter() - begin:.0f} s", end="\r")
            errors = [error for error in (each.result() for each in running) if error]
        lacking = errors[0].strip().splitlines()[-1] if errors else ""
    if lacking:
        _say(f"kernels are not compiled ahead of time ({lacking}): the first use of each compiles it, minutes in all")
        return []
    for old in files[0].parent.glob("*.so"):
        if f"-{jit.STAMP}-" not in old.name:
            old.unlink()
    size = sum(file.stat().st_size for file in files)
    _say(f"compiled in {perf_counter() - begin:.0f} s, {size / 1e6:.1f} MB")
    return files


def _lacking() -> str:
    """Return what keeps this machine from building, "" for nothing."""
    compiler = (sysconfig.get_config_var("CC") or "cc").split()[0]
    if platform.system() != "Linux":
        return "only on Linux so far"
    if shutil.which(compiler) is None:
        return f"no C compiler: {compiler}"
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        return "no headers of Python"
    absent = [name for name in ("numba", "setuptools") if find_spec(name) is None]
    return f"no {absent[0]}" if absent else ""


def _compiled(one: tuple[str, str]) -> str:
    """Compile one part for a level in a process of its own, and return its error, "" for none.

    The name of the processor is read when numba is imported; numba's own assertions are a twentieth of the time.
    """
    level, part = one
    surroundings = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    if level.startswith("x86-64"):
        surroundings |= {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": ""}
    command = [sys.executable, "-O", __file__, "--part", level, part]
    done = subprocess.run(command, env=surroundings, stderr=subprocess.PIPE, text=True, check=False)
    return done.stderr if done.returncode else ""


def build(level: str, part: str) -> None:
    """Compile one part of the module for a processor level."""
    from numba.core import typing
    from numba.pycc import cc, compiler

    gc.disable()  # a tenth of the time: the compiler makes many objects that live until it is done
    jit = _kernels()
    _only_once()
    jit.register_choices()
    name = f"palpate_native_{part}"
    module = cc.CC(name, source_module=ModuleType("palpate_native"))
    released = set[Any]()
    for entry in jit.ENTRIES.values():
        entry.options["cache"] = False  # there is no machine code to keep
        for way, arguments in enumerate(entry.ways):
            symbol, types = entry.symbol(way), [_type(argument) for argument in arguments]
            if part_of(symbol) == part:
                signature = typing.signature(None, *types)
                module._exported_functions[symbol] = compiler.ExportEntry(symbol, signature, entry.py_func)
        if entry.options.get("nogil"):
            released.add(entry.py_func)
    compiler.compile_extra = _with_flags(compiler.compile_extra, released, jit.OPTIONS["error_model"])
    with tempfile.TemporaryDirectory() as scratch:
        module.output_dir, module.output_file = scratch, f"{name}.so"
        module.target_cpu = level if level.startswith("x86-64") else "generic"
        module._extra_cflags = {"posix": ["-g0", "-O1"]}  # of numba's C files, which no kernel spends time in
        module.compile()
        final = jit.native_file(level, part)
        final.parent.mkdir(exist_ok=True)
        temporary = final.with_suffix(f".{os.getpid()}")  # two builds at once make the same file
        shutil.copy(Path(scratch, module.output_file), temporary)
        temporary.replace(final)


def _with_flags(compile_extra: Any, released: set[Any], error_model: str) -> Any:
    """Return what pycc compiles an entry with, and with the flags that its own call leaves out."""

    def compile_with_flags(*given: Any, **rest: Any) -> Any:
        *first, function, args, returns, flags = given
        flags = flags.copy()
        flags.error_model, flags.release_gil = error_model, function in released
        return compile_extra(*first, function, args, returns, flags, **rest)

    return compile_with_flags


def _only_once() -> None:
    """Let numba optimise and emit the whole module at its end, and not each inner function with all that it calls.

    The functions between are typed and lowered, and stay as they are: nobody runs them here. What numba itself runs is
    compiled before.
    """
    from numba import njit
    from numba.core import codegen, cpu

    njit(lambda: [0.0])()

    def finalize(library: Any) -> None:
        library._finalize_dynamic_globals()
        library._finalized = True

    def with_all(library: Any) -> None:
        """Link what is called, callers first: what nobody has called so far would be dropped."""
        order: list[Any] = []

        def visit(called: Any) -> None:
            for one in called._linking_libraries:
                if one not in seen:
                    seen.add(one)
                    visit(one)
                    order.append(one)

        seen: set[Any] = set()
        visit(library)
        library._linking_libraries = order[::-1]
        link(library)

    link = codegen.AOTCodeLibrary.finalize

    def keep(library: Any, module: Any) -> None:
        module.data_layout = library._codegen._data_layout

    codegen.CPUCodeLibrary._optimize_functions = keep
    codegen.JITCodeLibrary.finalize, codegen.AOTCodeLibrary.finalize = finalize, with_all
    cpu.CPUContext.get_executable = lambda *_: [].append  # a function of its own for each; it is never called


def _type(argument: Any) -> Any:
    """Return numba's type of an argument."""
    from numba.core import types
    from numba.np.numpy_support import from_dtype

    kind = type(argument).__name__
    if kind == "Function":
        return types.FunctionType(types.void(types.float64[::1], types.float64[::1]))
    if kind == "Number":
        return {"float": types.float64, "int": types.int64, "bool": types.boolean}[argument.kind]
    if kind == "Several":
        return types.Tuple([_type(part) for part in argument.parts])
    return types.Array(from_dtype(argument.dtype), len(argument.shape), "A" if argument.strided else "C")


def _kernels() -> Any:
    """Import every kernel without the packages that it is in, which need what a build has not; return `_jit`."""
    if "palpate" not in sys.modules:
        folders = (file.parent for name in ("palpate", "palpate_lab") for file in (SOURCE / name).rglob("__init__.py"))
        for folder in sorted(folders):
            name = ".".join(folder.relative_to(SOURCE).parts)
            package = sys.modules[name] = ModuleType(name)
            package.__path__ = [str(folder)]
    jit = import_module("palpate.surfaces._jit")
    for file in jit.kernel_files():
        import_module(".".join(file.relative_to(SOURCE).with_suffix("").parts))
    return jit


def _say(text: str, end: str = "\n") -> None:
    sys.stderr.write(text + end)
    sys.stderr.flush()


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    if sys.argv[1:2] == ["--part"]:
        build(*sys.argv[2:])
    elif sys.argv[1:2] == ["--first"]:
        main(parts=FIRST)
    else:
        main(sys.argv[1:])
