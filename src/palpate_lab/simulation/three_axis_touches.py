"""Draw touches with shear and torque on a flat skin of three-axis taxels: to calibrate it, and to test it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from jaxtyping import Bool, Float, Int

RATE = 100.0  # Hz, of frames
TIPS = ((5e-3, 5e-3), (10e-3, 10e-3), (inf, 4.5e-3))  # m: radius of curvature and of the edge, to calibrate with
UNSEEN_TIPS = ((7e-3, 7e-3), (15e-3, 15e-3), (inf, 6e-3))  # m: to test with
SMALL_TIPS = ((3e-3, 3e-3), (4e-3, 4e-3), (inf, 3e-3))  # m: of which two have room two pitches apart
LIGHT, HEAVY, SHEAR = 0.5, 10.0, 0.8  # bounds of normal forces [N], evenly between their logarithms; shear / normal
LEVER = 2e-3  # m: the largest torque about the normal, per newton of the normal force
REST = 100  # frames before the first touch
_RISE, _HOLD, _FALL = 8, 18, 24  # frames of a touch until its force is full, falls, and is 0
_PERIOD = 54  # frames, with 0.3 s of rest: in less, a light touch passes for what remains of a heavy one
_TRIES = 400  # draws of a pair of places


@dataclass(frozen=True)
class Loads:
    """Contacts that act in `count` frames, m in all, in the frame of the skin: its outward normal is +z.

    Attributes:
        count: number of frames.
        frame, touch: (m,) the frame in which a contact acts, and the number of its touch.
        place, force: (m, 3) [m] and [N] on the skin.
        torque: (m,) [N m] about +z at the place.
        tip: (m, 2) [m] radius of curvature (inf: flat), and of the round edge.
        full: (m,) true where the full force acts.
    """

    count: int
    frame: Int[np.ndarray, " m"]
    touch: Int[np.ndarray, " m"]
    place: Float[np.ndarray, "m 3"]
    force: Float[np.ndarray, "m 3"]
    torque: Float[np.ndarray, " m"]
    tip: Float[np.ndarray, "m 2"]
    full: Bool[np.ndarray, " m"]


def three_axis_touches(
    positions: Float[np.ndarray, "k 3"],
    rng: np.random.Generator,
    touches: int = 200,
    *,
    tips: tuple[tuple[float, float], ...] = TIPS,
    spacing: tuple[float, float] | None = None,
    twist: bool = False,
) -> Loads:
    """Draw touches at random places up to the outer taxels, in every direction, with rest between them.

    Args:
        positions: (k, 3) [m] of the taxels, at z = 0.
        rng: random numbers.
        touches: number of touches.
        tips: radii [m] of curvature and of the edge, of which each contact draws one.
        spacing: bounds [m] of the distance between two contacts at once; None: one at a time.
        twist: True for a torque about the normal.
    """
    pairs = rng.uniform(positions.min(axis=0), positions.max(axis=0), (_TRIES, touches, 2, 3))
    low, high = spacing or (0.0, inf)
    fits = np.abs(np.linalg.norm(pairs[:, :, 1] - pairs[:, :, 0], axis=2) - (low + high) / 2) <= (high - low) / 2
    place = pairs[np.argmax(fits, axis=0), np.arange(touches), : 2 if spacing else 1]
    many = place.shape[:2]
    normal = LIGHT * (HEAVY / LIGHT) ** rng.random(many)
    angle, share = rng.uniform(0.0, 2 * np.pi, many), normal * rng.uniform(0.0, SHEAR, many)
    force = np.stack([share * np.cos(angle), share * np.sin(angle), -normal], axis=-1)
    torque = LEVER * normal * rng.uniform(-1.0, 1.0, many) * twist
    tip = np.array(tips)[rng.integers(len(tips), size=many)]
    touch, step, which = np.indices((touches, _FALL, many[1])).reshape(3, -1)
    scale = np.interp(step + 0.5, [0, _RISE, _HOLD, _FALL], [0.0, 1.0, 1.0, 0.0])
    time, pick = (REST + _PERIOD * touches, REST + _PERIOD * touch + step, touch), (touch, which)
    return Loads(*time, place[pick], scale[:, None] * force[pick], scale * torque[pick], tip[pick], scale == 1.0)
