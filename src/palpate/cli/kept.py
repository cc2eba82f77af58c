"""What takes long to make and is the same in every run, kept on disk where Python keeps its own compiled files."""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import tempfile
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

__all__ = ["kept"]

Value = TypeVar("Value")
PACKAGE = Path(__file__).parents[1]


def kept(name: str, inputs: object, make: Callable[[], Value]) -> Value:
    """Return what `make` made, in this run or in an earlier one.

    A file is used if it bears the digest of these inputs and of all code that Palpate has, and was not damaged since;
    otherwise it is made anew and replaced. Where no folder can be written, nothing is kept.

    Args:
        name: of the file.
        inputs: all that the result depends on; its `repr` says which it is.
        make: the result, which can be pickled; its arrays come back read-only.
    """
    stamp = _stamp(repr(inputs))
    for folder in _folders():
        with suppress(OSError, ValueError, EOFError, pickle.UnpicklingError):
            return _read((folder / f"{name}.kept").read_bytes(), stamp)
    value = make()
    written = _written(value, stamp)
    for folder in _folders():
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            _replace(folder / f"{name}.kept", written)
            break
    return value


def _folders() -> tuple[Path, ...]:
    """The package's own, and the user's where that cannot be written."""
    own = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(__file__).parent / "__pycache__", Path(own) / "palpate"


def _stamp(inputs: str) -> bytes:
    versions = [platform.python_version(), *(f"{each} {version(each)}" for each in ("numpy", "scipy"))]
    digest = hashlib.sha256("\n".join([inputs, *versions]).encode())
    for file in sorted(PACKAGE.rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.digest()


def _written(value: object, stamp: bytes) -> bytes:
    buffers = list[pickle.PickleBuffer]()
    head = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    content = pickle.dumps((head, [bytes(each.raw()) for each in buffers]))
    return stamp + hashlib.sha256(content).digest() + content


def _read(raw: bytes, stamp: bytes) -> Any:
    """The value in a file.

    Raises:
        ValueError: it is of other inputs or other code, or damaged.
    """
    content = raw[64:]
    if raw[:64] != stamp + hashlib.sha256(content).digest():
        raise ValueError("not what is wanted")
    head, buffers = pickle.loads(content)
    return pickle.loads(head, buffers=buffers)  # bytes cannot be written to: nor can the arrays


def _replace(file: Path, content: bytes) -> None:
    """Write a file that is whole at any moment; whoever does it last wins."""
    handle, part = tempfile.mkstemp(prefix=file.name, dir=file.parent)
    try:
        with os.fdopen(handle, "wb") as opened:
            opened.write(content)
        Path(part).replace(file)
    finally:
        Path(part).unlink(missing_ok=True)
