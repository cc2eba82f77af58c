"""The search tree over patches: boxes for positions, cones for normals, in unit size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate.surfaces._patches import Patches

__all__ = ["Tree", "build_tree"]


@dataclass(frozen=True)
class Tree:
    """A bounding-volume hierarchy as three arrays, which is what the compiled loops read.

    Lengths inside are (p - centre) / scale: at metre scale, closest-point and ray routines lose digits (kernels.md).

    Attributes:
        nodes: (n, 16): box centre 0-2 and half extents 3-5; axis of the cone of normals 6-8 and cos of its half-angle
            9; the second child's number (the first follows its parent) or, in a leaf, the first patch 10; how many
            patches, 0 for an inner node, 11; sin^2 of the half-angle 12 and its sin cos 13. Whole numbers are exact in float64, and one row is two cache lines.
        corners: (m, 18): per corner position and unit normal, patches in the order of the leaves.
        tags: (m, 2): kind of patch and facet.
        centre: (3,) [m]; scale [m].
    """

    nodes: Float[np.ndarray, "n 16"]
    corners: Float[np.ndarray, "m 18"]
    tags: Int[np.ndarray, "m 2"]
    centre: Float[np.ndarray, "3"]
    scale: float


def build_tree(patches: Patches) -> Tree:
    """Build the tree: median splits along the longest side, leaves of up to four patches."""
    from palpate.surfaces import _bvh  # compiled: loaded when first needed

    positions = patches.corners[:, :, :3]
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    centre, scale = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    corners = patches.corners.copy()
    corners[:, :, :3] = (positions - centre) / scale
    order, nodes = _bvh.build(corners)
    tags = np.stack([patches.kind, patches.facet], axis=1)
    return Tree(
        nodes=nodes,
        corners=np.ascontiguousarray(corners[order].reshape(-1, 18)),
        tags=np.ascontiguousarray(tags[order]),
        centre=centre,
        scale=scale,
    )
