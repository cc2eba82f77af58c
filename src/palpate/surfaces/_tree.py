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
            how many 11: patches of a leaf, or the number of an inner node and 0; -1 where there is no child. In the
            last node, 10 of the first child is the root of a second tree, of sharp edges and corners, or -1.
        corners: (m, 20): per corner position and unit normal, then kind and facet; patches in the order of the leaves,
            those of the second tree behind.
        centre: (3,) [m]; scale [m].
    """

    nodes: Float32[np.ndarray, "n 14 8"]
    corners: Float[np.ndarray, "m 20"]
    centre: Float[np.ndarray, "3"]
    scale: float


def build_tree(patches: Patches, sharp: Patches | None = None) -> Tree:
    """Build the tree: three rounds of median splits along the longest side a node, leaves of up to four patches.

    Args:
        patches: what a wrench can meet.
        sharp: edges and corners that it can pass within its noise (`sharp_edges`).
    """
    if len(patches.kind) > _MOST:
        raise GeometryError(f"{len(patches.kind)} patches are too many ({_MOST}); simplify the mesh or choose a region")

    positions = patches.corners[:, :, :3]
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    centre, scale = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    nodes, corners = _branches(patches, centre, scale)
    last = np.full((1, *nodes.shape[1:]), -1.0, dtype=np.float32)
    if sharp is not None and len(sharp.kind):
        more, edges = _branches(sharp, centre, scale)
        inside = more[:, 11] == 0.0
        more[:, 10] += np.where(inside, np.float32(len(nodes)), np.float32(len(corners)))
        last[0, 10, 0] = len(nodes)
        nodes, corners = np.concatenate([nodes, more]), np.concatenate([corners, edges])
    return Tree(nodes=np.concatenate([nodes, last]), corners=corners, centre=centre, scale=scale)


def _branches(
    patches: Patches, centre: Float[np.ndarray, "3"], scale: float
) -> tuple[Float32[np.ndarray, "n 14 8"], Float[np.ndarray, "m 20"]]:
    """Nodes over patches, and the patches in the order of the leaves, in unit size."""
    from palpate.surfaces import _bvh  # compiled: loaded when first needed

    corners = patches.corners.copy()
    corners[:, :, :3] = (corners[:, :, :3] - centre) / scale
    nodes = np.zeros((len(corners) + 1, 14, _bvh.WIDTH), dtype=np.float32)
    order, used = _bvh.build(corners, nodes)
    tags = np.stack([patches.kind, patches.facet], axis=1)
    return nodes[:used].copy(), np.concatenate([corners[order].reshape(-1, 18), tags[order]], axis=1)
