"""Write and summarise contacts block by block, in this process or in a second one."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from time import perf_counter
from typing import Any

from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.files.contacts import ContactsWriter, open_contacts
from palpate.files.output_lock import inherited
from palpate.processes import keep_memory
from palpate.setup.prefetch import Receiver, Sender, background_process, sendable, way
from palpate.viewer.run_summary import RunSummary

_END, _ABANDON = "end", "abandon"


class SummedWriter:
    """Write contacts and summarise them, block by block.

    Args:
        writer: writes the file; None: contacts are only summarised.

    Attributes:
        rows: number of rows written so far.
        summary: summary of all blocks, once the file is complete.
        seconds: time spent on writing, likewise.
    """

    def __init__(self, writer: ContactsWriter | None = None) -> None:
        self._writer: ContactsWriter | None = writer
        self.summary, self.seconds, self.rows = RunSummary(), 0.0, 0

    def write(self, found: Contacts, placed: Contacts) -> None:
        """Write a block: summarise `found`, in the surface's frame, and write `placed`, in that of the file.

        Raises:
            InputError: the file cannot be written.
        """
        begin = perf_counter()
        if self._writer is not None:
            self._writer.write(placed)
        self.seconds += perf_counter() - begin
        self.summary.add(found)
        self.rows += len(placed)


@contextmanager
def writing_here(output: Path | None, frame: str, features: tuple[str, ...]) -> Generator[SummedWriter]:
    """Open a context with a `SummedWriter` that writes in this process.

    Args:
        output: file, as for `palpate.files.contacts.open_contacts`; None: contacts are only summarised.
        frame: coordinate frame of the contacts in it.
        features: names of the columns that the sensor adds.

    Raises:
        InputError: the suffix is unknown, or the file cannot be written.
    """
    if output is None:
        yield SummedWriter()
        return
    with open_contacts(output, frame_id=frame, features=features) as writer:
        yield SummedWriter(writer)


class ProcessWriter(SummedWriter):
    """A `SummedWriter` of one file in another process, made by `writer_process`.

    Args:
        process: process that writes.
        sender: sends it blocks.
        answer: receives its summary and seconds, or its error.
    """

    def __init__(self, process: BaseProcess, sender: Sender, answer: Connection) -> None:
        super().__init__()
        self._process, self._sender, self._answer, self._output = process, sender, answer, Path()

    @contextmanager
    def writing(self, output: Path, frame: str, features: tuple[str, ...]) -> Generator[SummedWriter]:
        """Open a context in which this writes to a file; arguments as for `writing_here`.

        Raises:
            InputError: the suffix is unknown, the file cannot be written, or the process was ended.
        """
        self._output = output
        self._put((output, frame, features))
        try:
            yield self
        except BaseException:
            with suppress(EOFError, OSError):
                self._sender.put(_ABANDON)
                self._process.join()  # what was done stays OUTPUT.part
            raise
        self._put(_END)
        self._receive()

    def write(self, found: Contacts, placed: Contacts) -> None:
        """Send a block to the process.

        Raises:
            InputError: the file cannot be written, or the process was ended.
        """
        self._put((found, None if placed is found else placed))
        self.rows += len(placed)

    def _put(self, value: object) -> None:
        """Send a value to the process; where it has failed, raise its error."""
        try:
            self._sender.put(value)
        except (EOFError, OSError):
            self._receive()
            raise

    def _receive(self) -> None:
        """Take over summary and seconds, or raise the error of the process."""
        try:
            answer: Any = self._answer.recv()
        except (EOFError, OSError) as problem:
            why = "the process that wrote it ended early; run the command again."
            raise InputError(why, where=str(self._output)) from problem
        if isinstance(answer, Exception):
            raise answer
        self.summary, self.seconds = answer


@contextmanager
def writer_process() -> Generator[ProcessWriter]:
    """Open a context with a `ProcessWriter`; its process takes a second to start."""
    sender, receiver = way()
    answer, answers = get_context("spawn").Pipe(duplex=False)
    with background_process("writer", _write, receiver, answers) as process:
        yield ProcessWriter(process, sender, answer)


def _write(receiver: Receiver, answers: Connection) -> None:
    """Run the process that writes."""
    keep_memory()
    try:
        if isinstance(opening := _next(receiver), str):
            return
        with inherited(opening[0].resolve()), writing_here(*opening) as writer:
            while not isinstance(value := _next(receiver), str):
                found, placed = value
                writer.write(found, found if placed is None else placed)
            if value == _ABANDON:
                raise SystemExit  # an error, so that the file does not take its name
        answers.send((writer.summary, writer.seconds))
    except Exception as problem:  # raised where it is written from
        answers.send(sendable(problem))


def _next(receiver: Receiver) -> Any:
    """Return the next block or command; if the sender was killed, `_ABANDON`."""
    try:
        return receiver.get()
    except EOFError:
        return _ABANDON
