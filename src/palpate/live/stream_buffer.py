"""The ring: a mapped file that passes samples and their contacts from one writer to any number of readers.

The writer never waits: a reader that is too slow is lapped, and detects it. A sample is in the file as soon as it is
received, its contacts a moment later. The file outlives every process.
"""

from __future__ import annotations

import fcntl
import json
import mmap
import os
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from math import prod
from operator import is_
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any, NamedTuple, cast

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW
from palpate.contact.origins import EXPECTED, Origin, Origins
from palpate.errors import InputError
from palpate.files.logs.decoding import seconds
from palpate.live.source import Batch

__all__ = ["READERS", "StreamBuffer", "latencies"]

# The head holds numbers that processes share, each in its own cache line and written by one process, except for "asked"
# (for tares) and "recording"; a description as JSON; the last sentences on events. The slots follow.
MAGIC, VERSION = b"PALPRING", 2
_BROKEN = "Remove it; `palpate recover` then completes the record from its .part file alone."
HEAD = 1 << 16  # bytes before the slots
LINE = 64  # bytes of a cache line
_WORDS = (
    *("version", "slots", "received", "answered", "alive", "said", "asked", "done", "stop"),
    *("recorded", "bytes", "noted", "missed", "file", "began"),  # the recorder's
    *("recording", "ended"),  # whether samples that can wait do so for the recorder; whether no more come
    *("lost", "away", "unknown"),  # samples lost; of them, while no receiver ran; how often their number is unknown
    *("position", "published"),  # where the sender's counters were; samples published, by all publishers
)
_PLACE = {word: place * LINE // 8 for place, word in enumerate(_WORDS)}  # in int64
_JSON, _SAID, _SENT = 4096, 24576, 61440  # where the description, the sentences and latencies begin
SENTENCES, SENTENCE = 112, 320  # kept, and bytes of each
PUBLISHED = 512  # latencies of the last that were published
SIZE = 1 << 26  # bytes of slots, as a rule
LEAST = 512  # slots
SMALL = 1 << 19  # bytes of slots that are quicker copied with all the room for contacts than without
READERS = 2  # value of "stop" that ends the recorder; all others end at 1 before
MARGIN = 1024  # slots: the largest batch
LATE = 60.0  # s: between two clocks, and no latency
_NONE = np.zeros((0, 0))


@dataclass(frozen=True)
class SlotForm:
    """Description of the samples and contacts in a ring.

    Attributes:
        sensor: name of the sensor's kind.
        shape: shape of one reading.
        images: whether readings are uint8 rather than float64.
        features: columns that the sensor adds to its contacts.
        width: number of values in a row of contacts.
        max_contacts: largest number of rows of one sample.
        frame: frame of the contacts.
        rig: file of the rig.
        poses: whether a pose comes with each sample.
        topic: topic of these readings in a log; "": the only one of its kind.
        wrenches: whether readings are wrenches only.
        origin: of a robot's sensor, its name and that of its link; "" for a rig of one sensor.
        place: of a robot's sensor, its place among all and their number, which make identities unique.
        expected: whether it is always touched, so that its contacts are no events.
        joints: of a robot's joint states, the names of the joints; then there are no contacts.
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
    origin: tuple[str, str] = ("", "")
    place: tuple[int, int] = (0, 1)
    expected: bool = False
    joints: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the features of contacts, with that of a sensor which is always touched."""
        return (*self.features, *((EXPECTED,) if self.expected else ()))

    @property
    def numbered(self) -> bool:
        """True if a row of contacts ends with an identity, as of sensors with several contacts."""
        return self.width > ROW.length + len(self.features)

    def slot(self) -> np.dtype[np.void]:
        """Return the structured dtype of a slot, which holds one sample and its contacts."""
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
        """Return the `Contacts` in slots (n,), in order; samples that are not answered have no row."""
        rows, sample, times = slots["contacts"], slots["number"] - 1, seconds(slots["stamp"])
        counts = np.clip(slots["rows"], 0, self.max_contacts) * (slots["ready"] > 0)  # of a damaged file, whatever
        if (counts == 1).all():  # as a rule
            return self._named(Contacts.of_rows(sample, times, rows[:, 0], self.features))
        which = np.repeat(np.arange(len(slots)), counts)
        place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        return self._named(Contacts.of_rows(sample[which], times[which], rows[which, place], self.features))

    def _named(self, found: Contacts) -> Contacts:
        """Return contacts with the names of a robot's sensor, as `RobotPipeline` gives them."""
        if not self.origin[0]:
            return found
        place, count = self.place
        expected = {EXPECTED: np.ones(len(found))} if self.expected else {}
        return replace(
            found,
            identity=found.identity * count + place,
            features={**found.features, **expected},
            origins=Origins.single(Origin(*self.origin), len(found)),
        )


def latencies(slots: np.ndarray) -> Float[np.ndarray, " k"]:
    """Return the latency [s] from arrival to contacts of each answered slot, (k,).

    It is empty if arrival was stamped by another clock: the median is negative, or 60 s and above.
    """
    return _sound(1e-9 * (slots["ready"] - slots["arrived"])[slots["ready"] > 0])


def _sound(waited: Float[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
    return waited if len(waited) and 0.0 <= np.median(waited) < LATE else waited[:0]


class _Taking(NamedTuple):
    """Arrays of a batch, the arguments that they are part of, checked once, and the compiled loop that stores them."""

    arrays: tuple[np.ndarray, ...]
    given: tuple[Any, ...]
    loop: Callable[..., None]


class StreamBuffer:
    """A ring in a mapped file, opened by its writer or by a reader.

    Numbers of the head are read and written by name: `ring["received"]` samples are stored, `ring["answered"]` of them
    have their contacts; `ring["stop"] = 1` ends its processes, the recorder only at 2.

    Args:
        path: the file, which exists.

    Attributes:
        path: as given.
        form: description of its samples and contacts.
        slots: (size,) of the dtype `form.slot()`, the mapped samples; copy them with `read`.

    Raises:
        InputError: the file cannot be opened, is no ring, is damaged, or is of another version.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._talking = path, Lock()
        self._taking: _Taking | None = None
        try:
            with path.open("r+b") as file:
                size = os.fstat(file.fileno()).st_size
                if size < HEAD or file.read(len(MAGIC)) != MAGIC:
                    raise InputError("is not a buffer of `palpate live`.", where=str(path), hint=_BROKEN)
                self._map = mmap.mmap(file.fileno(), 0)
        except OSError as problem:
            raise InputError(f"cannot be opened ({problem.strerror}).", where=str(path)) from problem
        begin = len(_WORDS) * LINE
        self._words = memoryview(self._map)[LINE : LINE + begin].cast("q")  # quicker than NumPy for single numbers
        if self["version"] != VERSION:
            hint = "Read it with that version."
            raise InputError("was written by another version of Palpate.", where=str(path), hint=hint)
        self.form = _described(self._map, path)
        slot, count = self.form.slot(), self["slots"]
        if count < LEAST or HEAD + count * slot.itemsize > size:
            raise InputError("is incomplete: it is shorter than its header states.", where=str(path), hint=_BROKEN)
        self.slots = np.frombuffer(self._map, slot, count, HEAD)
        self._memory = np.frombuffer(self._map, "<i8", count * (slot.itemsize // 8), HEAD).reshape(count, -1)
        self._sentences = np.frombuffer(self._map, [("stamp", "<i8"), ("text", f"S{SENTENCE}")], SENTENCES, _SAID)
        self._sent = np.frombuffer(self._map, "<i8", PUBLISHED, _SENT)

    @classmethod
    def make(cls, path: Path, form: SlotForm, size: int = SIZE) -> StreamBuffer:
        """Make a new ring with `size` bytes of slots, at least 512 slots, and open it.

        The disk allocates all bytes now, because a mapped file cannot report a full disk later.

        Raises:
            InputError: the file cannot be written, or the disk is full.
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
        """Return a number of the head by its name.

        Raises:
            KeyError: the head has no such number.
        """
        return self._words[_PLACE[word]]

    def __setitem__(self, word: str, value: int) -> None:
        self._words[_PLACE[word]] = value

    def close(self) -> None:
        """Unmap the file, which stays on the disk.

        Raises:
            BufferError: an array of the file is still in use.
        """
        self._words.release()
        self._taking = None
        vars(self).pop("_answering", None)
        del self.slots, self._memory, self._sentences, self._sent
        self._map.close()

    @cached_property
    def _loops(self) -> ModuleType:
        """Compiled loops of the writer, which readers need not load."""
        from palpate.live import _stream

        return _stream

    @cached_property
    def _answering(self) -> Callable[..., None]:
        from palpate.surfaces._jit import FixedEntry

        return FixedEntry(self._loops.answer, 0, (self._memory,))

    def take_in(self, batch: Batch, count: int, unsteady: Float[np.ndarray, " n"]) -> int:
        """Store the first `count` samples of a batch, and return the number of the first; for the writer.

        Args:
            batch: arrays that a source has filled.
            count: number of samples.
            unsteady: (n,) [m/s^2] standard deviation of the acceleration's error along each axis; used with poses.
        """
        first, taking = self["received"], self._taking
        if taking is None or not all(map(is_, taking.arrays, (batch.values, batch.arrived, unsteady))):
            taking = self._taking = self._checked(batch, unsteady)
        taking.loop(self._memory, first, count, *taking.given)
        if self.form.images:
            for here, part in self._parts(first, count):
                self.slots["values"][here] = batch.values[part]
        if lost := sum(batch.lost[:count].tolist()):  # quicker than NumPy's, as most batches hold one sample
            self["lost"] += lost
        self["received"] = first + count
        return first

    def _checked(self, batch: Batch, unsteady: np.ndarray) -> _Taking:
        values = _NONE if self.form.images else batch.values.reshape(len(batch), -1)
        poses = self.form.poses, batch.orientation, batch.position, batch.acceleration, unsteady
        given = batch.stamp, batch.arrived, batch.lost, values, *poses
        return _Taking(
            (batch.values, batch.arrived, unsteady), given, self._loops.take_in.compiled_for(self._memory, 0, 0, *given)
        )

    @property
    def position(self) -> tuple[int, ...]:
        """Position that a `LossCount` stores for a later receiver, up to seven integers; for the writer."""
        size, *values = self._words[_PLACE["position"] : _PLACE["position"] + LINE // 8].tolist()
        return tuple(values[:size])

    @position.setter
    def position(self, position: tuple[int, ...]) -> None:
        for place, value in enumerate((len(position), *position), _PLACE["position"]):
            self._words[place] = value

    def answer(
        self, rows: Float[np.ndarray, "rows width"], counts: Int[np.ndarray, " n"], *, known: bool = True
    ) -> None:
        """Store the contacts of the next samples; for the writer.

        Args:
            rows: (m, width) contacts of all samples.
            counts: (n,) number of rows of each sample.
            known: False marks the samples as not answered.

        Raises:
            ValueError: a sample has more rows than a slot with room for several.
        """
        if self.form.max_contacts > 1 and max(counts.tolist(), default=0) > self.form.max_contacts:
            raise ValueError(f"a sample has {counts.max()} rows, and there is room for {self.form.max_contacts}")
        first = self["answered"]
        self._answering(first, rows, counts, time.time_ns() if known else 0)
        self["answered"] = first + len(counts)

    def publish(self, samples: Sequence[int]) -> None:
        """Note that samples, given by their numbers, were published just now; for publishers."""
        now = time.time_ns()
        for sample in samples:
            count = self["published"]
            self._sent[count % PUBLISHED] = now - self.slots["arrived"][sample % len(self.slots)]
            self["published"] = count + 1

    def published(self) -> Float[np.ndarray, " k"]:
        """Return the latencies [s] from arrival to publication of the last samples, 512 at most, as `latencies`."""
        return _sound(1e-9 * self._sent[: self["published"]])

    def say(self, sentence: str) -> None:
        """Store a sentence with its time for all readers; any process may call this.

        Raises:
            OSError: the file cannot be opened or locked.
        """
        with self._alone():
            self._keep(sentence)

    def ask_tare(self, by: str) -> None:
        """Request a tare from the writer, and store a sentence that names `by`; any process may call this.

        Raises:
            OSError: the file cannot be opened or locked.
        """
        with self._alone():
            self._keep(f"tare requested by {by}")
            self["asked"] += 1

    @contextmanager
    def _alone(self) -> Generator[None]:
        """Lock sentences and requests against other processes and threads."""
        with self._talking, self.path.open("r+b") as file:  # threads of a process share the file's lock
            fcntl.lockf(file, fcntl.LOCK_EX, 1, _SAID)  # released when the file is closed or the process is killed
            yield

    def _keep(self, sentence: str) -> None:
        text = sentence.encode()[: SENTENCE - 1].decode(errors="ignore").encode()
        count = self["said"]
        self._sentences[count % SENTENCES] = (time.time_ns(), text)
        self["said"] = count + 1

    def events(self, since: int) -> tuple[list[tuple[int, str]], int]:
        """Return (stamp [ns], sentence) pairs from number `since` on, the last 112 at most, and the next number."""
        count = self["said"]
        kept = [self._sentences[k % SENTENCES] for k in range(max(since, count - SENTENCES), count)]
        return [(int(each["stamp"]), bytes(each["text"]).decode(errors="replace")) for each in kept], count

    def read(self, first: int, most: int, word: str = "answered", fields: Sequence[str] = ()) -> tuple[np.ndarray, int]:
        """Return a copy of slots, (n,) structured, and the first's number, above `first` if that was overwritten.

        Args:
            first: number of the sample to continue with.
            most: number of slots, at most.
            word: number of the head to read up to: "answered" or "received".
            fields: names of the fields of a slot to copy; (): all.
        """
        while True:
            first = max(first, self._oldest())
            count = min(most, max(self[word] - first, 0))
            parts = [self._copied(here, fields) for here, _ in self._parts(first, count)]
            overwritten = max(self._oldest() - first, 0)  # during the copy: a second try could be lapped again
            if not count or overwritten < count:
                slots = parts[0] if len(parts) == 1 else np.concatenate([self._copied(slice(0), fields), *parts])
                return slots[overwritten:], first + overwritten

    def _copied(self, here: slice, fields: Sequence[str]) -> np.ndarray:
        slots = self.slots[here]
        if not fields and slots.nbytes < SMALL:
            return slots.copy()
        made = np.empty(len(slots), [(name, slots.dtype[name]) for name in fields] or slots.dtype)
        for name in fields or [name for name in slots.dtype.names or () if name != "contacts"]:
            made[name] = slots[name]
        if not fields:  # without the room for contacts that no slot has: as a rule, most
            most = int(made["rows"].max(initial=1))
            made["contacts"][:, :most] = slots["contacts"][:, :most]
        return made

    def _oldest(self) -> int:
        return max(0, self["received"] - self.safe)

    @property
    def safe(self) -> int:
        """Number of the last samples that the writer's next batch does not overwrite."""
        return len(self.slots) - min(MARGIN, len(self.slots) // 2)

    def _parts(self, first: int, count: int) -> Sequence[tuple[slice, slice]]:
        """Return (slots, samples) as slices for each contiguous part of `count` samples."""
        begin = first % len(self.slots)
        room = len(self.slots) - begin
        if count <= room:
            return ((slice(begin, begin + count), slice(0, count)),) if count else ()
        return (slice(begin, None), slice(0, room)), (slice(0, count - room), slice(room, count))


def _described(held: mmap.mmap, path: Path) -> SlotForm:
    length = int.from_bytes(held[_JSON : _JSON + 4], "little")
    try:
        made: Mapping[str, Any] = json.loads(held[_JSON + 4 : _JSON + 4 + min(length, _SAID - _JSON - 4)])
        listed = ("shape", "features", "origin", "place", "joints")
        lists = {name: tuple(made[name]) for name in listed if name in made}
        form = SlotForm(**cast("dict[str, Any]", {**made, **lists}))
        if not (0 < form.width < 4096 and 0 < form.max_contacts < 4096 and 0 < prod(form.shape) < 1 << 26):
            raise ValueError("sizes")
    except (ValueError, TypeError, KeyError) as problem:
        raise InputError("is damaged: its header cannot be read.", where=str(path), hint=_BROKEN) from problem
    return form
