"""The search tree over patches: boxes for positions, cones for normals, in unit size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from palpate.errors import GeometryError
from palpate.surfaces._normals import blocks
from palpate.surfaces._patches import KIND

_MOST = 2**23  # patch and node numbers must be exact in float32


@dataclass(frozen=True)
class Tree:
    """A bounding-volume hierarchy as two arrays for the compiled loops, in unit size (p - centre) / scale.

    Attributes:
        nodes: (n, 14, 8) float32, a column for each child, so that one instruction serves several: box centre 0-2 and
            half extents 3-5; axis of the cone of normals 6-8, cos of its half-angle 9, sin^2 12 and sin cos 13; first
            10 and count 11: patches of a leaf, or the number of an inner node and 0; -1 where there is no child. In the
            last node, 10 of the first child is the root of a second tree, of sharp edges and corners, or -1.
        corners: (m, 20): per corner position and unit normal, then kind and facet; patches in the order of the leaves,
            those of the second tree behind.
        centre: (3,) [m].
        scale: [m].
    """

    nodes: Float32[np.ndarray, "n 14 8"]
    corners: Float[np.ndarray, "m 20"]
    centre: Float[np.ndarray, "3"]
    scale: float


def build_tree(rows: Float[np.ndarray, "m 20"], sharp: int = 0) -> Tree:
    """Build the tree: three rounds of median splits along the longest side per node, leaves of up to four patches.

    Args:
        rows: patches (`patch_rows`) that a wrench can meet; brought to unit size and the leaves' order, in place.
        sharp: number of `sharp_edges` at the end of the rows.

    Raises:
        GeometryError: more than 8,388,608 patches.
    """
    from palpate.surfaces import _bvh  # compiled: loaded when first needed

    count = len(rows) - sharp
    if count > _MOST:
        raise GeometryError(
            f"the surface has {count} patches, more than {_MOST}: simplify the mesh or choose a region."
        )

    positions = rows[:, :KIND].reshape(-1, 3, 6)[:, :, :3]  # a view
    low, high = _box(positions[:count])
    centre, scale = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    for block in blocks(len(rows)):
        positions[block] = (positions[block] - centre) / scale
    most = count // 4 + sharp // 4 + 5  # nodes: each but a root has five patches or more
    nodes = np.empty((most, 14, _bvh.WIDTH), dtype=np.float32)
    used = last = _bvh.build(rows[:count], nodes)
    if sharp:
        last += _bvh.build(rows[count:], nodes[used:])
        more = nodes[used:last]
        more[:, 10] += np.where(more[:, 11] == 0.0, np.float32(used), np.float32(count))
    nodes[last] = -1.0
    nodes[last, 10, 0] = used if sharp else -1.0
    nodes.resize((last + 1, *nodes.shape[1:]), refcheck=False)
    return Tree(nodes=nodes, corners=rows, centre=centre, scale=scale)


def _box(positions: Float[np.ndarray, "m 3 3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for block in blocks(len(positions)):
        columns = positions[block].transpose(2, 0, 1).reshape(3, -1)  # long rows are quicker
        low, high = np.minimum(low, columns.min(axis=1)), np.maximum(high, columns.max(axis=1))
    return low, high
