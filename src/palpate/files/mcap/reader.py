"""Read the messages of an MCAP file from its start, without its index, so that a cut file is read up to the cut.

The format: MAGIC, then records of a kind (1 byte), a length (8 bytes) and content; at the end an index, a footer and
MAGIC. Messages are in chunks, compressed or not, or between them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from io import BytesIO
from pathlib import Path
from struct import error as StructError
from struct import unpack_from
from typing import BinaryIO

import numpy as np
from jaxtyping import Int
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap.summary import Summary

from palpate.files.inputs import open_input, read_some
from palpate.files.mcap.chunks import LARGEST, inflate
from palpate.files.messages import MessageBlock, MessageFile, Topic, merged

MAGIC = b"\x89MCAP0\r\n"
READ, PIECE = 1 << 18, 1 << 22  # bytes read at a time, of chunks and of messages between them
KEPT = 1 << 21  # bytes of a chunk that is kept unpacked for the next sensor, at most
LONGEST: Mapping[int, int] = {Opcode.CHUNK: LARGEST, Opcode.MESSAGE: 1 << 26}  # bytes; others: PIECE; else skipped
_LONGEST = 1e8  # s: what states a longer duration has messages of two clocks
_HEAD = 9
_MOST, _OTHERS = 1 << 16, 1 << 11  # messages of a stretch, and other records
_DECLARING: Mapping[int, type[Schema] | type[Channel]] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}


@dataclass(frozen=True)
class _Stretch:
    """Complete records up to `end`, as `walk` lists them."""

    messages: Int[np.ndarray, "4 k"]
    others: list[list[int]]
    end: int

    @property
    def last(self) -> int:
        return self.others[-1][0] if self.others else 0


class McapFile(MessageFile):
    """The messages of one MCAP file.

    Attributes:
        definitions: type -> its fields, as text.

    Raises:
        OSError: the file does not exist.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, path.stat().st_size)
        self.definitions: dict[str, str] = {}  # name of a type -> its fields, as text
        self._defined = set[int]()  # schemas in the form of .msg files
        self._schemas: dict[int, str] = {}  # kept once read: a file may declare them after its messages
        self._channels: dict[int, Channel] = {}
        self._topics: dict[int, Topic] = {}
        self._forget()

    def topics(self) -> list[Topic]:
        """Return the topics with their message counts, by the index at the end or by reading the complete file.

        Raises:
            InputError: the file cannot be read.
        """
        if not self._read_index():
            for _ in self.messages():
                pass
        return merged(replace(topic, count=self._counts[key]) for key, topic in self._topics.items())

    def messages(self, names: Collection[str] = ()) -> Generator[MessageBlock]:
        """Yield all messages in the order of the file, in blocks, whatever `names`; `torn` then describes any damage.

        Raises:
            InputError: the file cannot be read.
        """
        self._read_index()  # what it declares stands even if the chunk that declares it is damaged
        self._counts.clear()
        with open_input(self.path) as file:
            yield from self._read(file)
        if self._damage is not None:
            at, what = self._damage
            count = sum(self._counts.values())
            where = f"at byte {at:,} of {self.size:,}, in the part that begins there"
            self.torn = f"the file is torn {where} ({what}); {count:,} complete messages were read"

    def notes(self) -> tuple[str, ...]:
        """Return a sentence on messages whose topic is not declared, in a tuple; () if there are none."""
        stray = sum(count for key, count in self._counts.items() if key not in self._topics)
        return (f"{stray} messages belong to topics that are not declared",) if stray else ()

    def _forget(self) -> None:
        self.position, self.torn = 0, ""
        self._damage: tuple[int, str] | None = None
        self._counts = Counter[int]()

    def _damaged(self, at: int, what: str) -> None:
        self._damage = self._damage or (at, what)  # the first is reported

    def _read(self, file: BinaryIO) -> Iterator[MessageBlock]:
        """Yield the messages up to the footer or a record that is cut or invalid."""
        at, held, want = file.seek(len(MAGIC)), b"", READ
        while more := read_some(file, self.path, want):
            held += more
            self.position = at + len(held)
            end = 0
            for stretch in _stretches(held):
                yield from self._use(stretch, held)
                end = stretch.end
                if stretch.last == Opcode.CHUNK:
                    _, start, length = stretch.others[-1]
                    yield from self._unpack(memoryview(held)[start : start + length], at + start - _HEAD)
                elif stretch.last == Opcode.FOOTER:
                    if held[end:] + read_some(file, self.path, len(MAGIC)) != MAGIC:
                        self._damaged(at + end, "there is more after the footer")
                    return
            held, at, want = held[end:], at + end, READ
            if len(held) < _HEAD:
                continue
            kind, length = unpack_from("<BQ", held)
            after = at + _HEAD + length
            if kind == 0 or after <= at + len(held):
                return self._damaged(at, "it is not a valid record")
            if after > self.size:
                if kind == Opcode.CHUNK:
                    yield from self._unpack(memoryview(held + read_some(file, self.path, LARGEST))[_HEAD:], at)
                return self._damaged(at, "it ends within a record")
            if length > LONGEST.get(kind, PIECE):
                self._pass_over(kind, held, at)
                held, at = b"", file.seek(after)
            else:
                want = max(PIECE if kind == Opcode.MESSAGE else READ, after - at - len(held))
        self._damaged(at, "it ends within a record" if held else "it ends without its footer")

    def _pass_over(self, kind: int, head: bytes, at: int) -> None:
        if kind == Opcode.CHUNK:
            self._damaged(at, "a chunk of more than 1 GiB")
        if kind == Opcode.MESSAGE:
            self._counts[unpack_from("<H", head, _HEAD)[0]] += 1

    def _unpack(self, content: memoryview, at: int) -> Iterator[MessageBlock]:
        small = len(content) <= KEPT
        data, problem, stretches = _unpacked_lately(bytes(content)) if small else _unpacked(content)
        end = 0
        for stretch in stretches:
            yield from self._use(stretch, data)
            end = stretch.end
        if end < len(data):
            problem = problem or "a chunk with an incomplete record"
        if problem:
            self._damaged(at, problem)

    def _use(self, stretch: _Stretch, data: bytes) -> Iterator[MessageBlock]:
        for kind, start, length in stretch.others:
            if kind in _DECLARING:
                with suppress(McapError, StructError, UnicodeDecodeError):  # one that is malformed declares nothing
                    content = ReadDataStream(BytesIO(data[start : start + length]))
                    self._declare(_DECLARING[kind].read(content))
        topic, time, start, length = stretch.messages
        if len(topic):
            counts = np.bincount(topic)
            self._counts.update({int(key): int(counts[key]) for key in np.flatnonzero(counts)})
            yield MessageBlock(data, self._topics, topic, time, start, length)

    def _declare(self, record: Schema | Channel) -> None:
        """Register a type or a topic; geometry_msgs/msg/Wrench is geometry_msgs/Wrench."""
        if isinstance(record, Schema):
            name = record.name.replace("/msg/", "/")
            self._schemas[record.id] = name
            self._defined |= {record.id} if record.encoding in ("ros1msg", "ros2msg") else set()
            self.definitions[name] = record.data.decode(errors="replace")
            channels = [channel for channel in self._channels.values() if channel.schema_id == record.id]
        else:
            self._channels[record.id] = record
            channels = [record]
        for channel in channels:  # a type may follow its channels
            kind = self._schemas.get(channel.schema_id, "")
            defined = self.definitions.get(kind, "") if channel.schema_id in self._defined else ""
            self._topics[channel.id] = Topic(channel.topic, kind, channel.message_encoding, 0, defined)

    def _read_index(self) -> bool:
        """Read the index; return True if it exists and names every topic."""
        self._forget()
        with suppress(Exception):  # whatever the library meets in a damaged one
            summary = self._summary
            if summary is not None and summary.statistics is not None:
                for record in (*summary.schemas.values(), *summary.channels.values()):
                    self._declare(record)
                self._counts.update(summary.statistics.channel_message_counts)
                duration = (summary.statistics.message_end_time - summary.statistics.message_start_time) / 1e9
                self.duration = duration if duration < _LONGEST else 0.0
                return summary.statistics.channel_count == len(self._topics)
        return False

    @cached_property
    def _summary(self) -> Summary | None:
        """Read the summary, only once: the library is slow."""
        with open_input(self.path) as file:
            return make_reader(file).get_summary()


def _unpacked(content: memoryview) -> tuple[bytes, str, Iterable[_Stretch]]:
    """Return what `inflate` does for a chunk, and its records."""
    data, problem = inflate(content)
    return data, problem, _stretches(data)


@lru_cache(maxsize=16)
def _unpacked_lately(content: bytes) -> tuple[bytes, str, Iterable[_Stretch]]:
    """Do the same for a small chunk, which is kept: the sensors of a robot read one log side by side."""
    data, problem, stretches = _unpacked(memoryview(content))
    return data, problem, tuple(stretches)


def _stretches(data: bytes) -> Iterator[_Stretch]:
    """Yield all complete records, in pieces that end with a chunk or the footer, or when long."""
    from palpate.files.mcap._walk import walk

    raw, end = np.frombuffer(data, dtype=np.uint8), 0
    messages = np.empty((4, min(_MOST, len(raw) // (_HEAD + 22) + 1)), dtype=np.int64)
    others = np.empty((min(_OTHERS, len(raw) // _HEAD + 1), 3), dtype=np.int64)
    while True:
        found, rest, stop = walk(raw, end, messages, others)
        if stop == end:
            return
        end = int(stop)
        yield _Stretch(messages[:, :found].copy(), others[:rest].tolist(), end)
