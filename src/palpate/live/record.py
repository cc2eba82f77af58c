"""Record a ring as MCAP files, each of which can be opened without the others.

After a kill, a new recorder continues where the file ends, if the ring still has the samples after it.
"""

from __future__ import annotations

import fcntl
import os
import signal
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from palpate.errors import InputError
from palpate.files.atomic import RING, part, writing
from palpate.live.record_file import RecordFile, grown, named, place
from palpate.live.record_messages import RecordMessages, event, record_topics
from palpate.live.stream_buffer import READERS, StreamBuffer

POLL = 0.02  # s between looks at the ring
SPAN = 0.25  # s of a chunk: a loss of power may cost so much beyond the last sync
CHUNK = 2048  # samples of a chunk, at most
BYTES = 1 << 23  # of slots of a chunk, at most
SYNC = 1.0  # s between syncs
QUIET, SILENT = 0.3, 1.5  # s without a change after which a ring has ended, with all answered or not
GRACE = 5.0  # s to wait for that, at most


def ring_of(output: Path) -> Path:
    """Return the path of the ring of a record: OUTPUT.ring.

    Raises:
        InputError: the path cannot be resolved, such as links in a circle.
    """
    return part(output).with_suffix(RING)


def require_record(output: Path) -> None:
    """Check that a record can begin.

    Raises:
        InputError: the name does not end in .mcap, an earlier run was cut short, or OUTPUT belongs to an earlier record
            of several files.
    """
    if output.suffix.lower() != ".mcap":
        raise InputError(f"a record cannot end in {output.suffix!r}.", where=str(output), hint="Use .mcap.")
    if ring_of(output).exists() or grown(output):
        hint = f"Run `palpate recover {output}` to save it, then start the new one again."
        raise InputError("an earlier recording was interrupted.", where=str(output), hint=hint)
    if named(output, 1).exists():
        hint = "Remove all files of that record, or name another output."
        what = f"belongs to an earlier record of several files: {named(output, 1)} exists."
        raise InputError(what, where=str(output), hint=hint)


def record(ring: Path, output: Path, split: float, parent: int) -> None:
    """Record a ring until it says stop, or the parent is gone and no more samples come; the target of a process.

    Args:
        ring: file of the ring.
        output: MCAP file, which grows as OUTPUT.part.
        split: bytes after which another file is begun: run.1.mcap, run.2.mcap, ...
        parent: id of the parent process.

    Raises:
        InputError: the ring cannot be opened.
        SystemExit: with 1, if another process writes the record or OUTPUT.part is another file; the ring stores why.
        OSError: the ring cannot be opened.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C and says stop
    opened = StreamBuffer(ring)
    try:
        with only_one(ring), writing(output):
            recorder, quiet = Recorder(opened, output, split), _Quiet(opened)
            while opened["stop"] < READERS and not (os.getppid() != parent and quiet.ended()):
                recorder.step()
                time.sleep(POLL)
            recorder.finish()
    except InputError as problem:
        opened["recording"] = 0
        opened.say(f"recording has stopped: {problem}")
        raise SystemExit(1) from problem


@contextmanager
def only_one(ring: Path) -> Generator[None]:
    """Lock a ring, so that only this process writes its record, until the block or the process ends.

    Raises:
        InputError: another process has the lock.
        OSError: the ring cannot be opened.
    """
    with ring.open("rb") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as problem:
            what, hint = "another process already writes its record.", "Stop that one, or name another output."
            raise InputError(what, where=str(ring), hint=hint) from problem
        yield


class Recorder:
    """A writer of a ring's samples to files, which continues the file of a recorder that was killed.

    Args:
        ring: the ring, which no other recorder reads.
        output: path of the first file.
        split: bytes after which another file is begun.

    Attributes:
        next: number of the next sample to write.
        file: the file that grows; None before there is something to write, and once the disk is full.
        full: whether recording has ended, because a file could not be written.

    Raises:
        InputError: the file to continue is no record, or has other topics.
        OSError: the file to continue cannot be opened.
    """

    # Numbers in the ring's head let another recorder continue after a kill at any point: the current file has the index
    # "file", and begins with sample "began" after "noted" sentences in earlier files; "recorded" is the next sample,
    # "missed" the number of samples in no file, "bytes" the size of all files.
    def __init__(self, ring: StreamBuffer, output: Path, split: float) -> None:
        self._ring, self._output, self._split = ring, output, split
        self._topics, self._messages = record_topics(ring.form), RecordMessages(ring.form)
        slot = ring.form.slot().itemsize
        self._most = max(1, min(CHUNK, BYTES // slot))
        self.file: RecordFile | None = None
        self.full = False
        self._written = self._synced = time.monotonic()
        which = ring["file"]
        if which and part(named(output, which - 1)).exists():
            place(named(output, which - 1))  # it was ended, and killed before it had its name
        self._before = sum(_size(named(output, each)) for each in range(which))  # bytes of files that are whole
        self.next, self._noted = ring["began"], ring["noted"]  # where there is no sample or sentence in the file
        if part(named(output, which)).exists():
            self._opened()

    def step(self) -> None:
        """Write sentences, and answered samples that fill a chunk or have waited for 0.25 s; sync once a second.

        Raises:
            InputError: OUTPUT.part is another file.
        """
        ring, now = self._ring, time.monotonic()
        waiting = self._until() - self.next
        if waiting >= self._most or (waiting and now - self._written >= SPAN):
            self._written = now
            self._samples(self._until())
        if ring["said"] > self._noted:
            self._sentences()
        if now - self._synced >= SYNC and self.file is not None:
            self._synced = now
            with self._guarded():
                self.file.sync()

    def finish(self) -> None:
        """Write everything that was received, and end and rename the file.

        Raises:
            InputError: OUTPUT.part is another file.
        """
        self._samples(self._ring["received"])
        self._sentences()
        with self._guarded():
            if self.file is None and not self._ring["file"] and not self.full:
                self._opened()  # a record without a sample still has a file
            if self.file is not None:
                self._end(self.file)

    def _until(self) -> int:
        """Return the number after the last sample to write: answered, or soon overwritten in the ring."""
        ring = self._ring
        return max(ring["answered"], ring["received"] - len(ring.slots) // 2)

    def _samples(self, end: int) -> None:
        ring = self._ring
        while self.next < end and not self.full:
            slots, first = ring.read(self.next, min(self._most, end - self.next), "received")
            if lost := first - self.next:
                ring["missed"] += lost
                ring.say(f"{lost} samples from sample {self.next} on are not recorded, because the disk was too slow")
            self.next = first
            if len(slots):
                with self._guarded():
                    self._opened().append(*self._messages.of(slots, first))
                    self.next = first + len(slots)
                self._grown()
        if self.full:
            self.next = end

    def _sentences(self) -> None:
        said, end = self._ring.events(self._noted)
        for number, (stamp, text) in enumerate(said, end - len(said) + 1):
            if not self.full:
                with self._guarded():
                    raw, view = event(stamp, text, number)
                    self._opened().append(raw, [view])
        self._noted = end
        self._grown()

    def _opened(self) -> RecordFile:
        """Return the current file; begin or continue it if it is not open."""
        if self.file is None:
            ring = self._ring
            self.file = RecordFile(named(self._output, ring["file"]), self._topics, ring["received"])
            self.next = max(self.next, self.file.span.end)
            self._noted = max(self._noted, self.file.span.noted)
        return self.file

    def _grown(self) -> None:
        """Store the progress in the ring, and end the file if it is large enough to be split."""
        ring = self._ring
        if self.full:
            return
        ring["recorded"] = self.next
        if self.file is not None:
            ring["bytes"] = self._before + self.file.size
            if self.file.size >= self._split:
                with self._guarded():
                    self._end(self.file)

    def _end(self, file: RecordFile) -> None:
        """End a file and give it its name."""
        ring = self._ring
        self.next -= file.end()
        ring["recorded"] = ring["began"] = self.next
        ring["noted"] = self._noted
        ring["file"] += 1  # if killed from here on, the next recorder renames the file
        self.file = None
        file.place()
        self._before += _size(file.path)
        ring["bytes"] = self._before

    @contextmanager
    def _guarded(self) -> Generator[None]:
        """End the record at an OSError in the block, such as a full disk."""
        try:
            yield
        except OSError as problem:
            self._give_up(problem)

    def _give_up(self, problem: OSError) -> None:
        self.full, self._ring["recording"], file = True, 0, self.file
        where = named(self._output, self._ring["file"]).name
        if file is not None:
            try:
                self._end(file)
            except OSError:  # not even that: it stays OUTPUT.part, for `palpate recover`
                file.close()
                self.file = None
        kept = f"the {self.next:,} samples before it are kept"
        self._ring.say(f"recording has stopped: {where} cannot be written ({problem.strerror}); {kept}")


class _Quiet:
    def __init__(self, ring: StreamBuffer) -> None:
        self._ring, self._state = ring, (0, 0, 0)
        self._began = self._changed = 0.0

    def ended(self) -> bool:
        """Return whether the ring has not changed for long enough."""
        ring, now = self._ring, time.monotonic()
        state = ring["received"], ring["answered"], ring["alive"]
        self._began = self._began or now
        if state != self._state:
            self._state, self._changed = state, now
        still = now - self._changed
        return still > (QUIET if state[0] == state[1] else SILENT) or now - self._began > GRACE


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
