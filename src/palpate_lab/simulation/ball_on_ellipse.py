"""A ball on an elliptic cylinder, x^2/a^2 + z^2/b^2 = 1: its contact point, and its wrench through a soft layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

RINGS, SPOKES = 16, 24  # of the cap of the ball that presses: twice as many move the line of action by 0.3 um
_STEPS = 4  # of Newton to the ellipse's nearest point, from a place at most a ball away


@dataclass(frozen=True)
class Ellipse:
    """Cross-section of the fingertip; y is free. The default is the paper's (`load_cells` (9)).

    Args:
        a, b: semi-axes along x and z [m].
    """

    a: float = 14e-3
    b: float = 5e-3

    def foot(
        self, x: Float[np.ndarray, "*batch"], y: Float[np.ndarray, "*batch"]
    ) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
        """Return the points (*batch, 3) [m] of the upper side above (x, y) [m], and the outward unit normals there.

        Beyond |x| = a, z of the point and the normal are NaN.
        """
        point = np.stack([x, y, self.b * np.sqrt(1.0 - (x / self.a) ** 2)], axis=-1)
        normal = point * [self.a**-2, 0.0, self.b**-2]
        return point, normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def depth(self, x: Float[np.ndarray, "*batch"], z: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Return the distance [m] of points near the upper side below the surface, negative above it.

        Newton's method on the angle t of the nearest point (a sin t, b cos t), where the way to it is along the normal.
        """
        turn = np.arctan2(x / self.a, z / self.b)
        for _ in range(_STEPS):
            sine, cosine = np.sin(turn), np.cos(turn)
            dx, dz = self.a * sine - x, self.b * cosine - z
            slope = dx * self.a * cosine - dz * self.b * sine
            bend = (self.a * cosine) ** 2 + (self.b * sine) ** 2 - dx * self.a * sine - dz * self.b * cosine
            turn = turn - slope / bend
        sine, cosine = np.sin(turn), np.cos(turn)
        out = (self.a * sine - x) * self.b * sine + (self.b * cosine - z) * self.a * cosine
        return out / np.hypot(self.b * sine, self.a * cosine)


FINGERTIP = Ellipse()


def pressed_wrench(
    ellipse: Ellipse,
    radius: float,
    stiffness: float,
    x: Float[np.ndarray, " n"],
    depth: Float[np.ndarray, " n"],
    friction: Float[np.ndarray, " n"],
    motion: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n 6"]:
    """Compute the wrench of a rigid ball on a layer that is an elastic foundation, pressed in above (x, 0).

    Where the ball reaches below the undeformed surface by d it is pressed by K d: a normal traction along the ball's
    own normal, so that without friction the resultant passes through its centre, and a tangential one, friction times
    it, along the ball's motion. Both are summed over the part of the ball that is below; friction acts at the deformed
    surface, not at the undeformed one. A flat layer carries K pi d^2 (r - d/3).

    Args:
        ellipse: the undeformed outside.
        radius: r of the ball [m].
        stiffness: K of the foundation [N/m^3].
        x: x of the foot of the ball's centre [m].
        depth: d under the foot [m], below r.
        friction: coefficient of friction.
        motion: (n, 3) motion of the ball over the surface, of any length but zero.

    Returns:
        (n, 6) [N, N m] on the body, about the origin, with the foot at y = 0.
    """
    foot, normal = ellipse.foot(x, np.zeros_like(x))
    across = np.stack([normal[:, 2], np.zeros_like(x), -normal[:, 0]], axis=1)
    centre = foot + (radius - depth)[:, None] * normal
    share, turn = (np.arange(RINGS) + 0.5) / RINGS, 2 * np.pi * (np.arange(SPOKES) + 0.5) / SPOKES
    down = 1.0 - share[None] * (depth / radius)[:, None]  # cosine of the angle from -normal: rings of equal area
    side = np.sqrt(1.0 - down**2)[..., None]
    outward = (
        (side * np.cos(turn))[..., None] * across[:, None, None]
        + (side * np.sin(turn))[..., None] * np.array([0.0, 1.0, 0.0])
        - down[..., None, None] * normal[:, None, None]
    )
    place = centre[:, None, None] + radius * outward
    below = np.maximum(ellipse.depth(place[..., 0], place[..., 2]), 0.0)
    load = stiffness * below * (2 * np.pi * radius * depth / (RINGS * SPOKES))[:, None, None]
    along = motion[:, None, None] - np.sum(motion[:, None, None] * outward, axis=-1, keepdims=True) * outward
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    traction = load[..., None] * (outward + friction[:, None, None, None] * along)
    return np.concatenate([traction.sum(axis=(1, 2)), np.cross(place, traction).sum(axis=(1, 2))], axis=1)
