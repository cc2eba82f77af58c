"""Model the depth to which a touch sinks into a soft layer."""

from __future__ import annotations

from dataclasses import field

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial._arrays import frozen
from palpate.spatial.arguments import frozen_value


@frozen_value(eq=True)
class Indentation:
    """Depth below the surface of the point at which the force acts, under a soft layer.

    A ball that sinks into the layer transmits its friction below the surface, so that the force acts at c - d n, with c
    the point of the undeformed surface under the ball and

        d = depth |F . n|^exponent        [m], F in newtons.

    Args:
        depth: [m] at 1 N.
        exponent: 1/2 for a ball on an elastic foundation, 2/3 for Hertz.
        covariance: (2, 2) of depth and exponent.

    Raises:
        InputError: depth is not from 0 to below 1 m, or exponent not from 0 to 2; a covariance of another shape.
    """

    depth: float
    exponent: float = 0.5
    covariance: Float[np.ndarray, "2 2"] = field(default_factory=lambda: np.zeros((2, 2)))

    def __post_init__(self) -> None:
        if not (0 <= self.depth < 1 and 0 <= self.exponent <= 2):  # NaN too
            raise InputError(
                f"an indentation cannot have a depth of {self.depth:g} m at 1 N and an exponent of {self.exponent:g}.",
                hint="Use a depth of at least 0 m and less than 1 m, and an exponent from 0 to 2.",
            )
        object.__setattr__(self, "covariance", frozen(self.covariance, tail=(2, 2), name="covariance"))

    def __call__(self, pressing: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Return the depth (*batch) [m] under normal forces |F . n| (*batch) [N]."""
        return self.depth * np.abs(pressing) ** self.exponent
