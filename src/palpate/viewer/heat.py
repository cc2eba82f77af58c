"""Compute for how long each part of a body was touched, on a mesh that is fine enough to show it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, UInt8

from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.surfaces.mesh import Mesh

REACH = 3.0  # widths, beyond which a touch colours nothing
FACETS = 60_000  # of the finest mesh: more is slow to send and to draw
BARE = 203, 209, 216  # of the body where nothing touched it
PALETTE = np.array(
    [BARE, (250, 214, 120), (247, 160, 58), (224, 84, 45), (160, 28, 60), (92, 12, 70)], dtype=np.float64
)


@frozen_value(eq=True)
class FineMesh:
    """A mesh to draw: one normal per vertex, vertices doubled along creases.

    Attributes:
        vertices: (v, 3) [m].
        normals: (v, 3) unit.
        faces: (f, 3).
    """

    vertices: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]


@takes_arrays
def refined(mesh: Mesh, points: Float[np.ndarray, "n 3"], width: float) -> FineMesh:
    """Return the mesh as a `FineMesh` whose edges near the points [m] are at most `width` [m] long.

    Raises:
        InputError: points has another shape.
    """
    from scipy.spatial import KDTree

    corners = np.concatenate([mesh.vertices[mesh.faces], mesh.corner_normals], axis=2)  # (f, 3, 6)
    tree = KDTree(points) if len(points) else None
    while tree is not None and len(corners) < FACETS:
        edges = np.linalg.norm(corners[..., :3] - np.roll(corners[..., :3], 1, axis=1), axis=2).max(axis=1)
        away = tree.query(corners[..., :3].mean(axis=1))[0]
        long = (edges > width) & (away < edges + REACH * width)
        if not long.any():
            break
        corners = np.concatenate([corners[~long], _quartered(corners[long])])
    distinct, numbers = np.unique(corners.reshape(-1, 6).round(9), axis=0, return_inverse=True)
    normals = distinct[:, 3:] / np.linalg.norm(distinct[:, 3:], axis=1, keepdims=True)
    return FineMesh(distinct[:, :3].copy(), normals, numbers.reshape(-1, 3).astype(np.int64))


@takes_arrays
def density(
    body: FineMesh,
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    seconds: Float[np.ndarray, " n"],
    width: float,
) -> Float[np.ndarray, " v"]:
    """Return the time of touch per area at each vertex, (v,) [s/m^2].

    Each contact is a Gaussian of this width [m], on the side that was touched.

    Raises:
        InputError: arrays of other shapes.
    """
    from scipy.spatial import KDTree

    if not len(points):
        return np.zeros(len(body.vertices))
    points, normals, seconds = _gathered(points, normals, seconds, width / 2)
    pairs = KDTree(body.vertices).sparse_distance_matrix(KDTree(points), REACH * width, output_type="coo_matrix")
    facing = np.einsum("ij,ij->i", body.normals[pairs.row], normals[pairs.col])
    share = np.exp(-0.5 * (pairs.data / width) ** 2) / (2.0 * np.pi * width**2) * np.clip(facing, 0.0, 1.0)
    return np.bincount(pairs.row, share * seconds[pairs.col], minlength=len(body.vertices))


@takes_arrays
def colours(share: Float[np.ndarray, " v"]) -> UInt8[np.ndarray, "v 3"]:
    """Return sRGB colours, (v, 3), for shares from 0 (the bare body) to 1 (the darkest).

    Raises:
        InputError: share has another shape.
    """
    stops = np.linspace(0.0, 1.0, len(PALETTE))
    return np.column_stack([np.interp(share, stops, PALETTE[:, k]) for k in range(3)]).round().astype(np.uint8)


@takes_arrays
def linear(colour: UInt8[np.ndarray, "v 3"]) -> UInt8[np.ndarray, "v 3"]:
    """Convert colours (v, 3) from sRGB to linear, as a glTF's vertices and instances need."""
    return (255 * (colour / 255.0) ** 2.2).round().astype(np.uint8)


def _quartered(corners: Float[np.ndarray, "f 3 6"]) -> Float[np.ndarray, "g 3 6"]:
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate([np.stack(three, axis=1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def _gathered(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], seconds: Float[np.ndarray, " n"], cell: float
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
    """Merge the points of one cell [m] and side into their mean."""
    keys = np.concatenate([np.floor((points - points.min(axis=0)) / cell), normals > 0], axis=1).astype(np.int64)
    sizes = keys.max(axis=0) + 1
    code = np.ravel_multi_index(keys.T, sizes)
    _, which, count = np.unique(code, return_inverse=True, return_counts=True)
    middle = np.column_stack([np.bincount(which, values) for values in (*points.T, *normals.T)]) / count[:, None]
    normal = middle[:, 3:] / np.maximum(np.linalg.norm(middle[:, 3:], axis=1, keepdims=True), 1e-12)
    return middle[:, :3], normal, np.bincount(which, seconds)
