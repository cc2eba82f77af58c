"""Run `palpate live`: find contacts in a device's samples; show a line, a page, write a record, send messages."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from secrets import token_urlsafe
from typing import Annotated

from tyro.conf import FlagConversionOff, FlagCreatePairsOff, UseAppendAction, arg

from palpate.cli.live_line import FigureLine, summary
from palpate.cli.live_page import show
from palpate.console.console import counting, lines, note, title, wait
from palpate.console.keys import Came, pressed, signals
from palpate.console.options import FileOption, RigFile, Scalar, require_port, require_positive
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs
from palpate.live.publish import publish, require_address
from palpate.live.receiver import receive
from palpate.live.record import record as record_ring
from palpate.live.record import require_record, ring_of
from palpate.live.record_file import grown
from palpate.live.stream_buffer import StreamBuffer
from palpate.live.supervisor import Worker, WorkerSupervisor
from palpate.setup import Rig, load_rig

__all__ = ["live"]

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
    sensor: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None,
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
        heard, trouble = Pipe(duplex=False)
        arguments = (rig, path, sensor, os.getpid(), trouble, realtime, record is not None)
        receiver, token = Worker("receiver", receive, arguments), token_urlsafe(16)
        supervisor = WorkerSupervisor([receiver])
        receiver.start()
        ring = None
        try:
            ring = _made(path, receiver, heard, came)
            supervisor.workers += _readers(path, rig, record, split, publish)
            if view:
                supervisor.workers.append(Worker("page", show, (path, rig, host, port, token, os.getpid())))
            for worker in supervisor.workers[1:]:
                worker.start()
            _watch(supervisor, ring, heard, came, seconds, token, stays=view)
        finally:
            note(supervisor.stop(ring), kind="warning")
        if ring is not None:
            summary(ring)
        if record is not None:
            lines([("record", str(record))])


def _require(stated: Rig, rig: Path, record: Path | None, publish: tuple[str, ...], split: float) -> None:
    """Refuse unusable files and addresses before anything is started."""
    if record is not None:
        keep_inputs(record, (rig, *stated.files().values()))
        require_record(record)
        require_positive(split, "--split")
    for each in publish:
        require_address(each)


def _readers(ring: Path, rig: Path, record: Path | None, split: float, publish_to: tuple[str, ...]) -> list[Worker]:
    """Return the processes that read the ring: the recorder and the publishers."""
    parent = os.getpid()
    made: list[Worker] = []
    if record is not None:
        made.append(Worker("recorder", record_ring, (ring, record, split * MEGA, parent)))
    made += [Worker(f"publisher to {to}", publish, (ring, to, rig, parent)) for to in publish_to]
    return made


@contextmanager
def _ring(record: Path | None) -> Generator[Path]:
    """Give the path of the ring: next to the record, removed once the record is complete, or in memory."""
    if record is not None:
        ring = ring_of(record)
        if ring.exists():
            raise InputError(
                "an earlier recording was interrupted.",
                where=str(record),
                hint=f"Run `palpate recover {record}` to save it, then start the new one again.",
            )
        try:
            yield ring
        finally:
            if ring.exists() and _whole(record, ring):
                ring.unlink()
        return
    memory = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="palpate-", dir=memory if os.access(memory, os.W_OK) else None))
    try:
        yield folder / "live.ring"
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _whole(record: Path, path: Path) -> bool:
    """Return whether all of a ring is in its record, whatever ended the run; if not, print how to recover it."""
    ring = StreamBuffer(path)
    received, recorded = ring["received"], ring["recorded"]
    ring.close()
    if recorded >= received and not grown(record):
        return True
    note([f"{record.name} is not complete; run `palpate recover {record}` to complete it"], kind="warning")
    return False


def _made(path: Path, receiver: Worker, trouble: Connection, came: Came) -> StreamBuffer:
    """Return the ring, once the receiver has made it.

    Raises:
        InputError: the receiver could not make it, with the receiver's message, or was too slow.
        KeyboardInterrupt: a signal requested the end.
    """
    end = time.monotonic() + START
    while not path.exists():
        _heard(trouble)
        if came.stop:
            raise KeyboardInterrupt
        if not receiver.alive:
            _heard(trouble, 1.0)
            what = "the process that receives samples ended before it was ready, without a message."
            raise InputError(what, where="palpate live", hint="Free memory, and start again.")
        if time.monotonic() > end:
            what = f"the process that receives samples is not ready after {START:g} s."
            raise InputError(what, where="palpate live", hint="Check that the device answers, and start again.")
        time.sleep(0.02)
    return StreamBuffer(path)


def _heard(trouble: Connection, timeout: float = 0.0) -> None:
    """Raise an InputError with the receiver's message if it ended with one."""
    with suppress(EOFError):
        if trouble.poll(timeout):
            raise InputError(trouble.recv_bytes().decode(errors="replace"))


def _watch(
    supervisor: WorkerSupervisor,
    ring: StreamBuffer,
    trouble: Connection,
    came: Came,
    seconds: float | None,
    token: str,
    *,
    stays: bool,
) -> None:
    """Run until Ctrl-C, or for some seconds: restart processes, print events and a line of figures, take tares.

    The end of a replayed log ends it too, unless it `stays` for a person at the page.
    """
    figures, end = FigureLine(ring, token), time.monotonic() + (seconds or float("inf"))
    every, then = LINE if sys.stderr.isatty() else SELDOM, 0.0
    done = 0
    with counting(), pressed() as key:
        while not came.stop and time.monotonic() < end and (stays or not ring["ended"]):
            if key(0.1) == "t":
                ring.ask_tare("the key t")
            if (tares := came.tares) > done:  # counted, not reset: a signal may fall between any two steps
                ring.ask_tare("a signal (SIGUSR1)")
                done = tares
            _heard(trouble)
            supervisor.watch(ring)
            figures.sentences()
            if time.monotonic() >= then:
                figures.line()
                then = time.monotonic() + every
        figures.sentences()
