"""Ground truth of contacts from another source: at instants, or for each touch."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial._arrays import frozen
from palpate.spatial.arguments import frozen_value


@frozen_value
class TrueSamples:
    """True contacts at instants.

    Attributes:
        time: (n,) [s], on the log's clock.
        point: (n, 3) [m] in the frame of the estimates.
        normal: (n, 3) outward, or None.
        force: (n, 3) [N] on the body, or None.

    Raises:
        InputError: arrays of other or different shapes.
    """

    time: Float[np.ndarray, " n"]
    point: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "n 3"] | None = None
    force: Float[np.ndarray, "n 3"] | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None:
                object.__setattr__(self, name, frozen(value))


@frozen_value
class TrueTouches:
    """Intervals in which one known point was touched.

    Attributes:
        start: (n,) [s].
        end: (n,) [s], included.
        point: (n, 3) [m] in the frame of the estimates.
        label: n names.

    Raises:
        InputError: arrays of other or different shapes.
    """

    start: Float[np.ndarray, " n"]
    end: Float[np.ndarray, " n"]
    point: Float[np.ndarray, "n 3"]
    label: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in ("start", "end", "point"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.label)
