"""Keep on disk what takes long to make and is the same in every run, where Python keeps its own compiled files."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar
from zipfile import BadZipFile
from zlib import error as ZlibError

from palpate.errors import InputError

__all__ = ["kept"]

Value = TypeVar("Value")
PACKAGES = [Path(__file__).parents[2] / name for name in ("palpate", "palpate_lab")]


def kept(
    name: str,
    inputs: object,
    make: Callable[[], Value],
    write: Callable[[Path, Value], None],
    read: Callable[[Path], Value],
) -> Value:
    """Return what `make` made, in this run or in an earlier one.

    A file is used if its name bears the digest of these inputs and of all code that Palpate has, and if it can be read;
    otherwise it is made anew. Files of other digests are removed. Where no folder can be written, nothing is kept.

    Args:
        name: of the file, with its suffix.
        inputs: all that the result depends on; its `repr` says which it is.
        make: the result.
        write: whole or not at all.
        read: what `write` wrote, the same to the last bit.
    """
    stem, suffix = os.path.splitext(name)
    file = f"{stem}-{_digest(repr(inputs))}{suffix}"
    for folder in _folders():
        with suppress(InputError, OSError, ValueError, KeyError, EOFError, BadZipFile, ZlibError):
            return read(folder / file)
    value = make()
    for folder in _folders():
        with suppress(InputError, OSError):
            folder.mkdir(parents=True, exist_ok=True)
            write(folder / file, value)
            for old in folder.glob(f"{stem}-*{suffix}"):
                if old.name != file:
                    old.unlink(missing_ok=True)
            break
    return value


def _folders() -> tuple[Path, ...]:
    """Return the package's own, and the user's for where that cannot be written."""
    own = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(__file__).parent / "__pycache__", Path(own) / "palpate"


def _digest(inputs: str) -> str:
    versions = [platform.python_version(), *(f"{each} {version(each)}" for each in ("numpy", "scipy"))]
    digest = hashlib.sha256("\n".join([inputs, *versions]).encode())
    for source in (file for package in PACKAGES for file in sorted(package.rglob("*.py"))):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]
