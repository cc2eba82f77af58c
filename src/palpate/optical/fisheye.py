"""A fisheye camera, and its view of the plane of a ring of markers.

A ray at the angle theta from the optical axis lands at f theta_d from the principal point, with
theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) [Kannala and Brandt 2006], as in OpenCV's
`cv2.fisheye`. x_c points along the image's rows, y_c down its columns, z_c out of the lens.
"""

from __future__ import annotations

from dataclasses import fields
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen, shaped
from palpate.spatial.arguments import frozen_value
from palpate.spatial.pose import Pose

_GROUND = frozen(np.zeros(1))
STEPS = 60  # at most: Newton needs 4, halving an interval of pi to its last bit 53


@frozen_value(eq=True)
class Fisheye:
    """A fisheye lens and its image.

    Args:
        fx, fy: pixels per radian at the centre.
        cx, cy: principal point [px]; (0, 0) is the middle of the first pixel.
        k1, k2, k3, k4: coefficients of theta_d; all zero is an equidistant lens.
        width, height: of the image [px].

    Raises:
        InputError: a focal length or a size that is not positive, a number that is not finite.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    width: int = 640
    height: int = 480

    def __post_init__(self) -> None:
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        bad = [name for name, value in values.items() if not np.isfinite(value)]
        bad += [name for name in ("fx", "fy", "width", "height") if not values[name] > 0]
        if bad:
            raise InputError(
                f"{bad[0]} of a camera must be finite, and a focal length or a size positive, not {values[bad[0]]}."
            )

    @classmethod
    def equidistant(cls, width: int = 640, height: int = 480) -> Fisheye:
        """Return a `Fisheye` whose image spans 180 degrees along its longer side."""
        f = max(width, height) / np.pi
        return cls(f, f, (width - 1) / 2, (height - 1) / 2, width=width, height=height)

    @cached_property
    def reach(self) -> float:
        """Largest theta [rad] that has a pixel, at most pi."""
        slope = np.polynomial.Polynomial([1.0, 0.0, 3 * self.k1, 0.0, 5 * self.k2, 0.0, 7 * self.k3, 0.0, 9 * self.k4])
        roots = slope.roots()
        turns = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)]
        return float(min(np.pi, *turns)) if len(turns) else float(np.pi)

    def project(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
        """Return the pixels (*batch, 2) of points in the camera's frame [m]; NaN where theta exceeds `reach`.

        Raises:
            InputError: points has another shape.
        """
        x, y, z = np.moveaxis(points, -1, 0)
        r = np.asarray(np.hypot(x, y))
        theta = np.asarray(np.arctan2(r, z))
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(r > 0, self._bent(theta)[0] / r, 1.0 / z)
        scale = np.where((theta <= self.reach) & ((r > 0) | (z > 0)), scale, np.nan)
        return np.stack([self.fx * scale * x + self.cx, self.fy * scale * y + self.cy], axis=-1)

    def rays(self, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 3"]:
        """Return unit directions (*batch, 3), in the camera's frame, of the rays through pixels; NaN beyond `reach`.

        Raises:
            InputError: pixels has another shape.
        """
        return self._seen(pixels)[0]

    def rays_with_slope(
        self, pixels: Float[np.ndarray, "*batch 2"]
    ) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3 2"]]:
        """Return `rays` (*batch, 3) of pixels (*batch, 2) [px], and their derivatives (*batch, 3, 2) [1/px].

        Raises:
            InputError: pixels has another shape.
        """
        rays, plane, bent, theta, ratio = self._seen(pixels)
        slope = 1.0 / self._bent(theta)[1]
        near = bent < 1e-9
        unit = np.where(near[..., None], (1.0, 0.0), plane / np.where(near, 1.0, bent)[..., None])
        along = np.concatenate([np.cos(theta)[..., None] * unit, -np.sin(theta)[..., None]], axis=-1)
        across = np.stack([-unit[..., 1], unit[..., 0]], axis=-1)
        turned = np.concatenate([across, np.zeros((*across.shape[:-1], 1))], axis=-1)
        matrix = (slope[..., None] * along)[..., :, None] * unit[..., None, :]
        matrix += (ratio[..., None] * turned)[..., :, None] * across[..., None, :]
        return rays, matrix / (self.fx, self.fy)

    def _seen(self, pixels: Float[np.ndarray, "*batch 2"]) -> tuple[np.ndarray, ...]:
        """Return rays, pixels over the focal lengths, their radius theta_d, theta, and sin(theta) over theta_d."""
        plane = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        bent = np.asarray(np.sqrt(plane[..., 0] * plane[..., 0] + plane[..., 1] * plane[..., 1]))
        theta = self._angle(bent)
        near = bent < 1e-9  # there sin(theta) / bent is 1 to the last bit
        ratio = np.where(near, 1.0, np.sin(theta) / np.where(near, 1.0, bent))
        rays = np.empty((*theta.shape, 3))
        rays[..., :2], rays[..., 2] = ratio[..., None] * plane, np.cos(theta)
        return rays, plane, bent, theta, ratio

    @cached_property
    def numbers(self) -> Float[np.ndarray, " 10"]:
        """Numbers (10,) of the lens: fx, fy [px/rad], cx, cy [px], k1 to k4, largest theta and its theta_d [rad]."""
        bends, widest = (self.k1, self.k2, self.k3, self.k4), float(self._bent(np.asarray(self.reach))[0])
        return frozen([self.fx, self.fy, self.cx, self.cy, *bends, self.reach, widest])

    def _bent(self, theta: Float[np.ndarray, "*batch"]) -> tuple[Float[np.ndarray, "*batch"], ...]:
        """Return theta_d and its derivative by theta."""
        t = theta * theta
        value = np.asarray(theta * (1.0 + t * (self.k1 + t * (self.k2 + t * (self.k3 + t * self.k4)))))
        slope = 1.0 + t * (3 * self.k1 + t * (5 * self.k2 + t * (7 * self.k3 + t * 9 * self.k4)))
        return value, np.asarray(slope)

    def _angle(self, bent: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Return theta [rad] from theta_d; NaN beyond `reach`."""
        from palpate.optical._fisheye import angles  # compiled: loaded when first needed

        flat = np.ascontiguousarray(bent).reshape(-1)
        theta, low, high = np.empty((3, len(flat)))
        angles(flat, self.numbers[4:8], self.reach, STEPS, theta, low, high)
        return np.where(bent <= self.numbers[9], theta.reshape(bent.shape), np.nan)


@frozen_value(init=False)
class RingView(Value):
    """A camera's view of rings of markers, and the markers' places at rest.

    The ring's frame: origin in the first ring's centre, z along the barrel's axis towards the camera, angles about z
    from x.

    Args:
        camera: the lens.
        pose: T_ring_camera.
        radius: of the rings of markers [m].
        angles: (m,) of the markers at rest [rad], ring by ring, the same number in each.
        rings: (r,) heights of the rings [m]; the first is 0.

    Raises:
        InputError: a radius that is not positive, fewer than three angles or NaN among them, angles that cannot be
            divided among the rings, a first height that is not 0, a camera in the ring's plane, or a ring behind it.
    """

    camera: Fisheye
    pose: Pose
    radius: float
    angles: Float[np.ndarray, " m"]
    rings: Float[np.ndarray, " r"]

    def __init__(
        self, camera: Fisheye, pose: Pose, radius: float, angles: Float[np.ndarray, " m"], rings: ArrayLike = (0.0,)
    ) -> None:
        given = {"camera": camera, "pose": pose, "radius": float(radius), "angles": frozen(angles)}
        for name, value in (given | {"rings": frozen(np.asarray(rings, dtype=np.float64))}).items():
            object.__setattr__(self, name, value)
        if not (np.isfinite(radius) and radius > 0):
            raise InputError(f"radius of a ring must be positive and finite, not {radius} m.")
        if self.angles.ndim != 1 or len(self.angles) < 3 or not np.isfinite(self.angles).all():
            raise InputError("angles must be three or more finite numbers [rad], one for each marker.")
        if pose.translation.shape != (3,) or not abs(pose.translation[2]) > 1e-6:
            raise InputError(
                "pose must be a single one, with a translation (3,) whose z is not 0: the camera is not in the plane "
                "of the ring of markers."
            )
        if self.rings.ndim != 1 or not len(self.rings) or self.rings[0] != 0.0 or len(self.angles) % len(self.rings):
            raise InputError(
                "rings must be a list of heights that begins with 0, with the same number of markers in each ring."
            )
        if not (self.rings < abs(pose.translation[2])).all():
            raise InputError("every ring must be in front of the camera.")

    @cached_property
    def rest(self) -> Float[np.ndarray, "m 2"]:
        """Places x, y of the markers at rest, (m, 2) [m]."""
        return frozen(self.radius * np.stack([np.cos(self.angles), np.sin(self.angles)], axis=-1))

    @cached_property
    def ring(self) -> Int[np.ndarray, " m"]:
        """Index (m,) of each marker's ring in `rings`."""
        return np.repeat(np.arange(len(self.rings)), len(self.angles) // len(self.rings))

    @cached_property
    def heights(self) -> Float[np.ndarray, " m"]:
        """Height of each marker at rest, (m,) [m]."""
        return frozen(self.rings[self.ring])

    def to_plane(
        self, pixels: Float[np.ndarray, "*batch 2"], heights: Float[np.ndarray, " k"] = _GROUND
    ) -> Float[np.ndarray, "*batch 2"]:
        """Return points x, y (*batch, 2) [m] of planes z = height seen at pixels; NaN where a ray misses its plane.

        Args:
            pixels: (*batch, 2).
            heights: (k,) of the planes [m], for one pixel after the other, over and over.

        Raises:
            InputError: arrays of other shapes.
        """
        from palpate.optical._fisheye import to_plane  # compiled: loaded when first needed

        flat, out = flat_pixels(pixels), np.empty((np.size(pixels) // 2, 2))
        to_plane(flat, *self.numbers, heights, STEPS, out)
        return out.reshape(np.shape(pixels))

    @cached_property
    def numbers(self) -> tuple[Float[np.ndarray, " 10"], Float[np.ndarray, " 12"]]:
        """Numbers (10,) of the lens, as `Fisheye.numbers`, and (12,) of the pose: rotation by rows, translation [m]."""
        return self.camera.numbers, np.concatenate([self.pose.rotation.reshape(-1), self.pose.translation])

    def to_plane_with_slope(
        self, pixels: Float[np.ndarray, "*batch 2"], height: ArrayLike = 0.0
    ) -> tuple[Float[np.ndarray, "*batch 2"], Float[np.ndarray, "*batch 2 2"]]:
        """Return points x, y (*batch, 2) [m] of planes z = height seen at pixels, and their derivatives by the pixel.

        The derivatives are (*batch, 2, 2) [m/px]; both are NaN where a ray misses its plane.

        Args:
            pixels: (*batch, 2).
            height: of the planes [m], one or (*batch,).

        Raises:
            InputError: pixels has another shape.
        """
        rays, slope = self.camera.rays_with_slope(pixels)
        ray, turn = self.pose.rotate(rays), self.pose.rotation @ slope
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = ray[..., :2] / ray[..., 2:]
            length = (height - self.pose.translation[2]) / ray[..., 2]
        length = np.where(length > 0, length, np.nan)[..., None]  # NaN where the plane is behind
        matrix = turn[..., :2, :] - ratio[..., None] * turn[..., 2:, :]
        return self.pose.translation[:2] + length * ray[..., :2], length[..., None] * matrix

    def from_plane(
        self, points: Float[np.ndarray, "*batch 2"], height: ArrayLike = 0.0
    ) -> Float[np.ndarray, "*batch 2"]:
        """Return pixels (*batch, 2) of points x, y [m] at z = `height` [m] of the ring's frame; NaN out of view.

        Raises:
            InputError: points has another shape.
        """
        high = np.broadcast_to(np.asarray(height)[..., None], (*points.shape[:-1], 1))
        return self.camera.project(self.pose.inverse().apply(np.concatenate([points, high], axis=-1)))


def flat_pixels(pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "n 2"]:
    """Return pixels one after the other, (n, 2), as a read-only float64 array for compiled loops.

    Raises:
        InputError: `pixels` is not an array (*batch, 2) of real numbers.
    """
    flat = shaped(pixels, (..., 2), "pixels").reshape(-1, 2).view()
    flat.flags.writeable = False
    return flat
