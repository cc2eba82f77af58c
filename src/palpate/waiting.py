"""Announce slow work once, by the logger "palpate", to stderr.

`logging.getLogger("palpate").setLevel(logging.ERROR)` switches it off; commands, which have lines of progress, do.
"""

from __future__ import annotations

import threading
from collections.abc import Generator
from contextlib import contextmanager

PATIENCE = 2.0  # s
_ANNOUNCED: set[str] = set()


@contextmanager
def waiting(what: str) -> Generator[None]:
    """Return a context that logs the warning `what`, once a process, if its block takes longer than two seconds."""
    if what in _ANNOUNCED:
        yield
        return
    timer = threading.Timer(PATIENCE, _announce, (what,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _announce(what: str) -> None:
    import logging  # here: it is seldom wanted

    if what not in _ANNOUNCED:
        _ANNOUNCED.add(what)
        logging.getLogger("palpate").warning("palpate: %s", what)
