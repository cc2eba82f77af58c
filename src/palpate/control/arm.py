"""Model a serial arm for a control loop: pose of its sensor, motion of a point on it, limits of its joints."""

from __future__ import annotations

from dataclasses import field

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from palpate.control import _arm
from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen, require_out, shaped
from palpate.spatial.arguments import frozen_value
from palpate.spatial.pose import Pose


@frozen_value
class Arm(Value):
    """A chain of n joints from the base to the sensor, T_base_sensor = P_0 M_1(q_1) P_1 ... M_n(q_n) P_n.

    M turns about, or slides along, its joint's axis. `load_arm` of `palpate.files.arm` reads one from a URDF.

    Args:
        names: names of the joints, from the base on.
        placements: P, a batch of n + 1 poses.
        axes: (n, 3) axis of each joint in the frame after P; scaled to length 1.
        revolute: (n,) True for a joint that turns [rad], False for one that slides [m].
        lower, upper: (n,) limits of the positions; infinite if unlimited.
        speed: (n,) largest speed [rad/s, m/s].
        acceleration: (n,) largest acceleration [rad/s^2, m/s^2]; None: infinite.

    Attributes:
        chain: (n + 1, 16) geometry for compiled loops; do not change it.
        limits: (4, n) lower, upper, speed and acceleration; do not change it.

    Raises:
        InputError: lengths differ, an axis has no direction, a range is empty, a speed is not positive and finite, or
            an acceleration is not positive.
    """

    names: tuple[str, ...]
    placements: Pose
    axes: Float[np.ndarray, "n 3"]
    revolute: Bool[np.ndarray, " n"]
    lower: Float[np.ndarray, " n"]
    upper: Float[np.ndarray, " n"]
    speed: Float[np.ndarray, " n"]
    acceleration: Float[np.ndarray, " n"] | None = None
    chain: Float[np.ndarray, "m 16"] = field(init=False, repr=False)
    limits: Float[np.ndarray, "4 n"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        n = len(self.names)
        rows = {"lower": self.lower, "upper": self.upper, "speed": self.speed}
        rows["acceleration"] = np.full(n, np.inf) if self.acceleration is None else self.acceleration
        for name, values in rows.items():
            object.__setattr__(self, name, frozen(shaped(values, (n,), name)))
        axes = shaped(self.axes, (n, 3), "axes")
        if not n or self.placements.translation.shape != (n + 1, 3) or np.shape(self.revolute) != (n,):
            raise InputError(
                f"an arm needs at least one joint, and {n} joints need {n + 1} placements and {n} values of revolute."
            )
        length = np.linalg.norm(axes, axis=1, keepdims=True)
        self._require(~((length[:, 0] > 0) & np.isfinite(length[:, 0])), "has no axis: it must be finite and not zero")
        self._require(~(self.lower < self.upper), "has an empty range: its lower limit is not below the upper one")
        self._require(~((self.speed > 0) & np.isfinite(self.speed)), "has no speed limit: it must be positive")
        self._require(~(np.asarray(self.acceleration) > 0), "has an acceleration limit that is not positive")
        turns = np.array(self.revolute, dtype=bool)
        turns.flags.writeable = False
        joints = np.zeros((n + 1, 4))
        joints[:n, :3], joints[:n, 3] = axes / length, turns
        fixed = self.placements
        chain = np.hstack([fixed.rotation.reshape(-1, 9), fixed.translation, joints])
        object.__setattr__(self, "axes", frozen(joints[:n, :3]))
        object.__setattr__(self, "revolute", turns)
        # writable, because compiled loops that are given a read-only array are compiled again
        object.__setattr__(self, "chain", np.ascontiguousarray(chain))
        object.__setattr__(
            self, "limits", np.array([self.lower, self.upper, self.speed, self.acceleration], dtype=np.float64)
        )

    def _require(self, wrong: Bool[np.ndarray, " n"], what: str) -> None:
        if wrong.any():
            raise InputError(f"joint {self.names[int(np.argmax(wrong))]!r} {what}.")

    @property
    def middle(self) -> Float[np.ndarray, " n"]:
        """Joint positions halfway between the limits, (n,) [rad, m]; 0 for unlimited joints."""
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper)
        return 0.5 * (np.where(bounded, self.lower, 0.0) + np.where(bounded, self.upper, 0.0))

    def motion_into(
        self,
        q: Float[np.ndarray, " n"],
        rate: Float[np.ndarray, " n"],
        change: Float[np.ndarray, " n"],
        point: Float[np.ndarray, " 3"],
        out: Float[np.ndarray, " 12"],
    ) -> None:
        """Write velocity, angular velocity, acceleration and angular acceleration of a point of the sensor's frame.

        From joint to joint (Luh, Walker and Paul 1980, its outward half), with o the vector to the next origin,

            v += w x o,   a += al x o + w x (w x o),   then for a joint that turns w += z q',  al += w x z q' + z q''
            and for one that slides v += z q',  a += 2 w x z q' + z q''

        Args:
            q: (n,) joint positions [rad, m].
            rate: (n,) their velocities.
            change: (n,) their accelerations.
            point: (3,) in the sensor's frame [m].
            out: (12,) in base axes [m/s, rad/s, m/s^2, rad/s^2]; without gravity.

        Raises:
            InputError: an array of another shape, or `out` that is not writable.
        """
        require_out(out, (12,))
        moves = (self._joints(each) for each in (q, rate, change))
        _arm.motion(self.chain, *moves, shaped(point, (3,), "point"), out)

    def pose(self, q: ArrayLike) -> Pose:
        """Return T_base_sensor at joint positions q (n,) [rad, m] as a `Pose`.

        Raises:
            InputError: positions of another number than the arm's joints.
        """
        rotation, translation = np.empty((3, 3)), np.empty(3)
        _arm.pose(self.chain, self._joints(q), rotation, translation)
        return Pose(rotation, translation)

    def jacobian(self, q: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> Float[np.ndarray, "6 n"]:
        """Return the Jacobian (6, n), in base axes, at joint positions q (n,) [rad, m].

        Its rows are velocity, then angular velocity of a point (3,) [m] of the sensor's frame; a column is z x (p - o)
        and z for a joint that turns, z and 0 for one that slides.

        Raises:
            InputError: positions of another number than the arm's joints, or a point of another shape.
        """
        out = np.empty((6, len(self.names)))
        _arm.jacobian(self.chain, self._joints(q), shaped(point, (3,), "point"), out)
        return out

    def _joints(self, values: ArrayLike) -> Float[np.ndarray, " n"]:
        return shaped(values, (len(self.names),), "joints")
