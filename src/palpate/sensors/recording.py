"""A recording: named channels on one clock, in SI, as a value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool, Float

from palpate.spatial._arrays import frozen

__all__ = ["ACCELERATION", "CELLS", "FORCE", "LARGEST", "ORIENTATION", "POSITION", "TORQUE", "UNSTEADY", "Recording"]

LARGEST = 1e9  # N, N m, m/s^2: what is larger is a fault of the file, and its powers would overflow
FORCE = "force"  # (n, 3) N
TORQUE = "torque"  # (n, 3) N m
ORIENTATION = "orientation"  # (n, 4) quaternion x, y, z, w: sensor in base
POSITION = "position"  # (n, 3) m: of the sensor's origin in the base
CELLS = "cells"  # (n, rows, columns) or (n, k): raw readings of taxels
ACCELERATION = "acceleration"  # (n, 3) m/s^2: of the sensor's origin, in the sensor's frame
UNSTEADY = "unsteady"  # (n, 1) m/s^2: standard deviation, along each axis, of what ACCELERATION leaves out


@dataclass(frozen=True)
class Recording:
    """Channels of one log, sample by sample: what a file or a stream becomes inside.

    Args:
        time: (n,) [s], as recorded: it may repeat, run backwards or be NaN; nothing is sorted or dropped.
        channels: name -> (n, ...) float64, SI. A value that could not be read is NaN. Names used across the house
            are the constants of this module; a sensor with its own channels names them itself.
        frame: the frame in which force and torque are written, "sensor" or "base".
        source: where it came from, for messages and provenance.
        notes: what a reader of the results should know (a gap, unsorted times), one sentence each.
    """

    time: Float[np.ndarray, " n"]
    channels: Mapping[str, Float[np.ndarray, "n ..."]]
    frame: str = "sensor"
    source: str = ""
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        time = frozen(self.time)
        channels = {name: frozen(values) for name, values in self.channels.items()}
        for name, values in channels.items():
            if values.ndim < 2 or len(values) != len(time):
                raise ValueError(f"channel {name!r} has shape {values.shape} for {len(time)} times")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "channels", MappingProxyType(channels))

    def __len__(self) -> int:
        return len(self.time)

    def wrenches(self) -> Float[np.ndarray, "n 6"]:
        """Force [N] and torque [N m] side by side; what is infinite or beyond `LARGEST` is NaN."""
        values = np.concatenate([self.channels[FORCE], self.channels[TORQUE]], axis=1)
        return np.where(np.abs(values) <= LARGEST, values, np.nan)

    def picked(self, rows: slice | Bool[np.ndarray, " n"]) -> Recording:
        """The samples that a slice or a mask picks."""
        channels = {name: values[rows] for name, values in self.channels.items()}
        return replace(self, time=self.time[rows], channels=channels)

    def rate(self) -> float | None:
        """Samples a second, from the steps forward in time that are no gaps; None where there is none."""
        steps = np.diff(self.time)
        steps = steps[steps > 0]
        if not len(steps):
            return None
        return 1.0 / float(np.mean(steps[steps < 1.5 * np.median(steps)]))  # the median alone has the clock's rounding
