"""An opened log, whatever its format, and the messages of a file of messages: read in blocks, any number of times."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from palpate.files.tables.stated import Stated
from palpate.signals.recording import CELLS, Recording
from palpate.spatial.arguments import takes_arrays

__all__ = ["Images", "Log", "LogContents", "MessageBlock", "MessageFile", "Stored", "Topic", "merged"]

Stored = tuple[Float[np.ndarray, " n"], np.ndarray]  # times [s], and frames (n, k) as they are stored


@dataclass(frozen=True)
class Topic:
    """What a channel or connection carries; `encoding` is cdr (ROS 2) or ros1, and `count` its messages, if known."""

    name: str
    kind: str
    encoding: str
    count: int = 0

    def same(self, other: Topic) -> bool:
        """Whether these only differ in the count."""
        return (self.name, self.kind, self.encoding) == (other.name, other.kind, other.encoding)


def merged(topics: Iterable[Topic]) -> list[Topic]:
    """One entry for those that only differ in the count."""
    counts: dict[Topic, int] = {}
    for topic in topics:
        key = replace(topic, count=0)
        counts[key] = counts.get(key, 0) + topic.count
    return [replace(topic, count=count) for topic, count in counts.items()]


@dataclass(frozen=True)
class Images:
    """What a video or a folder of frames says of itself.

    Attributes:
        size: height, width, channels of the first frame; 0, 0, 0 where it does not say so, or none can be read.
        count: frames; of a video as many as it announces, 0 where it does not.
        rate: [Hz]; None of a folder.
        codec: of a video as its four characters, of a folder the suffixes.
    """

    size: tuple[int, int, int]
    count: int
    rate: float | None
    codec: str


@dataclass(frozen=True)
class LogContents:
    """What a log holds, as far as it says so before it is read.

    Attributes:
        path: of the log.
        names: column -> (), array of a NumPy file -> the shape of one sample; none where the log has topics.
        topics: of an MCAP file or a bag.
        duration: [s] of a log with topics, where it says so; 0 where it does not.
        torn: the sentence that says where the file was cut, as far as it was met.
        stated: units and rate, as far as a table states them.
        written: how a text is written, in words, where that is not plain.
        images: of a video or a folder of frames; it has no names and no topics.
    """

    path: Path
    names: Mapping[str, tuple[int, ...]]
    topics: tuple[Topic, ...] = ()
    torn: str = ""
    duration: float = 0.0
    stated: Stated = field(default_factory=Stated)
    written: str = ""
    images: Images | None = None


@takes_arrays
@dataclass(frozen=True)
class MessageBlock:
    """Some messages, in the order of the file.

    Attributes:
        data: the bytes in which they are.
        topic: (n,) a key of `topics`; a message whose key is not there belongs to nothing that was declared.
        time: (n,) [ns] when they were recorded.
        start, length: (n,) of the payload in `data`.
    """

    data: bytes
    topics: Mapping[int, Topic]
    topic: Int[np.ndarray, " n"]
    time: Int[np.ndarray, " n"]
    start: Int[np.ndarray, " n"]
    length: Int[np.ndarray, " n"]

    def of(self, topic: Topic) -> MessageBlock:
        """Those of one topic, as far as they are of its type."""
        mask = np.zeros(len(self.topic), dtype=bool)
        for key, other in self.topics.items():
            if other.same(topic):
                mask |= self.topic == key
        return MessageBlock(
            self.data, self.topics, self.topic[mask], self.time[mask], self.start[mask], self.length[mask]
        )


class _Watched:
    """What is read piece by piece while somebody looks on.

    Attributes:
        path: of the file or folder.
        size: bytes to read in all.
        position: bytes read so far in the running iteration.
        torn: after an iteration, the sentence that says where the file was cut; "" where it is whole.
    """

    def __init__(self, path: Path, size: int) -> None:
        self.path, self.size = path, size
        self.position, self.torn = 0, ""

    def notes(self) -> tuple[str, ...]:
        """What a reader of the results should know of what was read so far, one sentence each."""
        return ()


class MessageFile(_Watched, ABC):
    """A file of messages.

    Attributes:
        duration: [s] from the first message to the last, where the file says so; 0 where it does not.
    """

    duration: float = 0.0

    @abstractmethod
    def topics(self) -> list[Topic]:
        """Everything that it declares, one entry a name and type, with how many messages there are."""

    @abstractmethod
    def messages(self, names: Collection[str] = ()) -> Generator[MessageBlock]:
        """From the start, in the order of the file: all, or at least those of the topics that are named."""


class Log(_Watched, ABC):
    """What every reader gives."""

    @abstractmethod
    def contents(self) -> LogContents:
        """What is in it, whatever the layout; only an MCAP file without an index is read for it.

        Raises:
            InputError: it cannot be read.
        """

    @abstractmethod
    def blocks(self) -> Iterator[Recording]:
        """The samples from the start, in the order of the file, every one once, in pieces as they come.

        Raises:
            InputError: what the layout asks for is not there.
        """

    def stored(self) -> Iterator[Stored]:
        """Times [s] and frames (n, k) of taxels as they are stored, where that is quicker: whole numbers stay whole.

        Raises:
            InputError: what the layout asks for is not there.
        """
        for block in self.blocks():
            yield block.time, block.channels[CELLS].reshape(len(block), -1)

    def merged_with(self, frames: Log) -> Iterator[Recording | Stored]:
        """Its `blocks`, and what `frames`, the file by another layout, has `stored`: in one reading where that can be.

        Raises:
            InputError: what one of the layouts asks for is not there.
        """
        yield from self.blocks()
        yield from frames.stored()
