"""Prefetch a log in another process, and send its blocks from process to process through shared memory."""

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
from palpate.processes import keep_memory
from palpate.signals.motion import Motion
from palpate.signals.recording import Recording

SLOTS, SLOT = 6, 1 << 22  # values in transit at most; bytes of one: larger values go through the pipe


class Sender:
    """The sending end of a way between processes; values wait in shared memory."""

    def __init__(self, memory: Any, messages: Connection, freed: Connection) -> None:
        self._memory, self._messages, self._freed = memory, messages, freed
        self._free = list(range(SLOTS))

    def put(self, value: object) -> None:
        """Send a value that can be pickled; wait while six are in transit.

        Raises:
            EOFError, OSError: the receiver is gone.
        """
        while self._freed.poll() or not self._free:
            self._free.append(self._freed.recv())
        parts = list[pickle.PickleBuffer]()
        head = pickle.dumps(value, protocol=5, buffer_callback=parts.append)
        raws, slot = [part.raw() for part in parts], self._free.pop()
        if sum(raw.nbytes for raw in raws) > SLOT:
            head, raws = pickle.dumps(value, protocol=5), []
        at, view = slot * SLOT, np.frombuffer(self._memory, dtype=np.uint8)
        for raw in raws:
            view[at : at + raw.nbytes] = np.frombuffer(raw, dtype=np.uint8)
            at += raw.nbytes
        self._messages.send((slot, [(raw.nbytes, raw.readonly) for raw in raws], head))


class Receiver:
    """The receiving end of a way between processes; values keep their order."""

    def __init__(self, memory: Any, messages: Connection, freed: Connection) -> None:
        self._memory, self._messages, self._freed = memory, messages, freed

    def get(self) -> Any:
        """Wait for the next value and return it; its arrays share no memory.

        Raises:
            EOFError: the sender is gone.
        """
        slot, forms, head = self._messages.recv()
        at, view = slot * SLOT, np.frombuffer(self._memory, dtype=np.uint8)
        parts = list[bytearray | memoryview]()
        for size, readonly in forms:
            copy = bytearray(view[at : at + size].data)
            parts.append(memoryview(copy).toreadonly() if readonly else copy)
            at += size
        with suppress(OSError):  # the sender has ended; its last values are still valid
            self._freed.send(slot)
        return pickle.loads(head, buffers=parts)


def way() -> tuple[Sender, Receiver]:
    """Return the two ends of a way between processes; either can be an argument of a new process."""
    context = get_context("spawn")
    memory = context.RawArray("B", SLOTS * SLOT)
    taken, messages = context.Pipe(duplex=False)
    freed, frees = context.Pipe(duplex=False)
    return Sender(memory, messages, freed), Receiver(memory, taken, frees)


@contextmanager
def deaf() -> Generator[None]:
    """Block Ctrl-C in this thread during the block; processes and threads started inside keep it blocked."""
    resource_tracker.ensure_running()  # it lets signals through when it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which they keep
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def background_process(name: str, target: Callable[..., None], *arguments: object) -> Generator[BaseProcess]:
    """Run a function in another process, which ignores Ctrl-C and ends with the block.

    Args:
        name: name in the list of processes.
        target: the function, importable.
        arguments: arguments of the function; connections and ends of ways among them are closed in this process.
    """
    process = get_context("spawn").Process(target=target, args=arguments, name=f"palpate {name}", daemon=True)
    with deaf():
        process.start()
    for end in arguments:
        for handle in vars(end).values() if isinstance(end, Sender | Receiver) else (end,):
            if isinstance(handle, Connection):  # so that the process notices when the other end is gone
                handle.close()
    try:
        yield process
    finally:
        if process.is_alive():
            process.terminate()
        process.join()


def sendable(problem: Exception) -> Exception:
    """Return the exception, or a RuntimeError with its text if it cannot be pickled."""
    try:
        return pickle.loads(pickle.dumps(problem))
    except Exception:  # of others' classes of errors, which may do anything
        return RuntimeError(f"{type(problem).__name__}: {problem}")


@dataclass(frozen=True)
class _Read:
    """A block, None at the end, and the progress of the reader; `failed` is the error that ended it."""

    block: Recording | None
    position: int
    torn: str
    notes: tuple[str, ...]
    motion: Motion | None
    failed: Exception | None = None


class MotionAhead(Motion):
    """The motion of a sensor whose log is prefetched: the reader's process adds the accelerations to the blocks.

    Attributes:
        met: the motion that the reader begins with, then the reader's as of the last block.
    """

    def __init__(self, met: Motion) -> None:
        super().__init__()
        self.met = met

    def stream(self, blocks: Iterator[Recording]) -> Iterator[Recording]:
        """Return the blocks as they are."""
        return blocks

    def notes(self, mass: float | None = None) -> tuple[str, ...]:
        """Return notes on the reader's motion, one sentence each; in newtons with a `mass` [kg]."""
        return self.met.notes(mass)


class LogReader:
    """A process that reads one log, started by `reading_in_process`."""

    def __init__(self, receiver: Receiver, told: Connection) -> None:
        self._receiver, self._told = receiver, told

    def blocks(self, path: Path, motion: Motion | None) -> Iterator[_Read]:
        """Start the reader and yield what it reads, to the log's end; `motion`, unless None, adds accelerations.

        Each item has `block` (None at the end), `position` [bytes], `torn`, `notes`, `motion`, and `failed`, the
        exception that ended it or None.

        Raises:
            InputError: the process was ended.
        """
        try:
            self._told.send(motion)
            while True:
                yield self._receiver.get()
        except (EOFError, OSError) as problem:
            what = "the process that reads this log ended early: too little memory, or a crash in a library."
            hint = "Free memory and run it again, or convert the log to Parquet."
            raise InputError(what, where=str(path), hint=hint) from problem


@contextmanager
def reading_in_process(path: Path, layout: LogLayout) -> Generator[LogReader]:
    """Start a process that opens a log, and reads it once `blocks` of the `LogReader` is called."""
    sender, receiver = way()
    told, tells = get_context("spawn").Pipe(duplex=False)
    with background_process("reader", _read, sender, told, path, layout):
        yield LogReader(receiver, tells)


class PrefetchedLog(Log):
    """A log whose blocks, the same as the log's own, another process reads in advance.

    Args:
        log: the log, opened in this process.
        reader: the process that reads the same log.
        ahead: the sensor's motion in this process; None: no accelerations are added.
    """

    def __init__(self, log: Log, reader: LogReader, ahead: MotionAhead | None = None) -> None:
        super().__init__(log.path, log.size)
        self._log, self._reader, self._ahead = log, reader, ahead
        self._notes: tuple[str, ...] = ()

    def contents(self) -> LogContents:
        """Return the contents of the log, read in this process.

        Raises:
            InputError: the log cannot be read.
        """
        return self._log.contents()

    def notes(self) -> tuple[str, ...]:
        """Return notes on the blocks read so far, one sentence each."""
        return self._notes

    def blocks(self) -> Iterator[Recording]:
        """Yield the blocks of the log, once; raise what the reader's process raised.

        Raises:
            InputError: the log cannot be read on or lacks something that is requested, or the process was ended.
        """
        for read in self._reader.blocks(self.path, None if self._ahead is None else self._ahead.met):
            self.position, self.torn, self._notes = read.position, read.torn, read.notes
            if self._ahead is not None and read.motion is not None:
                self._ahead.met = read.motion
            if read.failed is not None:
                raise read.failed
            if read.block is None:
                return
            yield read.block


def _read(sender: Sender, told: Connection, path: Path, layout: LogLayout) -> None:
    """Read a log and send its blocks, in a process; begin when `told` receives the motion."""
    keep_memory()
    log = open_log(path, layout)
    try:
        motion: Motion | None = told.recv()
    except EOFError:  # the receiver is gone
        return
    failed = None
    try:
        for block in log.blocks() if motion is None else motion.stream(log.blocks()):
            sender.put(_Read(block, log.position, log.torn, log.notes(), motion))
    except (EOFError, BrokenPipeError):  # the receiver is gone
        return
    except Exception as problem:  # raised in the process that uses the blocks
        failed = sendable(problem)
    with suppress(EOFError, OSError):
        sender.put(_Read(None, log.position, log.torn, log.notes(), motion, failed))
