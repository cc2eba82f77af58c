"""Receive samples and estimate their contacts in a process that does nothing else."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from pathlib import Path

import numpy as np

from palpate.errors import InputError, PalpateError
from palpate.files.logs.topics import LIVE_BOTH
from palpate.live.joints import JointSource, joint_form, joint_source
from palpate.live.live import Live
from palpate.live.source import Batch, PunctualSource
from palpate.live.stream_buffer import SIZE, SlotForm, StreamBuffer
from palpate.setup.load import load_robot

PRIORITY = 60  # of SCHED_FIFO: above what is usual, below the threads of the system
IMAGES = 1 << 28  # bytes of a ring of images
SHARED, SLOTS = 8, 8192  # rings of a robot's sensors are smaller by as much, at most, if they have so many slots
ALONE = 1.0  # s between looks whether the parent is there
TURN = 2e-4  # s that the thread which reads a log on keeps Python's lock, at most: 5 ms unless stated
POLL = 0.05  # s that joint states are waited for
TOGETHER = 0.02  # s in which they come together: they are for the record and the page alone
_LOCK_NOW_AND_LATER = 3  # MCL_CURRENT | MCL_FUTURE


def receive(
    rig: Path,
    ring: Path,
    sensor: str | None,
    parent: int,
    trouble: Connection,
    realtime: bool,
    recorded: bool,
    together: Event | None = None,
) -> None:
    """Pass samples and contacts through a ring until it says stop or the parent is gone; the target of a process.

    Args:
        rig: file of a rig with a [source].
        ring: file to make, or to continue after an earlier process.
        sensor: name of the sensor, or of its table, if there are several.
        parent: id of the parent process.
        trouble: receives the text (UTF-8) of a `PalpateError`, which ends this process.
        realtime: request real-time priority, unless samples can wait.
        recorded: the ring is recorded; samples that can wait do so.
        together: of one of several sensors of a robot, whose contacts have its name: the source is opened once this is
            set, which an empty message to `trouble` requests.

    Raises:
        OSError: the device cannot be read.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C and says stop
    with _reported(trouble):
        live = Live(rig, sensor)
        _wait(together, [trouble], parent)
        with live:  # before the ring is there: without a device nothing is begun
            opened = _ring_for(live, rig, ring, sensor if together else None, recorded)
            if realtime and not live.patient:
                opened.say(_hurried())
            gc.collect()
            gc.freeze()  # what exists now is not collected, which would pause the loop
            while not opened["stop"] and not orphaned(parent):
                _step(live, opened)
            live.finish()
            _say(live, opened)


def receive_together(
    rig: Path,
    rings: Sequence[Path],
    sensors: Sequence[str],
    parent: int,
    troubles: Sequence[Connection],
    realtime: bool,
    recorded: bool,
    together: Event,
) -> None:
    """Pass samples and contacts of several sensors of a robot through rings, as `receive` does, in one process.

    Their sources are punctual: what a process costs, and each time it wakes up, is shared. A sensor with an error is
    left out, and the others go on.

    Args:
        rig: file of the robot's rig.
        rings: file of each sensor's ring, to make or to continue.
        sensors: names of the sensors.
        parent: id of the parent process.
        troubles: for each sensor, as for `receive`.
        realtime: request real-time priority.
        recorded: the rings are recorded.
        together: as for `receive`.

    Raises:
        OSError: a log cannot be read.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    lives, streams = list[tuple[Live, str, Path, Connection]](), list[_SharedStream]()
    with ExitStack() as stack:
        for sensor, ring, trouble in zip(sensors, rings, troubles, strict=True):
            with _reported(trouble):
                lives.append((Live(rig, sensor), sensor, ring, trouble))
        _wait(together, [trouble for *_, trouble in lives], parent)
        for live, sensor, ring, trouble in lives:
            with _reported(trouble):
                stack.enter_context(live)
                streams.append(_SharedStream(live, _ring_for(live, rig, ring, sensor, recorded), trouble))
        if realtime and streams:
            streams[0].ring.say(_hurried())
        gc.collect()
        gc.freeze()
        _take_turns(streams, parent)


def _take_turns(streams: list[_SharedStream], parent: int) -> None:
    """Receive from whichever stream has the next sample, until the first ring says stop or the parent is gone."""
    sys.setswitchinterval(TURN)
    begin = time.monotonic()
    for each in streams:
        each.source.begin(begin)
    while streams and not streams[0].ring["stop"] and not orphaned(parent):
        now = time.monotonic()
        if failed := [each for each in streams if each.next <= now and not each.step()]:
            streams = [each for each in streams if each not in failed]
        time.sleep(max(0.0, min((each.next for each in streams), default=0.0) - time.monotonic()))
    for each in streams:
        with _reported(each.trouble):
            each.live.finish()
        _say(each.live, each.ring)


class _SharedStream:
    """Receive one of several sensors of a process."""

    def __init__(self, live: Live, ring: StreamBuffer, trouble: Connection) -> None:
        if not isinstance(live.source, PunctualSource):
            raise InputError("cannot be received in one process with others.", where="[source]")
        self.live, self.ring, self.source, self.trouble = live, ring, live.source, trouble
        self.next = 0.0  # s, by `time.monotonic`

    def step(self) -> bool:
        """Pass on what has come; return False after an error, which is reported."""
        try:
            _step(self.live, self.ring, 0.0)
        except PalpateError as problem:  # not by `_reported`, which takes 1 % of a core of two dozen sensors
            self.trouble.send_bytes(str(problem).encode())
            return False
        self.next = min(self.source.due(), time.monotonic() + POLL)
        return True


@contextmanager
def _reported(trouble: Connection) -> Generator[None]:
    """Send the text of a `PalpateError`, which ends the block."""
    try:
        yield
    except PalpateError as problem:
        trouble.send_bytes(str(problem).encode())


def _wait(together: Event | None, troubles: Sequence[Connection], parent: int) -> None:
    """Wait until the receivers of all sensors are prepared: samples that came before would not be recorded."""
    if together is not None:
        for trouble in troubles:
            trouble.send_bytes(b"")
        while not together.wait(ALONE) and not orphaned(parent):
            pass


def _ring_for(live: Live, rig: Path, ring: Path, sensor: str | None, recorded: bool) -> StreamBuffer:
    """Open or make the ring of a stream, of a robot's sensor if it has a name, and store its samples there."""
    form = live.form(rig=str(rig))
    opened = _opened(ring, _named(live, form, sensor) if sensor else form, recorded)
    live.into(opened)
    return opened


def _named(live: Live, form: SlotForm, sensor: str) -> SlotForm:
    """Return the form with the names of a robot's sensor, whose contacts are in the frame of its link."""
    robot, arrays = load_robot(form.rig), live.setup.layout().arrays
    topic = f"{LIVE_BOTH}{arrays[0].topic or ''}" if form.topic == LIVE_BOTH and arrays else form.topic
    each, names = robot.picked(sensor)[0], list(robot.sensors)
    place = names.index(sensor), len(names)
    frame = each.link or form.frame
    return replace(form, origin=tuple(each.origin), place=place, expected=each.expected, frame=frame, topic=topic)


def receive_joints(
    rig: Path,
    ring: Path,
    sensors: tuple[str, ...] | None,
    parent: int,
    trouble: Connection,
    recorded: bool,
    together: Event | None = None,
) -> None:
    """Pass the joint states of a robot through a ring, as `receive` does samples; the target of a process.

    Args:
        rig: file of the robot's rig.
        ring: file to make, or to continue.
        sensors: names of the sensors that are received; None: all.
        parent: id of the parent process.
        trouble: receives the text (UTF-8) of a `PalpateError`, which ends this process.
        recorded: the ring is recorded; messages that can wait do so.
        together: as for `receive`.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with _reported(trouble):
        source = joint_source(load_robot(rig), sensors)
        if source is None:
            raise InputError("names no topic of joint states that can be read live.", where=str(rig))
        with closing(source):
            _wait(together, [trouble], parent)
            source.open()
            opened = _opened(ring, joint_form(source, str(rig)), recorded)
            _pass_on(source, opened, parent)


def _pass_on(source: JointSource, ring: StreamBuffer, parent: int) -> None:
    batch, none = Batch((len(source.joints),)), np.zeros((0, ring.form.width))
    while not ring["stop"] and not orphaned(parent):
        behind = source.patient and ring["recording"] and ring["received"] - ring["recorded"] > ring.safe // 2
        stamps, values = (none[:, 0], none) if behind else source.receive(POLL)
        for start in range(0, len(stamps), len(batch)):
            part = slice(start, start + len(batch))
            count = len(stamps[part])
            batch.stamp[:count], batch.values[:count] = stamps[part], values[part]
            batch.arrive(count, time.time_ns())
            ring.take_in(batch, count, batch.turned)
            ring.answer(none, np.zeros(count, dtype=np.int64))
        if behind or not source.patient:
            time.sleep(POLL if behind else TOGETHER)
        ring["alive"], ring["ended"] = time.time_ns(), int(source.ended)
        ring["done"] = ring["asked"]  # a tare is of sensors


def orphaned(parent: int) -> bool:
    """Return whether the parent process, given by its id, is gone."""
    return os.getppid() != parent


def _step(live: Live, ring: StreamBuffer, timeout: float = 0.1) -> None:
    """Pass on what has come, and take what is requested; wait up to `timeout` [s] for a sample."""
    live.pass_on(timeout)
    if ended := live.ended:
        live.finish()
    _say(live, ring)
    ring["alive"], ring["ended"] = time.time_ns(), int(ended)
    if ring["asked"] != ring["done"]:
        ring["done"] = ring["asked"]
        live.tare()


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
    size = max(SIZE // min(form.place[1], SHARED), min(SIZE, SLOTS * form.slot().itemsize))
    made = StreamBuffer.make(beside, form, IMAGES if form.images else size)
    made["recording"] = int(recorded)
    made.close()
    beside.replace(path)
    return StreamBuffer(path)


def hurry(priority: int) -> bool:
    """Request real-time priority for the threads of this process, and return whether it is granted."""
    try:
        for thread in threading.enumerate():  # all: one without it may keep Python's lock while it waits for a core
            os.sched_setscheduler(thread.native_id or 0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError):  # PermissionError, or a thread that ended meanwhile
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
