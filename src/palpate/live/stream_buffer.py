"""The ring: a mapped file that samples and their contacts pass through, from one writer to any number of readers.

The writer never waits for a reader: a reader that is too slow is lapped, and notices. A sample is in the file as soon
as it was received ("received"), its contacts a moment later ("answered"), and the file outlives every process, so that
what was received is there after any `kill -9`; `palpate.live.record` reads it back.

The head takes 64 KiB: numbers that processes share, each of them in a cache line of its own and, but for "asked" (for
tares) and "recording", written by one process; a description as JSON; the last sentences on what happened. Behind it
stand the slots, all of one structured type.
"""

from __future__ import annotations

import fcntl
import json
import mmap
import os
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cached_property
from math import prod
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any, cast

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.files.logs.decoding import seconds
from palpate.live.source import Batch

__all__ = ["READERS", "StreamBuffer", "latencies"]

MAGIC, VERSION = b"PALPRING", 1
HEAD = 1 << 16  # bytes before the slots
LINE = 64  # bytes of a cache line
_WORDS = (
    *("version", "slots", "received", "answered", "alive", "said", "asked", "done", "stop"),
    *("recorded", "bytes", "noted", "missed", "file", "began"),  # the recorder's
    *("recording", "ended"),  # whether samples that can wait do so for the recorder; whether no more come
)
_PLACE = {word: place for place, word in enumerate(_WORDS)}
_JSON, _SAID = 4096, 24576  # where the description and the sentences begin
SENTENCES, SENTENCE = 128, 320  # kept, and bytes of each
SIZE = 1 << 26  # bytes of slots, as a rule
LEAST = 512  # slots
READERS = 2  # what "stop" says to those who read, once the writer has ended by the 1 that it was told
MARGIN = 1024  # slots: the largest batch
LATE = 60.0  # s: between two clocks, and no latency
_NONE = np.zeros((0, 0))


@dataclass(frozen=True)
class SlotForm:
    """What passes through a ring: what describes a sample and its contacts to whoever opens it.

    Attributes:
        sensor: name of the sensor's kind.
        shape: of one reading.
        images: whether readings are uint8, and no float64.
        features: columns that the sensor adds to its contacts.
        width: numbers of a row of contacts.
        max_contacts: rows of one sample.
        frame: that the contacts are in.
        rig: file that all this was made from.
        poses: whether a pose comes with each sample.
        topic: that the rig reads a log of these readings from; "": whichever there is.
        wrenches: whether readings are wrenches, and nothing else.
    """

    sensor: str
    shape: tuple[int, ...]
    images: bool
    features: tuple[str, ...]
    width: int
    max_contacts: int
    frame: str = "surface"
    rig: str = ""
    poses: bool = False
    topic: str = ""
    wrenches: bool = False

    def slot(self) -> np.dtype[np.void]:
        """Of one sample."""
        return np.dtype(
            [
                ("number", "<i8"),  # of the sample, from 1: a page of the file that was not written has another
                ("stamp", "<i8"),  # ns since 1970: its time
                ("arrived", "<i8"),  # ns since 1970 on this machine's clock
                ("ready", "<i8"),  # the same, when its contacts were known; 0: they are not
                ("lost", "<i8"),  # samples that are missing just before it
                ("rows", "<i8"),  # of `contacts`
                ("orientation", "<f8", (4,)),
                ("position", "<f8", (3,)),
                ("acceleration", "<f8", (3,)),
                ("unsteady", "<f8"),
                ("contacts", "<f8", (self.max_contacts, self.width)),
                ("values", "u1" if self.images else "<f8", self.shape),
            ],
            align=True,
        )

    def contacts(self, slots: np.ndarray) -> Contacts:
        """Of slots in order; samples without an answer have no row."""
        rows, sample, times = slots["contacts"], slots["number"] - 1, seconds(slots["stamp"])
        counts = slots["rows"] * (slots["ready"] > 0)
        if (counts == 1).all():  # as a rule
            return Contacts.of_rows(sample, times, rows[:, 0], self.features)
        which = np.repeat(np.arange(len(slots)), counts)
        place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        return Contacts.of_rows(sample[which], times[which], rows[which, place], self.features)


def latencies(slots: np.ndarray) -> Float[np.ndarray, " k"]:
    """[s] from the arrival to the contacts of each slot that is answered; none where two clocks are compared."""
    waited = 1e-9 * (slots["ready"] - slots["arrived"])[slots["ready"] > 0]
    return waited if len(waited) and 0.0 <= np.median(waited) < LATE else waited[:0]


class StreamBuffer:
    """One mapped file, opened by its writer or by a reader.

    Attributes:
        path: of the file.
        form: of what passes through it.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._talking = path, Lock()
        try:
            with path.open("r+b") as file:
                size = os.fstat(file.fileno()).st_size
                if size < HEAD or file.read(len(MAGIC)) != MAGIC:
                    raise InputError("is no ring of `palpate live`.", where=str(path))
                self._map = mmap.mmap(file.fileno(), 0)
        except OSError as problem:
            raise InputError(f"cannot be opened ({problem.strerror}).", where=str(path)) from problem
        begin = len(_WORDS) * LINE
        self._words = np.frombuffer(self._map, "<i8", begin // 8, LINE).reshape(-1, LINE // 8)
        if self["version"] != VERSION:
            raise InputError("was written by another version of Palpate.", where=str(path))
        self.form = _described(self._map, path)
        slot, count = self.form.slot(), self["slots"]
        if count < LEAST or HEAD + count * slot.itemsize > size:
            raise InputError("is cut off: it is shorter than its head says.", where=str(path))
        self.slots = np.frombuffer(self._map, slot, count, HEAD)
        self._memory = np.frombuffer(self._map, "<i8", count * (slot.itemsize // 8), HEAD).reshape(count, -1)
        self._sentences = np.frombuffer(self._map, [("stamp", "<i8"), ("text", f"S{SENTENCE}")], SENTENCES, _SAID)

    @classmethod
    def make(cls, path: Path, form: SlotForm, size: int = SIZE) -> StreamBuffer:
        """A new one of so many bytes, all of which the disk grants now: a map cannot say later that it is full.

        Raises:
            InputError: it cannot be written, or the disk is full.
        """
        slot = form.slot().itemsize
        count = max(LEAST, size // slot)
        text = json.dumps(asdict(form)).encode()
        try:
            with path.open("w+b") as file:
                os.posix_fallocate(file.fileno(), 0, HEAD + count * slot)
                head = np.zeros((len(_WORDS), LINE // 8), dtype="<i8")
                head[_WORDS.index("version"), 0], head[_WORDS.index("slots"), 0] = VERSION, count
                file.seek(LINE)
                file.write(head.tobytes())
                file.seek(_JSON)
                file.write(len(text).to_bytes(4, "little") + text)
                file.seek(0)
                file.write(MAGIC)
        except OSError as problem:
            raise InputError(f"cannot be written ({problem.strerror}).", where=str(path)) from problem
        return cls(path)

    def __getitem__(self, word: str) -> int:
        """A number that processes share."""
        return int(self._words[_PLACE[word], 0])

    def __setitem__(self, word: str, value: int) -> None:
        self._words[_PLACE[word], 0] = value

    def close(self) -> None:
        """Let go of the file, which stays."""
        del self._words, self.slots, self._memory, self._sentences
        self._map.close()

    @cached_property
    def _loops(self) -> ModuleType:
        """Compiled: of the writer alone, so that readers need not load them."""
        from palpate.live import _stream

        return _stream

    def take_in(self, batch: Batch, count: int, unsteady: Float[np.ndarray, " n"]) -> int:
        """The writer's: so many samples of a batch are received.

        Returns:
            the number of the first.
        """
        first, form, arrived = self["received"], self.form, batch.stamp if batch.arrived is None else batch.arrived
        values = batch.values.reshape(len(batch), -1)
        self._loops.take_in(
            self._memory,
            first,
            count,
            batch.stamp,
            arrived,
            batch.lost,
            _NONE if form.images else values,
            form.poses,
            batch.orientation,
            batch.position,
            batch.acceleration,
            unsteady,
        )
        if form.images:
            for here, part in self._parts(first, count):
                self.slots["values"][here] = batch.values[part]
        self["received"] = first + count
        return first

    def answer(
        self, rows: Float[np.ndarray, "rows width"], counts: Int[np.ndarray, " n"], *, known: bool = True
    ) -> None:
        """The writer's: contacts of the next samples, `counts` rows each; not `known`: there is no answer to them."""
        if self.form.max_contacts > 1 and counts.max(initial=0) > self.form.max_contacts:
            raise ValueError(f"a sample has {counts.max()} rows, and there is room for {self.form.max_contacts}")
        first = self["answered"]
        self._loops.answer(self._memory, first, rows, counts, time.time_ns() if known else 0)
        self["answered"] = first + len(counts)

    def say(self, sentence: str) -> None:
        """Keep a sentence with the time, for all who read the ring; any process may, one at a time."""
        with self._alone():
            self._keep(sentence)

    def ask_tare(self, by: str) -> None:
        """Ask the writer for a tare, and keep who did; any process may."""
        with self._alone():
            self._keep(f"tare asked for by {by}")
            self["asked"] += 1

    @contextmanager
    def _alone(self) -> Generator[None]:
        """While no other process, and no other thread of this one, does the same."""
        with self._talking, self.path.open("r+b") as file:  # the lock of the file is one for all threads of a process
            fcntl.lockf(file, fcntl.LOCK_EX, 1, _SAID)  # let go of when the file is closed, or the process killed
            yield

    def _keep(self, sentence: str) -> None:
        text = sentence.encode()[: SENTENCE - 1].decode(errors="ignore").encode()
        count = self["said"]
        self._sentences[count % SENTENCES] = (time.time_ns(), text)
        self["said"] = count + 1

    def events(self, since: int) -> tuple[list[tuple[int, str]], int]:
        """Stamps [ns] and sentences from a number on, as far as they are kept, and the number to go on from."""
        count = self["said"]
        kept = [self._sentences[k % SENTENCES] for k in range(max(since, count - SENTENCES), count)]
        return [(int(each["stamp"]), bytes(each["text"]).decode(errors="replace")) for each in kept], count

    def read(self, first: int, most: int, word: str = "answered") -> tuple[np.ndarray, int]:
        """A copy of slots from a number on, and the number of the first: larger where this reader was lapped.

        Args:
            first: number of the sample to go on with.
            most: slots.
            word: up to which number: "answered", or "received".
        """
        while True:
            end = self[word]
            first = max(first, self._oldest())
            count = min(most, max(end - first, 0))
            parts = [self.slots[here].copy() for here, _ in self._parts(first, count)]
            if first >= self._oldest():  # nothing was written over meanwhile
                return parts[0] if len(parts) == 1 else np.concatenate([self.slots[:0], *parts]), first

    def _oldest(self) -> int:
        """The number of the first slot that the writer will not touch with its next batch."""
        return max(0, self["received"] - self.safe)

    @property
    def safe(self) -> int:
        """How many of the last samples readers can be sure of."""
        return len(self.slots) - min(MARGIN, len(self.slots) // 2)

    def _parts(self, first: int, count: int) -> Sequence[tuple[slice, slice]]:
        """Where so many slots from a number on stand, and which of the samples each part holds."""
        begin = first % len(self.slots)
        room = len(self.slots) - begin
        if count <= room:
            return ((slice(begin, begin + count), slice(0, count)),) if count else ()
        return (slice(begin, None), slice(0, room)), (slice(0, count - room), slice(room, count))


def _described(held: mmap.mmap, path: Path) -> SlotForm:
    length = int.from_bytes(held[_JSON : _JSON + 4], "little")
    try:
        made: Mapping[str, Any] = json.loads(held[_JSON + 4 : _JSON + 4 + min(length, _SAID - _JSON - 4)])
        lists = {name: tuple(made[name]) for name in ("shape", "features")}
        form = SlotForm(**cast("dict[str, Any]", {**made, **lists}))
        if not (0 < form.width < 4096 and 0 < form.max_contacts < 4096 and 0 < prod(form.shape) < 1 << 26):
            raise ValueError("sizes")
    except (ValueError, TypeError, KeyError) as problem:
        raise InputError("is damaged: its description cannot be read.", where=str(path)) from problem
    return form
