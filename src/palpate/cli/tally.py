"""What is remembered of a stream of estimates, however long it gets."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from palpate.contact.estimate import ContactEstimate
from palpate.contact.events import Events, TouchFinder
from palpate.contact.plausibility import lines_of_action, never_at_rest, unexplained
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.io.logs import join
from palpate.sensors.recording import Recording
from palpate.viewer.thinned import Thinned

__all__ = ["Tally"]

KEPT = 5_000  # samples of the log, evenly spread, that doubts are raised from


class Tally:
    """Counts of each status, touches, and some of the samples.

    Attributes:
        samples: seen so far.
        thinned: some of the estimates, and how many of each status.
    """

    def __init__(self) -> None:
        self.samples, self.thinned, self._finder = 0, Thinned(), TouchFinder()
        self._stride, self._kept = 1, list[Recording]()

    @property
    def counts(self) -> Int[np.ndarray, " s"]:
        """(len(Status),) of each status."""
        return self.thinned.statuses

    def touches(self) -> Events:
        """Found so far."""
        return self._finder.touches()

    def add(self, block: Recording, found: ContactEstimate) -> None:
        """A block of the log and its contacts in the surface's frame, row for row."""
        self.thinned.add(block.time, found)
        self._finder.add(block.time, found)
        self._kept.append(block.picked(slice(-self.samples % self._stride, None, self._stride)))
        self.samples += len(block)
        while sum(map(len, self._kept)) > 2 * KEPT:  # every second one of those kept stays
            self._kept = [join(self._kept).picked(slice(None, None, 2))]
            self._stride *= 2

    def doubts(self, estimator: WrenchEstimator) -> list[str]:
        """What does not fit: units, bias, mounting.

        Lines of action are judged in the sensor's frame, whose origin a wrong unit draws them to.
        """
        if not self.samples:
            return []
        surface = estimator.locator.surface
        wrenches, _, _ = estimator.contact_wrenches(join(self._kept))
        sensed = wrenches @ estimator.mount.wrench_matrix().T  # saturated ones too: a wrong unit saturates a sensor
        said = [
            lines_of_action(sensed, estimator.mount.apply(surface.centre), surface.size).doubt,
            never_at_rest(sensed, estimator.locator.on),
        ]
        return [*(doubt for doubt in said if doubt), *unexplained(self.counts)]
