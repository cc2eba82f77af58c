"""Combine two devices as one source: samples of a skin, each with the mean of the wrenches around it."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from palpate.files.logs.decoding import seconds
from palpate.files.logs.samples import SampleReader
from palpate.files.logs.wrench_means import WrenchMeans
from palpate.live.source import SILENT, Batch, Source, drained, source_of
from palpate.setup.setup import Setup
from palpate.setup.source import RigSource
from palpate.setup.tables import RigOrientation

WAITS = 0.1  # s that a skin's sample waits for the wrenches around its time


class PairedSource:
    """A source of a skin's samples with wrenches: its values, the mean wrench, and the number of readings in the mean.

    A sample waits for wrenches half a step newer, up to 0.1 s; then it is given with the wrenches that have come, or
    NaN.

    Args:
        frames: the source of the skin's samples.
        wrenches: the source of wrenches (6,), force first, stamped by the same clock.
        means: averages the wrenches; not used before.
    """

    dtype: DTypeLike = np.float64
    poses = False  # of ROS 2 come beside any source

    def __init__(self, frames: Source, wrenches: Source, means: WrenchMeans) -> None:
        self._frames, self._wrenches, self._means = frames, wrenches, means
        self.shape: tuple[int, ...] = (int(np.prod(frames.shape)) + 7,)
        self._frame, self._wrench = Batch(frames.shape), Batch((6,))
        self._stamp, self._lost = np.zeros((2, 0), dtype=np.int64)
        self._values = np.zeros((0, self.shape[0] - 7))
        self._since, self._heard, self._quiet = 0.0, 0.0, False
        self._said: list[str] = []

    @classmethod
    def of(cls, stated: RigSource, setup: Setup) -> PairedSource:
        """Return the source of a sensor that combines a skin and a force/torque sensor, not opened yet.

        Raises:
            InputError: the [source], or its `wrench`, does not fit the sensor.
        """
        layout, both = setup.layout(), list[Source]()
        for part, source in zip(setup.kind.parts, (stated, stated.wrench or stated), strict=True):
            sensor = setup.sensors[part]
            # without an orientation, because poses come beside the pair
            alone = replace(setup, kind=sensor.kind, sensors={part: sensor}, orientation=RigOrientation())
            both.append(source_of(replace(source, wrench=None), alone))
        limits = None if layout.wrench_range is None else SampleReader(layout, Path()).recorded(layout.wrench_range)
        return cls(both[0], both[1], WrenchMeans(layout.max_gap, limits))

    def open(self) -> None:
        """Connect to both devices.

        Raises:
            InputError: one of them cannot be opened.
        """
        self._wrenches.open()
        self._frames.open()
        self._heard = time.monotonic()

    def receive(self, batch: Batch, timeout: float) -> int:
        """Fill a batch with samples and their wrenches, and return how many; wait up to `timeout` [s].

        Raises:
            OSError: a device cannot be read.
        """
        self._take(self._frames.receive(self._frame, 0.0 if len(self._stamp) else timeout))
        end = time.monotonic() + min(timeout, WAITS)
        while True:
            if count := self._wrenches.receive(self._wrench, 0.0):
                self._means.add(seconds(self._wrench.stamp[:count]), self._wrench.values[:count].copy())
            ready = self._means.answerable(seconds(self._stamp)) if len(self._stamp) else 0
            if ready or time.monotonic() >= end or not len(self._stamp):
                break
            time.sleep(5e-4)
        if not ready and len(self._stamp) and time.monotonic() - self._since > WAITS:
            ready = len(self._stamp)
        return self._given(batch, min(ready, len(batch)))

    def events(self) -> list[str]:
        """Return the events of both devices since the last call, and of samples without wrenches."""
        return [*drained(self._said), *self._frames.events(), *self._wrenches.events()]

    def close(self) -> None:
        """Disconnect from both devices."""
        self._frames.close()
        self._wrenches.close()

    def _take(self, count: int) -> None:
        if not count:
            return
        if not len(self._stamp):
            self._since = time.monotonic()
        self._stamp = np.concatenate([self._stamp, self._frame.stamp[:count]])
        self._lost = np.concatenate([self._lost, self._frame.lost[:count]])
        self._values = np.concatenate([self._values, self._frame.values[:count].reshape(count, -1)])

    def _given(self, batch: Batch, count: int) -> int:
        """Fill a batch with the first `count` waiting samples and their wrenches."""
        if not count:
            return 0
        time_ = seconds(self._stamp[:count])
        wrenches, averaged = self._means.means(time_)
        self._means.forget(float(time_[-1]))
        batch.stamp[:count], batch.lost[:count] = self._stamp[:count], self._lost[:count]
        batch.arrived = np.full(count, time.time_ns())
        batch.values[:count] = np.column_stack([self._values[:count], wrenches, averaged])
        self._stamp, self._lost, self._values = self._stamp[count:], self._lost[count:], self._values[count:]
        self._since = time.monotonic()
        self._watch(bool(np.isfinite(wrenches).all(axis=1).any()))
        return count

    def _watch(self, found: bool) -> None:
        """Report once that samples stay without wrenches, or have some again."""
        now = time.monotonic()
        if found:
            if self._quiet:
                self._said.append(f"frames have wrenches again, after {now - self._heard:.1f} s")
            self._heard, self._quiet = now, False
        elif now - self._heard > SILENT and not self._quiet:
            self._quiet = True
            self._said.append(
                f"no wrench has the time of a frame for {SILENT:g} s: check that both are stamped by one clock. "
                "Until then forces come from the skin alone"
            )
