"""Files that are either whole or not there, and never an input of the command that writes them."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path

from palpate.errors import InputError

__all__ = ["keep_inputs", "replacing", "write_text"]


def keep_inputs(output: Path, inputs: Iterable[Path | None], *, beside: Iterable[Path] = ()) -> None:
    """Refuse, before any work is done, to write over what is read or over what is no regular file.

    Args:
        output: what will be written.
        inputs: what is read; None is passed over. A file that may be updated in place is left out.
        beside: what else will be written, such as OUTPUT.toml.

    Raises:
        InputError: a file to write is an input (by whatever name or link), a folder, a pipe or a device.
    """
    read = [(path, _status(path)) for path in inputs if path is not None]
    for written in (output, *beside):
        target = _status(written)
        _refuse_irregular(written, target)
        for path, status in read:
            if target is not None and status is not None and os.path.samestat(target, status):
                raise InputError(f"would overwrite an input, {path}.", where=str(written), mend="Name another output.")


@contextmanager
def replacing(path: Path) -> Generator[Path]:
    """A temporary path beside `path` that takes its place when the block ends well, and vanishes when it does not.

    Links are followed: what they lead to is replaced.

    Raises:
        InputError: the folder is not there, or may not be written, or `path` is a folder, a pipe or a device.
    """
    _refuse_irregular(path, _status(path))
    try:
        target = path.resolve()
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:32]}.", suffix=".part")
    except (OSError, ValueError, RuntimeError) as problem:  # the last two: a NUL in the name, links in a circle
        raise InputError(f"cannot write here ({_reason(problem)}).", where=str(path)) from problem
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())  # mkstemp makes it private
        temporary.replace(target)
    except OSError as problem:
        raise InputError(f"cannot write here ({_reason(problem)}).", where=str(path)) from problem
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8, whole or not at all.

    Raises:
        InputError: it cannot be written, or holds what is not UTF-8: the name of some file.
    """
    try:
        raw = text.encode()
    except UnicodeEncodeError as problem:
        raise InputError("cannot be written: the name of a file in it is not UTF-8.", where=str(path)) from problem
    with replacing(path) as temporary:
        temporary.write_bytes(raw)


def _refuse_irregular(path: Path, status: os.stat_result | None) -> None:
    if status is not None and not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
        raise InputError(f"is {kind}, not a file to write.", where=str(path), mend="Name another output.")


def _status(path: Path) -> os.stat_result | None:
    """Of what a name leads to; None where there is nothing, or where writing will say what is wrong."""
    try:
        return path.stat()
    except (OSError, ValueError):
        return None


def _reason(problem: Exception) -> str:
    return str((problem.strerror if isinstance(problem, OSError) else None) or problem)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
