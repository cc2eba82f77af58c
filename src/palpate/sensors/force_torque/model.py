"""A six-axis force/torque sensor: noise, range, gain error and the frame that it reports in."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from palpate.calls import by_name, called_as
from palpate.errors import InputError
from palpate.signals.noise import NoiseSpectrum
from palpate.signals.recording import LARGEST
from palpate.signals.wrench_sensor import WrenchSensor
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value
from palpate.spatial.shown import one_line
from palpate.spatial.uncertain import noise_covariance

FRAMES = ("sensor", "base")


@called_as("palpate.ForceTorque(noise=(0.02, 0.001))")
@frozen_value(init=False)
class ForceTorque(Value):
    """A six-axis force/torque sensor.

    Args:
        noise: standard deviations of force and torque of one reading [N, N m], or six, or a (6, 6) covariance, force
            first; None: not known.
        limits: (6,) range [N, N m], at which a reading is saturated, inf for none; None: not known.
        frame: of the log's wrenches, "sensor" or "base".
        spectrum: of the noise; None: white.
        gain_error: standard deviation of each entry of the sensor's matrix, as a share: the channels of force err by
            gain_error sqrt(|F|^2 + |M|^2/L^2), and those of torque by L times that, with L of `lever`.
        drift: (6,) standard deviation of the random walk of the bias [N/sqrt(s), N m/sqrt(s)] since the tare or the
            start of the log; None: 0.

    Raises:
        InputError: a shape is wrong, a limit is not positive, the frame is unknown, `noise` is none of its three forms,
            a drift is negative or above 1e9, or gain_error is not in [0, 1).
    """

    noise: Float[np.ndarray, "6 6"] | None
    limits: Float[np.ndarray, "6"] | None
    frame: str
    spectrum: NoiseSpectrum | None
    gain_error: float
    drift: Float[np.ndarray, "6"]

    def __init__(
        self,
        noise: ArrayLike | None = None,
        limits: ArrayLike | None = None,
        frame: str = "sensor",
        spectrum: NoiseSpectrum | None = None,
        gain_error: float = 0.0,
        drift: ArrayLike | None = None,
    ) -> None:
        set_field = object.__setattr__
        set_field(self, "noise", None if noise is None else frozen(noise_covariance(noise)))
        set_field(self, "limits", None if limits is None else frozen(limits, tail=(6,), name="limits"))
        set_field(self, "frame", frame)
        set_field(self, "spectrum", spectrum)
        set_field(self, "gain_error", gain_error)
        set_field(self, "drift", frozen(np.zeros(6) if drift is None else drift, tail=(6,), name="drift"))
        if not np.all((self.drift >= 0) & (self.drift <= LARGEST)):  # NaN too
            raise InputError("drift must be six numbers that are not negative.", where="force_torque")
        if self.limits is not None and not np.all(self.limits > 0):  # NaN too
            raise InputError("every limit must be positive.", where="force_torque", hint="Use inf for no limit.")
        if frame not in FRAMES:
            raise InputError(f"frame must be 'sensor' or 'base', not {frame!r}.", where="force_torque")
        if not 0 <= gain_error < 1:  # NaN too
            raise InputError(f"gain_error must be at least 0 and below 1, not {gain_error:g}.", where="force_torque")

    @property
    def lever(self) -> float:
        """Lever L [m]: torque over force of the ranges, or of the noise where a range is unknown."""
        scale = np.full(6, np.inf) if self.limits is None else self.limits
        if not np.isfinite(scale).all():
            scale = np.ones(6) if self.noise is None else np.sqrt(np.diag(self.noise))
        return float(np.sqrt(np.sum(scale[3:] ** 2) / np.sum(scale[:3] ** 2)))

    def unloaded(self) -> WrenchSensor:
        """Return the sensor without a payload, to be tared, as a `Compensation`."""
        return by_name("palpate.sensors.force_torque.compensation.Compensation")(self)

    def saturated(self, wrenches: Float[np.ndarray, "*batch 6"]) -> Bool[np.ndarray, "*batch"]:
        """Return a mask (*batch,) of readings (*batch, 6) [N, N m], in the sensor frame, at a limit; False for NaN.

        Raises:
            InputError: wrenches has another shape.
        """
        if self.limits is None:
            return np.zeros(wrenches.shape[:-1], dtype=bool)
        return np.any(np.abs(wrenches) >= self.limits, axis=-1)

    def __repr__(self) -> str:
        return one_line(self)
