"""One log into one file of contacts with OUTPUT.toml beside it: what `palpate estimate` and `palpate batch` do."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from palpate.cli.interrupts import uninterrupted
from palpate.io.contacts import ContactsWriter, open_contacts
from palpate.io.models import provenance, write_provenance
from palpate.io.pipeline import OpenedLog, Pipeline
from palpate.viewer.run_summary import RunSummary

__all__ = ["Estimated", "estimate_log", "record_of"]

Watch = Callable[[int, float], None]
"""Is told of samples done, and of the share of the file that was read."""


@dataclass(frozen=True)
class Estimated:
    """A log that is done.

    Attributes:
        pipeline: that it went through.
        summary: of its contacts.
        record: what stands in OUTPUT.toml.
        ended: "whole"; "torn": the log is cut off; "interrupted": by Ctrl-C.
        doubts: what may be wrong.
        short: why not all of the log is in the output, one sentence each.
        nothing: why nothing in it can be believed; "": something can.
    """

    pipeline: Pipeline
    summary: RunSummary
    record: dict[str, str]
    ended: str
    doubts: list[str]
    short: list[str]
    nothing: str


class _Stopped(Exception):
    """Ctrl-C where a file that is not whole must not take its name."""


def record_of(output: Path) -> Path:
    """OUTPUT.toml."""
    return output.with_name(f"{output.name}.toml") if output.name else output


def estimate_log(
    opened: OpenedLog,
    output: Path,
    frame: str,
    files: Mapping[str, Path | None],
    watch: Watch,
    *,
    keep_short: bool = True,
) -> Estimated:
    """Every sample of a log into contacts.

    Args:
        opened: the log.
        output: of contacts; OUTPUT.toml is written when it stands.
        frame: of the result.
        files: what it is made from, for OUTPUT.toml: what each is -> where.
        watch: is told how far it is.
        keep_short: after Ctrl-C the contacts found so far take the name of OUTPUT; otherwise they stay OUTPUT.part.

    Raises:
        InputError: the log or a file of the rig cannot be used.
        KeyboardInterrupt: there is no row yet, or it is not to be kept.
    """
    pipeline, summary = Pipeline.of(opened, frame), RunSummary()
    pipeline.seconds["write"] = 0.0
    try:
        with ExitStack() as stack:
            features = pipeline.estimator.features
            writer = stack.enter_context(open_contacts(output, frame_id=frame, features=features))
            interrupted = _interrupted(pipeline, writer, summary, watch)
            if interrupted and not keep_short:
                raise _Stopped
            with uninterrupted():  # a second Ctrl-C waits until the file is whole
                stack.close()
    except _Stopped:
        raise KeyboardInterrupt from None
    ended = "interrupted" if interrupted else "torn" if opened.torn else "whole"
    options = {**pipeline.facts, "frame": frame, "sensor": opened.kind.name, "ended": ended}
    record = provenance(files, options)
    write_provenance(record_of(output), record)
    doubts, short = pipeline.doubts(), list(_short(output, opened, summary, interrupted=interrupted))
    return Estimated(pipeline, summary, record, ended, doubts, short, pipeline.unbelievable())


def _interrupted(pipeline: Pipeline, writer: ContactsWriter, summary: RunSummary, watch: Watch) -> bool:
    """Every sample of the log, block by block; whether Ctrl-C ended it. Without a row there is nothing to keep."""
    try:
        for _, found, placed in pipeline.stream():
            with uninterrupted():  # a block is written and counted, or neither
                begin = perf_counter()
                writer.write(placed)
                pipeline.seconds["write"] += perf_counter() - begin
                summary.add(found)
            watch(summary.samples, pipeline.log.position / max(pipeline.log.size, 1))
    except KeyboardInterrupt:
        if not writer.rows:
            raise
        return True
    return False


def _short(output: Path, log: OpenedLog, summary: RunSummary, *, interrupted: bool) -> Iterator[str]:
    """Why not all of the log is in the output."""
    if interrupted:
        yield f"interrupted: {output.name} holds the {summary.samples:,} samples done until then"
    if log.torn:
        yield log.torn
