"""Render a body as a camera sees it, on the processor alone: facets become a picture with depths."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from palpate.spatial.arguments import frozen_value, takes_arrays

_AT_ONCE = 200_000  # pixels of facets' boxes that are tried at once: more do not stay in the processor's cache
_LEAST = 1e-3  # depth: what is nearer is not drawn


@frozen_value(eq=True)
class ViewPoint:
    """A camera's position and direction, with z up in the picture.

    Attributes:
        position: (3,) of the camera.
        target: (3,) point that it looks at.
        view: [rad] angle from the top of the picture to its bottom.
        size: (width, height) of the picture [px].
    """

    position: Float[np.ndarray, "3"]
    target: Float[np.ndarray, "3"]
    view: float
    size: tuple[int, int]

    def seen(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return column and row [px] of each point, and its depth in the unit of the points, (n, 3).

        Raises:
            InputError: points has another shape.
        """
        ahead = (self.target - self.position) / np.linalg.norm(self.target - self.position)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else np.array([1.0, 0.0, 0.0])
        along = (points - self.position) @ np.column_stack([right, -np.cross(right, ahead), ahead])
        depth = np.maximum(along[:, 2], _LEAST)
        scale = 0.5 * self.size[1] / np.tan(self.view / 2)
        return np.column_stack([scale * along[:, :2] / depth[:, None] + np.array(self.size) / 2, depth])


@frozen_value
class Rendered:
    """A picture (h, w) in red, green, blue, and the depth of each of its pixels, infinite where nothing is."""

    picture: UInt8[np.ndarray, "h w 3"]
    depth: Float[np.ndarray, "h w"]

    def visible(self, seen: Float[np.ndarray, "n 3"], slack: float) -> Bool[np.ndarray, " n"]:
        """Return which points of `ViewPoint.seen` are in the picture and at most `slack` behind the body, (n,).

        Raises:
            InputError: seen has another shape.
        """
        height, width = self.depth.shape
        columns, rows = np.rint(seen[:, 0]).astype(np.int64), np.rint(seen[:, 1]).astype(np.int64)
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        at = self.depth[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
        return inside & (seen[:, 2] <= at + slack)


@takes_arrays
def rendered(
    camera: ViewPoint,
    vertices: Float[np.ndarray, "v 3"],
    normals: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    colours: UInt8[np.ndarray, "v 3"],
    ground: tuple[int, int, int] = (255, 255, 255),
) -> Rendered:
    """Return a mesh as a `Rendered`, lit from the camera, both sides drawn.

    Args:
        camera: from which it is seen.
        vertices: of the mesh.
        normals: unit, at the vertices.
        faces: of the mesh.
        colours: sRGB, at the vertices.
        ground: colour where nothing is.

    Raises:
        InputError: arrays of other shapes.
    """
    width, height = camera.size
    seen = camera.seen(vertices)
    way = camera.position - vertices
    lit = np.abs(np.einsum("ij,ij->i", normals, way / np.linalg.norm(way, axis=1, keepdims=True)))
    inks = colours * (0.45 + 0.55 * lit)[:, None]
    picture = np.empty((height * width, 3))
    picture[:] = ground
    depth = np.full(height * width, np.inf)
    corners = seen[faces]
    low = np.clip(np.ceil(corners[..., :2].min(axis=1)), 0, [width, height]).astype(np.int64)
    high = np.clip(np.floor(corners[..., :2].max(axis=1)), -1, [width - 1, height - 1]).astype(np.int64)
    spans = np.maximum(high - low + 1, 0)
    count = spans.prod(axis=1)
    toward = np.einsum("ij,ij->i", normals, way)[faces].max(axis=1) > 0
    for facing in (True, False):  # those that face away are mostly hidden by the others, and need not be filled then
        there = np.flatnonzero((count > 0) & (toward == facing))
        if not facing:
            at = np.clip(np.rint(corners[there, :, :2]), 0, [width - 1, height - 1]).astype(np.int64)
            nearest = depth[at[..., 1] * width + at[..., 0]]
            there = there[(corners[there, :, 2] < nearest).any(axis=1)]
        parts = np.cumsum(count[there]) // _AT_ONCE
        for some in np.split(there, np.flatnonzero(np.diff(parts)) + 1):
            which, pixels, shares = _inside(corners[some], low[some], spans[some], count[some], width)
            three = faces[some[which]]
            far = np.einsum("ij,ij->i", shares, seen[three, 2])
            order = np.argsort(-far, kind="stable")  # the nearest is written last
            order = order[far[order] < depth[pixels[order]]]
            depth[pixels[order]] = far[order]
            picture[pixels[order]] = np.einsum("ij,ijk->ik", shares[order], inks[three[order]])
    shape = (height, width)
    return Rendered(picture.round().astype(np.uint8).reshape(*shape, 3), depth.reshape(shape))


def _inside(
    corners: Float[np.ndarray, "k 3 3"],
    low: Int[np.ndarray, "k 2"],
    spans: Int[np.ndarray, "k 2"],
    count: Int[np.ndarray, " k"],
    width: int,
) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"], Float[np.ndarray, "p 3"]]:
    """Return for each pixel inside a facet: facet, pixel, barycentric shares of the corners."""
    which = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    x = low[which, 0] + number % spans[which, 0]
    y = low[which, 1] + number // spans[which, 0]
    a, b, c = corners[:, 0, :2], corners[:, 1, :2], corners[:, 2, :2]
    ab, ac = b - a, c - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    scale = np.where(np.abs(area) > 1e-12, 1.0 / np.where(area == 0, 1.0, area), np.nan)[which]
    px, py = x - a[which, 0], y - a[which, 1]
    second = (px * ac[which, 1] - py * ac[which, 0]) * scale
    third = (ab[which, 0] * py - ab[which, 1] * px) * scale
    within = (second >= -1e-9) & (third >= -1e-9) & (second + third <= 1 + 1e-9)  # NaN is not
    shares = np.column_stack([1 - second - third, second, third])[within]
    return which[within], (y * width + x)[within], shares
