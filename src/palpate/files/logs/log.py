"""Define the interface of logs, which can be read in blocks, any number of times."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.files.inputs import Watched
from palpate.files.messages import Topic
from palpate.files.tables.stated import Stated
from palpate.signals.recording import CELLS, Recording

Stored = tuple[Float[np.ndarray, " n"], np.ndarray]  # times [s], and frames (n, k) as they are stored


@dataclass(frozen=True)
class Images:
    """A video or a folder of images.

    Attributes:
        size: height, width, channels of the first image; 0, 0, 0 if unknown.
        count: number of images, as a video announces it; 0 if unknown.
        rate: [Hz] of a video; None if unknown.
        codec: four characters of a video; suffixes of a folder.
    """

    size: tuple[int, int, int]
    count: int
    rate: float | None
    codec: str


@dataclass(frozen=True)
class LogContents:
    """The contents of a log, as far as they are known before its samples are read.

    Attributes:
        path: of the log.
        names: column -> (), array -> shape of one sample; empty for other logs.
        topics: of an MCAP file or a bag.
        torn: sentence on where the file was cut, as far as it was read, or "".
        duration: [s] of a log with topics; 0 if unknown.
        stated: units and rate of a table.
        written: how a text differs from a plain table, or "".
        images: of a video or a folder of images.
        poses: of a second table, which has the poses; None: there is none.
    """

    path: Path
    names: Mapping[str, tuple[int, ...]]
    topics: tuple[Topic, ...] = ()
    torn: str = ""
    duration: float = 0.0
    stated: Stated = field(default_factory=Stated)
    written: str = ""
    images: Images | None = None
    poses: LogContents | None = None


class Log(Watched, ABC):
    """An opened log.

    Attributes:
        pose_log: table of the poses, if it is another one.
        block_rows: rows of a block of a log of topics, at most.
        block_bytes: bytes of messages of all topics in which a block lies, about: logs of several sensors in one file
            are then read side by side.
    """

    pose_log: Log | None = None
    block_rows = 1 << 13
    block_bytes = inf

    @abstractmethod
    def contents(self) -> LogContents:
        """Return what is known of the log before its samples are read, whatever the layout.

        Raises:
            InputError: the log cannot be read, or needs a library that is not installed.
        """

    @abstractmethod
    def blocks(self) -> Iterator[Recording]:
        """Yield the samples from the start, in the order of the file, each once, in recordings of any length.

        Raises:
            InputError: the log cannot be read, or lacks something that the layout requests.
        """

    @property
    def time_unit(self) -> tuple[str, str]:
        """Unit in which the times of a table were read, and a remark if it was judged from them; "" if not known."""
        return "", ""

    def stored(self) -> Iterator[Stored]:
        """Yield times (n,) [s] and frames (n, k) of taxels, in their stored type where that is faster.

        Raises:
            InputError: the log cannot be read, or lacks something that the layout requests.
            KeyError: the layout requests no taxels.
        """
        for block in self.blocks():
            yield block.time, block.channels[CELLS].reshape(len(block), -1)

    def merged_with(self, frames: Log) -> Iterator[Recording | Stored]:
        """Yield the `blocks` of this log and the `stored` of `frames`, the same file in another layout.

        Items are recordings, or pairs of times (n,) [s] and frames (n, k).

        Raises:
            InputError: the file cannot be read, or lacks something that one of the layouts requests.
        """
        yield from self.blocks()
        yield from frames.stored()
