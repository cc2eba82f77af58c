"""Convert between the speeds of two parallel tracks and the motion of the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.calls import called_as
from palpate.errors import InputError


@called_as("palpate.DifferentialDrive(track=0.085, top=0.05)")
@dataclass(frozen=True)
class DifferentialDrive:
    """A robot that steers by the difference of its two track speeds, without slip.

    forward = (left + right)/2 [m/s] along the heading, turn = (right - left)/track [rad/s] counter-clockwise.

    Args:
        track: [m] between the middles of the tracks.
        top: [m/s] largest speed of a track, forward and backward.

    Raises:
        InputError: a value that is not positive and finite.
    """

    track: float = 0.085
    top: float = 0.05

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 < value < np.inf:  # NaN too
                raise InputError(f"{name} must be positive, not {value}.", where="drive")

    def wheels(self, forward: float, turn: float) -> tuple[float, float]:
        """Return (left, right), the track speeds [m/s] for a forward speed [m/s] and a turn rate [rad/s].

        If one exceeds `top`, both are scaled down: the robot is slower on the same curve. Both are 0 for inputs that
        are not finite.
        """
        half = 0.5 * self.track * turn
        left, right = forward - half, forward + half
        fastest = max(abs(left), abs(right))
        if not fastest < np.inf:
            return 0.0, 0.0
        if fastest > self.top:
            left, right = left * (self.top / fastest), right * (self.top / fastest)
        return left, right

    def twist(self, left_speed: float, right_speed: float) -> tuple[float, float]:
        """Return (forward speed [m/s], turn rate [rad/s]) for the track speeds [m/s]."""
        return 0.5 * (left_speed + right_speed), (right_speed - left_speed) / self.track
