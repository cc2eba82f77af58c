"""Run the commands: loops and messages, no mathematics."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence

from palpate.errors import PalpateError

__all__ = ["main"]

FAILED, USAGE, INTERRUPTED = 1, 2, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; `argv` defaults to the program's arguments.

    Returns:
        Exit code: 0; 1 if an input cannot be used or an output not be written (one sentence on stderr); 2 for a wrong
        call; 130 after Ctrl-C; or the command's own.
    """
    try:
        code = _run(argv)
        print(end="", flush=True)  # here, where what goes wrong can still be said
    except KeyboardInterrupt:
        print("palpate: interrupted; no file is half written", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output (head, less) has left
        _drop_output()
        return 0
    except OSError as problem:  # a full disk behind `> file`
        _drop_output()
        print(f"palpate: {problem}", file=sys.stderr)
        return FAILED
    return code


def _run(argv: Sequence[str] | None) -> int:
    try:
        from palpate.interrupts import importing

        words = list(sys.argv[1:] if argv is None else argv)
        if words == ["--version"]:
            from palpate import __version__

            print(f"palpate {__version__}")
            return 0
        with importing():  # imports here, not above: Ctrl-C may fall on them
            from palpate.cli.app import find
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")  # names of files need not fit the terminal's encoding
        if {"-h", "--help"} & set(words):  # nothing but the parser speaks
            find(words)()
            return 0
        with importing():
            from palpate.console.console import spoken
            from palpate.files.output_lock import reserving
        # these two are of every command, wherever they stand
        with reserving(), spoken(quiet="--quiet" in words, json="--json" in words):
            find([word for word in words if word not in ("--quiet", "--json")])()
    except PalpateError as problem:
        print(f"palpate: {problem}", file=sys.stderr)
        return FAILED
    except SystemExit as leaving:  # the parser's: 0 or None after what was asked for, a sentence on what is misspelt
        if isinstance(leaving.code, str):
            print(f"palpate: {leaving.code}", file=sys.stderr)
            return USAGE
        return leaving.code or 0
    return 0


def _drop_output() -> None:
    """Redirect stdout to nowhere, as Python flushes it again at exit."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError:  # an output that is no file
        return
