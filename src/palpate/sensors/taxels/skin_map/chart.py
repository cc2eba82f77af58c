"""Define the lines on which control points lie: the intersections of two families of planes.

Around a link they are spokes about its axis; over a patch that is seen from one side they follow its mean normal.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial.arguments import frozen_value, takes_arrays


@frozen_value
class Chart:
    """Planes u and v, and the line in which they meet: A(u, v) + s D(v).

    Attributes:
        round: spokes about an axis, v an angle [rad] and u a height [m]; else both are lengths [m].
        centre: (3,) where u is 0 [m].
        axes: (3, 3) rows p, q, w: spokes p cos v + q sin v and w the axis; else u along p, v along q, lines along w.
            The surface's r_u x r_v points out.
    """

    round: bool
    centre: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]

    def lines(
        self, u: Float[np.ndarray, "*#batch"], v: Float[np.ndarray, "*#batch"]
    ) -> tuple[Float[np.ndarray, "... 3"], Float[np.ndarray, "... 3"]]:
        """Return a point of each line (..., 3) [m], and its unit direction (..., 3), for u and v of any one shape.

        Raises:
            InputError: arrays of other shapes.
        """
        p, q, w = self.axes
        u, v = np.asarray(u)[..., None], np.asarray(v)[..., None]
        if self.round:
            return self.centre + u * w + 0.0 * v, np.cos(v) * p + np.sin(v) * q + 0.0 * u
        return self.centre + u * p + v * q, np.broadcast_to(w, (*np.broadcast_shapes(u.shape, v.shape)[:-1], 3))

    def local(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return u and two coordinates in its plane, (..., 3) [m]: x and y about an axis, else v and s.

        Raises:
            InputError: points has another shape.
        """
        x, y, z = np.moveaxis((points - self.centre) @ self.axes.T, -1, 0)
        return np.stack([z, x, y] if self.round else [x, y, z], axis=-1)

    def coordinates(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return u, v and s of points, (..., 3) [m]; about an axis v is an angle in [-pi, pi].

        Raises:
            InputError: points has another shape.
        """
        u, b, c = np.moveaxis(self.local(points), -1, 0)
        return np.stack([u, np.arctan2(c, b), np.hypot(b, c)] if self.round else [u, b, c], axis=-1)

    def between(
        self, start: Float[np.ndarray, "*#batch _"], end: Float[np.ndarray, "*#batch _"]
    ) -> Float[np.ndarray, "..."]:
        """Return the steps in u and v, (..., 2) [m; rad for an angle], from start to end, the shorter way.

        Raises:
            InputError: arrays of other shapes.
        """
        way = end[..., :2] - start[..., :2]
        if self.round:
            way[..., 1] = wrapped(way[..., 1])
        return way


@takes_arrays
def wrapped(angle: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """Return the same angle [rad] in [-pi, pi).

    Raises:
        InputError: angle has another shape.
    """
    return np.mod(angle + np.pi, 2 * np.pi) - np.pi


@takes_arrays
def flat_chart(
    origin: Float[np.ndarray, "3"], normal: Float[np.ndarray, "3"], heading: Float[np.ndarray, "3"]
) -> Chart:
    """Return a flat `Chart` about an origin [m]: v along the heading, lines along the unit normal, p = q x w.

    Raises:
        InputError: arrays of other shapes.
    """
    v = heading - normal * (heading @ normal)
    v /= np.linalg.norm(v)
    return Chart(False, origin, np.stack([np.cross(v, normal), v, normal]))


@takes_arrays
def round_chart(
    middles: Float[np.ndarray, "f 3"],
    normals: Float[np.ndarray, "f 3"],
    areas: Float[np.ndarray, " f"],
    origin: Float[np.ndarray, "3"],
    axis: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]] | None,
) -> Chart:
    """Return a `Chart` about an axis, whose v is 0 at the origin.

    Args:
        middles: (f, 3) of the facets [m].
        normals: (f, 3) of the facets, unit.
        areas: (f,) of the facets [m^2].
        origin: of the sheet [m].
        axis: a point [m] and a direction; None: along the smallest eigenvector of sum A n n', nearest to all normals.

    Raises:
        InputError: the axis has no direction, or the origin lies on it; or arrays of other shapes.
    """
    if axis is None:
        spread = np.einsum("f,fi,fj->ij", areas, normals, normals)
        direction = np.linalg.eigh(spread)[1][:, 0]
        direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
        point = None
    else:
        point, direction = (np.asarray(part, dtype=np.float64) for part in axis)
        if not np.linalg.norm(direction) > 0:
            raise InputError("the axis must not be zero.", where="axis", hint="Give a point and a direction.")
        direction = direction / np.linalg.norm(direction)
    across = np.eye(3) - np.outer(direction, direction)
    if point is None:
        flat = normals @ across
        length = np.linalg.norm(flat, axis=1)
        flat = flat / np.where(length > 0, length, 1.0)[:, None]
        reject = (areas * length)[:, None, None] * (across - flat[:, :, None] * flat[:, None, :])
        right = np.einsum("fij,fj->i", reject, middles)
        whole = reject.sum(axis=0)
        whole = whole + np.trace(whole) * (np.outer(direction, direction) + 1e-9 * np.eye(3))  # along it all points do
        point = cast("Any", np.linalg.solve(whole, right))
    point = point + direction * (direction @ (origin - point))
    spoke = across @ (origin - point)
    if not np.linalg.norm(spoke) > 0:
        what = "the axis must not pass through the sheet's origin, from which angles about it are counted."
        raise InputError(what, where="axis", hint="Give the axis of the link, about which the sheet is wrapped.")
    spoke /= np.linalg.norm(spoke)
    return Chart(True, point, np.stack([spoke, np.cross(spoke, direction), direction]))
