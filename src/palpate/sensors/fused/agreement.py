"""Check, by the share of frames in which they disagree, that a skin and a force/torque sensor fit each other."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

DISAGREES = 0.8  # of the frames with a contact may be unexplained before a warning
ENOUGH = 50  # frames with a contact that a warning needs


class Agreement:
    """Counts of frames with a contact, and of those in which skin and wrench disagree."""

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
            forces: (m, 3) [N] of the contacts that the skin feels.
            frame: (m,) number of each contact's frame.
            wrenches: (n, 6) [N, N m].
            touched: (n,) frames with a contact and a wrench.
            alarm: (n,) frames whose wrench the contacts do not explain.
        """
        total = np.zeros((len(wrenches), 3))
        np.add.at(total, frame, forces)
        unexplained = touched & alarm
        opposed = unexplained & (np.sum(total * wrenches[:, :3], axis=1) < 0.0)
        self._touched += np.count_nonzero(touched)
        self._unexplained += np.count_nonzero(unexplained)
        self._opposed += np.count_nonzero(opposed)

    def warnings(self) -> tuple[str, ...]:
        """Return a warning if over 80 % of at least 50 frames with a contact disagree; else an empty tuple."""
        if self._touched < ENOUGH:
            return ()
        if self._opposed > DISAGREES * self._touched:
            return (
                f"the wrench points against what the skin feels in {self._opposed} of {self._touched} frames with a "
                "contact: check whether it is the reaction (axes, left_handed), or that of the other end of the link",
            )
        if self._unexplained > DISAGREES * self._touched:
            return (
                f"in {self._unexplained} of {self._touched} frames with a contact the wrench does not fit what the "
                "skin feels: check the skin map, surface.pose, clocks and units",
            )
        return ()
