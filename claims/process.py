"""Processes of their own, what they print, and what they take."""

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

# The kernel counts what a process was before it became the command: so a small one starts it, not this large one.
_START = """\
import os, subprocess, sys
command = subprocess.Popen(sys.argv[1:])
_, status, usage = os.wait4(command.pid, 0)
print(usage.ru_utime + usage.ru_stime, usage.ru_maxrss, file=sys.stderr)
sys.stderr.flush()
os._exit(os.waitstatus_to_exitcode(status))
"""


class Took(NamedTuple):
    """What a process printed, seconds on the wall and of the processor, its start included, and its peak [MiB]."""

    printed: str
    wall: float
    cpu: float
    peak: float


def python(*words: str | Path, cwd: str | Path | None = None, env: Mapping[str, str] | None = None) -> Took:
    """Run Python with these words to its end, which must be a good one."""
    begin, command = perf_counter(), [sys.executable, "-c", _START, sys.executable, *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, env=env)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[4:])} ended with {done.returncode}: {done.stderr}")
    cpu, peak = map(float, done.stderr.splitlines()[-1].split())
    return Took(done.stdout, perf_counter() - begin, cpu, peak / 1024)


def palpate(*words: str | Path, cwd: str | Path | None = None) -> Took:
    """Run a command as a user types it."""
    return python("-m", "palpate", *words, cwd=cwd)
