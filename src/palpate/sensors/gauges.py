"""A six-axis sensor that reads six strain gauges: voltages times a matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.sensors.force_torque import ForceTorque
from palpate.spatial._arrays import frozen

__all__ = ["Gauges", "certified_noise"]


@dataclass(frozen=True, eq=False)
class Gauges:
    """w = G (u - u0), u the six gauges' voltages and u0 what they read unloaded.

    Args:
        matrix: (6, 6) G [N/V, N m/V], force first.
        limits: (6,) range [N, N m].
        volts: largest voltage to either side; inf where it is not known.
        serial: of the sensor.
    """

    matrix: Float[np.ndarray, "6 6"]
    limits: Float[np.ndarray, "6"]
    volts: float = np.inf
    serial: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", frozen(self.matrix, tail=(6, 6), name="matrix"))
        object.__setattr__(self, "limits", frozen(self.limits, tail=(6,), name="limits"))
        if not (np.isfinite(self.matrix).all() and np.linalg.matrix_rank(self.matrix) == 6):
            raise InputError("the matrix of the gauges does not give six numbers.", where="gauges")
        if not (np.all(self.limits > 0) and self.volts > 0):
            raise InputError("ranges must be positive.", where="gauges")

    def wrenches(
        self, voltages: Float[np.ndarray, "*batch 6"], zero: Float[np.ndarray, "6"]
    ) -> Float[np.ndarray, "*batch 6"]:
        """Wrenches [N, N m]; NaN where a gauge is at its largest voltage."""
        full = np.any(np.abs(voltages) >= self.volts, axis=-1, keepdims=True)
        return np.where(full, np.nan, (voltages - zero) @ self.matrix.T)

    def sensor(self, noise: Float[np.ndarray, "6 6"] | Float[np.ndarray, "6"] | None = None) -> ForceTorque:
        """As what a `WrenchEstimator` takes, with its range.

        Args:
            noise: six deviations or a covariance of one reading, such as `certified_noise`.
        """
        return ForceTorque(noise, self.limits)


def certified_noise(errors: Float[np.ndarray, "n 6"], limits: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6 6"]:
    """Covariance [N, N m] of what a sensor errs, from certified load cases.

    Mean outer product about zero: a maker's errors are systematic, and their mean is one of them. With n cases its
    deviations are known to 1/sqrt(2 n).

    Args:
        errors: (n, 6) of full scale, as shares (1 % is 0.01), force first.
        limits: (6,) full scale [N, N m].

    Raises:
        InputError: fewer than seven cases, or numbers missing.
    """
    if len(errors) < 7 or not np.isfinite(errors).all():
        raise InputError(f"{len(errors)} load cases do not tell a covariance of six errors.", mend="Give 7 or more.")
    size = errors * limits
    return size.T @ size / len(size)
