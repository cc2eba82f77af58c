"""What is known to be true: a value, sample by sample or touch by touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

__all__ = ["Samples", "Touches"]


@dataclass(frozen=True)
class Samples:
    """The truth at instants.

    Attributes:
        time: (n,) [s], on the log's clock.
        point: (n, 3) [m] in the frame of the estimates.
        normal: (n, 3) outward, or None.
        force: (n, 3) [N] on the body, or None.
    """

    time: Float[np.ndarray, " n"]
    point: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "n 3"] | None = None
    force: Float[np.ndarray, "n 3"] | None = None


@dataclass(frozen=True)
class Touches:
    """Intervals in which one known point was touched.

    Attributes:
        start: (n,) [s].
        end: (n,) [s], included.
        point: (n, 3) [m] in the frame of the estimates; NaN where the point is not known.
        label: n names.
    """

    start: Float[np.ndarray, " n"]
    end: Float[np.ndarray, " n"]
    point: Float[np.ndarray, "n 3"]
    label: tuple[str, ...]
