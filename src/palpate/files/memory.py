"""Keep freed memory in the process.

Thousands of blocks of a log are allocated and freed. By default the C library returns the memory of each to the system,
above all that of threads, and the system clears it again for the next: a fifth of the CPU time of Dask workers.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress

__all__ = ["KEEPING", "keep_memory"]

# Settings of glibc's malloc: name in the environment, number for `mallopt`, value. All threads share one arena; arrays
# up to 32 MiB, the largest threshold allowed, are allocated in it; free memory is returned from 1 GiB on.
_SETTINGS = (
    ("MALLOC_ARENA_MAX", -8, 1),
    ("MALLOC_MMAP_THRESHOLD_", -3, 1 << 25),
    ("MALLOC_TRIM_THRESHOLD_", -1, 1 << 30),
)
KEEPING = {name: value for name, _, value in _SETTINGS}  # environment of processes that are started to keep theirs


def keep_memory() -> None:
    """Make this process, including threads that it starts later, keep freed memory; has an effect with glibc only."""
    with suppress(OSError, TypeError, AttributeError):  # another C library
        mallopt = ctypes.CDLL(None).mallopt
        for _, number, value in _SETTINGS:
            mallopt(number, value)
