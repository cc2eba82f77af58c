"""Recover a live record from its unfinished file and the ring, or the rings of a robot's sensors."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.files.atomic import PART, RING, part, writing
from palpate.files.mcap.regain import regained
from palpate.files.output_lock import only_writer
from palpate.live.record import Recorder, only_one, rings_of
from palpate.live.record_file import RecordFile, grown, named, span_of
from palpate.live.stream_buffer import StreamBuffer

ALIVE = 2e9  # ns since a receiver's last sign of life, within which it counts as running
_READ = 4096  # slots at a time


def recover(output: Path) -> str:
    """Complete OUTPUT from OUTPUT.part and OUTPUT.ring, and remove the ring; of a robot, all OUTPUT.SENSOR.ring.

    Samples without contacts become readings alone. A complete OUTPUT stays as it is.

    Returns:
        A sentence on the numbers of samples in the record, in the ring, and missing.

    Raises:
        InputError: the record is being written, no file has that name, the ring is damaged, or the disk is full.
        OSError: the ring cannot be opened.
    """
    rings = rings_of(output)
    if rings:
        with writing(output), only_one(rings[0]), only_writer(output.resolve()):
            return _from_rings(rings, output)
    if unfinished := grown(output):
        with writing(output), only_writer(output.resolve()):
            return "; ".join(_alone(named(output, which)) for which in unfinished)
    if output.exists():
        return f"{output.name} is complete: there is nothing to recover"
    hint = "Name the file that `palpate live` recorded to."
    raise InputError("has nothing to recover.", where=str(output), hint=hint)


def cut_short(file: Path) -> str:
    """Return a sentence on the samples of an unfinished live record, in its file and ring; "" if there is no ring.

    Args:
        file: OUTPUT, OUTPUT.part or a ring.

    Raises:
        InputError: the ring cannot be opened, or is damaged.
        OSError: the file cannot be read.
    """
    output = file.with_suffix("") if file.suffix in (PART, RING) else file
    if file.suffix == RING and output.suffix.lower() != ".mcap":
        output = output.with_suffix("")  # OUTPUT.SENSOR.ring
    if output.suffix.lower() != ".mcap":
        return ""
    paths, unfinished = rings_of(output), grown(output)
    if not paths:
        return ""
    last = named(output, unfinished[-1]) if unfinished else None
    found = regained(part(last)) if last is not None else None
    more, samples, alive = 0, 0, False
    for k, path in enumerate(paths):
        with closing(StreamBuffer(path)) as ring:
            span = span_of(found, ring["received"], k) if found is not None else None
            reached = span.end if span is not None and span.samples else ring["began"]
            more, samples = more + max(0, ring["received"] - reached), samples + (span.samples if span else 0)
            alive |= _alive(ring)
    there = [f"{more:,} {'more' if last else 'samples'} in {_called(paths)}"]
    if last is not None and found is not None:
        there.insert(0, f"{samples:,} samples in {part(last).name}")
    if alive:
        return f"it is still being written: {', '.join(there)}"
    return f"writing was interrupted: {', '.join(there)}; run `palpate recover {output}` to join them"


def _called(rings: Sequence[Path]) -> str:
    return rings[0].name if len(rings) == 1 else f"{len(rings)} rings"


def _from_rings(paths: Sequence[Path], output: Path) -> str:
    with ExitStack() as stack:
        rings = [stack.enter_context(closing(StreamBuffer(path))) for path in paths]
        if any(map(_alive, rings)):
            hint = "End `palpate live`, or wait two seconds after it was killed."
            raise InputError("is still being written.", where=str(output), hint=hint)
        recorder = Recorder(rings, output, np.inf)
        starts = recorder.starts()
        recorded = sum(starts) - sum(ring["missed"] for ring in rings)
        unsound = sum(map(_cut_unsound, rings, starts))
        recorder.finish()
        if recorder.full:
            said, _ = rings[0].events(rings[0]["said"] - 1)
            raise InputError(f"{said[-1][1]}.", where=str(output), hint="Free disk space, and run the command again.")
        missed = sum(ring["missed"] for ring in rings)
        more = sum(max(0, ring["received"] - start) for ring, start in zip(rings, starts, strict=True))
        known = [max(ring["answered"], start) for ring, start in zip(rings, starts, strict=True)]
        bare = sum(max(0, ring["received"] - end) for ring, end in zip(rings, known, strict=True))
    for path in reversed(paths):  # the first states which files are complete
        path.unlink()
    where = "the ring" if len(paths) == 1 else _called(paths)
    without = f" ({bare:,} of them without contacts)" if bare else ""
    missing = f"{missed:,} are missing, because the disk was too slow" if missed else "none is missing"
    if unsound:
        missing += f"; {unsound:,} in the ring were damaged, as by a loss of power, and are left out"
    return f"{output.name}: {recorded:,} samples were recorded, {more:,} more were in {where}{without}; {missing}"


def _cut_unsound(ring: StreamBuffer, first: int) -> int:
    """End the ring before the first slot that does not hold its sample, and return the number of samples cut off."""
    at, received = first, ring["received"]
    while at < received:
        slots, at = ring.read(at, _READ, "received")
        if len(wrong := np.flatnonzero(slots["number"] != at + 1 + np.arange(len(slots)))):
            ring["received"] = at + int(wrong[0])
            ring["answered"] = min(ring["answered"], ring["received"])
            return received - ring["received"]
        at += len(slots)
    return 0


def _alone(path: Path) -> str:
    """Complete an unfinished file without a ring, and return a sentence on its samples."""
    file = RecordFile(path, None)
    file.end()
    file.place()
    count = sum(span.samples for span in file.spans)
    return f"{path.name}: {count:,} samples were recorded; there is no ring file with more samples"


def _alive(ring: StreamBuffer) -> bool:
    return time.time_ns() - ring["alive"] < ALIVE
