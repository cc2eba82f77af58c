"""A command run in this process, with an eye on the time, the memory, and everything it says."""

import contextlib
import io
import os
import resource
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile

from palpate.cli import main

LIMIT = 10  # s of the processor, which other processes do not take away
PATIENCE = 120  # s, for what waits for nothing
MEMORY = 400  # MB more than ever before, for files of some 50 kB


@dataclass(frozen=True)
class Heard:
    """Exit code, stdout, stderr, seconds, and what no command may do: fail without a sentence, warn, hang, grow."""

    code: int
    out: str
    said: str
    seconds: float
    fault: str


class _HangError(BaseException):
    """Not an Exception, which might be caught."""


def watched(arguments: Sequence[str]) -> Heard:
    """Run a command; stderr holds also what compiled code writes past Python."""
    heard, said, fault, code = io.StringIO(), io.StringIO(), "", -1
    peak, begin = _peak(), time.perf_counter()
    with TemporaryFile() as below, warnings.catch_warnings(record=True) as warned, _below(below.fileno()):
        warnings.simplefilter("always")
        old = [signal.signal(number, _ring) for number in (signal.SIGPROF, signal.SIGALRM)]
        signal.setitimer(signal.ITIMER_PROF, LIMIT)
        signal.setitimer(signal.ITIMER_REAL, PATIENCE)
        try:
            with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(said):
                code = main(arguments)
        except BaseException as problem:  # what a user would see as a traceback
            place = traceback.extract_tb(problem.__traceback__)[-12:]
            way = " < ".join(f"{Path(at.filename).name}:{at.lineno}" for at in reversed(place))
            fault = f"{type(problem).__name__}: {problem} ({way})"
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)
            for number, handler in zip((signal.SIGPROF, signal.SIGALRM), old, strict=True):
                signal.signal(number, handler)
        below.seek(0)
        text = said.getvalue() + below.read().decode(errors="replace")
    if warned:
        fault = fault or f"{warned[0].category.__name__}: {warned[0].message} ({warned[0].filename}:{warned[0].lineno})"
    if _peak() - peak > MEMORY:
        fault = fault or f"took {_peak() - peak} MB"
    fault = fault or _unfit(code, heard.getvalue(), text)
    return Heard(code, heard.getvalue(), text, time.perf_counter() - begin, fault)


def _ring(*_: object) -> None:
    raise _HangError


@contextlib.contextmanager
def _below(file: int) -> Iterator[None]:
    """What compiled code says of itself goes to the file."""
    sys.stderr.flush()
    kept = os.dup(2)
    os.dup2(file, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _unfit(code: int, heard: str, said: str) -> str:
    """What is wrong with an exit code and what was said."""
    if code not in (0, 1, 3, 4):
        return f"exit {code}: {said}"
    sentence, _, rest = said.partition("\n")
    if code == 1 and (not sentence.startswith("palpate: ") or (rest and "panicked at crates/polars" not in rest)):
        return f"no sentence, but {said!r}"  # polars' own readers of damaged Parquet talk beside it
    if code != 1 and said:
        return f"exit {code}, and on stderr {said!r}"
    return "Traceback" if "Traceback" in heard + said else ""


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
