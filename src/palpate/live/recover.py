"""Recover a live record from its unfinished file and the ring."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.files.atomic import PART, RING, part, writing
from palpate.files.mcap.regain import regained
from palpate.live.record import Recorder, only_one, ring_of
from palpate.live.record_file import RecordFile, grown, named, span_of
from palpate.live.stream_buffer import StreamBuffer

ALIVE = 2e9  # ns since a receiver's last sign of life, within which it counts as running
_READ = 4096  # slots at a time


def recover(output: Path) -> str:
    """Complete OUTPUT from OUTPUT.part and OUTPUT.ring, and remove the ring.

    Samples without contacts become readings alone. A complete OUTPUT stays as it is.

    Returns:
        A sentence on the numbers of samples in the record, in the ring, and missing.

    Raises:
        InputError: the record is being written, no file has that name, the ring is damaged, or the disk is full.
        OSError: the ring cannot be opened.
    """
    ring = ring_of(output)
    if ring.exists():
        with writing(output), only_one(ring):
            return _from_ring(ring, output)
    if unfinished := grown(output):
        with writing(output):
            return "; ".join(_alone(named(output, which)) for which in unfinished)
    if output.exists():
        return f"{output.name} is complete: there is nothing to recover"
    hint = "Name the file that `palpate live` recorded to."
    raise InputError("has nothing to recover.", where=str(output), hint=hint)


def cut_short(file: Path) -> str:
    """Return a sentence on the samples of an unfinished live record, in its file and ring; "" if there is no ring.

    Args:
        file: OUTPUT, OUTPUT.part or OUTPUT.ring.

    Raises:
        InputError: the ring cannot be opened, or is damaged.
        OSError: the file cannot be read.
    """
    output = file.with_suffix("") if file.suffix in (PART, RING) else file
    if output.suffix.lower() != ".mcap":
        return ""
    path, unfinished = ring_of(output), grown(output)
    if not path.exists():
        return ""
    with closing(StreamBuffer(path)) as ring:
        last = named(output, unfinished[-1]) if unfinished else None
        found = regained(part(last)) if last is not None else None
        span = span_of(found, ring["received"]) if found is not None else None
        reached = span.end if span is not None and span.samples else ring["began"]
        more, alive = max(0, ring["received"] - reached), _alive(ring)
    there = [f"{more:,} {'more' if last else 'samples'} in {path.name}"]
    if last is not None and span is not None:
        there.insert(0, f"{span.samples:,} samples in {part(last).name}")
    if alive:
        return f"it is still being written: {', '.join(there)}"
    return f"writing was interrupted: {', '.join(there)}; run `palpate recover {output}` to join them"


def _from_ring(path: Path, output: Path) -> str:
    with closing(StreamBuffer(path)) as ring:
        if _alive(ring):
            hint = "End `palpate live`, or wait two seconds after it was killed."
            raise InputError("is still being written.", where=str(output), hint=hint)
        recorder = Recorder(ring, output, np.inf)
        began = recorder.next
        unsound = _cut_unsound(ring, began)
        recorder.finish()
        if recorder.full:
            said, _ = ring.events(ring["said"] - 1)
            raise InputError(f"{said[-1][1]}.", where=str(output), hint="Free disk space, and run the command again.")
        received, answered, missed = ring["received"], ring["answered"], ring["missed"]
    path.unlink()
    more = max(0, received - began)
    bare = max(0, received - max(answered, began))
    without = f" ({bare:,} of them without contacts)" if bare else ""
    missing = f"{missed:,} are missing, because the disk was too slow" if missed else "none is missing"
    if unsound:
        missing += f"; {unsound:,} in the ring were damaged, as by a loss of power, and are left out"
    return (
        f"{output.name}: {began - missed:,} samples were recorded, {more:,} more were in the ring{without}; {missing}"
    )


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
    file = RecordFile(path, None, 0)
    file.end()
    file.place()
    return f"{path.name}: {file.span.samples:,} samples were recorded; there is no ring file with more samples"


def _alive(ring: StreamBuffer) -> bool:
    return time.time_ns() - ring["alive"] < ALIVE
