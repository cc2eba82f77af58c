"""Run `palpate live`: find contacts in a device's samples; show a line, a page, write a record, send messages."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Generator
from contextlib import ExitStack, closing, contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from secrets import token_urlsafe
from tempfile import TemporaryDirectory
from typing import Annotated

from tyro.conf import FlagConversionOff, FlagCreatePairsOff, UseAppendAction, arg

from palpate.cli.live_line import FigureLine, summary
from palpate.cli.live_page import show
from palpate.console.console import counting, lines, note, title, wait
from palpate.console.keys import Came, pressed, signals
from palpate.console.options import FileOption, NameOption, RigFile, Scalar, require_port, require_positive
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs
from palpate.live.publish import RATE, publish, require_address
from palpate.live.receiver import receive
from palpate.live.record import record as record_ring
from palpate.live.record import require_record, ring_of
from palpate.live.record_file import grown
from palpate.live.stream_buffer import StreamBuffer
from palpate.live.supervisor import Worker, WorkerSupervisor
from palpate.setup import Rig, load_rig

START = 180.0  # s in which the receiver must have its ring: the first time kernels are compiled
LINE = 0.5  # s between lines for a person who watches
SELDOM = 10.0  # s between them where nobody does
MEGA = 1e6


def live(
    *,
    rig: RigFile,
    record: FileOption = None,
    split: float = 1000.0,
    view: Annotated[bool, FlagCreatePairsOff] = False,
    port: int = 8080,
    host: Annotated[str, arg(metavar="ADDRESS")] = "127.0.0.1",
    publish: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="TO", help_behavior_hint="")] = (),
    sensor: NameOption = None,
    seconds: Scalar = None,
    realtime: Annotated[bool, FlagConversionOff] = True,
) -> None:
    """Estimate contacts in the samples of a device, live.

    Find contacts in the samples of a device as they come; Ctrl-C ends it, and the end of a log that is replayed.

    A line shows rate, contacts, latency and lost samples. A tare is taken when the key t is pressed, on SIGUSR1
    (`kill -USR1` of this process), or on the page. All events are printed with their times, and recorded.

    Args:
        rig: rig with a [source]: the device and its address (`palpate rig new --source`).
        record: MCAP to write, readings and contacts: `palpate estimate` and `palpate view` read it, and after a crash
            `palpate recover`.
        split: MB after which another file is begun: run.mcap, run.1.mcap, ...
        view: show the contacts in a browser.
        port: port of that page; the next free one if it is taken.
        host: address to serve it at; the default can be reached from this machine only.
        publish: contacts to ros2[:DOMAIN], udp:HOST:PORT or unix:PATH (JSON lines); may be given again.
        sensor: name of the sensor's table, where the rig has several.
        seconds: duration; without it until Ctrl-C, or the end of a log that is replayed without a page.
        realtime: ask the system for real-time priority.

    Raises:
        InputError: the rig or an option cannot be used, an earlier recording was interrupted, or the device cannot be
            opened.
        KeyboardInterrupt: Ctrl-C before the receiver is ready.
    """
    stated = load_rig(rig)
    source = stated.stream()
    require_positive(seconds, "--seconds")
    require_port(port, "--port")
    _require(stated, rig, record, publish, split)
    title(f"{source.kind}{f' at {source.address}' if source.address else ''}, {stated.kind(sensor).called}")
    wait("preparing the surface")
    with ExitStack() as stack:
        came = stack.enter_context(signals())  # from here on: a tare may be asked for before anything runs
        path = stack.enter_context(_ring(record))
        problems, sender = Pipe(duplex=False)
        arguments = (rig, path, sensor, os.getpid(), sender, realtime, record is not None)
        receiver, token = Worker("receiver", receive, arguments), token_urlsafe(16)
        supervisor = WorkerSupervisor([receiver])
        receiver.start()
        ring = None
        try:
            ring = _ready_ring(path, receiver, problems, came)
            supervisor.workers += _readers(path, rig, record, split, publish, realtime and source.kind != "replay")
            if view:
                supervisor.workers.append(Worker("page", show, (path, rig, host, port, token, os.getpid())))
            for worker in supervisor.workers[1:]:
                worker.start()
            _watch(supervisor, ring, problems, came, seconds, token, stays=view)
        finally:
            note(supervisor.stop(ring), kind="warning")
        if ring is not None:
            summary(ring)
        if record is not None:
            lines([("record", str(record))])


def _require(stated: Rig, rig: Path, record: Path | None, publish: tuple[str, ...], split: float) -> None:
    """Refuse unusable files and addresses."""
    if record is not None:
        keep_inputs(record, (rig, *stated.files().values()))
        require_record(record)
        require_positive(split, "--split")
    for each in publish:
        require_address(each)


def _readers(
    ring: Path, rig: Path, record: Path | None, split: float, publish_to: tuple[str, ...], realtime: bool
) -> list[Worker]:
    """Return recorder and publishers."""
    parent = os.getpid()
    publishers = [Worker(f"publisher to {to}", publish, (ring, to, rig, parent, RATE, realtime)) for to in publish_to]
    if record is None:
        return publishers
    return [Worker("recorder", record_ring, (ring, record, split * MEGA, parent)), *publishers]


@contextmanager
def _ring(record: Path | None) -> Generator[Path]:
    """Open a context with the ring's path: next to the record, removed once that is complete, or in memory."""
    if record is not None:
        ring = ring_of(record)
        try:
            yield ring
        finally:
            if ring.exists() and _is_complete(record, ring):
                ring.unlink()
        return
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with TemporaryDirectory(prefix="palpate-", dir=memory, ignore_cleanup_errors=True) as folder:
        yield Path(folder) / "live.ring"


def _is_complete(record: Path, path: Path) -> bool:
    """Return whether all of a ring is in its record; if not, print how to recover it."""
    with closing(StreamBuffer(path)) as ring:
        recorded = ring["recorded"] >= ring["received"]
    if recorded and not grown(record):
        return True
    note([f"{record.name} is not complete; run `palpate recover {record}` to complete it"], kind="warning")
    return False


def _ready_ring(path: Path, receiver: Worker, problems: Connection, came: Came) -> StreamBuffer:
    """Return the ring once the receiver has made it; a signal raises KeyboardInterrupt."""
    end = time.monotonic() + START
    while not path.exists():
        _raise_problem(problems)
        if came.stop:
            raise KeyboardInterrupt
        if not receiver.alive:
            _raise_problem(problems, 1.0)
            what = "the process that receives samples ended before it was ready, without a message."
            raise InputError(what, where="palpate live", hint="Free memory, and start again.")
        if time.monotonic() > end:
            what = f"the process that receives samples is not ready after {START:g} s."
            raise InputError(what, where="palpate live", hint="Check that the device answers, and start again.")
        time.sleep(0.02)
    return StreamBuffer(path)


def _raise_problem(problems: Connection, timeout: float = 0.0) -> None:
    """Raise an InputError with the receiver's message if it ended with one."""
    with suppress(EOFError):
        if problems.poll(timeout):
            raise InputError(problems.recv_bytes().decode(errors="replace"))


def _watch(
    supervisor: WorkerSupervisor,
    ring: StreamBuffer,
    problems: Connection,
    came: Came,
    seconds: float | None,
    token: str,
    *,
    stays: bool,
) -> None:
    """Supervise, print and take tares until Ctrl-C, for some seconds, or, unless it `stays`, until a log's end."""
    figures, end = FigureLine(ring, token), time.monotonic() + (seconds or float("inf"))
    every, then, done = LINE if sys.stderr.isatty() else SELDOM, 0.0, 0
    with counting(), pressed() as key:
        while not came.stop and time.monotonic() < end and (stays or not ring["ended"]):
            if key(0.1) == "t":
                ring.ask_tare("the key t")
            if (tares := came.tares) > done:  # counted, not reset: a signal may fall between any two steps
                ring.ask_tare("a signal (SIGUSR1)")
                done = tares
            _raise_problem(problems)
            supervisor.watch(ring)
            figures.sentences()
            if time.monotonic() >= then:
                figures.line()
                then = time.monotonic() + every
        figures.sentences()
