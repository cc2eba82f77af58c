"""Holding force and angle on what moves: its surface is observed, foreseen over the loop's delay, and met there."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.control.law import Sensed
from palpate.control.motion_bank import MotionBank
from palpate.control.probe_face import ProbeFace
from palpate.errors import InputError

__all__ = ["Follow"]

ANGLE_FLOOR = float(np.radians(0.8))  # a filter that believes readings to be better turns faster than the loop's delay
HEIGHT_FLOOR = 60e-6  # m
SIZES = (0.17, 0.17, 0.01)  # of the motions to expect [rad, rad, m]
SMOOTHING = 0.04  # s
SETTLED = 0.1  # of the wanted force
SETTLING = 0.25  # s that the force is to be there
PATIENCE = 6.0  # s, after which the stiffness stays as it was stated


class Follow:
    """Ours: the surface's two angles and its height, each with its speed, are states that readings correct.

    With n the outward normal of the probe where it is touched (`ProbeFace.normal`), turned into the base by the robot's
    own pose, the surface leans by a = atan2(nx, nz), b = atan2(ny, nz) in the axes that the probe had when it first
    touched; its height is that of the probe's lowest point, less what the force is off the wanted one over the stiffness
    K. All three are the surface's, not the probe's: the robot's own motion does not enter them, which is why they can be
    foreseen over the loop's delay (`MotionBank`) and met there by position.

    K is fitted while the probe first presses, to depth = c + s t + force/K. A wrong one converges where it is above half
    of the true one.

    Args:
        face: that presses.
        force: [N] wanted.
        stiffness: [N/m] of what is touched, where the first press does not tell.
        stiffest: [N/m] to be expected: how gently it first presses.

    Raises:
        InputError: a number that is not positive, or a stiffness above the stiffest.
    """

    def __init__(self, face: ProbeFace, force: float, stiffness: float = 2000.0, stiffest: float = 10e3) -> None:
        if not (force > 0 and 0 < stiffness <= stiffest < np.inf):  # NaN too
            raise InputError(
                f"force ({force:g} N) must be positive, and stiffness ({stiffness:g} N/m) between 0 and the "
                f"stiffest ({stiffest:g} N/m)."
            )
        self.face, self.force, self.stated, self.stiffest = face, float(force), float(stiffness), float(stiffest)
        self.stiffness, self.late, self.ready = self.stated, 0.07, False
        self.bank = MotionBank(SIZES)
        self._axes, self._origin = np.eye(3), np.zeros(3)
        self._readings, self._variances = np.zeros(3), np.zeros(3)
        self._normal, self._point, self._target = np.zeros(3), np.zeros(3), np.eye(3)
        self._sums, self._right = np.zeros((3, 3)), np.zeros(3)
        self._begun = self._time = self._reached = 0.0
        self._pressing = self._touch = self.depth = 0.0
        self._smooth = np.zeros(3)

    def start(self, seen: Sensed) -> None:
        """Axes and place of the touch; what was learned of the stiffness stays."""
        self._axes[:], self._origin[:] = seen.rotation, seen.tip
        self._sums[:], self._right[:] = 0.0, 0.0
        self._begun = self._time = seen.time
        self._reached, self.ready, self._pressing = np.inf, False, 0.0
        self._angles(seen)
        self.bank.start([*self._readings[:2], 0.0])
        self._touch = float(np.sqrt(seen.force @ seen.force))

    def observe(self, seen: Sensed) -> None:
        """The surface by one reading."""
        self._angles(seen)
        pressing = -float(seen.force @ (seen.rotation.T @ self._outward(self.bank.predict(seen.time - self._time)[0])))
        self._height(seen, pressing)
        self.bank.update(seen.time - self._time, self._readings, self._variances)
        self._pressing += min(1.0, (seen.time - self._time) / 0.05) * (pressing - self._pressing)
        self._time = seen.time
        if not self.ready:
            self._learn(seen, pressing)

    def press(self, seen: Sensed, period: float, out: Float[np.ndarray, " 6"]) -> None:
        """Along the probe's axis by (wanted - force)/D, with D twice the stiffest times the delay: without overshoot."""
        out[:] = 0.0
        speed = (self.force - self._pressing) / (2.0 * self.stiffest * self.late)
        out[:3] = speed * period * seen.rotation[:, 2]

    def hold(
        self,
        time: float,
        rotation: Float[np.ndarray, "3 3"],
        tip: Float[np.ndarray, " 3"],
        period: float,
        out: Float[np.ndarray, " 6"],
    ) -> None:
        """To where the surface will be when the command is met: tip on it, axis against it, no spin."""
        decay = float(np.exp(-period / SMOOTHING)) if SMOOTHING else 0.0
        values, _ = self.bank.predict(time - self._time + self.late + (period * decay / (1.0 - decay)))
        self._smooth += (1.0 - decay) * (values - self._smooth)
        normal = self._outward(self._smooth)
        upright = float(normal @ self._axes[:, 2])
        out[:3] = self._origin + (self._smooth[2] - self.depth / upright) * self._axes[:, 2] + self.depth * normal - tip
        _turn(self._axes, normal, self._target)
        _rotation_vector(self._target, rotation, out[3:])

    def _outward(self, values: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
        """Outward normal that the probe should have, in the base, by the angles of the surface."""
        local = self._point
        local[0], local[1], local[2] = np.tan(values[0]), np.tan(values[1]), 1.0
        local /= float(np.sqrt(local @ local))
        return self._axes @ local

    def _angles(self, seen: Sensed) -> None:
        self.face.normal(seen.place, self._normal)
        n = self._axes.T @ (seen.rotation @ self._normal)
        self._readings[0], self._readings[1] = np.arctan2(n[0], n[2]), np.arctan2(n[1], n[2])
        radii = self.face.radii
        for k in (0, 1):
            self._variances[k] = max(ANGLE_FLOOR**2, float(seen.variance[k] / radii[k] ** 2))

    def _height(self, seen: Sensed, pressing: float) -> None:
        """Where the wanted force would be felt, along the first axis: by the lowest point, and force over stiffness."""
        values, _ = self.bank.predict(seen.time - self._time)
        normal = self._outward(values)
        self.face.lowest(seen.rotation.T @ normal, self._point)
        low = seen.rotation @ self._point + seen.tip - self._origin
        upright = float(normal @ self._axes[:, 2])
        self._readings[2] = (float(low @ normal) - (pressing - self.force) / self.stiffness) / upright
        self._variances[2] = HEIGHT_FLOOR**2

    def _learn(self, seen: Sensed, pressing: float) -> None:
        """Stiffness from depth against time and force, above half of the wanted force."""
        if self._pressing > 0.5 * self.force:
            row = np.array([1.0, seen.time - self._begun, pressing])
            self._sums += np.outer(row, row)
            self._right += row * float((seen.tip - self._origin) @ self._axes[:, 2])
        if self._pressing > (1.0 - SETTLED) * self.force and not np.isfinite(self._reached):
            self._reached = seen.time
        if seen.time - self._reached > SETTLING or seen.time - self._begun > PATIENCE:
            self._know()

    def _know(self) -> None:
        """Take the fitted stiffness if it is one, and begin to follow from here."""
        if np.linalg.matrix_rank(self._sums) == 3:
            compliance = float(np.linalg.solve(self._sums, self._right)[2])
            if compliance > 1.0 / self.stiffest:
                self.stiffness = 1.0 / compliance
        values, rates = self.bank.predict(0.0)
        height = self._readings[2]
        self.bank.start([values[0], values[1], height], [rates[0], rates[1], 0.0])
        self._smooth[:] = values[0], values[1], height
        self.depth = max(0.0, height) / (1.0 - min(0.5, np.sqrt(self._touch / self.force)))
        self.ready = True


def _turn(axes: Float[np.ndarray, "3 3"], normal: Float[np.ndarray, " 3"], out: Float[np.ndarray, "3 3"]) -> None:
    """Axes turned by the least rotation that brings their third one onto a normal (Rodrigues)."""
    z = axes[:, 2]
    v, c = np.cross(z, normal), float(z @ normal)
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    out[:] = axes + k @ axes + k @ (k @ axes) / (1.0 + c)


def _rotation_vector(
    to: Float[np.ndarray, "3 3"], of: Float[np.ndarray, "3 3"], out: Float[np.ndarray, " 3"]
) -> None:
    """Rotation vector in the base that turns one set of axes into another, less than half a turn away."""
    r = to @ of.T
    out[0], out[1], out[2] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    sine, cosine = 0.5 * float(np.sqrt(out @ out)), 0.5 * (float(np.trace(r)) - 1.0)
    out *= 0.5 * (np.arctan2(sine, cosine) / sine if sine > 1e-9 else 1.0)
