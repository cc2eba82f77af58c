"""Receive samples and estimate their contacts in a process that does nothing else."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from palpate.errors import InputError, PalpateError
from palpate.live.live import Live
from palpate.live.stream_buffer import SIZE, SlotForm, StreamBuffer

PRIORITY = 60  # of SCHED_FIFO: above what is usual, below the threads of the system
IMAGES = 1 << 28  # bytes of a ring of images
_LOCK_NOW_AND_LATER = 3  # MCL_CURRENT | MCL_FUTURE


def receive(
    rig: Path, ring: Path, sensor: str | None, parent: int, trouble: Connection, realtime: bool, recorded: bool
) -> None:
    """Pass samples and contacts through a ring until it says stop or the parent is gone; the target of a process.

    Args:
        rig: file of a rig with a [source].
        ring: file to make, or to continue after an earlier process.
        sensor: name of the sensor's table, if there are several.
        parent: id of the parent process.
        trouble: receives the text (UTF-8) of a `PalpateError`, which ends this process.
        realtime: request real-time priority, unless samples can wait.
        recorded: the ring is recorded; samples that can wait do so.

    Raises:
        OSError: the device cannot be read.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C and says stop
    try:
        live = Live(rig, sensor)
        with live:  # before the ring is there: without a device nothing is begun
            opened = _opened(ring, live.form(rig=str(rig)), recorded)
            live.into(opened)
            if realtime and not live.patient:
                opened.say(_hurried())
            gc.collect()
            gc.freeze()  # what exists now is not collected, which would pause the loop
            _loop(live, opened, parent)
    except PalpateError as problem:
        trouble.send_bytes(str(problem).encode())


def orphaned(parent: int) -> bool:
    """Return whether the parent process, given by its id, is gone."""
    return os.getppid() != parent


def _loop(live: Live, ring: StreamBuffer, parent: int) -> None:
    while not ring["stop"] and not orphaned(parent):
        live.step()
        if live.ended:
            live.finish()
        _say(live, ring)
        ring["alive"], ring["ended"] = time.time_ns(), int(live.ended)
        if ring["asked"] != ring["done"]:
            ring["done"] = ring["asked"]
            live.tare()
    live.finish()
    _say(live, ring)


def _say(live: Live, ring: StreamBuffer) -> None:
    for sentence in live.events():
        ring.say(sentence)


def _opened(path: Path, form: SlotForm, recorded: bool) -> StreamBuffer:
    """Return the existing ring, or a new one, whose file appears when it is complete."""
    if path.exists():
        ring = StreamBuffer(path)
        if ring.form != form:
            hint = "Save its samples with `palpate recover`, or remove it."
            raise InputError("was written with another rig or sensor.", where=str(path), hint=hint)
        for _ in range(ring["received"] - ring["answered"]):  # received by one that was killed before it had answered
            ring.answer(np.zeros((0, form.width)), np.zeros(1, dtype=np.int64), known=False)
        return ring
    beside = path.with_name(f"{path.name}.new")
    made = StreamBuffer.make(beside, form, IMAGES if form.images else SIZE)
    made["recording"] = int(recorded)
    made.close()
    beside.replace(path)
    return StreamBuffer(path)


def hurry(priority: int) -> bool:
    """Request real-time priority for this thread, and return whether it is granted."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, PermissionError):
        return False
    return True


def _hurried() -> str:
    """Request real-time priority and locked memory, and return a sentence on the outcome."""
    if not hurry(PRIORITY):
        return (
            "no real-time priority was granted, so other work on this machine delays contacts "
            "(allow rtprio in /etc/security/limits.conf, or CAP_SYS_NICE)"
        )
    locked = ctypes.CDLL(None).mlockall(_LOCK_NOW_AND_LATER) == 0
    return f"real-time priority {PRIORITY} (SCHED_FIFO){', memory locked' if locked else ''}"
