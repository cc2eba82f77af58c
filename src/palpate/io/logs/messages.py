"""Messages in bulk, and what a file of them gives."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int

from palpate.io.logs.log import Topic, Watched

__all__ = ["Messages", "Source", "merged"]


def merged(topics: Iterable[Topic]) -> list[Topic]:
    """One entry for those that only differ in the count."""
    counts: dict[Topic, int] = {}
    for topic in topics:
        key = replace(topic, count=0)
        counts[key] = counts.get(key, 0) + topic.count
    return [replace(topic, count=count) for topic, count in counts.items()]


@dataclass(frozen=True)
class Messages:
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

    def of(self, topic: Topic) -> Messages:
        """Those of one topic, as far as they are of its type."""
        mask = np.zeros(len(self.topic), dtype=bool)
        for key, other in self.topics.items():
            if other.same(topic):
                mask |= self.topic == key
        return Messages(self.data, self.topics, self.topic[mask], self.time[mask], self.start[mask], self.length[mask])


@runtime_checkable
class Source(Watched, Protocol):
    """A file of messages."""

    def topics(self) -> list[Topic]:
        """Everything that it declares, one entry a name and type, with how many messages there are."""
        ...

    def messages(self, names: Collection[str] = ()) -> Generator[Messages]:
        """From the start, in the order of the file: all, or at least those of the topics that are named."""
        ...
