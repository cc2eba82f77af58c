"""Combine two devices as one source: samples of a skin, each with the mean of the wrenches around it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.files.logs.decoding import seconds
from palpate.files.logs.samples import SampleReader
from palpate.files.logs.wrench_means import WrenchMeans
from palpate.live.source import Batch, Source, source_of
from palpate.live.waiting_source import WaitingSource
from palpate.setup.setup import Setup
from palpate.setup.source import RigSource
from palpate.setup.tables import RigOrientation

_WHAT = (
    "wrench has the time of a frame",
    "check that both are stamped by one clock. Until then forces come from the skin alone",
    "frames have wrenches",
)


class PairedSource(WaitingSource):
    """A source of a skin's samples with wrenches: its values, the mean wrench, and the number of readings in the mean.

    A sample waits for wrenches half a step newer, up to 0.1 s; then it is given with the wrenches that have come, or
    NaN.

    Args:
        frames: the source of the skin's samples.
        wrenches: the source of wrenches (6,), force first, stamped by the same clock.
        means: averages the wrenches; not used before.
    """

    def __init__(self, frames: Source, wrenches: Source, means: WrenchMeans) -> None:
        super().__init__(frames, _WHAT)
        self._wrenches, self._means = wrenches, means
        self.shape = (int(np.prod(frames.shape)) + 7,)
        self._wrench = Batch((6,))

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
        super().open()

    def events(self) -> list[str]:
        """Return the events of both devices since the last call, and of samples without wrenches."""
        return [*super().events(), *self._wrenches.events()]

    def close(self) -> None:
        """Disconnect from both devices."""
        super().close()
        self._wrenches.close()

    def _listen(self) -> None:
        if count := self._wrenches.receive(self._wrench, 0.0):
            self._means.add(seconds(self._wrench.stamp[:count]), self._wrench.values[:count].copy())

    def _answerable(self, time: Float[np.ndarray, " n"]) -> int:
        return self._means.answerable(time)

    def _join(self, batch: Batch, time: Float[np.ndarray, " n"], values: np.ndarray) -> bool:
        wrenches, averaged = self._means.means(time)
        self._means.forget(float(time[-1]))
        batch.values[: len(time)] = np.column_stack([values.reshape(len(time), -1), wrenches, averaged])
        return bool(np.isfinite(wrenches).all(axis=1).any())
