"""Estimate one log into one file of contacts and OUTPUT.toml, for `palpate estimate` and `palpate batch`."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sized
from concurrent.futures import Future
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from time import perf_counter
from typing import NamedTuple

from palpate.cli.summarising_writer import ProcessWriter, SummedWriter, writer_process, writing_here
from palpate.contact.contacts import Contacts
from palpate.files.models import provenance, write_provenance
from palpate.interrupts import uninterrupted
from palpate.processes import keep_memory
from palpate.setup.pipeline import OpenedLog, Pipeline
from palpate.setup.prefetch import LogReader
from palpate.viewer.run_summary import RunSummary

TORN, INTERRUPTED = 3, 130  # exit codes: what was requested is done of a log that was cut off, or up to Ctrl-C
Watch = Callable[[int, float], None]
"""Called with the number of samples done, and the share (0 to 1) of the file that was read."""


@dataclass(frozen=True)
class Estimated:
    """The result of estimating a log.

    Attributes:
        pipeline: pipeline that the log went through.
        summary: summary of its contacts.
        record: contents of OUTPUT.toml.
        ended: "whole"; "torn": the log is cut off; "interrupted": by Ctrl-C.
        warnings: what may be wrong, one sentence each.
        short: why not all of the log is in the output, one sentence each.
        nothing: why nothing in it can be believed; "": something can.
        took: duration of estimating [s].
    """

    pipeline: Pipeline
    summary: RunSummary
    record: dict[str, str]
    ended: str
    warnings: list[str]
    short: list[str]
    nothing: str
    took: float


class _Stopped(Exception):
    """Ctrl-C was pressed; the incomplete file must not take its name."""


def record_of(output: Path) -> Path:
    """Return the path of OUTPUT.toml, which records how OUTPUT was made; without a file name, `output` itself."""
    return output.with_name(f"{output.name}.toml") if output.name else output


def estimate_log(
    opened: OpenedLog,
    output: Path | None,
    frame: str,
    files: Mapping[str, Path | None],
    watch: Watch,
    *,
    keep_short: bool = True,
    workers: int = 1,
) -> Estimated:
    """Estimate every sample of a log, write the contacts, and return an `Estimated`.

    Args:
        opened: the log.
        output: file of contacts; OUTPUT.toml follows when it is complete. None: contacts are only summarised.
        frame: coordinate frame of the result.
        files: role -> input file, for OUTPUT.toml.
        watch: called after every block.
        keep_short: after Ctrl-C the contacts found so far take the name of OUTPUT; False: they stay OUTPUT.part.
        workers: if more than one, that many threads locate, a process reads and one writes, with identical results.

    Raises:
        InputError: the log or a file of the rig cannot be used, or the output cannot be written.
        OSError: an input file cannot be read for its digest.
        KeyboardInterrupt: Ctrl-C before the first row, or without `keep_short`.
        GeometryError: the mesh has no usable surface.
    """
    keep_memory()
    with ExitStack() as stack:
        parallel = stack.enter_context(_start(opened, files)) if workers > 1 and output is not None else None
        pipeline = Pipeline.of(opened, frame)
        features = pipeline.estimator.features
        begin = perf_counter()
        if parallel is None or output is None:
            writing = writing_here(output, frame, features)
        else:
            opened.prefetch(parallel.reader, pipeline.estimator, workers)
            writing = parallel.writer.writing(output, frame, features)

        def made_from(*, interrupted: bool) -> dict[str, str]:
            ended = ending(interrupted=interrupted, torn=bool(opened.torn))
            options = {**pipeline.settings, "frame": frame, "sensor": opened.kind.name, "ended": ended}
            inputs = provenance(files, {}) if parallel is None else parallel.inputs.result()
            return inputs | provenance({}, options)

        writer, record = write_blocks(
            pipeline.stream(), lambda: opened.share, writing, watch, output, made_from, keep_short=keep_short
        )
    summary, ended = writer.summary, record["ended"]
    pipeline.seconds["write"] = writer.seconds
    warnings, short = pipeline.warnings(), [opened.torn] if opened.torn else []
    if ended == "interrupted":
        holds = "this covers" if output is None else f"{output.name} holds"
        short.insert(0, f"interrupted: {holds} the {summary.samples:,} samples done until then")
    took = perf_counter() - begin
    return Estimated(pipeline, summary, record, ended, warnings, short, pipeline.unbelievable(), took)


class _Parallel(NamedTuple):
    """Processes that read and write, and the digests of the inputs."""

    reader: LogReader
    writer: ProcessWriter
    inputs: Future[dict[str, str]]


@contextmanager
def _start(opened: OpenedLog, files: Mapping[str, Path | None]) -> Generator[_Parallel]:
    """Start reader, writer and hashing, while the rest is prepared."""
    inputs: Future[dict[str, str]] = Future()

    def hashed() -> None:
        try:
            inputs.set_result(provenance(files, {}))
        except Exception as problem:  # raised where it is used
            inputs.set_exception(problem)

    with opened.prefetching() as reader, writer_process() as writer:
        Thread(target=hashed, daemon=True).start()  # nobody waits for it when the command is ended
        yield _Parallel(reader, writer, inputs)


def ending(*, interrupted: bool, torn: bool) -> str:
    """Return how an estimate ended, as its record states it: "interrupted", "torn" (the log is cut off) or "whole"."""
    return "interrupted" if interrupted else "torn" if torn else "whole"


def write_blocks(
    blocks: Iterator[tuple[Sized, Contacts, Contacts]],
    share: Callable[[], float],
    writing: AbstractContextManager[SummedWriter],
    watch: Watch,
    output: Path | None,
    made_from: Callable[..., dict[str, str]],
    *,
    keep_short: bool = True,
) -> tuple[SummedWriter, dict[str, str]]:
    """Write OUTPUT and OUTPUT.toml: both, or after a further Ctrl-C neither; return the writer and the record.

    Args:
        blocks: samples, their contacts to summarise, and those to write.
        share: returns the share (0 to 1) of the log that was read.
        writing: context of the writer of OUTPUT.
        watch: called after every block.
        output: OUTPUT; None: contacts are only summarised.
        made_from: returns the contents of OUTPUT.toml, with `interrupted` that says whether Ctrl-C ended it.
        keep_short: after Ctrl-C the contacts so far take the name of OUTPUT; False: they stay OUTPUT.part.

    Raises:
        InputError: the log cannot be read on, or the output cannot be written.
        KeyboardInterrupt: Ctrl-C before the first row, or without `keep_short`.
    """
    try:
        with ExitStack() as stack:
            writer = stack.enter_context(writing)
            try:
                interrupted = _interrupted(blocks, share, writer, watch)
                if interrupted and not keep_short:
                    raise _Stopped
                record = made_from(interrupted=interrupted)
            except KeyboardInterrupt:
                raise _Stopped from None
            with uninterrupted():
                stack.close()
                if output is not None:
                    write_provenance(record_of(output), record)
    except _Stopped:
        raise KeyboardInterrupt from None
    return writer, record


def _interrupted(
    blocks: Iterator[tuple[Sized, Contacts, Contacts]], share: Callable[[], float], writer: SummedWriter, watch: Watch
) -> bool:
    """Write all blocks; return whether Ctrl-C ended it, and raise it if there is no row yet."""
    samples = 0
    try:
        for block, found, placed in blocks:
            with uninterrupted():  # a block is written and counted, or neither
                writer.write(found, placed)
            samples += len(block)
            watch(samples, share())
    except KeyboardInterrupt:
        if not writer.rows:
            raise
        return True
    return False
