"""Kill -9, again and again, of what writes a ring at 7 kHz, of its recorder, or of both: is every sample there after?

Each sample holds its own number. What was received is read off the ring, from outside, after the kill; the file is
read by the `mcap` library. As a script: `python -m tests.support.kill_recorder 200`.
"""

import os
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

from palpate.contact.estimate import ROW
from palpate.live.record import record, ring_of
from palpate.live.recover import recover
from palpate.live.source import Batch
from palpate.live.stream_buffer import SlotForm, StreamBuffer

RATE = 7000  # Hz
BEGIN = 1_700_000_000_123_456_789  # ns
FORM = SlotForm(
    "force_torque", (6,), images=False, features=(), width=ROW.length, max_contacts=1, poses=True, wrenches=True
)
WRITER, RECORDER, BOTH, ALL = range(4)  # who is killed; ALL: and what is left is put together
LIST = struct.Struct("<6d")


def batch(first: int, count: int, shape: tuple[int, ...] = (6,)) -> Batch:
    """Samples from a number on; every value follows from the number."""
    made = Batch(shape, count)
    number = first + np.arange(count)
    made.stamp[:] = BEGIN + number * (10**9 // RATE)
    made.values.reshape(count, -1)[:] = number[:, None] + np.arange(np.prod(shape)) / 8.0
    return made


def answers(first: int, count: int) -> np.ndarray:
    """A row of contact of each sample, whose point says the sample's number."""
    rows = np.zeros((count, ROW.length))
    rows[:, ROW.point], rows[:, ROW.normal], rows[:, ROW.force] = 0.0, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
    rows[:, ROW.point.start] = first + np.arange(count)
    rows[:, ROW.candidates] = 1.0
    return rows


def write(path: Path) -> None:
    """Go on where the ring ends, for ever; what one before this did not answer has no answer."""
    ring = StreamBuffer(path)
    for _ in range(ring["received"] - ring["answered"]):
        ring.answer(np.zeros((0, FORM.width)), np.zeros(1, dtype=np.int64), known=False)
    begin, first = time.monotonic(), ring["received"]
    while True:
        count = min(512, int((time.monotonic() - begin) * RATE) - (ring["received"] - first))
        if count > 0:
            at = ring.take_in(batch(ring["received"], count), count, np.zeros(count))
            ring.answer(answers(at, count), np.ones(count, dtype=np.int64))
        time.sleep(0.003)


def messages(file: Path) -> Iterator[Any]:
    """Schema, channel and message of each, by the `mcap` library, in their order in the file, which was ended."""
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_summary() is not None
        yield from reader.iter_messages(log_time_order=False)


def numbers(files: list[Path]) -> tuple[list[int], list[int]]:
    """Of the samples in files, and of those with a contact, as they stand in the messages."""
    found, contacts = list[int](), list[int]()
    for _, channel, message in (each for file in files for each in messages(file)):
        if channel.topic == "/palpate/live/wrench":
            values = LIST.unpack(message.data[-48:])
            assert [value - values[0] for value in values] == [k / 8.0 for k in range(6)]
            assert message.log_time == BEGIN + int(values[0]) * (10**9 // RATE)
            found.append(int(values[0]))
        elif channel.topic == "/palpate/contact/point":
            contacts.append(int(struct.unpack_from("<d", message.data, len(message.data) - 56)[0]))
    return found, contacts


class _Run:
    """One record, and the two processes that make it."""

    def __init__(self, output: Path, split: float) -> None:
        self.output, self._split = output, split
        self.ring = StreamBuffer.make(ring_of(output), FORM, 1 << 24)
        self._started: dict[int, int] = {}
        self.seen = 0

    def start(self) -> None:
        """What does not run."""
        parent, path = os.getpid(), self.ring.path
        acts: dict[int, Callable[[], None]] = {
            WRITER: lambda: write(path),
            RECORDER: lambda: record([path], self.output, self._split, parent),
        }
        for who, act in acts.items():
            if who not in self._started:
                child = os.fork()
                if not child:
                    try:
                        act()
                    finally:  # nothing of the parent's goes on here
                        traceback.print_exc()
                        os._exit(1)
                self._started[who] = child

    def kill(self, which: Collection[int]) -> None:
        """By the signal that nothing can catch; all that run of these at once."""
        self.seen = self.ring["received"]
        children = [self._started.pop(who) for who in which if who in self._started]
        for child in children:
            os.kill(child, signal.SIGKILL)
        for child in children:
            _, status = os.waitpid(child, 0)
            assert os.WIFSIGNALED(status), "it had ended by itself"

    def whole(self) -> tuple[int, str]:
        """Put together and read, once all are dead: how many samples it had received, and what was said."""
        received, answered = self.ring["received"], self.ring["answered"]
        self.ring.close()
        said = recover(self.output)
        assert not ring_of(self.output).exists()
        assert not list(self.output.parent.glob("*.part"))
        found, contacts = numbers(sorted(self.output.parent.glob("*.mcap"), key=lambda file: file.stat().st_mtime_ns))
        assert received >= self.seen
        assert found == list(range(received)), (len(found), received)
        assert contacts == sorted(set(contacts))
        assert len(contacts) <= answered
        return received, said


def kill_again_and_again(folder: Path, count: int, *, split: float = 3e6, seed: int = 1) -> tuple[int, int]:
    """So many kills.

    Returns:
        how many samples were received in all, and how many times what was left was put together.
    """
    rng = np.random.default_rng(seed)
    received = records = 0
    run: _Run | None = None
    for k in range(count):
        if run is None:
            (folder / f"{records}").mkdir()
            run = _Run(folder / f"{records}" / "run.mcap", split)
        run.start()
        time.sleep(rng.uniform(0.05, 0.5))
        who = k % 4
        run.kill((WRITER, RECORDER) if who >= BOTH else (who,))
        if who == ALL or k == count - 1:
            run.kill((WRITER, RECORDER))
            received += run.whole()[0]
            records, run = records + 1, None
    return received, records


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        samples, times = kill_again_and_again(Path(made), int(sys.argv[1]))
    told = f"{times} records put together: all of {samples:,} samples that were received are there"
    sys.stdout.write(f"{sys.argv[1]} kills, {told}\n")
