"""Protocol of a surface, for the rest of Palpate."""

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
        """Middle of the bounding box, (3,) [m]."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Repairs and warnings about the surface, a tuple of sentences."""
        ...

    def project(
        self, points: ArrayLike
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """Return closest points (n, 3) [m] to points (n, 3), outward unit normals there (n, 3), and facet numbers (n,).

        Facets are -1 where the surface has none. Points and normals are NaN for a point that is NaN.
        """
        ...

    def prepared(self) -> CompiledSurface:
        """Return the `CompiledSurface` for the compiled loops, built once."""
        ...

    def drawn(self) -> Mesh:
        """Return the `Mesh` that a viewer shows."""
        ...
