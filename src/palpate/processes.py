"""Prepare processes that read and write logs: they keep freed memory, and refuse tables where they were forked.

To clear memory block by block takes workers a fifth of their CPU time. In a forked process the threads of polars are
missing, and would be waited for for ever.
"""

from __future__ import annotations

import ctypes
import os
import sys
from contextlib import suppress
from pathlib import Path

from palpate.errors import InputError

# Settings of glibc's malloc: name in the environment, number for `mallopt`, value. All threads share one arena; arrays
# up to 32 MiB, the largest threshold allowed, are allocated in it; free memory is returned from 1 GiB on.
_SETTINGS = (
    ("MALLOC_ARENA_MAX", -8, 1),
    ("MALLOC_MMAP_THRESHOLD_", -3, 1 << 25),
    ("MALLOC_TRIM_THRESHOLD_", -1, 1 << 30),
)
KEEPING = {name: value for name, _, value in _SETTINGS}  # environment of processes that are started to keep theirs
_TASKS = Path("/proc/self/task")  # Linux alone has it; a fork of other systems is refused once polars is imported
_threads = {"started": False, "missing": False}


def keep_memory() -> None:
    """Let this process and its later threads keep freed memory; only glibc can."""
    with suppress(OSError, TypeError, AttributeError):  # another C library
        mallopt = ctypes.CDLL(None).mallopt
        for _, number, value in _SETTINGS:
            mallopt(number, value)


def require_polars_threads() -> None:
    """Refuse tables in a process that was forked after polars had started its threads: it would wait for ever.

    Raises:
        InputError: this is such a process.
    """
    if _threads["missing"]:
        raise InputError(
            "tables cannot be read or written in a process that was forked after its parent had read or written one: "
            "the threads of polars are missing.",
            where=f"process {os.getpid()}",
            hint='Start it by multiprocessing.get_context("spawn") or "forkserver", or fork before the first table.',
        )


def _look() -> None:
    """Note before a fork whether polars has started its threads."""
    try:
        names = [(task / "comm").read_text() for task in _TASKS.iterdir()]
    except OSError:
        _threads["started"] = "polars" in sys.modules
    else:
        _threads["started"] = any(name.startswith("polars-") and name[7:].strip().isdigit() for name in names)


def _forked() -> None:
    """Note in a forked process that its threads are missing; a process that it forks lacks them too."""
    _threads["missing"] = _threads["missing"] or _threads["started"]


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(before=_look, after_in_child=_forked)
