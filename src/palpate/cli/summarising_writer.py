"""Write and summarise contacts block by block, in this process or in a second one."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, Protocol, runtime_checkable

from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.files.contacts import ContactsWriter, open_contacts
from palpate.files.memory import keep_memory
from palpate.files.output_lock import inherited
from palpate.setup.prefetch import Receiver, Sender, background_process, sendable, way
from palpate.viewer.run_summary import RunSummary

__all__ = ["SummedWriter", "WriterProcess", "writer_process", "writing_here", "writing_in_process"]

_END, _ABANDON = "end", "abandon"


@runtime_checkable
class SummedWriter(Protocol):
    """A writer that also summarises its blocks.

    Attributes:
        rows: number of rows written so far.
        summary: summary of all blocks, once the file is complete.
        seconds: time spent on writing, likewise.
    """

    rows: int
    summary: RunSummary
    seconds: float

    def write(self, found: Contacts, placed: Contacts) -> None:
        """Write a block: summarise `found`, in the surface's frame, and write `placed`, in that of the file."""
        ...


class _Here:
    def __init__(self, writer: ContactsWriter | None) -> None:
        self._writer, self.summary, self.seconds, self.rows = writer, RunSummary(), 0.0, 0

    def write(self, found: Contacts, placed: Contacts) -> None:
        begin = perf_counter()
        if self._writer is not None:
            self._writer.write(placed)
        self.seconds += perf_counter() - begin
        self.summary.add(found)
        self.rows += len(placed)


@contextmanager
def writing_here(output: Path | None, frame: str, features: tuple[str, ...]) -> Generator[SummedWriter]:
    """Give a `SummedWriter` that writes in this process; without an output it only summarises.

    Args:
        output: file, as for `palpate.files.contacts.open_contacts`, or None.
        frame: coordinate frame of the contacts in it.
        features: names of the columns that the sensor adds.

    Raises:
        InputError: the suffix is unknown, or the file cannot be written.
    """
    if output is None:
        yield _Here(None)
        return
    with open_contacts(output, frame_id=frame, features=features) as writer:
        yield _Here(writer)


class WriterProcess(NamedTuple):
    """A process that writes one file, made by `writer_process`, with the ways to send it blocks and get its answer."""

    process: BaseProcess
    sender: Sender
    answer: Connection


@contextmanager
def writer_process() -> Generator[WriterProcess]:
    """Start a `WriterProcess`, which writes once `writing_in_process` sends it blocks: it takes a second to start."""
    sender, receiver = way()
    answer, answers = get_context("spawn").Pipe(duplex=False)
    with background_process("writer", _write, receiver, answers) as process:
        yield WriterProcess(process, sender, answer)


class _Beside:
    def __init__(self, process: WriterProcess, output: Path) -> None:
        self._process, self._output = process, output
        self.summary, self.seconds, self.rows = RunSummary(), 0.0, 0

    def write(self, found: Contacts, placed: Contacts) -> None:
        self.put((found, None if placed is found else placed))
        self.rows += len(placed)

    def put(self, value: object) -> None:
        """Send a value to the writer; where the writer has failed, raise its error."""
        try:
            self._process.sender.put(value)
        except (EOFError, OSError):
            self.end()
            raise

    def end(self) -> None:
        """Receive the writer's answer.

        Raises:
            InputError: the file cannot be written, or the process was ended.
        """
        try:
            answer: Any = self._process.answer.recv()
        except (EOFError, OSError) as problem:
            raise InputError(
                "the process that wrote it ended early; run the command again.", where=str(self._output)
            ) from problem
        if isinstance(answer, Exception):
            raise answer
        self.summary, self.seconds = answer


@contextmanager
def writing_in_process(
    process: WriterProcess, output: Path, frame: str, features: tuple[str, ...]
) -> Generator[SummedWriter]:
    """Give a `SummedWriter` that writes as that of `writing_here`, in another process.

    Raises:
        InputError: the suffix is unknown, the file cannot be written, or the process was ended.
    """
    writer = _Beside(process, output)
    writer.put((output, frame, features))
    try:
        yield writer
    except BaseException:
        with suppress(EOFError, OSError):
            process.sender.put(_ABANDON)
            process.process.join()  # what was done stays OUTPUT.part
        raise
    writer.put(_END)
    writer.end()


def _write(receiver: Receiver, answers: Connection) -> None:
    """Run the process that writes."""
    keep_memory()
    try:
        if isinstance(opening := _next(receiver), str):
            return
        made: AbstractContextManager[SummedWriter] = writing_here(*opening)
        with inherited(opening[0].resolve()), made as writer:
            while not isinstance(value := _next(receiver), str):
                found, placed = value
                writer.write(found, found if placed is None else placed)
            if value == _ABANDON:
                raise _Abandoned
        answers.send((writer.summary, writer.seconds))
    except _Abandoned:
        return
    except Exception as problem:  # raised where it is written from
        answers.send(sendable(problem))


class _Abandoned(Exception):
    """The file must not be finished."""


def _next(receiver: Receiver) -> Any:
    """Return the next block or command; where the sender was killed, the command to abandon the file."""
    try:
        return receiver.get()
    except EOFError:
        return _ABANDON
