"""Receive keys of the terminal and signals while a command runs."""

from __future__ import annotations

import select
import signal
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType


@dataclass
class Came:
    """Signals received so far: `stop` by Ctrl-C or SIGTERM, `tares` counts SIGUSR1."""

    stop: bool = False
    tares: int = 0


@contextmanager
def signals() -> Generator[Came]:
    """Open a context with a `Came`, which receives the signals in place of their usual effects.

    Raises:
        ValueError: it is opened in another thread than the main one.
    """
    came = Came()

    def receive(number: int, _: FrameType | None) -> None:
        if number == signal.SIGUSR1:
            came.tares += 1
        else:
            came.stop = True

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)
    before = {number: signal.signal(number, receive) for number in numbers}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def pressed() -> Generator[Callable[[float], str]]:
    """Open a context with a function that waits up to some seconds for a key of the terminal, and returns it or "".

    If stdin is no terminal, it waits for all of that time and returns "".
    """
    if not sys.stdin.isatty():
        yield _waited
        return
    import termios  # not on Windows
    import tty

    number = sys.stdin.fileno()
    before = termios.tcgetattr(number)
    tty.setcbreak(number)
    try:
        yield lambda timeout: sys.stdin.read(1) if select.select([number], [], [], timeout)[0] else ""
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)


def _waited(timeout: float) -> str:
    select.select([], [], [], timeout)
    return ""
