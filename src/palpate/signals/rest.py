"""Test whether a window of samples is unloaded and steady, and return its mean."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.signals.noise import estimate_noise
from palpate.spatial.arguments import frozen_value, takes_arrays

FEWEST = 10  # samples
SCATTER = 3.0  # times the noise: a motor that hums is at rest, an arm that moves with its load is not
DRIFT = 5.0  # standard errors between the halves, and at least
LEAST_DRIFT = 1.0  # times the noise: sensors warm up


@frozen_value
class RestReading:
    """Mean of a steady window of wrenches.

    Attributes:
        mean: (6,) [N, N m].
        deviation: (6,) standard deviation of one sample.
        samples: number of samples.
    """

    mean: Float[np.ndarray, "6"]
    deviation: Float[np.ndarray, "6"]
    samples: int

    @property
    def sentence(self) -> str:
        """Sentence on the wrench that a tare subtracts."""
        force, torque = _sizes(self.mean)
        return f"tare over {self.samples} samples: {force:.3g} N and {torque:.3g} N m are subtracted from now on"


@takes_arrays
def at_rest(wrenches: Float[np.ndarray, "n 6"], noise: Float[np.ndarray, "6 6"] | None, where: str) -> RestReading:
    """Return the mean of wrenches at rest, as a `RestReading`.

    Args:
        wrenches: (n, 6) [N, N m]; NaN where a sample is unusable.
        noise: (6, 6) covariance of one reading; None: from the wrenches.
        where: source of the wrenches, for messages.

    Raises:
        InputError: fewer than 10 usable samples, or the wrenches change by more than noise; or arrays of other shapes.
    """
    usable = wrenches[np.isfinite(wrenches).all(axis=1)]
    if len(usable) < FEWEST:
        raise InputError(
            f"a tare needs at least {FEWEST} usable samples, and has {len(usable)}.",
            where=where,
            hint="Let the log begin untouched, with an orientation if there is a payload; or tare over a longer time.",
        )
    deviation = usable.std(axis=0)
    seen = estimate_noise(usable) if noise is None else None
    known = deviation if seen is None else seen.deviation
    sigma = known if noise is None else np.sqrt(np.diag(noise))
    first, second = np.array_split(usable, 2)
    drift = np.abs(second.mean(axis=0) - first.mean(axis=0))
    allowed = np.maximum(DRIFT * sigma * 2.0 / np.sqrt(len(usable)), LEAST_DRIFT * sigma)
    _require_less("scatters by", deviation, SCATTER * sigma, sigma, where)
    _require_less("changes between the two halves by", drift, allowed, sigma, where)
    return RestReading(usable.mean(axis=0), deviation, len(usable))


def _require_less(what: str, seen: np.ndarray, allowed: np.ndarray, sigma: np.ndarray, where: str) -> None:
    if np.all(seen <= allowed + 1e-12 * np.abs(seen)):
        return
    (force, torque), (noise, twist) = _sizes(seen), _sizes(sigma)
    raise InputError(
        f"the sensor was not at rest during the tare: the wrench {what} {force:.3g} N and {torque:.3g} N m, "
        f"and its noise is {noise:.3g} N and {twist:.3g} N m.",
        where=where,
        hint="Keep the robot still and untouched during the tare, leave the tare out, or state a larger noise.",
    )


def _sizes(wrench: Float[np.ndarray, "6"]) -> tuple[float, float]:
    return float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
