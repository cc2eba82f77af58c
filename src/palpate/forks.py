"""Refuse tables in forked processes, where the threads of polars are missing and would be waited for for ever."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from palpate.errors import InputError

_TASKS = Path("/proc/self/task")  # Linux alone has it; a fork of other systems is refused once polars is imported
_threads = {"started": False, "missing": False}


def require_polars_threads() -> None:
    """Refuse tables in a process that was forked after polars had started its threads: it would wait for ever.

    Raises:
        InputError: this is such a process.
    """
    if _threads["missing"]:
        raise InputError(
            "tables cannot be read or written in a process that was forked after its parent had read or written one: "
            "the threads of polars are missing.",
            where=f"process {os.getpid()}",
            hint='Start it by multiprocessing.get_context("spawn") or "forkserver", or fork before the first table.',
        )


def _look() -> None:
    """Note before a fork whether polars has started its threads."""
    try:
        names = [(task / "comm").read_text() for task in _TASKS.iterdir()]
    except OSError:
        _threads["started"] = "polars" in sys.modules
    else:
        _threads["started"] = any(name.startswith("polars-") and name[7:].strip().isdigit() for name in names)


def _forked() -> None:
    """Note in a forked process that its threads are missing; a process that it forks lacks them too."""
    _threads["missing"] = _threads["missing"] or _threads["started"]


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(before=_look, after_in_child=_forked)
