"""Sources of live samples, and simulated devices: their protocols, the batch that a source fills, a rig's source."""

from __future__ import annotations

from collections.abc import MutableSequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import DTypeLike

from palpate.calls import by_name
from palpate.setup.setup import Setup
from palpate.setup.source import RigSource

SOURCES = {
    "netft": "palpate.live.netft.NetFt",
    "serial": "palpate.live.serial.SerialPort",
    "ros2": "palpate.live.ros2.RosTopics",
    "camera": "palpate.live.camera.CameraSource",
    "replay": "palpate.live.replay.Replay",
}
"""Kind of [source] in a rig -> the class, whose `of` makes a source. A new row serves every command."""

BATCH = 1024  # samples that a source gives at once, at most
SILENT = 5.0  # s without a sample, after which a source reports it


class Batch:
    """Arrays for samples, which a source fills again in each call.

    Attributes:
        stamp: (size,) int64 [ns] since 1970: time of each sample by its message or log, else of its arrival.
        arrived: (size,) int64 [ns] since 1970: arrival of each sample; `stamp` itself until `arrive` states another.
        lost: (size,) int64 number of samples missing just before each, by the device's counter.
        values: (size, *shape) as in a log of the same rig: a wrench force first, in the rig's units and axes.
        orientation: (size, 4) quaternion x, y, z, w of the sensor in the base; NaN if unknown.
        turned: (size,) [rad] rms error of the orientation because of its age.
        position: (size, 3) [m] of the sensor in the base; NaN if unknown.
        acceleration: (size, 3) of the sensor in its own frame, in the rig's unit; NaN if unknown.
    """

    def __init__(self, shape: tuple[int, ...], size: int = BATCH, dtype: DTypeLike = np.float64) -> None:
        self.stamp = np.zeros(size, dtype=np.int64)
        self.arrived: Int[np.ndarray, " size"] = self.stamp
        self.lost = np.zeros(size, dtype=np.int64)
        self.values = np.zeros((size, *shape), dtype=dtype)
        self.orientation = np.full((size, 4), np.nan)
        self.turned = np.zeros(size)
        self.position = np.full((size, 3), np.nan)
        self.acceleration = np.full((size, 3), np.nan)

    def __len__(self) -> int:
        return len(self.stamp)

    def arrive(self, count: int, now: int) -> None:
        """Set the arrival of the first `count` samples to a time [ns] since 1970, which is not their stamp."""
        if self.arrived is self.stamp:
            self.arrived = np.zeros_like(self.stamp)
        self.arrived[:count] = now


@runtime_checkable
class Source(Protocol):
    """A source of live samples: a device, or a log in place of one.

    Attributes:
        shape: shape of one sample: (6,) for a wrench.
        dtype: type of its numbers: float64, or uint8 for images.
        poses: whether `receive` also fills orientation and position.
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
        """Fill a batch with waiting samples and return their number; wait up to `timeout` [s] for the first.

        It is 0 if none came, as while a lost connection is not restored.

        Raises:
            InputError: a replayed log cannot be read.
            OSError: the device cannot be read.
        """
        ...

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each: a gap, a restart, no samples for 5 s."""
        ...

    def close(self) -> None:
        """Disconnect and leave the device as it was found; may be called again, or without `open`."""
        ...


@runtime_checkable
class CountingSource(Protocol):
    """A source whose sender counts its samples, so that one in a later process finds how many came in between."""

    @property
    def late(self) -> int:
        """Number of samples that were counted as lost and arrived later."""
        ...

    @property
    def unknown(self) -> int:
        """Number of times that samples were missing whose number no counter tells."""
        ...

    def position(self) -> tuple[int, ...]:
        """Return the counters at the last sample received, at most seven integers; () before the first."""
        ...

    def resume(self, position: tuple[int, ...]) -> None:
        """Count the samples missing since an earlier source's position as lost before the next one.

        Call it after `open`, before the first `receive`.
        """
        ...


@runtime_checkable
class PunctualSource(Source, Protocol):
    """A source whose next sample has a known time, so that one process can receive several of them."""

    def begin(self, at: float) -> None:
        """Let the first sample come at a time [s] by `time.monotonic`; that of `open` otherwise."""
        ...

    def due(self) -> float:
        """Return when the next sample comes [s], by `time.monotonic`; inf: none comes any more."""
        ...


def source_of(stated: RigSource, setup: Setup) -> Source:
    """Return the source that a rig's [source] states, not opened yet; a camera is opened at once.

    Args:
        stated: the [source].
        setup: the link and its sensors. A combined sensor gets a source that pairs the samples of its parts; one of
            wrenches, whose [acceleration] names a topic, samples with the accelerations of this topic of ROS 2.

    Raises:
        InputError: the source does not fit the sensor, or cannot be made.
    """
    if stated.kind == "replay":
        return by_name(SOURCES[stated.kind]).of(stated, setup)
    felt = setup.acceleration.topic is not None and setup.acceleration.recorded
    if felt and setup.layout().wrench is not None:
        return by_name("palpate.live.imu_source.ImuSource").of(stated, setup)
    paired = "palpate.live.paired_source.PairedSource"
    return by_name(paired if setup.kind.parts else SOURCES[stated.kind]).of(stated, setup)


def drained(sentences: MutableSequence[str]) -> list[str]:
    """Return a copy of a list of sentences, and clear the list itself."""
    taken = list(sentences)
    sentences.clear()
    return taken


@runtime_checkable
class Device(Protocol):
    """A simulated device, which sends given samples by the protocol of the real one."""

    def open(self) -> str:
        """Begin to listen, and return the [source] of a rig that reaches the device, as TOML.

        Raises:
            InputError: the port or file is taken, or may not be used.
        """
        ...

    def send(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> int:
        """Send samples to the listeners that requested them, and return how many were sent; 0 while nobody listens.

        Args:
            stamp: (n,) [ns] time of each sample in the log.
            values: (n, k) in SI units and in the sensor's axes; a wrench has its force first.
        """
        ...

    def close(self) -> None:
        """Stop the device; calling it again does nothing."""
        ...
