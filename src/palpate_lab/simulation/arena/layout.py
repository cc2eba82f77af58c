"""Arenas: a field with walls around it, fixed and movable boxes, and the starts and goals of robots."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, inf, sin

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Block:
    """A box that stands on the floor, higher than a robot's skin.

    Attributes:
        x, y: position of its middle [m].
        turn: angle of its first side from the arena's x, counter-clockwise [rad].
        half: half of its two sides [m].
        mass: mass [kg]; None: fixed.
        friction: Coulomb's coefficient of a movable one on the floor.
    """

    x: float
    y: float
    turn: float
    half: tuple[float, float]
    mass: float | None = None
    friction: float = 0.4

    def __post_init__(self) -> None:
        """Check that the numbers describe a box.

        Raises:
            InputError: a number is not finite, or a side, the mass or the friction is not positive.
        """
        if not all(-inf < value < inf for value in (self.x, self.y, self.turn)):
            raise InputError(f"x, y and turn must be finite, not {self.x}, {self.y}, {self.turn}.", where="block")
        if not all(0.0 < side < inf for side in self.half):
            raise InputError(f"half must be two positive lengths, not {self.half}.", where="block")
        if self.mass is not None and not 0.0 < self.mass < inf:
            raise InputError(f"mass must be positive, or None for a fixed block, not {self.mass}.", where="block")
        if not 0.0 < self.friction < inf:
            raise InputError(f"friction must be positive, not {self.friction}.", where="block")

    @property
    def reach(self) -> float:
        """Distance [m] from its middle to a corner."""
        return hypot(*self.half)

    @property
    def resistance(self) -> float:
        """Horizontal push [N] above which it slides, infinite for a fixed one."""
        return inf if self.mass is None else self.friction * self.mass * GRAVITY

    def corners(self) -> Float[np.ndarray, "4 2"]:
        """Return its corners (4, 2) [m], counter-clockwise."""
        a, b = self.half
        own = np.array([[a, b], [-a, b], [-a, -b], [a, -b]])
        return own @ _turned(self.turn).T + (self.x, self.y)

    def distance(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Return the distances (*n) [m] from points (*n, 2) to the box.

        Inside it is minus the depth below the nearest side.
        """
        beyond = np.abs((points - (self.x, self.y)) @ _turned(self.turn)) - self.half
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
        return outside + np.minimum(beyond.max(axis=-1), 0.0)

    def gap(self, other: Block) -> float:
        """Return the largest gap between two boxes along a side's normal [m], negative where they overlap."""
        a, b = self.corners(), other.corners()
        axes = np.concatenate([_turned(self.turn).T, _turned(other.turn).T])
        first, second = a @ axes.T, b @ axes.T
        return float(np.maximum(first.min(0) - second.max(0), second.min(0) - first.max(0)).max())


@dataclass(frozen=True, eq=False)
class ArenaLayout(Value):
    """An arena; its origin is the lower left corner, and walls stand around it.

    Attributes:
        size: width and height [m].
        blocks: fixed and movable blocks.
        starts: (n, 3) start of each robot: x, y [m], heading [rad].
        goals: (n, 2) goal of each robot [m].
        name: name of the arena.
    """

    size: tuple[float, float]
    blocks: tuple[Block, ...]
    starts: Float[np.ndarray, "n 3"]
    goals: Float[np.ndarray, "n 2"]
    name: str = ""

    def __post_init__(self) -> None:
        """Check shapes and numbers; `require_solvable` checks that robots can cross the arena.

        Raises:
            InputError: starts, goals or size have a wrong shape, or a number that is not possible.
        """
        starts, goals = (np.array(values, dtype=float) for values in (self.starts, self.goals))
        if starts.ndim != 2 or starts.shape[1] != 3 or not len(starts) or goals.shape != (len(starts), 2):
            raise InputError(
                f"starts must be (n, 3) and goals (n, 2), not {starts.shape} and {goals.shape}.", where="layout"
            )
        if not (np.isfinite(starts).all() and np.isfinite(goals).all()):
            raise InputError("starts and goals must be finite.", where="layout")
        if not all(0.0 < side < inf for side in self.size):
            raise InputError(f"size must be two positive lengths, not {self.size}.", where="layout")
        object.__setattr__(self, "starts", frozen(starts))
        object.__setattr__(self, "goals", frozen(goals))

    @property
    def robots(self) -> int:
        """Number of robots that cross the arena."""
        return len(self.starts)

    @property
    def movable(self) -> tuple[Block, ...]:
        """Tuple of the blocks that are not fixed, in the order of `blocks`."""
        return tuple(block for block in self.blocks if block.mass is not None)


def _turned(angle: float) -> Float[np.ndarray, "2 2"]:
    return np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])
