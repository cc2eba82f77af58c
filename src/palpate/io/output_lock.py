"""One writer of an output at a time: a lock beside it, which the system releases when a process dies.

OUTPUT's lock is the file `.OUTPUT.lock` in the folder of what OUTPUT leads to, so that every spelling of a path has the
same; it is removed when it is released. Where the file system has no locks, nothing is locked.
"""

from __future__ import annotations

import os
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from palpate.errors import InputError

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

__all__ = ["only_writer", "reserve", "reserving"]

_RESERVED: list[tuple[set[Path], ExitStack]] = []  # of each command that runs in this process, one within the other


@contextmanager
def reserving() -> Generator[None]:
    """What `reserve` is called for meanwhile is reserved until the block ends."""
    with ExitStack() as stack:
        _RESERVED.append((set(), stack))
        stack.callback(_RESERVED.pop)
        yield


def reserve(target: Path) -> None:
    """Let no other process write this output until the block of `reserving` ends; does nothing outside of one.

    Args:
        target: absolute path, without links.

    Raises:
        InputError: another process writes it.
    """
    if _RESERVED and not _reserved(target):
        targets, stack = _RESERVED[-1]
        stack.enter_context(_locked(target))
        targets.add(target)


@contextmanager
def only_writer(target: Path) -> Generator[None]:
    """Let nobody else write this output meanwhile, unless it is reserved already.

    Args:
        target: absolute path, without links.

    Raises:
        InputError: another process or thread writes it.
    """
    with ExitStack() as stack:
        if not _reserved(target):
            stack.enter_context(_locked(target))
        yield


def _reserved(target: Path) -> bool:
    return any(target in targets for targets, _ in _RESERVED)


@contextmanager
def _locked(target: Path) -> Generator[None]:
    file = target.with_name(f".{target.name}.lock")
    handle = _lock(file, target)
    try:
        yield
    finally:
        if handle is not None:
            file.unlink(missing_ok=True)
            os.close(handle)


def _lock(file: Path, target: Path) -> int | None:
    """Open and lock a file; None where there are no locks, or the process that started this one has the lock."""
    while fcntl is not None:
        try:
            handle = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        except OSError:  # what is wrong with the folder is reported when the output is written
            return None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if file.exists() and os.path.samestat(os.fstat(handle), file.stat()):
                os.truncate(handle, 0)
                os.write(handle, f"{os.getpid()} on {os.uname().nodename}".encode())
                return handle
            os.close(handle)  # it was released, and removed, between the two: the next try makes a new one
        except BlockingIOError:
            holder = _holder(handle)
            os.close(handle)
            if holder.split(" ")[0] == str(os.getppid()):
                return None
            raise InputError(
                f"is being written by another command (process {holder}).",
                where=str(target),
                hint="Wait until it has ended, or name another output.",
            ) from None
        except OSError:  # this file system has no locks
            os.close(handle)
            file.unlink(missing_ok=True)
            return None
    return None


def _holder(handle: int) -> str:
    """The process that has the lock, which it writes just after it took it."""
    for _ in range(10):
        if said := os.pread(handle, 300, 0).decode(errors="replace"):
            return said
        time.sleep(0.01)
    return "unknown"
