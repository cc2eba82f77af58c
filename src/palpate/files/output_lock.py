"""Let one process at a time write an output, by a lock that the system releases when the process dies.

The lock is the file `.OUTPUT.lock` next to OUTPUT. Where the file system has no locks, nothing is locked.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path

from palpate.errors import InputError

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

_RESERVED: list[tuple[int, set[Path], ExitStack]] = []  # by commands of this process, with the thread of each


@contextmanager
def reserving() -> Generator[set[Path]]:
    """Yield the set of targets reserved by `reserve` during the block; all are released when it ends."""
    with ExitStack() as stack:
        entry = threading.get_ident(), set[Path](), stack
        _RESERVED.append(entry)
        stack.callback(_RESERVED.remove, entry)
        yield entry[1]


@contextmanager
def inherited(target: Path) -> Generator[None]:
    """Treat an output, which the parent process has reserved, as reserved during the block."""
    with reserving() as targets:
        targets.add(target)
        yield


def reserve(target: Path) -> None:
    """Let no other process write an output until the enclosing `reserving` block ends; outside of one, do nothing.

    `target` is an absolute path, without links.

    Raises:
        InputError: another process is writing it.
    """
    own = [entry for entry in _RESERVED if entry[0] == threading.get_ident()]
    if own and not _reserved(target):
        _, targets, stack = own[-1]
        stack.enter_context(_locked(target))
        targets.add(target)


@contextmanager
def only_writer(target: Path) -> Generator[None]:
    """Lock an output against other writers during the block, unless this process has reserved it.

    `target` is an absolute path, without links.

    Raises:
        InputError: another process or thread is writing it.
    """
    with nullcontext() if _reserved(target) else _locked(target):
        yield


def _reserved(target: Path) -> bool:
    return any(target in targets for _, targets, _ in _RESERVED)


@contextmanager
def _locked(target: Path) -> Generator[None]:
    file = target.parent / f".{target.name[:200]}.lock"
    handle = _lock(file, target)
    try:
        yield
    finally:
        if handle is not None:
            try:
                with suppress(OSError):
                    file.unlink(missing_ok=True)
            finally:  # by Ctrl-C, too
                os.close(handle)


def _lock(file: Path, target: Path) -> int | None:
    """Lock a file, and return its handle; None where there are no locks."""
    while fcntl is not None:
        try:
            handle = _opened(file)
        except OSError:  # what is wrong with the folder is reported when the output is written
            return None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = _holder(handle)
            os.close(handle)
            what = f"is already being written by process {holder}."
            hint = "Wait until that process has ended, or name another output."
            raise InputError(what, where=str(target), hint=hint) from None
        except OSError:  # this file system has no locks
            os.close(handle)
            file.unlink(missing_ok=True)
            return None
        with suppress(OSError):
            if os.path.samestat(os.fstat(handle), file.stat()):
                with suppress(OSError):  # whose it is, is only for the sentence
                    os.truncate(handle, 0)
                    os.write(handle, f"{os.getpid()} on {os.uname().nodename}".encode())
                return handle
        os.close(handle)  # it was released, and removed, between the two: the next try makes a new one
    return None


def _opened(file: Path) -> int:
    """Open the lock file; one of another user for reading."""
    flags = os.O_NOFOLLOW | os.O_CLOEXEC
    try:
        return os.open(file, os.O_RDWR | os.O_CREAT | flags, 0o666)
    except PermissionError:
        return os.open(file, os.O_RDONLY | flags)


def _holder(handle: int) -> str:
    for _ in range(10):
        if said := os.pread(handle, 300, 0).decode(errors="replace"):
            return said
        time.sleep(0.01)
    return "unknown"
