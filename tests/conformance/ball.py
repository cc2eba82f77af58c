"""A sensor that Palpate does not know: 200 taxels anywhere on a sphere, as a taxel body of one file.

Each taxel feels the force along its normal, in newtons. Its neighbours are the six nearest: there are no rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

COUNT, RADIUS, NOISE = 200, 0.05, 0.003  # taxels, m, N
COLUMNS = tuple(f"t{k}" for k in range(COUNT))
MEET = 6  # neighbours of a taxel


def directions() -> np.ndarray:
    """(200, 3) outward normals, spread evenly, in no order that a sheet would have."""
    z = 1.0 - (2.0 * np.arange(COUNT) + 1.0) / COUNT
    turn = np.pi * (3.0 - 5**0.5) * np.arange(COUNT)
    flat = np.sqrt(1.0 - z**2)
    return np.random.default_rng(0).permutation(np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z]))


def neighbours(normals: np.ndarray) -> np.ndarray:
    """(200, 6) of the nearest, by number; the body has no edge, so none is -1."""
    return np.argsort(-normals @ normals.T, axis=1)[:, 1 : MEET + 1]


# --- what Palpate's table of sensors asks for: the one place to adapt to it ------------------------------------------


@dataclass(frozen=True)
class RigBall:
    """[ball] of a rig."""

    columns: tuple[str, ...] = COLUMNS
    tare: float | None = None


def body() -> Any:
    from palpate.sensors.taxels import TaxelBody

    normals = directions()
    area = np.full(COUNT, 4 * np.pi * RADIUS**2 / COUNT)
    return TaxelBody(RADIUS * normals, normals, area, neighbours(normals))


def add() -> None:
    from palpate.io.rig.kinds import KINDS, Channel, SensorKind

    KINDS["ball"] = SensorKind(
        name="ball",
        table=RigBall,
        layout=lambda table, rig: (Channel("cells", table.columns, scale=1.0),),
        build=lambda table, rig, head: body(),
        guess=lambda names: "[ball]\n" if set(COLUMNS) <= set(names) else None,
    )
