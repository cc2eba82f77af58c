"""Whether a skin and a force/torque sensor belong together: how often their frames disagree."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

__all__ = ["Agreement"]

AGREES = 0.8  # of the frames with a contact may be unexplained before that is a doubt
ENOUGH = 50  # frames with a contact, for doubts


class Agreement:
    """Count the frames with a contact in which skin and wrench disagree."""

    def __init__(self) -> None:
        self._touched = self._unexplained = self._opposed = 0

    def add(
        self,
        forces: Float[np.ndarray, "m 3"],
        frame: Int[np.ndarray, " m"],
        wrenches: Float[np.ndarray, "n 6"],
        touched: Bool[np.ndarray, " n"],
        alarm: Bool[np.ndarray, " n"],
    ) -> None:
        """Count more frames.

        Args:
            forces: [N] of the contacts that the skin feels.
            frame: of each contact.
            wrenches: of the frames.
            touched: frames with a contact and a wrench.
            alarm: frames whose wrench is not that of what the skin feels.
        """
        total = np.zeros((len(wrenches), 3))
        np.add.at(total, frame, forces)
        unexplained = touched & alarm
        opposed = unexplained & (np.sum(total * wrenches[:, :3], axis=1) < 0.0)
        self._touched += int(np.count_nonzero(touched))
        self._unexplained += int(np.count_nonzero(unexplained))
        self._opposed += int(np.count_nonzero(opposed))

    def warnings(self) -> tuple[str, ...]:
        """Return what may be wrong, as a sentence, where most frames disagree."""
        if self._touched < ENOUGH:
            return ()
        if self._opposed > AGREES * self._touched:
            return (
                f"the wrench points against what the skin feels in {self._opposed} of {self._touched} frames with a "
                "contact: is it the reaction (axes, left_handed), or of the other end of the link?",
            )
        if self._unexplained > AGREES * self._touched:
            return (
                f"in {self._unexplained} of {self._touched} frames with a contact the wrench is not that of what the "
                "skin feels: are skin map, surface.pose, clocks and units of one link?",
            )
        return ()
