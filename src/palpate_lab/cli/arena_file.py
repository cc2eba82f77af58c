"""An arena of one's own: the TOML that `palpate simulate arena` writes beside a recording, read back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.files.models.toml import load_toml
from palpate.files.schema import parse
from palpate_lab.simulation.arena import ArenaLayout, Block

__all__ = ["read_arena"]

RUN = ("seed", "method", "sensing", "seconds")  # how it was run: not of the arena


@dataclass(frozen=True, eq=False)
class _Arena:
    """Its keys: `size`, `starts`, `goals`, `name`, and a `[[block]]` each."""

    size: tuple[float, float]
    starts: Float[np.ndarray, "n 3"]
    goals: Float[np.ndarray, "n 2"]
    name: str = ""
    block: tuple[Block, ...] = ()


def read_arena(file: str | Path) -> ArenaLayout:
    """The arena of a file: lengths [m], angles [rad]; a block without a mass is fixed.

    Raises:
        InputError: it cannot be read, a key is missing, unknown or of another kind, or its numbers are no arena.
    """
    table = {name: value for name, value in load_toml(file).items() if name not in RUN}
    read = parse(table, _Arena, file=str(file))
    return ArenaLayout(read.size, read.block, read.starts, read.goals, read.name or Path(file).stem)
