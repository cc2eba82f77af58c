# ruff: noqa: D102 - the protocol is documented in docs/architecture.md
"""A sensor that Palpate does not know: three single-axis cells under a slippery plate, as a wrench sensor of one file.

Each cell feels the force along z at its place. Together they tell F_z, M_x and M_y; a slippery plate has no others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from palpate.sensors.recording import LARGEST, Recording
from palpate.spatial.pose import Pose

NOISE = 0.005  # N: standard deviation of one cell
CELLS = np.array([[-0.02, -0.015, 0.0], [0.02, -0.015, 0.0], [0.0, 0.02, 0.0]])  # m
COLUMNS = ("left", "right", "back")
WRENCHES = np.stack([np.zeros(3), np.zeros(3), np.ones(3), CELLS[:, 1], -CELLS[:, 0], np.zeros(3)])  # of 1 N on a cell
SLIPPERY = np.diag([NOISE, NOISE, 0.0, 0.0, 0.0, 1e-2 * NOISE]) ** 2  # what is not felt is small, as plates go


class Loads(NamedTuple):
    """What `measure` answers: readings as wrenches in the sensor's frame, and which of them are to be located."""

    time: np.ndarray
    wrench: np.ndarray
    status: np.ndarray


@dataclass
class Plate:
    """The wrench sensor: see docs/architecture.md for the protocol. It has a zero, and forgets nothing else."""

    zero: np.ndarray = field(default_factory=lambda: np.zeros(3))
    channels = ("plate",)
    noise = NOISE**2 * WRENCHES @ WRENCHES.T + SLIPPERY

    def ready(self, blocks: Iterable[Recording]) -> Iterator[Recording]:
        yield from blocks  # nothing looks ahead

    def measure(self, recording: Recording) -> Loads:
        return self._loads(recording.time, recording.channels["plate"])

    def single(self, time: float, reading: Any, rotation: Any = None, acceleration: Any = None) -> Loads:
        return self._loads(np.array([time], dtype=np.float64), np.array(reading, dtype=np.float64).reshape(1, 3))

    def place(self, measured: Loads, wrenches: np.ndarray, share: np.ndarray, mounting: Pose) -> tuple[Any, Any]:
        move = mounting.inverse().wrench_matrix()
        moved = np.stack([move @ wrench for wrench in wrenches])  # one by one: the same bits in blocks of any size
        return moved, np.ones((len(wrenches), 1, 1)) * np.reshape(share, (-1, 1, 1)) * (move @ self.noise @ move.T)

    def tare(self, recording: Recording) -> Any:
        self.zero = recording.channels["plate"].mean(axis=0)
        return tared(f"tare over {len(recording)} samples: {self.zero.round(3)} N are taken off from now on")

    def reset(self) -> None: ...

    def notes(self) -> tuple[str, ...]:
        return ()

    doubts = notes

    def _loads(self, time: np.ndarray, forces: np.ndarray) -> Loads:
        bad = ~(np.abs(forces) <= LARGEST).all(axis=1)  # NaN too
        wrench = np.sum((np.where(bad[:, None], 0.0, forces) - self.zero)[:, None, :] * WRENCHES, axis=2)
        return Loads(time, wrench, np.where(bad, 7, -1).astype(np.int8))  # 7: INVALID, -1: to be located


# --- what Palpate's table of sensors asks for: the one place to adapt to it ------------------------------------------


@dataclass(frozen=True)
class RigPlate:
    """[plate] of a rig."""

    columns: tuple[str, str, str] = COLUMNS


def tared(said: str) -> Any:
    from palpate.contact.tare import Tare

    return Tare(said, "")


def add() -> None:
    from palpate.io.rig.kinds import KINDS, Channel, SensorKind

    KINDS["plate"] = SensorKind(
        name="plate",
        table=RigPlate,
        layout=lambda table, rig: (Channel("plate", table.columns, scale=1.0),),
        build=lambda table, rig, head: Plate(),
        guess=lambda names: "[plate]\n" if set(COLUMNS) <= set(names) else None,
    )
