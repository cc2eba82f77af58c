"""Record rings as MCAP files, each of which can be opened without the others.

After a kill, a new recorder continues where the file ends, if the ring still has the samples after it.
"""

from __future__ import annotations

import fcntl
import os
import signal
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from glob import escape
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.files.atomic import RING, part, writing
from palpate.live.record_file import RecordFile, Span, grown, named, place
from palpate.live.record_messages import RecordMessages, event, event_channels, record_topics
from palpate.live.stream_buffer import READERS, StreamBuffer

POLL = 0.02  # s between looks at the ring
SPAN, LONGEST = 0.25, 1.0  # s of a chunk; of several rings as many times, at most
CHUNK = 2048  # samples of a ring in a chunk, at most
BYTES = 1 << 23  # of slots of a ring in a chunk, at most
SYNC = 1.0  # s between syncs
QUIET, SILENT = 0.3, 1.5  # s without a change after which a ring has ended, with all answered or not
GRACE = 5.0  # s to wait for that, at most


def ring_of(output: Path, sensor: str = "") -> Path:
    """Return the path of the ring of a record: OUTPUT.ring, or OUTPUT.SENSOR.ring of a robot's sensor.

    Raises:
        InputError: the path cannot be resolved, such as links in a circle.
    """
    return part(output).with_suffix(f".{sensor}{RING}" if sensor else RING)


def rings_of(output: Path) -> list[Path]:
    """Return the paths of all rings of a record that are there, in the order of their names.

    Raises:
        InputError: the path cannot be resolved, such as links in a circle.
    """
    own = ring_of(output)
    return [own] if own.exists() else sorted(own.parent.glob(f"{escape(own.stem)}.*{RING}"))


def require_record(output: Path) -> None:
    """Check that a record can begin.

    Raises:
        InputError: the name does not end in .mcap, an earlier run was cut short, or OUTPUT belongs to an earlier record
            of several files.
    """
    if output.suffix.lower() != ".mcap":
        raise InputError(f"a record cannot end in {output.suffix!r}.", where=str(output), hint="Use .mcap.")
    if rings_of(output) or grown(output):
        hint = f"Run `palpate recover {output}` to save it, then start the new one again."
        raise InputError("an earlier recording was interrupted.", where=str(output), hint=hint)
    if named(output, 1).exists():
        hint = "Remove all files of that record, or name another output."
        what = f"belongs to an earlier record of several files: {named(output, 1)} exists."
        raise InputError(what, where=str(output), hint=hint)


def record(rings: Sequence[Path], output: Path, split: float, parent: int) -> None:
    """Record rings until the first says stop, or the parent is gone and no samples come; the target of a process.

    Args:
        rings: file of the ring, or those of a robot's sensors.
        output: MCAP file, which grows as OUTPUT.part.
        split: bytes after which another file is begun: run.1.mcap, run.2.mcap, ...
        parent: id of the parent process.

    Raises:
        InputError: a ring cannot be opened.
        SystemExit: with 1, if another process writes the record or OUTPUT.part is another file; the first ring stores
            why.
        OSError: a ring cannot be opened.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C and says stop
    opened = [StreamBuffer(each) for each in rings]
    try:
        with only_one(rings[0]), writing(output):
            recorder, quiet = Recorder(opened, output, split), _Quiet(opened)
            while opened[0]["stop"] < READERS and not (os.getppid() != parent and quiet.ended()):
                recorder.step()
                time.sleep(POLL)
            recorder.finish()
    except InputError as problem:
        for ring in opened:
            ring["recording"] = 0
        opened[0].say(f"recording has stopped: {problem}")
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


class _Drain:
    """The samples and sentences of one ring, on their way into the record."""

    def __init__(self, ring: StreamBuffer, events: int, features: tuple[str, ...]) -> None:
        self.ring, self._events = ring, events
        self._messages = RecordMessages(ring.form, events, features)
        self.most = max(1, min(CHUNK, BYTES // ring.form.slot().itemsize))  # samples of a chunk
        self.next, self.noted = ring["began"], ring["noted"]  # where there is no sample or sentence in the file

    @property
    def waiting(self) -> int:
        """Number of samples that can be written."""
        return self.until() - self.next

    def until(self) -> int:
        """Return the number after the last sample to write: answered, or soon overwritten in the ring."""
        return max(self.ring["answered"], self.ring["received"] - len(self.ring.slots) // 2)

    def samples(self, end: int) -> tuple[int, list[np.ndarray]]:
        """Return the number after the next samples, at most `end`, and their messages; report those that are lost."""
        slots, first = self.ring.read(self.next, min(self.most, end - self.next), "received")
        if lost := first - self.next:
            self.ring["missed"] += lost
            said = f"{lost} samples from sample {self.next} on are not recorded, because the disk was too slow"
            self.ring.say(said)
        self.next = first
        return first + len(slots), self._messages.of(slots, first)

    def sentences(self) -> Generator[np.ndarray]:
        """Yield the messages of new sentences, which count as noted from then on."""
        said, end = self.ring.events(self.noted)
        for number, (stamp, text) in enumerate(said, end - len(said) + 1):
            yield event(stamp, text, number, self._events)
        self.noted = end

    def found(self, span: Span) -> None:
        """Continue after what is in the file."""
        self.next, self.noted = max(self.next, span.end), max(self.noted, span.noted)


class Recorder:
    """A writer of the samples of rings to files, which continues the file of a recorder that was killed.

    Args:
        rings: the ring, or those of a robot's sensors, which no other recorder reads.
        output: path of the first file.
        split: bytes after which another file is begun.

    Attributes:
        file: the file that grows; None before there is something to write, and once the disk is full.
        full: whether recording has ended, because a file could not be written.

    Raises:
        InputError: the file to continue is no record, or has other topics.
        OSError: the file to continue cannot be opened.
    """

    # Numbers in the rings' heads let another recorder continue after a kill at any point: the current file has the
    # index "file" (of the first ring), and begins with sample "began" after "noted" sentences in earlier files;
    # "recorded" is the next sample, "missed" the number of samples in no file, "bytes" the size of all files.
    def __init__(self, rings: StreamBuffer | Sequence[StreamBuffer], output: Path, split: float) -> None:
        rings = [rings] if isinstance(rings, StreamBuffer) else list(rings)
        self._rings, self._ring, self._output, self._split = rings, rings[0], output, split
        features = tuple(dict.fromkeys(name for each in rings for name in each.form.columns))
        self._topics = tuple(topic for each in rings for topic in record_topics(each.form, features))
        events = event_channels(self._topics)
        self._span, self._written = min(SPAN * len(rings), LONGEST), time.monotonic()
        self._drains = [_Drain(each, channel, features) for each, channel in zip(rings, events, strict=True)]
        self.file: RecordFile | None = None
        self.full = False
        self._synced = time.monotonic()
        which = self._ring["file"]
        if which and part(named(output, which - 1)).exists():
            place(named(output, which - 1))  # it was ended, and killed before it had its name
        self._before = sum(_size(named(output, each)) for each in range(which))  # bytes of files that are whole
        if part(named(output, which)).exists():
            self._opened()

    @property
    def next(self) -> int:
        """Number of the next sample to write; of several rings, the sum."""
        return sum(self.starts())

    def starts(self) -> list[int]:
        """Return the number of the next sample to write of each ring."""
        return [drain.next for drain in self._drains]

    def step(self) -> None:
        """Write sentences, and answered samples that fill a chunk or have waited for its span; sync once a second.

        The span is 0.25 s, and up to 1 s of several rings: a loss of power may cost so much beyond the last sync.

        Raises:
            InputError: OUTPUT.part is another file.
        """
        now, waiting = time.monotonic(), [drain.waiting for drain in self._drains]
        full = any(count >= drain.most for drain, count in zip(self._drains, waiting, strict=True))
        if full or (any(waiting) and now - self._written >= self._span):
            self._samples([drain.until() for drain in self._drains])
        for drain in self._drains:
            if drain.ring["said"] > drain.noted:
                self._sentences(drain)
        if now - self._synced >= SYNC and self.file is not None:
            self._synced = now
            with self._guarded():
                self.file.sync()

    def finish(self) -> None:
        """Write everything that was received, and end and rename the file.

        Raises:
            InputError: OUTPUT.part is another file.
        """
        self._samples([drain.ring["received"] for drain in self._drains])
        for drain in self._drains:
            self._sentences(drain)
        with self._guarded():
            if self.file is None and not self._ring["file"] and not self.full:
                self._opened()  # a record without a sample still has a file
            if self.file is not None:
                self._end(self.file)

    def _samples(self, ends: Sequence[int]) -> None:
        """Write samples up to a number of each ring, in chunks of all rings: what a chunk costs is shared.

        Those of several spans, because something else delayed this process, become as many chunks: one would need as
        many times the memory.
        """
        drains, before, self._written = list(zip(self._drains, ends, strict=True)), self._written, time.monotonic()
        chunks = max(1, round((self._written - before) / self._span))
        while not self.full and (waiting := [(drain, end) for drain, end in drains if drain.next < end]):
            self._chunk([(drain, drain.next - (drain.next - end) // chunks) for drain, end in waiting])
            chunks = max(1, chunks - 1)
        for drain, end in drains if self.full else ():
            drain.next = end

    def _chunk(self, drains: Sequence[tuple[_Drain, int]]) -> None:
        taken = [(drain, *drain.samples(end)) for drain, end in drains]
        if fresh := [each for each in taken if each[1] > each[0].next]:
            with self._guarded():
                self._opened().append([each for *_, messages in fresh for each in messages])
                for drain, last, *_ in fresh:
                    drain.next = last
            self._grown()

    def _sentences(self, drain: _Drain) -> None:
        for message in drain.sentences():
            if not self.full:
                with self._guarded():
                    self._opened().append([message])
        self._grown()

    def _opened(self) -> RecordFile:
        """Return the current file; begin or continue it if it is not open."""
        if self.file is None:
            latest = [each["received"] for each in self._rings]
            self.file = RecordFile(named(self._output, self._ring["file"]), self._topics, latest)
            for drain, span in zip(self._drains, self.file.spans, strict=True):
                drain.found(span)
        return self.file

    def _grown(self) -> None:
        """Store the progress in the rings, and end the file if it is large enough to be split."""
        if self.full:
            return
        for drain in self._drains:
            drain.ring["recorded"] = drain.next
        if self.file is not None:
            self._ring["bytes"] = self._before + self.file.size
            if self.file.size >= self._split:
                with self._guarded():
                    self._end(self.file)

    def _end(self, file: RecordFile) -> None:
        """End a file and give it its name."""
        for drain, removed in zip(self._drains, file.end(), strict=True):
            drain.next -= removed
            drain.ring["recorded"] = drain.ring["began"] = drain.next
            drain.ring["noted"] = drain.noted
        self._ring["file"] += 1  # if killed from here on, the next recorder renames the file
        self.file = None
        file.place()
        self._before += _size(file.path)
        self._ring["bytes"] = self._before

    @contextmanager
    def _guarded(self) -> Generator[None]:
        """End the record at an OSError in the block, such as a full disk."""
        try:
            yield
        except OSError as problem:
            self._give_up(problem)

    def _give_up(self, problem: OSError) -> None:
        self.full, file = True, self.file
        where = named(self._output, self._ring["file"]).name
        if file is not None:
            try:
                self._end(file)
            except OSError:  # not even that: it stays OUTPUT.part, for `palpate recover`
                file.close()
                self.file = None
        for ring in self._rings:
            ring["recording"] = 0
        kept = f"the {self.next:,} samples before it are kept"
        self._ring.say(f"recording has stopped: {where} cannot be written ({problem.strerror}); {kept}")


class _Quiet:
    def __init__(self, rings: Sequence[StreamBuffer]) -> None:
        self._rings, self._state = rings, (0, 0, 0)
        self._began = self._changed = 0.0

    def ended(self) -> bool:
        """Return whether no ring has changed for long enough."""
        now, words = time.monotonic(), ("received", "answered", "alive")
        state = tuple(sum(ring[word] for ring in self._rings) for word in words)
        self._began = self._began or now
        if state != self._state:
            self._state, self._changed = state, now
        still = now - self._changed
        return still > (QUIET if state[0] == state[1] else SILENT) or now - self._began > GRACE


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
