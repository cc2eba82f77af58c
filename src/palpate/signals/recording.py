"""A recording: named channels on one clock, in SI, as a value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool, Float, UInt8
from numpy.typing import ArrayLike, DTypeLike

from palpate.calls import called_as
from palpate.errors import InputError

LARGEST = 1e9  # N, N m, m/s^2: what is larger is a fault of the file, and its powers would overflow
FORCE = "force"  # (n, 3) N
TORQUE = "torque"  # (n, 3) N m
ORIENTATION = "orientation"  # (n, 4) quaternion x, y, z, w: sensor in base
POSITION = "position"  # (n, 3) m: of the sensor's origin in the base
ACCELERATION = "acceleration"  # (n, 3) m/s^2: of the sensor's origin, in the sensor's frame
UNSTEADY = "unsteady"  # (n, 1) m/s^2: standard deviation, along each axis, of what ACCELERATION leaves out
VIBRATION = "vibration"  # (n, 1) number of the covariance by which an arm vibrates, which the sensor keeps; 0: none
AVERAGED = "averaged"  # (n, 1) readings of the wrench of which FORCE and TORQUE are the mean; 0: interpolated
TEMPERATURE = "temperature"  # (n, 1) K or degrees C: of the sensor, of which only changes matter
VOLTAGE = "voltage"  # (n, 3 k) V: of load cells, cell by cell x, y, z
CELLS = "cells"  # (n, rows, columns) or (n, k): raw readings of taxels
REFERENCE = "reference"  # (n, 6), (n, 3) or (n, 1) of a bench: force or weight [N], then centre or place [m]
IMAGE = "image"  # (n, height, width, 3) uint8, blue, green, red: all zero where a frame could not be read

_SHAPES: Mapping[str, tuple[int, ...]] = {  # of one sample, where it is always the same
    FORCE: (3,),
    TORQUE: (3,),
    ORIENTATION: (4,),
    POSITION: (3,),
    ACCELERATION: (3,),
    UNSTEADY: (1,),
    VIBRATION: (1,),
    AVERAGED: (1,),
    TEMPERATURE: (1,),
}


@called_as('palpate.Recording(time, {"force": force, "torque": torque})')
@dataclass(frozen=True, eq=False)
class Recording:
    """Channels of one log, sample by sample.

    All arrays are float64 (of `IMAGE` uint8), contiguous by rows, and read-only. Arrays given in this form are used
    without a copy.

    Args:
        time: (n,) [s], as recorded: it may repeat, run backwards or be NaN.
        channels: name -> (n, ...), SI; NaN where a value could not be read. Names used across Palpate are the constants
            of this module.
        frame: the frame of force and torque, "sensor" or "base".
        source: where it came from, for messages and provenance.
        notes: remarks on the log (a gap, unsorted times), one sentence each.

    Raises:
        InputError: a channel is not of real numbers, does not have one row for each time, or does not have the shape
            that its name requires.
    """

    time: Float[np.ndarray, " n"]
    channels: Mapping[str, Float[np.ndarray, "..."] | UInt8[np.ndarray, "..."]]
    frame: str = "sensor"
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        time = sealed(self.time)
        channels = {name: sealed(values, dtype=_dtype(name, values)) for name, values in self.channels.items()}
        for name, values in {"time": time, **channels}.items():
            shape = () if values is time else _SHAPES.get(name, values.shape[1:])
            if name == IMAGE and (values.ndim != 4 or values.shape[3] != 3 or values.dtype != np.uint8):
                self._refuse(name, values, "n x height x width x 3 of uint8")
            if values.shape != (time.size, *shape):
                self._refuse(name, values, f"{' x '.join(map(str, ('n', *shape)))}, for n = {time.size} times")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "channels", MappingProxyType(channels))

    def _refuse(self, name: str, values: np.ndarray, wanted: str) -> None:
        kind = f" of {values.dtype}" if name == IMAGE else ""
        raise InputError(
            f"channel {name!r} has the shape {values.shape}{kind}; it must be {wanted}.", where=self.source
        )

    def __reduce__(self) -> tuple[type[Recording], tuple[object, ...]]:
        """Pickle channels as a dict, as a read-only view cannot be pickled."""
        return Recording, (self.time, dict(self.channels), self.frame, self.source, self.notes)

    def __len__(self) -> int:
        return len(self.time)

    def wrenches(self) -> Float[np.ndarray, "n 6"]:
        """Return force [N] and torque [N m], (n, 6); NaN where a value is infinite or beyond `LARGEST`.

        Raises:
            InputError: the recording has no force or no torque.
        """
        if not {FORCE, TORQUE} <= set(self.channels):
            there = ", ".join(self.channels) or "only the time"
            raise InputError(f"force and torque are needed, and there is {there}.", where=self.source)
        values = np.concatenate([self.channels[FORCE], self.channels[TORQUE]], axis=1)
        return np.where(np.abs(values) <= LARGEST, values, np.nan)

    def picked(self, rows: slice | Bool[np.ndarray, " n"]) -> Recording:
        """Return the `Recording` of the samples that a slice or a mask (n,) picks.

        Raises:
            IndexError: the mask has another length.
        """
        channels = {name: sealed(values[rows], own=True, dtype=values.dtype) for name, values in self.channels.items()}
        return replace(self, time=sealed(self.time[rows], own=True), channels=channels)

    def first(self, seconds: float) -> Recording:
        """Return the `Recording` of the samples of the first `seconds` [s].

        Raises:
            InputError: the recording has no times.
        """
        known = self.time[np.isfinite(self.time)]
        if not len(known):
            hint = "Name the column of times, or state rate, in the rig's [time]."
            raise InputError("has no times, so its first seconds cannot be found.", where=self.source, hint=hint)
        return self.picked(self.time <= known[0] + seconds)

    def rate(self) -> float | None:
        """Return the rate [Hz] by the mean forward step, without gaps; None if time never increases."""
        steps = np.diff(self.time)
        steps = steps[steps > 0]
        if not len(steps):
            return None
        return 1.0 / float(np.mean(steps[steps < 1.5 * np.median(steps)]))  # the median alone has the clock's rounding

    def __repr__(self) -> str:
        known = self.time[np.isfinite(self.time)]
        span = f", {known.min():.3f} to {known.max():.3f} s" if len(known) else ""
        source = f", from {self.source!r}" if self.source else ""
        return f"Recording({len(self):,} samples{span}: {', '.join(self.channels) or 'no channels'}{source})"


def split_channels(names: Sequence[str], readings: np.ndarray) -> dict[str, np.ndarray]:
    """Split readings (n, ...) into a dict of name -> channel (n, ...), such as force and torque from (n, 6).

    One channel whose name does not fix its width, such as cells, gets the columns that the others leave.
    """
    if len(names) == 1:
        return {names[0]: readings}
    widths = [_SHAPES[name][0] if name in _SHAPES else 0 for name in names]
    widths = [width or readings.shape[1] - sum(widths) for width in widths]
    ends = np.cumsum(widths)
    return dict(zip(names, np.split(readings, ends[:-1], axis=1), strict=True))


def _dtype(name: str, values: ArrayLike) -> DTypeLike:
    """Return the type of a channel: images keep their own."""
    return getattr(values, "dtype", np.uint8) if name == IMAGE else np.float64


def sealed(
    values: ArrayLike, *, own: bool = False, dtype: DTypeLike = np.float64
) -> Float[np.ndarray, "..."] | UInt8[np.ndarray, "..."]:
    """Return a read-only array, contiguous by rows: `values` itself if it is one, else a copy.

    Args:
        values: numbers.
        own: nothing else refers to `values`, so that a writable array is sealed without a copy.
        dtype: of the array.

    Raises:
        InputError: the values are not real numbers, or not an array.
    """
    try:
        array = np.asarray(values)
    except ValueError as problem:  # lists of different lengths
        raise InputError(f"values of a recording must be an array of numbers: {problem}.") from problem
    if array.size and array.dtype.kind not in "biuf":
        raise InputError(f"values of a recording must be real numbers, not {array.dtype} of shape {array.shape}.")
    copied = None if own or not array.flags.writeable else True  # None: where it must be
    array = np.array(array, dtype=dtype, order="C", copy=copied)
    array.flags.writeable = False
    return array
