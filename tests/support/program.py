"""Palpate as a program of its own."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def program(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """It hears Ctrl-C, even where whoever runs the tests does not; killed at the end, if it is still there."""
    hears = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)"
    script = f"{hears}; from palpate.cli import main; sys.exit(main())"
    run = subprocess.Popen(
        [sys.executable, "-c", script, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        yield run
    finally:
        run.kill()
        run.communicate()
