"""How often a wrench is as far off as this one where nothing is unseen: drawn, because forces are not Gaussian.

A chi-square of the distance holds for Gaussian forces. Tangential forces have bounds, errors of a skin and of a place
are proportional to forces that are not known: with it 0.4 to 6 % of touches were "rarer than 1 %", more for one contact
than for five. So wrenches are drawn for the very contacts at hand, from the model that the settings state: tangential
forces uniform in a disc, gains and places normal.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

__all__ = ["Draws"]

_COUNT = 4096
_LIKELY = 0.05  # rough share above which nothing is drawn, and at least _BEYOND times that of an alarm: the rough share
_BEYOND = 5.0  # of a gamma distribution is the smaller one
_TAIL = 0.05  # share of the draws beyond which the tail is taken as exponential


class Draws:
    """Normal and uniform numbers, drawn once, from which wrenches are made.

    Args:
        seed: of them.
        alarm: share of false alarms that is asked for.
    """

    def __init__(self, seed: int, alarm: float) -> None:
        self._likely = max(_LIKELY, _BEYOND * alarm)
        rng = np.random.default_rng([seed, 1])
        table = rng.standard_normal((_COUNT, 13))
        angle, radius = rng.uniform(0.0, 2.0 * np.pi, _COUNT), np.sqrt(rng.uniform(size=_COUNT))
        table[:, 5], table[:, 6] = radius * np.cos(angle), radius * np.sin(angle)
        self._table, self._out = table, np.empty((_COUNT, 6))

    def share(
        self,
        contacts: Float[np.ndarray, "n 17"],
        carries: Bool[np.ndarray, " n"],
        covariance: Float[np.ndarray, "6 6"],
        total: Float[np.ndarray, "16"],
        factor: Float[np.ndarray, "6 6"],
        settings: Float[np.ndarray, "5"],
    ) -> float:
        """Share of drawn wrenches that are further off than one sensor's, given what the closed form left of it."""
        rough = float(total[9])
        if not contacts.size or not rough < self._likely:
            return rough
        from palpate.contact import _fused

        noise = 0.5 * (covariance + covariance.T)
        _fused.split(noise)
        _fused.drawn(contacts, carries, noise, total[:6], factor, settings, self._table, self._out)
        rest = int(_COUNT * _TAIL)
        apart: Float[np.ndarray, " m"] = np.einsum("ni,ni->n", self._out, self._out)
        far: Float[np.ndarray, " t"] = np.sort(apart)[_COUNT - rest :]
        begin = float(far[0])
        if total[6] <= begin:
            return int(np.count_nonzero(apart >= total[6])) / _COUNT
        mean = float(far.mean()) - begin
        return _TAIL * float(np.exp(-(total[6] - begin) / mean)) if mean > 0.0 else 0.0
