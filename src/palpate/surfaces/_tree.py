"""The search tree over patches: boxes for positions, cones for normals, in unit size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from palpate.errors import GeometryError
from palpate.surfaces._patches import Patches

__all__ = ["Tree", "build_tree"]

_MOST = 2**23  # patch and node numbers must be exact in float32


@dataclass(frozen=True)
class Tree:
    """A bounding-volume hierarchy as two arrays, which is what the compiled loops read.

    Lengths inside are (p - centre) / scale: at metre scale, closest-point and ray routines lose digits (kernels.md).

    Attributes:
        nodes: (n, 14, 8) float32, a column a child, so that one instruction serves several: box centre 0-2 and half
            extents 3-5; axis of the cone of normals 6-8, cos of its half-angle 9, sin^2 12 and sin cos 13; first 10 and
            how many 11: patches of a leaf, or the number of an inner node and 0; -1 where there is no child.
        corners: (m, 20): per corner position and unit normal, then kind and facet; patches in the order of the leaves.
        centre: (3,) [m]; scale [m].
    """

    nodes: Float32[np.ndarray, "n 14 8"]
    corners: Float[np.ndarray, "m 20"]
    centre: Float[np.ndarray, "3"]
    scale: float


def build_tree(patches: Patches) -> Tree:
    """Build the tree: three rounds of median splits along the longest side a node, leaves of up to four patches."""
    from palpate.surfaces import _bvh  # compiled: loaded when first needed

    if len(patches.kind) > _MOST:
        raise GeometryError(f"{len(patches.kind)} patches are too many ({_MOST}); simplify the mesh or choose a region")

    positions = patches.corners[:, :, :3]
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    centre, scale = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    corners = patches.corners.copy()
    corners[:, :, :3] = (positions - centre) / scale
    nodes = np.zeros((len(corners) + 1, 14, _bvh.WIDTH), dtype=np.float32)
    order, used = _bvh.build(corners, nodes)
    tags = np.stack([patches.kind, patches.facet], axis=1)
    return Tree(
        nodes=nodes[:used].copy(),
        corners=np.concatenate([corners[order].reshape(-1, 18), tags[order]], axis=1),
        centre=centre,
        scale=scale,
    )
