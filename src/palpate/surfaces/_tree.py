"""The search tree over patches: boxes for positions, cones for normals, in unit size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from palpate.errors import GeometryError
from palpate.surfaces._patches import Patches

__all__ = ["Tree", "build_tree"]

_MOST = 2**23  # patch and node numbers must be exact in float32


@dataclass(frozen=True)
class Tree:
    """A bounding-volume hierarchy as three arrays, which is what the compiled loops read.

    Lengths inside are (p - centre) / scale: at metre scale, closest-point and ray routines lose digits (kernels.md).

    Attributes:
        nodes: (n, 16) float32, aligned: box centre 0-2 and half extents 3-5; axis of the cone of normals 6-8, cos of
            its half-angle 9, sin^2 12 and sin cos 13; the first of two children, which lie side by side, or the first
            patch of a leaf 10; how many patches, 0 for an inner node, 11. A node is one cache line.
        corners: (m, 18): per corner position and unit normal, patches in the order of the leaves.
        tags: (m, 2): kind of patch and facet.
        centre: (3,) [m]; scale [m].
    """

    nodes: Float32[np.ndarray, "n 16"]
    corners: Float[np.ndarray, "m 18"]
    tags: Int[np.ndarray, "m 2"]
    centre: Float[np.ndarray, "3"]
    scale: float


def build_tree(patches: Patches) -> Tree:
    """Build the tree: median splits along the longest side, leaves of up to four patches."""
    from palpate.surfaces import _bvh  # compiled: loaded when first needed

    if len(patches.kind) > _MOST:
        raise GeometryError(f"{len(patches.kind)} patches are too many ({_MOST}); simplify the mesh or choose a region")

    positions = patches.corners[:, :, :3]
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    centre, scale = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    corners = patches.corners.copy()
    corners[:, :, :3] = (positions - centre) / scale
    nodes = _aligned(2 * len(corners) + 2)
    order, used = _bvh.build(corners, nodes)
    tags = np.stack([patches.kind, patches.facet], axis=1)
    return Tree(
        nodes=nodes[:used],
        corners=np.ascontiguousarray(corners[order].reshape(-1, 18)),
        tags=np.ascontiguousarray(tags[order]),
        centre=centre,
        scale=scale,
    )


def _aligned(count: int) -> Float32[np.ndarray, "n 16"]:
    """Zeros that begin on a cache line."""
    raw = np.zeros(16 * count + 32, dtype=np.float32)
    skip = (-raw.ctypes.data % 128) // 4
    return raw[skip : skip + 16 * count].reshape(count, 16)
