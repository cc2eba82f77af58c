"""Handle Ctrl-C so that it is neither lost nor interrupts an import."""

from __future__ import annotations

import gc
import signal
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module


@contextmanager
def uninterrupted() -> Generator[None]:
    """Return a context that holds Ctrl-C back until its block has ended, in the main thread with Python's own handler.

    Libraries guard optional imports by `except BaseException`, which swallows a `KeyboardInterrupt` raised within.

    Raises:
        KeyboardInterrupt: at the end of the block, if Ctrl-C was pressed.
    """
    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not usual or threading.current_thread() is not threading.main_thread():  # somebody else hears Ctrl-C
        yield
        return
    caught: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: caught.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if caught:
        raise KeyboardInterrupt


@contextmanager
def importing() -> Generator[None]:
    """Return a context in which a command imports: it holds back Ctrl-C, and the garbage collector passes over modules.

    They stay until the process ends, and to look through them takes a quarter of the time of a short command. Whatever
    else exists when modules were imported is passed over, too: this is not for a library's functions.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed: raised at the end.
    """
    collecting, known = gc.isenabled(), len(sys.modules)
    gc.disable()
    try:
        with uninterrupted():
            yield
    finally:
        if len(sys.modules) > known:
            gc.freeze()
        if collecting:
            gc.enable()


def import_mesh_reader() -> None:
    """Import trimesh, without an interruption by Ctrl-C halfway.

    Raises:
        ImportError: it is not installed or does not load.
    """
    with uninterrupted():
        import_module("trimesh")
