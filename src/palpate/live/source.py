"""What a source of live samples is, whatever the device: it fills a batch, and says what went wrong on the way."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int
from numpy.typing import DTypeLike

__all__ = ["BATCH", "Batch", "Source"]

BATCH = 1024  # samples that a source gives at once, at most
SILENT = 5.0  # s without a sample, after which a source says so


class Batch:
    """Samples as a source gives them; the arrays are filled again and again.

    Attributes:
        stamp: (size,) int64 [ns] since 1970: the time of each: when it arrived, by the kernel where that says so, or as
            its message or log states it.
        arrived: (size,) int64 [ns] since 1970, where that is another time than `stamp`; None: it is not.
        lost: (size,) int64: samples missing just before it, by the device's counter; 0 where it has none.
        values: (size, *shape) as a log of the same rig holds them: a wrench force first, in the rig's units and axes.
        orientation: (size, 4) quaternion x, y, z, w of the sensor in the base, NaN where the source knows none.
        turned: (size,) [rad] rms of the angle by which the orientation may be off because it is old; 0: it is not.
        position: (size, 3) [m].
        acceleration: (size, 3), in the rig's unit, NaN where the source knows none.
    """

    def __init__(self, shape: tuple[int, ...], size: int = BATCH, dtype: DTypeLike = np.float64) -> None:
        self.stamp = np.zeros(size, dtype=np.int64)
        self.arrived: Int[np.ndarray, " size"] | None = None
        self.lost = np.zeros(size, dtype=np.int64)
        self.values = np.zeros((size, *shape), dtype=dtype)
        self.orientation = np.full((size, 4), np.nan)
        self.turned = np.zeros(size)
        self.position = np.full((size, 3), np.nan)
        self.acceleration = np.full((size, 3), np.nan)

    def __len__(self) -> int:
        return len(self.stamp)


@runtime_checkable
class Source(Protocol):
    """A device, or what stands for one. Nothing is opened before `open`; a lost connection is mended by `receive`.

    Attributes:
        shape: of one sample: (6,) of a wrench.
        dtype: of its numbers: float64; uint8 of images.
        poses: whether orientation, position and acceleration are filled too, as far as they are known.
    """

    shape: tuple[int, ...]
    dtype: DTypeLike
    poses: bool

    def open(self) -> None:
        """Connect.

        Raises:
            InputError: there is no such device, no permission, or it is another one; how to mend it.
        """
        ...

    def receive(self, batch: Batch, timeout: float) -> int:
        """Every sample that waits, as many as the batch holds; waits for the first as long as `timeout` [s].

        Returns:
            how many; 0 when none came, or a connection was lost and is not back yet.
        """
        ...

    def events(self) -> list[str]:
        """What happened since this was last asked, one sentence each: a gap, a restart, no samples for 5 s."""
        ...

    def close(self) -> None:
        """Leave the device as it was found; may be called twice, and without `open`."""
        ...
