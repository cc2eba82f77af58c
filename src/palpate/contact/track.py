"""Which touch is which: identities that stay while touches move, come close and part."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

__all__ = ["Tracker"]


class Tracker:
    """Gives touches their identities, from the nearest pair on, by where each would be by now.

    Distances are those in space, so that a seam of the sheet is no gap. A touch that is lost keeps its identity for
    `patience`: two that merge for a moment part under their own names.

    Args:
        reach: [m] that a touch may be off from one frame to the next.
        speed: [m/s] that it may move beside that.
        patience: [s] that a lost touch is waited for.
    """

    def __init__(self, reach: float = 0.012, speed: float = 0.5, patience: float = 0.3) -> None:
        from palpate.contact import _track  # compiled: loaded when first needed

        self._follow = _track.follow
        self.reach, self.speed, self.patience = reach, speed, patience
        self._tracks = np.full((_track.TRACKS, _track.TRACK), -1.0)
        self._following = np.zeros(1, dtype=np.int64)
        self._identity = np.zeros(_track.TRACKS, dtype=np.int64)

    def reset(self) -> None:
        """Forget all touches; identities go on."""
        self._tracks[:] = -1.0

    def follow(self, time: float, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Identities of the touches of one frame; a view that the next call overwrites.

        Args:
            time: [s]; where it runs backwards or is missing, tracks that are not near in time are given up.
            points: (n, 3) [m], at most 64.
        """
        count = len(points)
        self._follow(
            time, points, count, self._tracks, self._following, self.reach, self.speed, self.patience, self._identity
        )
        return self._identity[:count]
