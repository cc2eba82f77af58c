"""Cache on disk what takes long to make and is the same in every run, next to Python's own compiled files."""

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

Value = TypeVar("Value")
PACKAGES = [Path(__file__).parents[2] / name for name in ("palpate", "palpate_lab")]


def kept(
    name: str,
    inputs: object,
    make: Callable[[], Value],
    write: Callable[[Path, Value], None],
    read: Callable[[Path], Value],
) -> Value:
    """Return the result of `make`, from this run or from an earlier one.

    A file is used if its name has the digest of these inputs and of all code of Palpate, and if it can be read;
    otherwise it is made anew. Files of other digests are removed. If no folder can be written, nothing is cached.

    Args:
        name: name of the file, with its suffix.
        inputs: everything that the result depends on; its `repr` identifies it.
        make: function that makes the result.
        write: function that writes the file completely or not at all.
        read: function that reads what `write` wrote, the same to the last bit.
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
    """Return the package's cache folder, then the user's, which serves if the first cannot be written."""
    own = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(__file__).parent / "__pycache__", Path(own) / "palpate"


def _digest(inputs: str) -> str:
    versions = [platform.python_version(), *(f"{each} {version(each)}" for each in ("numpy", "scipy"))]
    digest = hashlib.sha256("\n".join([inputs, *versions]).encode())
    for source in (file for package in PACKAGES for file in sorted(package.rglob("*.py"))):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]
