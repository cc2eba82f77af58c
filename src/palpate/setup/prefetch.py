"""A log read by a process of its own, ahead of who uses it, and the way that blocks take from process to process."""

from __future__ import annotations

import pickle
import signal
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import InputError
from palpate.files.logs import open_log
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.log import Log, LogContents
from palpate.files.memory import keep_memory
from palpate.signals.motion import Motion
from palpate.signals.recording import Recording

__all__ = [
    "LogReader",
    "MotionAhead",
    "PrefetchedLog",
    "Receiver",
    "Sender",
    "background_process",
    "deaf",
    "reading_in_process",
    "sendable",
    "way",
]

SLOTS, SLOT = 6, 1 << 22  # values on their way at most; bytes of one: what is larger goes through the pipe


class Sender:
    """Where values go in. A value waits in shared memory until it is taken, or its place is wanted."""

    def __init__(self, memory: Any, messages: Connection, freed: Connection) -> None:
        self._memory, self._messages, self._freed = memory, messages, freed
        self._free = list(range(SLOTS))

    def put(self, value: object) -> None:
        """Send what can be pickled; waits while too many are on their way.

        Raises:
            EOFError, OSError: nobody receives any more.
        """
        while self._freed.poll() or not self._free:
            self._free.append(self._freed.recv())
        parts = list[pickle.PickleBuffer]()
        head = pickle.dumps(value, protocol=5, buffer_callback=parts.append)
        raws = [part.raw() for part in parts]
        sizes, slot = [raw.nbytes for raw in raws], self._free.pop()
        if sum(sizes) > SLOT:
            head, sizes = pickle.dumps(value, protocol=5), []
            raws = []
        at, view = slot * SLOT, np.frombuffer(self._memory, dtype=np.uint8)
        for raw in raws:
            view[at : at + raw.nbytes] = np.frombuffer(raw, dtype=np.uint8)
            at += raw.nbytes
        self._messages.send_bytes(pickle.dumps((slot, sizes, [raw.readonly for raw in raws], head)))


class Receiver:
    """Where values come out, in their order."""

    def __init__(self, memory: Any, messages: Connection, freed: Connection) -> None:
        self._memory, self._messages, self._freed = memory, messages, freed

    def get(self) -> Any:
        """The next value, its arrays its own.

        Raises:
            EOFError: who sends is gone.
        """
        slot, sizes, fixed, head = pickle.loads(self._messages.recv_bytes())
        at, view = slot * SLOT, np.frombuffer(self._memory, dtype=np.uint8)
        parts = list[bytearray | memoryview]()
        for size, readonly in zip(sizes, fixed, strict=True):
            copy = bytearray(view[at : at + size].data)
            parts.append(memoryview(copy).toreadonly() if readonly else copy)
            at += size
        with suppress(OSError):  # who sent it has ended: its last values are here all the same
            self._freed.send(slot)
        return pickle.loads(head, buffers=parts)


def way() -> tuple[Sender, Receiver]:
    """From one process to another; either end is an argument of the other process."""
    context = get_context("spawn")
    memory = context.RawArray("B", SLOTS * SLOT)
    taken, messages = context.Pipe(duplex=False)
    freed, frees = context.Pipe(duplex=False)
    return Sender(memory, messages, freed), Receiver(memory, taken, frees)


@contextmanager
def deaf() -> Generator[None]:
    """Processes and threads that are started meanwhile, and what these start, do not hear Ctrl-C."""
    resource_tracker.ensure_running()  # it lets signals through when it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which they keep
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def background_process(name: str, target: Callable[..., None], *arguments: object) -> Generator[BaseProcess]:
    """A process that does not hear Ctrl-C, which is for this one, and does not outlive the block.

    Args:
        name: for the list of processes.
        target: what it runs, importable.
        arguments: of it; connections and ends of ways among them are closed here.
    """
    process = get_context("spawn").Process(target=target, args=arguments, name=f"palpate {name}", daemon=True)
    with deaf():
        process.start()
    for end in arguments:
        if isinstance(end, Connection):
            end.close()
        elif isinstance(end, Sender | Receiver):
            close(end)
    try:
        yield process
    finally:
        if process.is_alive():
            process.terminate()
        process.join()


def sendable(problem: Exception) -> Exception:
    """What went wrong in one process, to be raised in another: as it is, or what it says where it cannot be pickled."""
    try:
        return pickle.loads(pickle.dumps(problem))
    except Exception:  # of others' classes of errors, which may do anything
        return RuntimeError(f"{type(problem).__name__}: {problem}")


def close(end: Sender | Receiver) -> None:
    """This process's hold on it, so that the other end notices when the process that has it is gone."""
    for connection in vars(end).values():
        if isinstance(connection, Connection):
            connection.close()


@dataclass(frozen=True)
class _Read:
    """A block, and how far the reader is; `block` None: that was all; `failed`: why it cannot go on."""

    block: Recording | None
    position: int
    torn: str
    notes: tuple[str, ...]
    motion: Motion | None
    failed: Exception | None = None


class MotionAhead(Motion):
    """What a sensor has in place of the motion that the reader tells: blocks come with it, and so does what it met."""

    met: Motion | None = None

    def stream(self, blocks: Iterator[Recording]) -> Iterator[Recording]:
        """As they are."""
        return blocks

    def notes(self, mass: float | None = None) -> tuple[str, ...]:
        """See `Motion`."""
        return () if self.met is None else self.met.notes(mass)


class LogReader:
    """A process that reads one log, made by `reading_beside`."""

    def __init__(self, receiver: Receiver, told: Connection) -> None:
        self._receiver, self._told = receiver, told

    def blocks(self, path: Path, motion: Motion | None) -> Iterator[_Read]:
        """Let it begin; what it has read, to the end.

        Raises:
            InputError: the process was ended.
        """
        try:
            self._told.send(motion)
            while True:
                yield self._receiver.get()
        except (EOFError, OSError) as problem:
            raise InputError("the process that read it was ended.", where=str(path)) from problem


@contextmanager
def reading_in_process(path: Path, layout: LogLayout) -> Generator[LogReader]:
    """A process that opens a log now, and reads it when it is told how: it takes a second to start."""
    sender, receiver = way()
    told, tells = get_context("spawn").Pipe(duplex=False)
    with background_process("reader", _read, sender, told, path, layout):
        yield LogReader(receiver, tells)


class PrefetchedLog(Log):
    """A log whose blocks another process reads and decodes while they are used here; the same blocks.

    Args:
        log: opened as usual; says what is in it.
        reader: the process, of this log.
        motion: what adds accelerations to the blocks, there; None: nothing does.
        told: is told what that met.
    """

    def __init__(
        self, log: Log, reader: LogReader, motion: Motion | None = None, told: MotionAhead | None = None
    ) -> None:
        super().__init__(log.path, log.size)
        self._log, self._reader, self._motion, self._told = log, reader, motion, told
        self._notes: tuple[str, ...] = ()

    def contents(self) -> LogContents:
        """See `Log`."""
        return self._log.contents()

    def notes(self) -> tuple[str, ...]:
        """See `Log`."""
        return self._notes

    def blocks(self) -> Iterator[Recording]:
        """See `Log`; once."""
        for read in self._reader.blocks(self.path, self._motion):
            self.position, self.torn, self._notes = read.position, read.torn, read.notes
            if self._told is not None:
                self._told.met = read.motion
            if read.failed is not None:
                raise read.failed
            if read.block is None:
                return
            yield read.block


def _read(sender: Sender, told: Connection, path: Path, layout: LogLayout) -> None:
    """The process that reads."""
    keep_memory()
    log = open_log(path, layout)
    try:
        motion: Motion | None = told.recv()
    except EOFError:  # nobody wants any
        return
    failed = None
    try:
        for block in log.blocks() if motion is None else motion.stream(log.blocks()):
            sender.put(_Read(block, log.position, log.torn, log.notes(), motion))
    except (EOFError, BrokenPipeError):  # nobody wants more
        return
    except Exception as problem:  # raised where it is used
        failed = sendable(problem)
    with suppress(EOFError, OSError):
        sender.put(_Read(None, log.position, log.torn, log.notes(), motion, failed))
