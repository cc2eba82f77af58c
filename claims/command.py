"""Commands in this process, as a user types them, and what they print."""

import contextlib
import io
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from palpate.cli import main


class Done(NamedTuple):
    """Exit code and text of a command; `output` has both streams in the order of their lines."""

    returncode: int
    stdout: str
    stderr: str
    output: str


class _Both(io.StringIO):
    def __init__(self, output: io.StringIO) -> None:
        super().__init__()
        self._output = output

    def write(self, text: str) -> int:
        self._output.write(text)
        return super().write(text)


def heard(call: Callable[[], int | None]) -> Done:
    """Call something that returns an exit code; what it lets through is a traceback, as a user sees it."""
    output = io.StringIO()
    out, err = _Both(output), _Both(output)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = call() or 0
        except SystemExit as end:
            code = int(end.code or 0)
        except Exception:
            traceback.print_exc()
            code = 1
    return Done(code, out.getvalue(), err.getvalue(), output.getvalue())


def cli(*words: str | Path) -> Done:
    """Run `palpate` with a user's words."""
    return heard(lambda: main([*map(str, words)]))


def must(*words: str | Path) -> str:
    """Run `palpate` with words that must succeed, and return what it prints."""
    done = cli(*words)
    if done.returncode:
        raise RuntimeError(done.output)
    return done.output
