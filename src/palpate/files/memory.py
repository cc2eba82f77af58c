"""Keep freed memory in the process: to clear it block by block takes workers a fifth of their CPU time."""

from __future__ import annotations

import ctypes
from contextlib import suppress

# Settings of glibc's malloc: name in the environment, number for `mallopt`, value. All threads share one arena; arrays
# up to 32 MiB, the largest threshold allowed, are allocated in it; free memory is returned from 1 GiB on.
_SETTINGS = (
    ("MALLOC_ARENA_MAX", -8, 1),
    ("MALLOC_MMAP_THRESHOLD_", -3, 1 << 25),
    ("MALLOC_TRIM_THRESHOLD_", -1, 1 << 30),
)
KEEPING = {name: value for name, _, value in _SETTINGS}  # environment of processes that are started to keep theirs


def keep_memory() -> None:
    """Let this process and its later threads keep freed memory; only glibc can."""
    with suppress(OSError, TypeError, AttributeError):  # another C library
        mallopt = ctypes.CDLL(None).mallopt
        for _, number, value in _SETTINGS:
            mallopt(number, value)
