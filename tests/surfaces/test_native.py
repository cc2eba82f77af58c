"""The extension module has every kernel, of this version and for this processor; without it numba compiles."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from claims.row import ROOT
from palpate.errors import InputError
from palpate.surfaces import _jit
from palpate.surfaces._arguments import forms, require
from palpate.surfaces._band import solve_band

BUILT = _jit.native_file(_jit.level(), "mesh").exists()
SOURCE = _jit.PACKAGE.parent
needs_module = pytest.mark.skipif(  # CI has a compiler: there it fails
    not BUILT and not os.environ.get("CI"), reason="no extension module was built (make native)"
)


@pytest.fixture
def anew() -> Iterator[None]:
    """The module is looked for anew, and afterwards once more."""
    _jit._native.cache_clear()
    yield
    _jit._native.cache_clear()


def ran(code: str, *before: str, **surroundings: str) -> tuple[str, list[str]]:
    """What a process of its own prints, and the lines of its stderr; the code stands behind other words."""
    words = [*(before or (sys.executable, "-c")), code]
    found = subprocess.run(words, env={**os.environ, **surroundings}, capture_output=True, text=True, cwd=ROOT)
    if found.returncode and ("unshare:" in found.stderr or "mount:" in found.stderr):
        pytest.skip("this system lets nobody mount a folder read-only")
    assert found.returncode == 0, found.stderr
    return found.stdout.strip(), found.stderr.splitlines()


@needs_module
def test_it_has_every_way_of_every_entry() -> None:
    code = """
import native_build
jit = native_build._kernels()
wanted = {entry.symbol(k) for entry in jit.ENTRIES.values() for k in range(len(entry.ways))}
print(sorted(wanted - jit._native().keys()))
"""
    assert ran(code)[0] == "[]"


def test_every_compiled_function_that_python_calls_is_stated() -> None:
    decorated = {"entry", "released"}
    for file in _jit.kernel_files():
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef):
                plain = {one.id for one in node.decorator_list if isinstance(one, ast.Name)}
                assert not plain & decorated, f"{file.name}: {node.name} states no arguments"
    numba = [file for file in SOURCE.rglob("*.py") if "import njit" in file.read_text(encoding="utf-8")]
    assert {file.name for file in numba} == {"_jit.py"}


def test_the_digest_covers_whatever_compiled_code_is_made_of() -> None:
    files = _jit.kernel_files()
    names = {".".join(file.relative_to(SOURCE).with_suffix("").parts) for file in files}
    names |= {"palpate.surfaces._jit", "palpate.errors"}
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("palpate"):
                rooms = {f"{node.module}.{one.name}" for one in node.names}  # `from palpate.surfaces import _bvh`
                given = {node.module} if rooms - names else rooms
                assert file.name in _jit.CONSTANTS or given <= names, file.name


@needs_module
def test_the_first_answer_needs_no_compiler() -> None:
    code = """
import sys, palpate
corners = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
mesh = palpate.Mesh.from_arrays(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
print(palpate.locate([-1.0, -1.0, -1.0, 0, 0, 0], mesh).point.round(4).tolist(), "numba" in sys.modules)
"""
    assert ran(code)[0] == "[0.0333, 0.0333, 0.0333] False"


def test_a_module_of_other_kernels_is_not_used(anew: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    before = _jit._stamp()
    kernel = tmp_path / "_band.py"
    kernel.write_bytes(Path(_jit.PACKAGE, "surfaces", "_band.py").read_bytes() + b"\n# edited\n")
    files = [kernel if file.name == "_band.py" else file for file in _jit.kernel_files()]
    monkeypatch.setattr(_jit, "kernel_files", lambda: files)
    edited = _jit._stamp()
    assert edited != before
    monkeypatch.setattr(_jit, "STAMP", edited)
    assert _jit._native() == {}


def test_it_can_be_switched_off(anew: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PALPATE_NATIVE", "0")
    assert _jit._native() == {}


def test_an_older_processor_gets_the_plain_level(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(_jit.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(_jit, "CPUINFO", tmp_path / "cpuinfo")
    for flags, level in (("avx avx2 bmi1 bmi2 f16c fma abm movbe sse4_2", "x86-64-v3"), ("avx sse4_2", "x86-64")):
        (tmp_path / "cpuinfo").write_text(f"processor : 0\nflags : {flags}\n", encoding="ascii")
        assert _jit.level() == level
    (tmp_path / "cpuinfo").unlink()
    assert _jit.level() == "x86-64"


def test_without_a_c_compiler_one_line_says_so(tmp_path: Path) -> None:
    code = "import native_build as b; b._kernels().STAMP = '0' * 16; print(b.main())"
    printed, (line,) = ran(code, PATH=str(tmp_path))
    assert printed == "[]"
    assert "no C compiler" in line


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can mount")
def test_where_nothing_can_be_written_kernels_are_compiled_with_one_line() -> None:
    code = """
import numpy as np
from palpate.surfaces._band import solve_band
vector = np.ones(2)
solve_band(np.array([[2.0, 0.0], [2.0, 0.0]]), vector)
print(vector.tolist())
"""
    locked = 'mount --bind "$1" "$1" && mount -o remount,ro,bind "$1" && exec "$2" -B -c "$3"'
    before = ("unshare", "-m", "bash", "-c", locked, "bash", str(ROOT), sys.executable)
    printed, said = ran(code, *before, PALPATE_NATIVE="0", NUMBA_CACHE_DIR="", HOME="/proc", XDG_CACHE_HOME="/proc")
    assert printed == "[0.5, 0.5]"
    (line,) = (line for line in said if "takes about a minute" not in line)  # on a busy machine
    assert "NUMBA_CACHE_DIR" in line


def test_arguments_are_read_as_they_are_stated() -> None:
    (way,) = forms(
        "a n 3, b out int8 2n, c n|1, d n+1, e float, f (int, 2*bool), g bool", ["a", "b", "c", "d", "e", "f", "g"]
    )

    def given(**other: object) -> tuple[object, ...]:
        right = {"a": np.zeros((4, 3)), "b": np.zeros(8, np.int8), "c": np.zeros(1), "d": np.zeros(5)}
        return tuple({**right, "e": 1.0, "f": (1, (True, False)), "g": True, **other}.values())

    assert require(given, (way,), given()) == 0
    assert require(given, (way,), given(c=np.zeros(4), a=np.zeros((4, 3)))) == 0
    wrong = {"a": np.zeros((4, 2)), "b": np.zeros(7, np.int8), "c": np.zeros(2), "d": np.zeros(4), "e": 1, "g": 1}
    for name, value in {**wrong, "f": (1, (True,))}.items():
        with pytest.raises(InputError, match="must be"):
            require(lambda a, b, c, d, e, f, g: None, (way,), given(**{name: value}))


def test_an_entry_says_what_is_wrong() -> None:
    with pytest.raises(InputError, match=r"vector of solve_band must be a writable, contiguous array of float64"):
        solve_band(np.eye(2), [1.0, 2.0])
