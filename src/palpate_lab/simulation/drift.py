"""Simulate drifting biases from a seed, by the law that `palpate.signals.drift.Drift` states."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate.spatial._arrays import shaped


def simulate_drift(
    time: ArrayLike, drift: Drift, rng: np.random.Generator, temperature: ArrayLike | None = None
) -> Float[np.ndarray, "n m"]:
    """Simulate the drift of each channel's bias from its value at the first time.

    With W a Wiener process, r0 drawn from a normal law of standard deviation `warm_up`, and k from one of mean
    `thermal` and standard deviation `thermal_deviation`,

        b(t) = walk W(t) + r0 s (1 - exp(-t / s)) + k (T(t) - T(0)),    s = `settling`.

    Times are exact, however uneven. The payload's `weight` is no part of a bias: it turns with the sensor.

    Args:
        time: (n,) [s], not decreasing.
        drift: drift of m channels.
        rng: draws r0, k and then the walk.
        temperature: (n,) [K or deg C]; None: constant.

    Returns:
        (n, m) in the channels' units; zeros in the first row.

    Raises:
        InputError: times that decrease, or another shape.
    """
    when = shaped(time, (None,), "time")
    steps = np.diff(when, prepend=when[:1])
    if not np.all(steps >= 0):  # NaN too
        raise InputError("must not decrease.", where="time")
    channels = len(drift.walk)
    rate = drift.warm_up * rng.standard_normal(channels)
    coefficient = drift.thermal + drift.thermal_deviation * rng.standard_normal(channels)
    walk = np.cumsum(np.sqrt(steps)[:, None] * drift.walk * rng.standard_normal((len(when), channels)), axis=0)
    elapsed = when - when[:1]
    run = elapsed if np.isinf(drift.settling) else -drift.settling * np.expm1(-elapsed / drift.settling)
    zeros = walk + run[:, None] * rate
    if temperature is None:
        return zeros
    kelvin = shaped(temperature, when.shape, "temperature")
    return zeros + (kelvin - kelvin[:1])[:, None] * coefficient
