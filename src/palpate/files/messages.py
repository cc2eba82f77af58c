"""Read files of messages, such as MCAP files and ROS bags, block by block."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Generator, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from typing import TypeVar

import numpy as np
from jaxtyping import Int

from palpate.files.inputs import Watched
from palpate.spatial.arguments import frozen_value

Found = TypeVar("Found")


@dataclass(frozen=True)
class Topic:
    """A topic: name, type of its messages, their encoding, cdr (ROS 2) or ros1, and their count, 0 if unknown.

    `definition` is that of the type, as the file has it; "" if it has none.
    """

    name: str
    kind: str
    encoding: str
    count: int = 0
    definition: str = field(default="", compare=False, repr=False)

    def same(self, other: Topic) -> bool:
        """Return True if the topics differ at most in their count."""
        return (self.name, self.kind, self.encoding) == (other.name, other.kind, other.encoding)


def merged(topics: Iterable[Topic]) -> list[Topic]:
    """Return topics in which those that differ only in their count are one, with the sum of the counts."""
    counts: dict[Topic, int] = {}
    for topic in topics:
        key = replace(topic, count=0)
        counts[key] = counts.get(key, 0) + topic.count
    return [replace(topic, count=count) for topic, count in counts.items()]


@frozen_value(eq=True)
class MessageBlock:
    """A block of n messages, in the order of the file.

    Attributes:
        data: bytes that contain them.
        topics: number of a topic -> topic.
        topic: (n,) numbers of topics; those not in `topics` were not declared.
        time: (n,) [ns] when they were recorded.
        start, length: (n,) first byte and length of the payloads in `data`.
    """

    data: bytes
    topics: Mapping[int, Topic]
    topic: Int[np.ndarray, " n"]
    time: Int[np.ndarray, " n"]
    start: Int[np.ndarray, " n"]
    length: Int[np.ndarray, " n"]

    def of(self, topic: Topic) -> MessageBlock:
        """Return the messages of one topic that have its type."""
        mask = np.isin(self.topic, [key for key, other in self.topics.items() if other.same(topic)])
        return MessageBlock(
            self.data, self.topics, self.topic[mask], self.time[mask], self.start[mask], self.length[mask]
        )


class MessageFile(Watched, ABC):
    """A file of messages, or several read as one.

    Attributes:
        duration: [s] from the first message to the last; 0 if the file does not state it.
    """

    duration: float = 0.0

    @abstractmethod
    def topics(self) -> list[Topic]:
        """Return all declared topics, one per name and type, with their message counts.

        Raises:
            InputError: the file cannot be read, or needs a library that is not installed.
        """

    @abstractmethod
    def messages(self, names: Collection[str] = ()) -> Generator[MessageBlock]:
        """Yield blocks of messages in the file's order: all, or at least those of topics in `names`.

        Raises:
            InputError: the file cannot be read, or needs a library that is not installed.
        """

    def first(self, topic: Topic, read: Callable[[MessageBlock], Found | None]) -> Found | None:
        """Return the first result of `read`, called with blocks of a topic's messages, that is not None; else None.

        Raises:
            InputError: the file cannot be read.
        """
        with closing(self.messages([topic.name])) as pieces:
            return next((found for piece in pieces if (found := read(piece.of(topic))) is not None), None)

    def has_stamps(self, topic: Topic, read: Callable[[MessageBlock], Iterable[int]]) -> bool:
        """Return whether a topic has stamps: False if its first two, or its only one, are all 0, as without a clock.

        `read` returns the stamps in a block of the topic's messages.

        Raises:
            InputError: the file cannot be read.
        """
        with closing(self.messages([topic.name])) as pieces:
            found = list(islice(chain.from_iterable(read(piece.of(topic)) for piece in pieces), 2))
        return any(found) or not found
