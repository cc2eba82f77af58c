"""An opened log, whatever its format: read in blocks, any number of times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from palpate.sensors.recording import Recording

__all__ = ["Log", "LogContents", "Topic", "Watched"]


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


@dataclass(frozen=True)
class LogContents:
    """What a log holds, as far as it says so before it is read.

    Attributes:
        path: of the log.
        names: column -> (), array of a NumPy file -> the shape of one sample; none where the log has topics.
        topics: of an MCAP file or a bag.
        torn: the sentence that says where the file was cut, as far as it was met.
    """

    path: Path
    names: Mapping[str, tuple[int, ...]]
    topics: tuple[Topic, ...] = ()
    torn: str = ""


@runtime_checkable
class Watched(Protocol):
    """What is read piece by piece while somebody looks on.

    Attributes:
        size: bytes to read in all; `position`: bytes read so far in the running iteration, for who watches.
        torn: after an iteration, the sentence that says where the file was cut; "" where it is whole.
    """

    @property
    def size(self) -> int: ...  # noqa: D102 - said above

    @property
    def position(self) -> int: ...  # noqa: D102 - said above

    @property
    def torn(self) -> str: ...  # noqa: D102 - said above

    def notes(self) -> tuple[str, ...]:
        """What a reader of the results should know of what was read so far, one sentence each."""
        ...


@runtime_checkable
class Log(Watched, Protocol):
    """What every reader gives; `path` is of the file or folder."""

    @property
    def path(self) -> Path: ...  # noqa: D102 - said above

    def contents(self) -> LogContents:
        """What is in it, whatever the layout; only an MCAP file without an index is read for it.

        Raises:
            InputError: it cannot be read.
        """
        ...

    def blocks(self) -> Iterator[Recording]:
        """The samples from the start, in the order of the file, every one once, in pieces as they come.

        Raises:
            InputError: what the layout asks for is not there.
        """
        ...
