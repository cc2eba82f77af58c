"""A surface as compiled loops read it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays

__all__ = ["CompiledSurface"]


@takes_arrays
@dataclass(frozen=True)
class CompiledSurface:
    """A surface as compiled loops read it: two arguments (`_kernels`), in unit size (p - centre)/scale, in metres.

    `edged`: has it sharp edges?
    """

    arguments: tuple[Any, Float[np.ndarray, "m k"]]
    centre: Float[np.ndarray, "3"]
    scale: float
    edged: bool = False
