"""What is remembered of a run of estimates, however long it gets."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.events import Events, TouchFinder
from palpate.viewer.downsample import Downsample

__all__ = ["RunSummary"]


class RunSummary:
    """Counts of each status, touches, and some of the contacts.

    Attributes:
        samples: of the log, so far; rows: of contacts.
        most: contacts in one sample.
        downsampled: some of the contacts, for a report.
    """

    def __init__(self) -> None:
        self.samples = self.rows = self.most = 0
        self.downsampled, self._finder = Downsample(), TouchFinder()

    @property
    def counts(self) -> Int[np.ndarray, " s"]:
        """(len(Status),) rows of each status."""
        return self.downsampled.statuses

    def touches(self) -> Events:
        """Found so far."""
        return self._finder.touches()

    def add(self, samples: int, found: Contacts) -> None:
        """The contacts of so many more samples, in the surface's frame."""
        self.downsampled.add(found)
        self._finder.add(found)
        self.samples += samples
        self.rows += len(found)
        felt = found.sample[found.located & (found.status <= Status.AMBIGUOUS)]
        if len(felt):
            self.most = max(self.most, int(np.bincount(felt - felt[0]).max()))
