"""A contact that lasts and that a skin does not feel: when there is one, and where."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from palpate.contact.estimate import ROW, Status
from palpate.sensors.fused.locator import FusedFrames, FusedLocator

__all__ = ["LastingUnseen", "Place"]

LOOKS = 0.1  # s after which the place of what the skin does not feel is looked for again: that takes milliseconds
PERSISTS = 0.05  # s that something must be unexplained before it is a contact: a touch that begins is felt first


class Place(NamedTuple):
    """A contact that the skin does not feel: as a row but for its force, and as `FusedLocator.rows` has it."""

    row: Float[np.ndarray, " w"]
    contact: Float[np.ndarray, "17"]


class LastingUnseen:
    """Find what the skin does not feel once it is unexplained for 50 ms, at the place that is believed most.

    Args:
        fused: on the surface.
        belief: column of the belief in the place.
        width: of a row.
    """

    def __init__(self, fused: FusedLocator, belief: int, width: int) -> None:
        self._locator, self._belief, self._width = fused, belief, width
        self.reset()

    def reset(self) -> None:
        """Forget what frames left."""
        self._since = self._looked = np.nan  # [s] when the wrench began to be unexplained, and its place was looked for
        self._place: Place | None = None

    def found(
        self,
        time: Float[np.ndarray, " n"],
        reporting: Bool[np.ndarray, " n"],
        usable: Bool[np.ndarray, " n"],
        fused: FusedFrames,
    ) -> dict[int, Place]:
        """Return the place by frame, of frames in which something lasts; it is looked for now and then.

        Args:
            time: [s].
            reporting: frames in which skin or wrench have something to say.
            usable: frames with a wrench.
            fused: what the skin explains of it.
        """
        found = dict[int, Place]()
        for k, now in enumerate(time.tolist()):
            if not reporting[k]:
                self._since = np.nan
            elif usable[k] and self._persists(now, bool(fused.alarm[k])):
                if self._place is None or not now - self._looked < LOOKS:
                    self._place, self._looked = self._looked_for(fused.whitened[k], fused.factors[k]), now
                found[k] = self._place
        return found

    def _persists(self, time: float, alarm: bool) -> bool:
        """Return whether what is unexplained lasts."""
        if not alarm:
            self._since, self._place = np.nan, None
            return False
        if np.isnan(self._since):
            self._since = time
        return time - self._since >= PERSISTS

    def _looked_for(self, whitened: Float[np.ndarray, "6"], factor: Float[np.ndarray, "6 6"]) -> Place:
        places = self._locator.unseen_by(whitened, factor)
        inside, several = places.cluster == 0, int(places.cluster.max()) + 1
        believed = places.belief[inside].sum()
        share, away = places.belief[inside] / believed, places.points[inside] - places.points[0]
        row = np.full(self._width, np.nan)
        row[ROW.point], row[ROW.normal] = places.points[0], places.normals[0]
        row[ROW.covariance] = np.einsum("k,ki,kj->ij", share, away, away).ravel()
        row[ROW.residual], row[ROW.candidates] = 0.0, several
        row[ROW.status] = Status.CONTACT if several == 1 else Status.AMBIGUOUS
        row[self._belief], row[-1] = believed, 0.0
        return Place(row, self._locator.unseen_row(places))
