"""Read an arena from TOML, as `palpate simulate arena` writes it next to a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.files.inputs import load_toml
from palpate.files.schema import parse
from palpate_lab.simulation.arena.layout import ArenaLayout, Block

RUN = ("seed", "method", "sensing", "seconds", "fault")  # how it was run: not of the arena


@dataclass(frozen=True, eq=False)
class _Arena:
    """Keys of the file: `size`, `starts`, `goals`, `name`, and one `[[block]]` per block."""

    size: tuple[float, float]
    starts: Float[np.ndarray, "n 3"]
    goals: Float[np.ndarray, "n 2"]
    name: str = ""
    block: tuple[Block, ...] = ()


def read_arena(file: str | Path) -> ArenaLayout:
    """Read an `ArenaLayout` from a file: lengths [m], angles [rad]; a block without a mass is fixed.

    Raises:
        InputError: the file cannot be read, a key is missing, unknown or of another type, or the arena is not valid.
    """
    table = {name: value for name, value in load_toml(file).items() if name not in RUN}
    read = parse(table, _Arena, file=str(file))
    return ArenaLayout(read.size, read.block, read.starts, read.goals, read.name or Path(file).stem)
