"""A surface in the form that compiled loops read."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import frozen_value


@frozen_value(eq=True)
class CompiledSurface:
    """A surface in the form that compiled loops read.

    Attributes:
        arguments: two arguments of every kernel (`_kernels`), in unit size (p - centre)/scale.
        centre: (3,) [m].
        scale: [m].
        edged: True if it has sharp edges.
    """

    arguments: tuple[Any, Float[np.ndarray, "m k"]]
    centre: Float[np.ndarray, "3"]
    scale: float
    edged: bool = False
