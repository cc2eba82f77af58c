"""Model of a sensor's drift, as `palpate calibrate drift` finds it and a rig states it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value


@frozen_value(init=False)
class Drift(Value):
    """A sensor's drift: a random walk of the zero, a rate that decays during warm-up, and an error of the payload.

    In each of m channels, those of a wrench [N, N m] or voltages, the zero b and its rate r follow db = r dt + walk dW
    and dr = -r / settling dt.

    Args:
        walk: (m,) standard deviation of the random walk after one second, in the channel's unit over sqrt(s).
        warm_up: (m,) standard deviation of the rate at the start, in the channel's unit over s; None: 0, no warm-up.
        settling: [s] in which the rate falls to 1/e; inf: it stays.
        weight: [N] standard deviation of the payload's weight from the one that is compensated, if it is larger than
            those of its calibration and of 2 %.
        thermal: (m,) change per kelvin, where a temperature is read; None: 0.
        thermal_deviation: (m,) standard deviation of `thermal`; None: 0.

    Raises:
        InputError: an array is not of m finite numbers, an argument other than `thermal` is negative or NaN, `settling`
            is 0, or `weight` is infinite.
    """

    walk: Float[np.ndarray, " m"]
    warm_up: Float[np.ndarray, " m"]
    settling: float
    weight: float
    thermal: Float[np.ndarray, " m"]
    thermal_deviation: Float[np.ndarray, " m"]

    def __init__(
        self,
        walk: ArrayLike,
        warm_up: ArrayLike | None = None,
        settling: float = np.inf,
        weight: float = 0.0,
        thermal: ArrayLike | None = None,
        thermal_deviation: ArrayLike | None = None,
    ) -> None:
        walks = frozen(walk, name="walk")
        each = {"walk": walks}
        for name, given in (("warm_up", warm_up), ("thermal", thermal), ("thermal_deviation", thermal_deviation)):
            each[name] = frozen(np.zeros(walks.shape) if given is None else given, name=name)
        for name, values in each.items():
            if walks.ndim != 1 or values.shape != walks.shape or not np.isfinite(values).all():
                raise InputError(f"{name} must be {walks.size} finite numbers, one for each channel.", where="drift")
            if name != "thermal" and not np.all(values >= 0):
                raise InputError(f"{name} must not be negative.", where="drift")
            object.__setattr__(self, name, values)
        if not settling > 0:  # NaN too
            raise InputError(f"settling must be a positive time [s], not {settling:g}.", where="drift")
        if not 0 <= weight < np.inf:  # NaN too
            raise InputError(f"weight must be a force of 0 N or more, not {weight:g} N.", where="drift")
        object.__setattr__(self, "settling", float(settling))
        object.__setattr__(self, "weight", float(weight))
