# ruff: noqa: D101, D102 - docs/architecture.md says what each call of a WrenchSensor does
"""A sensor that Palpate does not know, in one file: three single-axis cells under a slippery plate, a WrenchSensor.

Each cell feels the force along z at its place; together they tell F_z, M_x and M_y, and a slippery plate has no others.
"""

from collections.abc import Iterable, Iterator
from dataclasses import make_dataclass
from typing import Any, NamedTuple

import numpy as np

from palpate.errors import InputError
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.setup.built import Guess
from palpate.setup.setup import SensorKind
from palpate.setup.wrench import wrench_estimator
from palpate.signals.recording import LARGEST, Recording
from palpate.signals.wrench_sensor import Placement, Tare

NOISE, COLUMNS = 0.005, ("left", "right", "back")  # N: standard deviation of one cell
CELLS = np.array([[-0.02, -0.015], [0.02, -0.015], [0.0, 0.02]])  # m
WRENCHES = np.stack([np.zeros(3), np.zeros(3), np.ones(3), CELLS[:, 1], -CELLS[:, 0], np.zeros(3)])  # of 1 N on a cell
FREE = np.diag([NOISE, NOISE, 0.0, 0.0, 0.0, 1e-2 * NOISE]) ** 2  # what is not felt is taken to be as small as noise


class Loads(NamedTuple):
    time: np.ndarray
    wrench: np.ndarray
    status: np.ndarray


class Plate:
    """The sensor; its zero is all that it keeps."""

    zero, channels, noise = np.zeros(3), ("plate",), (NOISE * WRENCHES) @ (NOISE * WRENCHES).T + FREE

    def ready(self, blocks: Iterable[Recording]) -> Iterator[Recording]:
        return iter(blocks)

    def smoothed_by(self, filter: Any, rate: Any, share: float) -> None:
        pass

    def measure(self, recording: Recording) -> Loads:
        forces = recording.channels.get("plate", np.empty((0, 0)))
        if forces.shape[1:] != (3,):
            raise InputError(f"a plate reads 3 loads a sample, not {forces.shape[1:]}.", where=recording.source)
        bad = ~(np.abs(forces) <= LARGEST).all(axis=1)  # NaN too
        loads = np.where(bad[:, None], 0.0, forces - self.zero)
        return Loads(recording.time, np.sum(loads[:, None] * WRENCHES, axis=2), np.where(bad, 7, -1).astype(np.int8))

    def single(self, time: float, reading: Any, rotation: Any, acceleration: Any) -> Loads:
        return self.measure(Recording(np.array([time]), {"plate": np.array(reading, dtype=np.float64)[None]}))

    def place(self, measured: Loads, wrenches: Any, share: Any, placement: Placement) -> tuple[np.ndarray, np.ndarray]:
        moved = np.sum(placement.matrix * wrenches[:, None], axis=2)
        noise = placement.matrix @ self.noise @ placement.matrix.T
        return moved, np.broadcast_to(share, len(moved))[:, None, None] * noise

    def tare(self, recording: Recording) -> Tare:
        self.zero = recording.channels["plate"].mean(axis=0)
        doubt = "more than a zero: something may have pressed" if np.abs(self.zero).max() > 0.5 else ""
        return Tare(f"{self.zero.round(3)} N are taken off the three cells", doubt)

    def notes(self) -> tuple[str, ...]:
        return ()

    warnings = reset = notes


LAYOUT = LogLayout(wrench=None, arrays=(ArrayChannel("plate", (3,), COLUMNS, table="plate"),))
PLATE = SensorKind(
    name="plate",
    called="three cells under a plate",
    table=make_dataclass("RigPlate", ()),  # it has nothing to say
    channels=("plate",),
    layout=lambda setup: LAYOUT,
    build=lambda setup: wrench_estimator(setup, Plate(), tare=setup.estimate.tare),
    guess=lambda log, there, mesh: Guess("three", LAYOUT, "[plate]\n") if set(COLUMNS) <= set(there.names) else None,
    view="palpate.setup.wrench_view.WrenchView",
    refused={"payload": "nothing hangs on a plate", "noise": "a plate's noise is known"},
)
