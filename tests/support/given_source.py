"""A source of live samples that gives what a test puts into it, and messages as a source of them gives."""

import numpy as np

from palpate.files.messages import MessageBlock, Topic
from palpate.live.source import Batch


def block(topic: str, kind: str, raws: list[bytes], sent: int | np.ndarray = 0) -> MessageBlock:
    """Messages of one topic, in CDR, and when they were sent [ns]."""
    length, nothing = np.array([len(raw) for raw in raws], dtype=np.int64), np.zeros(len(raws), dtype=np.int64)
    topics = {0: Topic(topic, kind, "cdr")}
    return MessageBlock(b"".join(raws), topics, nothing, nothing + sent, np.cumsum(length) - length, length)


class Given:
    """A device that gives what it is told to."""

    dtype = np.float64
    poses = False

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape, self.waiting = shape, list[tuple[int, np.ndarray]]()
        self.missing = dict[int, int]()  # before the sample of that stamp

    def give(self, stamps: np.ndarray, values: np.ndarray) -> None:
        """More samples that wait."""
        self.waiting += list(zip(stamps.tolist(), values, strict=True))

    def open(self) -> None:
        """Nothing."""

    def receive(self, batch: Batch, timeout: float) -> int:
        """All that wait."""
        count = min(len(batch), len(self.waiting))
        for k, (stamp, values) in enumerate(self.waiting[:count]):
            batch.stamp[k], batch.values[k], batch.lost[k] = stamp, values, self.missing.get(stamp, 0)
        self.waiting = self.waiting[count:]
        return count

    def events(self) -> list[str]:
        """Nothing."""
        return []

    def close(self) -> None:
        """Nothing."""
