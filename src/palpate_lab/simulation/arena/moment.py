"""A moment of a run in the arena, and the result of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8


@dataclass(frozen=True, eq=False)
class ArenaMoment:
    """A moment of a run.

    Attributes:
        time: time [s].
        poses: (n, 3) true x, y [m] and heading [rad].
        tracked: (n, 3) poses that the navigators get.
        blocks: (m, 3) true poses of the movable blocks.
        touches: (k, 2) angle [rad] and force [N] that each robot feels; None while its skin gives no reading.
        truths: (k, 5) angle, force, shear, depth and kind of the true contacts of each robot.
        wheels: (n, 2) commanded track speeds [m/s].
        states, whys: states of the navigators, and their reasons.
        frames: images of the cameras, blue, green, red; None without images.
        arrived: (n,) True for robots whose navigator has reached the goal.
    """

    time: float
    poses: Float[np.ndarray, "n 3"]
    tracked: Float[np.ndarray, "n 3"]
    blocks: Float[np.ndarray, "m 3"]
    touches: Sequence[Float[np.ndarray, "_ 2"] | None]
    truths: Sequence[Float[np.ndarray, "_ 5"]]
    wheels: Float[np.ndarray, "n 2"]
    states: tuple[str, ...]
    whys: tuple[str, ...]
    frames: Sequence[UInt8[np.ndarray, "h w 3"]] | None
    arrived: Bool[np.ndarray, " n"]


@dataclass(frozen=True)
class ArenaResult:
    """The result of a run, with one value per robot unless noted otherwise.

    Attributes:
        seed: seed of the run.
        arrived: time [s] at which the goal was reached; NaN if it was not.
        path: length driven [m].
        greatest: largest contact force [N].
        force: contact force [N] that is not exceeded in 99 % of the contact time; one value for the run.
        pushes: number of deliberate pushes, for our navigator; the paper's robots do not know whether they push.
        deadlocks: number of times that it stood nearly still for half a minute before its goal.
        state: final state, and its reason.
        seconds: duration of the run [s]; one value.
    """

    seed: int
    arrived: tuple[float, ...]
    path: tuple[float, ...]
    greatest: tuple[float, ...]
    force: float
    pushes: tuple[int, ...]
    deadlocks: tuple[int, ...]
    state: tuple[str, ...]
    seconds: float

    @property
    def count(self) -> int:
        """Number of robots that arrived."""
        return int(np.isfinite(self.arrived).sum())

    @property
    def complete(self) -> bool:
        """True if all robots arrived."""
        return self.count == len(self.arrived)
