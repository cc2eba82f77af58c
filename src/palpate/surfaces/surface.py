"""What a surface is to the rest of the house."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from palpate.surfaces._tree import Tree

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

    def project(
        self, points: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """Closest points, outward unit normals there, and the facets they lie on."""
        ...

    def tree(self) -> Tree:
        """The prepared search tree, built once."""
        ...
