"""Run `palpate live`: find contacts in a device's samples; show a line, a page, write a record, send messages."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, closing, contextmanager
from itertools import product
from pathlib import Path
from secrets import token_urlsafe
from tempfile import TemporaryDirectory
from typing import Annotated

from tyro.conf import FlagConversionOff, FlagCreatePairsOff, UseAppendAction, arg

from palpate.cli.estimate_robot import LEFT_OUT
from palpate.cli.live_line import FigureLine, summary
from palpate.cli.live_page import show
from palpate.cli.live_streams import LiveStream, Sensors, left_out, ready
from palpate.console.console import counting, lines, note, title, wait
from palpate.console.keys import Came, pressed, signals
from palpate.console.options import FileOption, NameOption, RigFile, Scalar, require_port, require_positive
from palpate.files.atomic import keep_inputs
from palpate.live.joints import NAME
from palpate.live.publish import RATE, publish, require_address
from palpate.live.record import record as record_rings
from palpate.live.record import require_record, ring_of, rings_of
from palpate.live.record_file import grown
from palpate.live.stream_buffer import StreamBuffer
from palpate.live.supervisor import Worker, WorkerSupervisor

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
        sensor: name of the sensor's table, where the rig has several; of a robot's sensors, with commas between.
        seconds: duration; without it until Ctrl-C, or the end of a log that is replayed without a page.
        realtime: ask the system for real-time priority.

    Raises:
        InputError: the rig or an option cannot be used, an earlier recording was interrupted, or the device cannot be
            opened.
        KeyboardInterrupt: Ctrl-C before the receiver is ready.
        SystemExit: 4: a sensor of a robot was left out.
    """
    sensors = Sensors.of(rig, sensor)
    sources = {name: each.stream() for name, each in sensors.rigs.items()}
    require_positive(seconds, "--seconds")
    require_port(port, "--port")
    _require(sensors, record, publish, split)
    title(_called(sensors))
    note([f"{name} is left out: {problem}" for name, problem in sensors.faulty.items()], kind="warning")
    wait("preparing the surface")
    with ExitStack() as stack:
        came = stack.enter_context(signals())  # from here on: a tare may be asked for before anything runs
        place = stack.enter_context(_rings(record))
        streams, token = sensors.receivers(place, realtime=realtime, recorded=record is not None), token_urlsafe(16)
        count = len(streams)
        supervisor, rings = WorkerSupervisor(_workers(streams)), list[StreamBuffer]()
        for worker in supervisor.workers:
            worker.start()
        try:
            streams = ready(streams, came)
            receivers = supervisor.workers = _workers(streams)
            rings = [each.ring for each in streams if each.ring is not None]
            hurried = realtime and any(each.kind != "replay" for each in sources.values())
            supervisor.workers = receivers + _readers(streams, rig, record, split, publish, hurried)
            if view:
                arguments = (tuple(each.path for each in rings), rig, sensor, host, port, token, os.getpid())
                supervisor.workers.append(Worker("page", show, arguments))
            for worker in supervisor.workers[len(receivers) :]:
                worker.start()
            _watch(supervisor, streams, came, seconds, token, stays=view)
        finally:
            note(supervisor.stop(rings[0] if rings else None), kind="warning")
        for each in streams:
            if each.ring is not None and each.name != NAME:
                summary(each.ring, each.name if sensors.several else "")
        if record is not None:
            lines([("record", str(record))])
    if sensors.faulty or any(each.over for each in streams) or len(streams) < count:
        raise SystemExit(LEFT_OUT)


def _workers(streams: Sequence[LiveStream]) -> list[Worker]:
    """Return the receivers of streams, each once."""
    return list({id(each.worker): each.worker for each in streams}.values())


def _called(sensors: Sensors) -> str:
    """Return text on the source and the kind of sensor, or on the number of sensors."""
    if sensors.several:
        return f"{sensors.rig}, {len(sensors.rigs)} sensors"
    name, rig = next(iter(sensors.rigs.items()))
    source = rig.stream()
    return f"{source.kind}{f' at {source.address}' if source.address else ''}, {rig.kind(name or None).called}"


def _require(sensors: Sensors, record: Path | None, publish: tuple[str, ...], split: float) -> None:
    """Refuse unusable files and addresses."""
    if record is not None:
        files = [path for each in sensors.rigs.values() for path in each.files().values()]
        keep_inputs(record, (sensors.rig, *files))
        require_record(record)
        require_positive(split, "--split")
    for each in publish:
        require_address(each)


def _readers(
    streams: Sequence[LiveStream],
    rig: Path,
    record: Path | None,
    split: float,
    publish_to: tuple[str, ...],
    realtime: bool,
) -> list[Worker]:
    """Return recorder and publishers."""
    parent, heard = os.getpid(), [each for each in streams if each.name != NAME]
    paths, name = [each.path for each in heard], heard[0].name or None
    workers = [
        Worker(f"publisher to {to}", publish, (paths, to, rig, name, parent, RATE, realtime)) for to in publish_to
    ]
    if record is not None:
        rings = sorted(each.path for each in streams)  # the order in which they are recovered
        workers.insert(0, Worker("recorder", record_rings, (rings, record, split * MEGA, parent)))
    return workers


@contextmanager
def _rings(record: Path | None) -> Generator[Callable[[str], Path]]:
    """Open a context with the rings' paths: next to the record, removed once that is complete, or in memory."""
    if record is not None:
        try:
            yield lambda sensor: ring_of(record, sensor)
        finally:
            rings = rings_of(record)
            if rings and _is_complete(record, rings):
                for ring in reversed(rings):
                    ring.unlink()
        return
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with TemporaryDirectory(prefix="palpate-", dir=memory, ignore_cleanup_errors=True) as folder:
        yield lambda sensor: Path(folder) / f"{sensor}.ring"


def _is_complete(record: Path, paths: Sequence[Path]) -> bool:
    """Return whether all of the rings is in their record; if not, print how to recover it."""
    recorded = True
    for path in paths:
        with closing(StreamBuffer(path)) as ring:
            recorded &= ring["recorded"] >= ring["received"]
    if recorded and not grown(record):
        return True
    note([f"{record.name} is not complete; run `palpate recover {record}` to complete it"], kind="warning")
    return False


def _watch(
    supervisor: WorkerSupervisor,
    streams: Sequence[LiveStream],
    came: Came,
    seconds: float | None,
    token: str,
    *,
    stays: bool,
) -> None:
    """Supervise, print and take tares until Ctrl-C, for some seconds, or, unless it `stays`, until a log's end."""
    rings = {each.name: each.ring for each in streams if each.ring is not None}
    figures, end = FigureLine(rings, token), time.monotonic() + (seconds or float("inf"))
    every, then, done = LINE if sys.stderr.isatty() else SELDOM, 0.0, 0
    with counting(), pressed() as key:
        while not came.stop and time.monotonic() < end and (stays or not _ended(streams)):
            asked = ["the key t"] if key(0.1) == "t" else []
            if (tares := came.tares) > done:  # counted, not reset: a signal may fall between any two steps
                asked, done = [*asked, "a signal (SIGUSR1)"], tares
            for ring, by in product(rings.values(), asked):
                ring.ask_tare(by)
            left_out(streams)
            supervisor.watch(next(iter(rings.values())))
            figures.sentences()
            if time.monotonic() >= then:
                figures.line()
                then = time.monotonic() + every
        figures.sentences()


def _ended(streams: Sequence[LiveStream]) -> bool:
    """Return whether all logs that are replayed are at their end."""
    running = [each for each in streams if not each.over and each.name != NAME]
    return all(each.ring is not None and each.ring["ended"] for each in running)
