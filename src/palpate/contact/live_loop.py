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
from palpate.signals.smoothing import Forward
from palpate.signals.wrench_sensor import Placement, WrenchSensor
from palpate.spatial.arguments import unchecked

__all__: list[str] = []  # for this package alone: arrays are checked where they come in

NO_FILTER = np.zeros((0, 6)), np.zeros((0, 2)), np.zeros(0), np.zeros(1), np.zeros(0)  # as `Forward.constants`
NO_PAST = np.zeros(2), np.zeros((1, 6))


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

    def constants(self, placement: Placement) -> tuple[np.ndarray, ...]:
        """Return the tuple of constant arrays that the loop takes, in its order."""
        ...


class LiveLoop:
    """A loop that locates live samples in one compiled call, with the same results as the separate steps.

    Args:
        sensor: wrench sensor.
        locator: on the surface.
        placement: pose of the surface on the sensor, with its covariance.
        forward: filter of the wrenches; None: none.
    """

    def __init__(
        self, sensor: CompiledSensor, locator: Locator, placement: Placement, forward: Forward | None = None
    ) -> None:
        from palpate.contact import _live  # compiled: loaded when first needed

        self._given, self._time = (sensor, locator, placement, forward), np.zeros(1)
        self._hold, self._pack, self._revision = sensor.hold, _live.packed, -1
        self.inputs = unchecked(sensor.inputs)
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
        self._time[0] = time
        self.run(self._time, rows)

    def run(self, time: np.ndarray, rows: np.ndarray, inputs: np.ndarray | None = None) -> None:
        """Write the contacts of samples at times (n,) [s] into rows (n, width).

        `inputs` are a flat array; None: the sensor's `live_inputs`.
        """
        sensor, _, placement, forward = self._given
        if self._revision != sensor.revision:
            smoothing, past = (NO_FILTER, NO_PAST) if forward is None else (forward.constants, forward.memory)
            packed = self._pack((*sensor.constants(placement), *smoothing))
            self._arguments = *packed, sensor.state, *past, *self._compiled
            self._revision = sensor.revision
            one = sensor.live_inputs, self._time, *self._arguments, np.empty((1, ROW.length))
            self._loop = self._entry.compiled_for(*one)
        self._loop(sensor.live_inputs if inputs is None else inputs, time, *self._arguments, rows)
