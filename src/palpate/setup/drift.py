"""The [drift] of a rig: the drift of a sensor's bias, as a person or `palpate calibrate drift` writes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.schema import INFINITE
from palpate.setup.tables import RigPair
from palpate.signals.drift import Drift

MINUTE = 60.0  # s
_DIGITS = 4  # of what is written


@dataclass(frozen=True)
class RigRates(RigPair):
    """A number for the forces and one for the torques, or three each.

    Raises:
        ValueError: one is negative or not finite.
    """

    def __post_init__(self) -> None:
        if not np.all((self.six() >= 0) & (self.six() < inf)):  # NaN too
            raise ValueError("force and torque must not be negative")


@dataclass(frozen=True)
class RigSlopes(RigPair):
    """A number for the forces and one for the torques, or three each, of any sign."""

    def __post_init__(self) -> None:
        pass


Several = tuple[float, ...]


@dataclass(frozen=True)
class RigDrift:
    """Drift of a sensor's bias, as a rig states it; see `palpate.signals.drift.Drift`.

    Values are `{ force = , torque = }` for a force/torque sensor, and for load cells one number for all voltages or a
    list. `walk` [N/sqrt(s), N m/sqrt(s); V/sqrt(s)] is the random walk; `warm_up` [N/min, N m/min; V/min] the standard
    deviation of the rate at the start, which settles within `settle` [s]; `weight` [N] the standard deviation of the
    payload's weight, if it is larger than 2 % and than its calibration states. `thermal` [N/K, N m/K; V/K], with the
    standard deviation `thermal_deviation`, needs `temperature`: the log's column or topic of it.

    Raises:
        ValueError: a value is out of bounds, or `thermal` is stated without `temperature`.
    """

    walk: RigPair | float | Several
    warm_up: RigRates | float | Several = 0.0
    settle: float = field(default=inf, metadata=INFINITE)
    weight: float = 0.0
    thermal: RigSlopes | float | Several = 0.0
    thermal_deviation: RigRates | float | Several = 0.0
    temperature: str | None = None

    def __post_init__(self) -> None:
        for name in ("walk", "warm_up", "thermal_deviation"):
            value = getattr(self, name)
            if not isinstance(value, RigPair) and not np.all(np.asarray(value) >= 0):
                raise ValueError(f"{name} must not be negative")
        if isinstance(self.walk, float) and not self.walk > 0:
            raise ValueError("walk must be positive")
        if not self.settle > 0:
            raise ValueError("settle must be a positive time [s]")
        if not 0 <= self.weight < inf:
            raise ValueError("weight must be a force [N] that is not negative")
        if np.any(self._stated("thermal")) and self.temperature is None:
            raise ValueError("thermal needs temperature, the column or topic of the log that holds it")

    @property
    def of_wrench(self) -> bool:
        """True for the drift of forces and torques, False for that of voltages."""
        return isinstance(self.walk, RigPair)

    def drift(self, channels: int) -> Drift:
        """Return a `Drift` with the rig's values for each channel of the sensor, in SI: rates per second.

        Args:
            channels: number of channels; 6 is a force/torque sensor.

        Raises:
            InputError: the rig states another number of channels, or no force and torque for six.
        """
        if channels == 6 and not self.of_wrench:
            what = "must be { force = ..., torque = ... } for a force/torque sensor."
            raise InputError(what, where="drift.walk", hint=_UNITS)
        return Drift(
            self._channels("walk", channels),
            self._channels("warm_up", channels) / MINUTE,
            self.settle,
            self.weight,
            self._channels("thermal", channels),
            self._channels("thermal_deviation", channels),
        )

    def _stated(self, name: str) -> Float[np.ndarray, " _"]:
        value = getattr(self, name)
        return value.six() if isinstance(value, RigPair) else np.atleast_1d(np.asarray(value, dtype=np.float64))

    def _channels(self, name: str, channels: int) -> Float[np.ndarray, " channels"]:
        stated = self._stated(name)
        if stated.size not in (1, channels):
            said = "force and torque" if isinstance(getattr(self, name), RigPair) else f"{stated.size} numbers"
            hint = f"Write one number, or a list of {channels}."
            raise InputError(f"has {said}, but the sensor has {channels} channels.", where=f"drift.{name}", hint=hint)
        return np.broadcast_to(stated, (channels,)).copy()


_UNITS = "Write it in N/sqrt(s) and N m/sqrt(s), or let `palpate calibrate drift` write it."


def drift_table(drift: Drift, weight: float | None = None, temperature: str | None = None) -> dict[str, Any]:
    """Return the [drift] of a rig as a dict, key -> value with four digits: rates per minute, equal channels as one.

    Args:
        drift: the drift; six channels are those of a wrench.
        weight: [N], in place of the drift's.
        temperature: the log's column or topic of the temperature; None: thermal drift is left out.
    """
    heavy = drift.weight if weight is None else weight
    table: dict[str, Any] = {"walk": _spelled(drift.walk)}
    if drift.warm_up.any():
        table |= {"warm_up": _spelled(MINUTE * drift.warm_up), "settle": _rounded(drift.settling)}
    if heavy:
        table["weight"] = _rounded(heavy)
    if temperature is not None and (drift.thermal.any() or drift.thermal_deviation.any()):
        table |= {"thermal": _spelled(drift.thermal), "thermal_deviation": _spelled(drift.thermal_deviation)}
    return table if temperature is None else {**table, "temperature": temperature}


def _spelled(values: Float[np.ndarray, " m"]) -> float | list[float] | Mapping[str, float | list[float]]:
    if len(values) != 6:
        return _one(values)
    return {"force": _one(values[:3]), "torque": _one(values[3:])}


def _one(values: Float[np.ndarray, " k"]) -> float | list[float]:
    rounded = [_rounded(float(value)) for value in values]
    return rounded[0] if len(set(rounded)) == 1 else rounded


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}") if isfinite(value) else value
