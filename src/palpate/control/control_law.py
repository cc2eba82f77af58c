"""What every law of motion in contact is given, and what it answers: the two that are there walk one loop."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

__all__ = ["MotionLaw", "Sensed"]


class Sensed:
    """What is known at a reading; one object, written anew each time.

    Attributes:
        time: [s] of the reading.
        rotation: (3, 3) the axes of the probe's face in the base.
        tip: (3,) [m] the middle of the face in the base.
        place: (3,) [m] the contact, off the middle, in the face's axes.
        variance: (2,) [m^2] of its first two, by the noise of the reading.
        force: (3,) [N] of the environment on the probe, in the face's axes; pressing is force[2] < 0.
    """

    def __init__(self) -> None:
        self.time = 0.0
        self.rotation, self.tip = np.eye(3), np.zeros(3)
        self.place, self.variance, self.force = np.zeros(3), np.zeros(2), np.zeros(3)


@runtime_checkable
class MotionLaw(Protocol):
    """How a probe that touches is to move.

    Steps are (6,), translation of the tip [m] then rotation vector [rad], in base axes: e of (9) in `probe`.
    """

    delay: float
    """[s] from a command to the motion; the loop sets it."""

    radii: Float[np.ndarray, " 2"]
    """[m/rad] by how much the contact moves for an angle, along the face and across."""

    ready: bool
    """Whether what it needs to know for `hold` is known."""

    def start(self, seen: Sensed) -> None:
        """The first reading of a touch."""
        ...

    def observe(self, seen: Sensed) -> None:
        """Each reading that was located, from the first on."""
        ...

    def keep(self) -> None:
        """What was observed so far was seen from where the robot was said to be: its feedback agrees."""
        ...

    def forget(self) -> None:
        """What was observed since was not: a command never reached the robot."""
        ...

    def press(self, seen: Sensed, period: float, out: Float[np.ndarray, " 6"]) -> None:
        """The step of one period [s] until it is ready."""
        ...

    def hold(
        self,
        time: float,
        rotation: Float[np.ndarray, "3 3"],
        tip: Float[np.ndarray, " 3"],
        period: float,
        out: Float[np.ndarray, " 6"],
    ) -> None:
        """The step of one period [s] from then on; rotation and tip are what was commanded last."""
        ...
