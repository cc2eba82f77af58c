"""The protocol of sources of live samples, which fill batches and report what went wrong."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int
from numpy.typing import DTypeLike

__all__ = ["BATCH", "Batch", "Source"]

BATCH = 1024  # samples that a source gives at once, at most
SILENT = 5.0  # s without a sample, after which a source reports it


class Batch:
    """Arrays for samples of a source, which fills the same arrays again in each call.

    Attributes:
        stamp: (size,) int64 [ns] since 1970: time of each sample, as its message or log states it; else its arrival,
            stamped by the kernel if possible.
        arrived: int64 [ns] since 1970: arrival of each sample, if it differs from `stamp`; None: it does not.
        lost: (size,) int64 number of samples missing just before each, by the device's counter; 0 without a counter.
        values: (size, *shape) as a log of the same rig holds them: a wrench force first, in the rig's units and axes.
        orientation: (size, 4) quaternion x, y, z, w of the sensor in the base; NaN if the source knows none.
        turned: (size,) [rad] rms error of the orientation because of its age; 0: it is up to date.
        position: (size, 3) [m] of the sensor in the base; NaN if the source knows none.
        acceleration: (size, 3) of the sensor in its own frame, in the rig's unit; NaN if the source knows none.
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
    """A source of live samples: a device, or a log in place of one.

    `open` connects, and `receive` restores a lost connection.

    Attributes:
        shape: shape of one sample: (6,) for a wrench.
        dtype: type of its numbers: float64, or uint8 for images.
        poses: whether `receive` also fills orientation, position and acceleration, as far as they are known.
    """

    shape: tuple[int, ...]
    dtype: DTypeLike
    poses: bool

    def open(self) -> None:
        """Connect to the device.

        Raises:
            InputError: there is no device of this name, permission is missing, or it is another kind of device.
        """
        ...

    def receive(self, batch: Batch, timeout: float) -> int:
        """Fill a batch with all waiting samples that it has room for; wait up to `timeout` [s] for the first.

        Returns:
            The number of samples; 0 if none came, or a connection was lost and is not restored yet.
        """
        ...

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each: a gap, a restart, no samples for 5 s."""
        ...

    def close(self) -> None:
        """Disconnect and leave the device as it was found; may be called again, or without `open`."""
        ...
