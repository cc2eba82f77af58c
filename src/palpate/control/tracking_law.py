"""Hold force and angle on a moving surface: observe it, predict it over the loop's delay, and meet it there."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.control.control_law import Sensed
from palpate.control.motion_bank import MotionBank
from palpate.control.probe_face import ProbeFace
from palpate.errors import InputError
from palpate.spatial._arrays import require_out
from palpate.spatial.arguments import takes_arrays

ANGLE_FLOOR = float(np.radians(0.8))  # a filter that believes readings to be better turns faster than the loop's delay
HEIGHT_FLOOR = 60e-6  # m
SIZES = (0.17, 0.17, 0.01)  # of the motions to expect [rad, rad, m]
SPEED = 0.01  # m/s at most, while it presses
SMOOTHING = np.array([0.05, 0.05, 0.025])  # s, of the commanded angles and height: what the joints' accelerations allow
SOFTEST = 0.02  # of the stiffest
SETTLED = 0.1  # of the wanted force
SETTLING = 0.25  # s that the force is to be there
RECALLED = 0.1  # s: what was known before that says less than readings from a wrong place
FAR = 8.0  # standard deviations
PATIENCE = 6.0  # s, after which the stiffness stays as it was stated


@takes_arrays
class Follow:
    """Palpate's law: the surface's two angles and its height, each with its rate, are states that readings correct.

    If a face of R (`ProbeFace`) is touched u away from its middle, the surface leans by asin(u/R). Its normal n, turned
    by the robot's pose, gives a = atan2(nx, nz), b = atan2(ny, nz) in the axes of the probe at first touch; its height
    is that of the probe's lowest point, less (force - wanted)/K. The robot's motion does not enter all three, so they
    can be predicted over the loop's delay (`MotionBank`) and met by position.

    The stiffness K is fitted while the probe first presses, to depth = c + s t + a sqrt(force), whose slope at the
    wanted force is 1/K. The loop converges if K is above half of the true one.

    Args:
        face: the face that presses.
        force: [N] wanted contact force.
        stiffness: [N/m] of the surface, used if the first press does not determine it.
        stiffest: [N/m] greatest stiffness to expect; it determines how gently the probe first presses.

    Raises:
        InputError: a number that is not positive and finite, or a stiffness above the stiffest.
    """

    def __init__(self, face: ProbeFace, force: float, stiffness: float = 2000.0, stiffest: float = 10e3) -> None:
        from palpate.control import _align as kernel  # compiled: loaded when first needed

        if not (force > 0 and 0 < stiffness <= stiffest < np.inf):  # NaN too
            raise InputError(
                f"force ({force:g} N) must be positive, and stiffness ({stiffness:g} N/m) above 0 and at "
                f"most stiffest ({stiffest:g} N/m)."
            )
        self.face, self.force, self._stated, self.stiffest = face, float(force), float(stiffness), float(stiffest)
        self.delay = 0.07
        self.bank = MotionBank(SIZES)
        self._axes, self._origin = np.eye(3), np.zeros(3)
        self._readings, self._variances = np.zeros(3), np.zeros(3)
        self._floor = np.array([ANGLE_FLOOR, ANGLE_FLOOR, HEIGHT_FLOOR]) ** 2
        self._grid = np.geomspace(SOFTEST * self.stiffest, self.stiffest, 10)
        self._table = np.array([face.radii(self.force, each) for each in self._grid])  # now: it takes 20 ms each
        self.radii = np.zeros(2)
        self._observed, self._smoothed = kernel.observed.unchecked, kernel.smoothed.unchecked
        self._target = kernel.target.unchecked
        self._sums, self._right = np.zeros((3, 3)), np.zeros(3)
        self._smooth, self._rate = np.zeros(3), np.zeros(3)
        self.reset()

    def reset(self) -> None:
        """Set stiffness and radii to what was stated, and forget the surface."""
        self.stiffness, self.ready, self._odd = self._stated, False, False
        self._begun = self._time = self._kept = self._reached = 0.0
        self._pressing = self._touch = self.depth = 0.0
        self._smooth[:], self._rate[:] = 0.0, 0.0
        self._know_radii()
        self.bank.start(np.zeros(3))

    def start(self, seen: Sensed) -> None:
        """Take axes and origin from the first reading of a touch; the stiffness is kept, and `ready` is False."""
        self._axes[:], self._origin[:] = seen.rotation, seen.tip
        self._sums[:], self._right[:] = 0.0, 0.0
        self._begun = self._time = seen.time
        self._reached, self.ready, self._odd, self._pressing = np.inf, False, False, 0.0
        self._read(seen)
        self.bank.start([*self._readings[:2], 0.0])
        self._kept = seen.time
        self._touch = float(np.sqrt(seen.force @ seen.force))

    def observe(self, seen: Sensed) -> None:
        """Correct the surface's estimate by one reading, and fit the stiffness until `ready`.

        A reading that is far from what the bank predicts is ignored, unless the one before was, too.
        """
        pressing = self._read(seen)
        self._odd = not self._odd and self.bank.far(self._readings, self._variances, seen.time - self._time) > FAR
        if self._odd:
            return
        self.bank.update(seen.time - self._time, self._readings, self._variances)
        self._pressing += min(1.0, (seen.time - self._time) / 0.05) * (pressing - self._pressing)
        self._time = seen.time
        if not self.ready:
            self._learn(seen, pressing)

    def keep(self) -> None:
        """Store the surface's estimate: the robot's feedback agrees with the pose it was seen from."""
        self.bank.keep()
        self._kept = self._time

    def forget(self) -> None:
        """Restore the estimate that was kept last, if less than 0.1 s ago; the stiffness keeps all readings."""
        if self._time - self._kept < RECALLED:
            self.bank.recall()
            self._time = self._kept

    def press(self, seen: Sensed, period: float, out: Float[np.ndarray, " 6"]) -> None:
        """Write a step along the probe's axis at speed (wanted - force)/D, D = 2 K `delay`: no overshoot.

        K is `stiffest` at first, then three times the force over the travel so far, if less: a round body is up to
        three times stiffer than that ratio.

        Args:
            seen: present reading.
            period: [s] of the step.
            out: (6,) translation [m], then rotation vector [rad], in base axes.

        Raises:
            InputError: `out` has another shape or is not writable.
        """
        require_out(out, (6,))
        out[:] = 0.0
        travel = float((seen.tip - self._origin) @ self._axes[:, 2])
        secant = 3.0 * max(self._pressing, self._touch) / max(travel, 1e-4)
        speed = (self.force - self._pressing) / (2.0 * min(self.stiffest, secant) * self.delay)
        out[:3] = min(speed, SPEED) * period * seen.rotation[:, 2]

    def hold(
        self,
        time: float,
        rotation: Float[np.ndarray, "3 3"],
        tip: Float[np.ndarray, " 3"],
        period: float,
        out: Float[np.ndarray, " 6"],
    ) -> None:
        """Write the step onto the surface as predicted for the command: tip on it, axis against it, no spin.

        Args:
            time: [s] of the command.
            rotation: (3, 3) axes of the face in the base, as commanded last.
            tip: (3,) [m] middle of the face in the base, as commanded last.
            period: [s] of the step.
            out: (6,) translation [m], then rotation vector [rad], in base axes.

        Raises:
            InputError: `out` has another shape or is not writable.
        """
        require_out(out, (6,))
        behind = float(SMOOTHING[0]) - 0.5 * period  # a command is already led there over the period that it begins
        values, rates = self.bank.predict(time - self._time + self.delay + behind)
        values[2] -= (SMOOTHING[0] - SMOOTHING[2]) * rates[2]
        self._smoothed(values, SMOOTHING, period, self._smooth, self._rate)
        self._target(self._smooth, self._axes, self._origin, self.depth, rotation, tip, out)

    def _read(self, seen: Sensed) -> float:
        """Write readings of the surface and their variances; return the normal force [N]."""
        values, _ = self.bank.predict(seen.time - self._time)
        contact = (seen.place, seen.variance, seen.force, seen.rotation, seen.tip)
        frame = (self.radii, self._axes, self._origin)
        wanted = (self.force, self.stiffness, self._floor)
        return self._observed(*contact, *frame, values, *wanted, self._readings, self._variances)

    def _learn(self, seen: Sensed, pressing: float) -> None:
        """Fit the stiffness, from a third of the wanted force on."""
        if self._pressing > 0.3 * self.force:
            row = np.array([1.0, seen.time - self._begun, np.sqrt(max(0.0, pressing) / self.force)])
            self._sums += np.outer(row, row)
            self._right += row * float((seen.tip - self._origin) @ self._axes[:, 2])
        if self._pressing > (1.0 - SETTLED) * self.force and not np.isfinite(self._reached):
            self._reached = seen.time
        if seen.time - self._reached > SETTLING or seen.time - self._begun > PATIENCE:
            self._know()

    def _know(self) -> None:
        """Take the fitted stiffness if it is valid, and begin to follow from here."""
        if np.linalg.matrix_rank(self._sums) == 3:
            fitted: Float[np.ndarray, " 3"] = np.linalg.solve(self._sums, self._right)
            compliance = 0.5 * float(fitted[2]) / self.force
            if compliance > 1.0 / self.stiffest:
                self.stiffness = 1.0 / compliance
        before = self.radii.copy()
        self._know_radii()
        height = float(self._readings[2])
        self.bank.scale(np.append(before / self.radii, 1.0))
        self.bank.start([height], series=slice(2, 3))
        self._kept = self._time
        self._smooth[:] = 0.0, 0.0, height  # the probe stands as it first touched: it has only pressed since
        self._rate[:] = 0.0
        self.depth = max(0.0, height) / (1.0 - min(0.5, np.sqrt(self._touch / self.force)))
        self.ready = True

    def _know_radii(self) -> None:
        """Set the radii [m/rad] from the stiffness."""
        for k in (0, 1):
            self.radii[k] = np.interp(np.log(self.stiffness), np.log(self._grid), self._table[:, k])
