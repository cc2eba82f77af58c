"""What a surface is to the rest of the house."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.surfaces.mesh import Mesh
from palpate.surfaces.prepared import CompiledSurface

__all__ = ["Surface"]


@runtime_checkable
class Surface(Protocol):
    """A body's outside: normals point out of it. Lengths in metres, in the surface's own frame."""

    @property
    def size(self) -> float:
        """Diagonal of the bounding box [m]."""
        ...

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Middle of the bounding box [m]."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What to doubt about it, a sentence each."""
        ...

    def project(
        self, points: ArrayLike
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """Closest points to points (n, 3), outward unit normals there, and the facets they lie on (-1: there are none).

        NaN of a point that is NaN.
        """
        ...

    def prepared(self) -> CompiledSurface:
        """For the compiled loops, built once."""
        ...

    def drawn(self) -> Mesh:
        """What a viewer shows of it."""
        ...
