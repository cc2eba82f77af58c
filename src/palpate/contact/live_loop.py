"""Locate live samples, from reading to contact, in one compiled call."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.calls import by_name
from palpate.contact.estimate import ROW
from palpate.contact.locate import Locator
from palpate.signals.wrench_sensor import Measured, Placement, WrenchSensor

__all__: list[str] = []  # for this package alone: arrays are checked where they come in


@runtime_checkable
class CompiledSensor(WrenchSensor, Protocol):
    """A wrench sensor with a compiled loop that turns its readings into rows.

    Attributes:
        loop: module and name of the loop; "" for a sensor without one.
        live_inputs: inputs of one live sample.
        state: state that one sample leaves to the next.
        revision: a number that changes if `constants` does.
    """

    loop: str
    live_inputs: Float[np.ndarray, " _"]
    state: Float[np.ndarray, " _"]
    revision: int

    def hold(self, time: float, reading: ArrayLike, rotation: ArrayLike | None, acceleration: ArrayLike | None) -> None:
        """Write the inputs of one sample at a time [s] into `live_inputs`."""
        ...

    def inputs(
        self,
        time: Float[np.ndarray, " n"],
        readings: Float[np.ndarray, "n m"],
        extra_channels: Mapping[str, np.ndarray],
    ) -> Float[np.ndarray, " _"]:
        """Return the inputs of n samples as a flat array, one kind after the other."""
        ...

    def measured(self, time: Float[np.ndarray, " n"], inputs: Float[np.ndarray, " _"]) -> Measured:
        """Return the samples of `inputs`, at times (n,) [s], as `Measured`."""
        ...

    def constants(self, placement: Placement) -> tuple[np.ndarray, ...]:
        """Return the tuple of constant arrays that the loop takes, in its order."""
        ...


class LiveLoop:
    """A loop that locates live samples in one compiled call, with the same results as the separate steps.

    Args:
        sensor: wrench sensor.
        locator: on the surface.
        placement: pose of the surface on the sensor, with its covariance.
    """

    def __init__(self, sensor: CompiledSensor, locator: Locator, placement: Placement) -> None:
        from palpate.contact import _live  # compiled: loaded when first needed

        self._given = sensor, locator, placement
        self._hold, self._pack, self._revision = sensor.hold, _live.packed, -1
        self._entry = by_name(sensor.loop)
        self._compiled = locator.compiled(known=sensor.noise is not None)

    def __reduce__(self) -> tuple[Any, ...]:
        return LiveLoop, self._given  # the surface prepares its tree anew

    def single(
        self,
        time: float,
        reading: ArrayLike,
        rotation: ArrayLike | None,
        acceleration: ArrayLike | None,
        rows: Float[np.ndarray, "1 width"],
    ) -> None:
        """Write the contact of one sample at a time [s] into rows (1, width), laid out as `ROW`."""
        self._hold(time, reading, rotation, acceleration)
        self.run(rows)

    def run(self, rows: np.ndarray, inputs: np.ndarray | None = None) -> None:
        """Write the contacts of inputs (a flat array; None: the sensor's `live_inputs`) into rows (n, width)."""
        sensor, _, placement = self._given
        if self._revision != sensor.revision:
            packed = self._pack(sensor.constants(placement))
            self._arguments = *packed, sensor.state, *self._compiled
            self._revision = sensor.revision
            self._loop = self._entry.compiled_for(sensor.live_inputs, *self._arguments, np.empty((1, ROW.length)))
        self._loop(sensor.live_inputs if inputs is None else inputs, *self._arguments, rows)
