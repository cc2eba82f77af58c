"""The physical settings of a robot of the arena: a disc with a soft skin on two tracks."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from palpate.errors import InputError

FRAME = 1 / 30  # s for which a command of the tracks holds: one frame of the skin's camera


@dataclass(frozen=True)
class RobotSettings:
    """A robot: a disc with a soft skin on two tracks, of the size and speed of papers/002, section V.

    Attributes:
        radius: radius of the skin [m].
        mass: mass [kg].
        track: distance between the middles of the tracks [m].
        grip: Coulomb's coefficient of the tracks on the floor: they resist up to grip mass 9.81 N along, as much
            across, and that force at half the track about. Within it a robot moves exactly as its tracks do.
        stiffness: stiffness of the skin [N/m]: a force of 5 N presses it in by 10 mm; two skins together have half of
            it.
        loss: damping time [s] of the skin: it bears stiffness (depth + loss d/dt depth).
        friction: Coulomb's coefficient of the skin on everything.
        uneven: standard deviation of the share by which each track is faster than commanded, drawn once a track.
    """

    radius: float = 0.055
    mass: float = 0.8
    track: float = 0.085
    grip: float = 0.7
    stiffness: float = 500.0
    loss: float = 0.02
    friction: float = 0.5
    uneven: float = 0.01

    def __post_init__(self) -> None:
        """Check that the numbers are possible.

        Raises:
            InputError: a number is not positive, or `uneven` is not from 0 to 0.5.
        """
        for name in ("radius", "mass", "track", "grip", "stiffness", "loss", "friction"):
            if not 0.0 < getattr(self, name) < inf:
                raise InputError(f"{name} must be positive, not {getattr(self, name)}.", where="robot")
        if not 0.0 <= self.uneven < 0.5:
            raise InputError(f"uneven must be a share from 0 to 0.5, not {self.uneven}.", where="robot")
