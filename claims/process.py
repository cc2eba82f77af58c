"""Processes of their own, what they print, and what they take."""

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

# The kernel counts what a process was before it became the command: so a small one starts it, not this large one.
_START = """\
import os, signal, subprocess, sys
command = subprocess.Popen(sys.argv[1:])
signal.signal(signal.SIGTERM, lambda *_: command.kill())
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


class Running:
    """A process of Python with these words, at work."""

    def __init__(self, *words: str | Path, cwd: str | Path | None = None, env: Mapping[str, str] | None = None) -> None:
        self._begin, pipe, nothing = perf_counter(), subprocess.PIPE, subprocess.DEVNULL
        command = [sys.executable, "-c", _START, sys.executable, *map(str, words)]
        self._process = subprocess.Popen(command, stdin=nothing, stdout=pipe, stderr=pipe, text=True, cwd=cwd, env=env)

    def ended(self, patience: float | None = None) -> tuple[int, str, Took]:
        """Return the exit code, stderr and what it took; after so many seconds it is killed."""
        try:
            printed, said = self._process.communicate(timeout=patience)
        except subprocess.TimeoutExpired:
            self._process.terminate()  # which kills the command
            printed, said = self._process.communicate()
        *lines, last = said.splitlines()
        cpu, peak = map(float, last.split())
        took = Took(printed, perf_counter() - self._begin, cpu, peak / 1024)
        return self._process.returncode, "\n".join(lines), took


def python(*words: str | Path, cwd: str | Path | None = None, env: Mapping[str, str] | None = None) -> Took:
    """Run Python with these words to its end, which must be a good one."""
    code, said, took = Running(*words, cwd=cwd, env=env).ended()
    if code:
        raise RuntimeError(f"{' '.join(map(str, words))} ended with {code}: {said}")
    return took


def palpate(*words: str | Path, cwd: str | Path | None = None) -> Took:
    """Run a command as a user types it."""
    return python("-m", "palpate", *words, cwd=cwd)
