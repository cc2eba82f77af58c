"""Free memory stays with the process.

Blocks of a log come and go by the thousand. The C library gives the memory of each back to the system, above all that
of threads, and the system clears it anew for the next: of Dask workers that was a fifth of the CPU time.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress

__all__ = ["KEEPING", "keep_memory"]

# Of glibc's malloc: as the environment has them, as `mallopt` does, and the value. One arena for all threads; memory of
# arrays up to 32 MiB, the most that can be said, taken from it; and what is free of it given back from 1 GiB on.
_SETTINGS = (
    ("MALLOC_ARENA_MAX", -8, 1),
    ("MALLOC_MMAP_THRESHOLD_", -3, 1 << 25),
    ("MALLOC_TRIM_THRESHOLD_", -1, 1 << 30),
)
KEEPING = {name: value for name, _, value in _SETTINGS}  # environment of processes that are started to keep theirs


def keep_memory() -> None:
    """From now on this process keeps its memory, the threads that it starts included; glibc only."""
    with suppress(OSError, TypeError, AttributeError):  # another C library
        mallopt = ctypes.CDLL(None).mallopt
        for _, number, value in _SETTINGS:
            mallopt(number, value)
