"""Interface of every law of motion in contact: its input `Sensed` and its methods, called by one loop."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float


class Sensed:
    """Input of a law at a reading; one object, overwritten each time.

    Attributes:
        time: [s] of the reading.
        rotation: (3, 3) axes of the probe's face in the base.
        tip: (3,) [m] middle of the face in the base.
        place: (3,) [m] contact point relative to the middle, in the face's axes.
        variance: (2,) [m^2] of the first two entries of `place`, from the noise of the reading.
        force: (3,) [N] of the environment on the probe, in the face's axes; pressing is force[2] < 0.
    """

    def __init__(self) -> None:
        self.time = 0.0
        self.rotation, self.tip = np.eye(3), np.zeros(3)
        self.place, self.variance, self.force = np.zeros(3), np.zeros(2), np.zeros(3)


@runtime_checkable
class MotionLaw(Protocol):
    """Law of motion of a probe in contact.

    Steps are (6,), translation of the tip [m] then rotation vector [rad], in base axes, e of (9) in `probe`.
    """

    delay: float
    """Delay [s] from a command to the motion; the loop sets it."""

    radii: Float[np.ndarray, " 2"]
    """Displacement of the contact per angle [m/rad], along the face and across, (2,)."""

    ready: bool
    """True once everything that `hold` needs is known."""

    def reset(self) -> None:
        """Set everything that was learnt to what was stated."""

    def start(self, seen: Sensed) -> None:
        """Set the law's state from the first reading of a touch."""

    def observe(self, seen: Sensed) -> None:
        """Update the law's state by a located reading; called for each, the first as well."""

    def keep(self) -> None:
        """Confirm all observations: the robot's feedback agrees with its modelled pose."""

    def forget(self) -> None:
        """Discard the observations since the last `keep`: a command never reached the robot."""

    def press(self, seen: Sensed, period: float, out: Float[np.ndarray, " 6"]) -> None:
        """Write the step (6,) [m, rad] of one period [s], while not `ready`, into out."""

    def hold(
        self,
        time: float,
        rotation: Float[np.ndarray, "3 3"],
        tip: Float[np.ndarray, " 3"],
        period: float,
        out: Float[np.ndarray, " 6"],
    ) -> None:
        """Write the step (6,) [m, rad] of one period [s], once `ready`, into out; the pose is the last command's."""
