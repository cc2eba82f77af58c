"""The package, imported once with all of its faults in it, as the tests import it: with shapes and types enforced."""

from __future__ import annotations

import hashlib
import importlib
import os
import py_compile
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import cache_from_source
from pathlib import Path

from mutants.fault import SOURCE, Fault, written

__all__ = ["import_with_faults", "sources"]

ROOT = SOURCE.parent
CACHE, CHILD = ROOT / ".cache" / "mutants", Path(__file__).parent / "child"
_ANYWAY = py_compile.PycInvalidationMode.UNCHECKED_HASH  # whatever the source is
USED = ("hypothesis", "mcap.writer", "rosbags.rosbag2", "scipy.optimize", "scipy.signal", "trimesh")  # by many tests


def sources(faults: list[Fault]) -> dict[str, bytes]:
    """Files with faults in them, by their path."""
    files: dict[str, list[tuple[int, Fault]]] = {}
    for number, fault in enumerate(faults, start=1):
        files.setdefault(fault.file, []).append((number, fault))
    made = {file: written((SOURCE / file).read_text(encoding="utf-8"), some) for file, some in files.items()}
    return {str(SOURCE / file): text.encode() for file, text in made.items()}


def import_with_faults(faults: list[Fault]) -> None:
    """Import every module of the package, those with faults as `written`; machine code has a cache of its own.

    So has Python's: the processes that tests start find the files with faults there, compiled.
    """
    made = sources(faults)
    digest = hashlib.sha256(b"".join(made[path] for path in sorted(made)))
    for file in sorted(SOURCE.rglob("*.py")):
        digest.update(file.read_bytes())
    folder = CACHE / digest.hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    os.environ["NUMBA_CACHE_DIR"] = str(folder / "numba")
    os.environ["PALPATE_NATIVE"] = "0"  # the module has no faults
    _read_instead(made)
    os.environ["PYTHONPATH"] = os.pathsep.join(map(str, (CHILD, ROOT, SOURCE)))  # of what the tests start
    sys.path[:0] = [str(ROOT), str(SOURCE), str(ROOT / "tests")]
    importlib.import_module("conftest")  # enforces shapes and types of what is imported from now on
    sys.pycache_prefix = os.environ["PYTHONPYCACHEPREFIX"] = str(folder / "pyc")
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    faulty = folder / "faulty.py"
    for path, text in made.items():  # for the processes that tests start
        faulty.write_bytes(text)
        py_compile.compile(str(faulty), cache_from_source(path), path, True, invalidation_mode=_ANYWAY)
    for file in sorted(SOURCE.rglob("*.py")):
        parts = file.relative_to(SOURCE).with_suffix("").parts
        if parts[-1] != "__main__":
            importlib.import_module(".".join(parts[:-1] if parts[-1] == "__init__" else parts))
    for name in USED:
        importlib.import_module(name)


def _read_instead(made: dict[str, bytes]) -> None:
    """Let Python's loader read these in place of the files."""
    usual = SourceFileLoader.get_data

    def get_data(self: SourceFileLoader, path: str) -> bytes:
        return made.get(str(Path(path)), b"") or usual(self, path)

    SourceFileLoader.get_data = get_data
