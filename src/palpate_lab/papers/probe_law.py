"""Law of the `probe` paper, corrected where necessary: admittances of force and angle, the baseline."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.control.control_law import Sensed
from palpate.control.probe_face import ProbeFace
from palpate.control.servo import Servo
from palpate.control.stability import Admittance, DelayedRobot, require_stable
from palpate.errors import InputError
from palpate.signals.filters import Butterworth
from palpate.signals.smoothing import Forward
from palpate.spatial._arrays import require_out
from palpate.spatial.arguments import takes_arrays

LOW_PASS = 10.0  # Hz, of the place of the contact, as the paper chose it from a spectrum
USED = np.full(1, -1, dtype=np.int8)


@takes_arrays
class Plain:
    """Law by (7), (8) and (9) of `probe`, with (8) paired crosswise (`turning_error`), on a low-passed contact point.

    The caller chooses the estimator's filter: the paper's is `Kalman(1e-6, 2e-4)`.

    Args:
        face: the face that presses.
        force: [N] wanted contact force.
        pushing: admittance of the force.
        bandwidth: [rad/s] of the angle: D of (8) is R/bandwidth for each axis, and M/D is that of `pushing`.
        stiffest: [N/m] greatest stiffness to be touched, at which the force loop must be stable.
        servo: model of the robot, for the stability check; None: `Servo()`.
        rate: [Hz] of the readings.
        smoothing: [s] time constant of the estimator's filter, for the stability check; 0: none.

    Raises:
        InputError: a loop is unstable (the message has the bound), a bandwidth is not positive, or the rate is too low
            for the 10 Hz low-pass.
    """

    delay = 0.0
    ready = True

    def __init__(
        self,
        face: ProbeFace,
        force: float,
        pushing: Admittance,
        bandwidth: float,
        *,
        stiffest: float,
        servo: Servo | None = None,
        rate: float = 200.0,
        smoothing: float = 0.0,
    ) -> None:
        if not 0 < bandwidth < np.inf:
            raise InputError(f"the bandwidth of the angle must be positive, not {bandwidth} rad/s.")
        self.face, self.force, self.pushing = face, float(force), pushing
        settles = pushing.mass / pushing.damping
        self.radii = face.radii(self.force)
        across = self.radii[::-1].tolist()  # about x counts the radius along y
        self.turning = tuple(Admittance(settles * r / bandwidth, r / bandwidth) for r in across)
        servo = Servo() if servo is None else servo
        cycles = round(servo.delay / servo.period)
        robot = DelayedRobot(servo.period, cycles, servo.ramp > 0, servo.lag, 2, smoothing)
        require_stable(robot, pushing, stiffest)
        low_pass = Butterworth(LOW_PASS)  # of the place alone: the force goes without
        robot = replace(robot, smoothing=smoothing + float(low_pass.delay(0.0, rate)))
        for about, radius in zip(self.turning, across, strict=True):
            require_stable(robot, about, radius, "orientation")
        self._low_pass = Forward(low_pass.recursion(rate), rate, 2)
        self._time, self._place = np.zeros(1), np.zeros((1, 2))
        self._off, self._turn, self._speed = 0.0, np.zeros(2), 0.0

    def reset(self) -> None:
        """Set the speeds of motion, and the force error and contact point of the last reading, to 0."""
        self._low_pass.reset()
        self._off, self._speed = 0.0, 0.0
        self._turn[:], self._place[:] = 0.0, 0.0

    def start(self, seen: Sensed) -> None:
        """Set the speeds of motion to 0, and restart the low-pass of the contact point."""
        self._low_pass.reset()
        self._turn[:], self._speed = 0.0, 0.0

    def observe(self, seen: Sensed) -> None:
        """Store the force error [N] and the low-passed contact point x, y [m] of a reading, for `hold`."""
        self._time[0], self._place[0] = seen.time, seen.place[:2]
        self._low_pass(self._time, USED, self._place)
        self._off = force_error(float(seen.force[2]), self.force)

    def keep(self) -> None:
        """Do nothing: the paper's law uses no feedback."""

    def forget(self) -> None:
        """Do nothing: the paper's law uses no feedback."""

    def press(self, seen: Sensed, period: float, out: Float[np.ndarray, " 6"]) -> None:
        """Write the step of one period [s] into out (6,): translation [m], rotation vector [rad], in base axes."""
        self.hold(seen.time, seen.rotation, seen.tip, period, out)

    def hold(
        self,
        time: float,
        rotation: Float[np.ndarray, "3 3"],
        tip: Float[np.ndarray, " 3"],
        period: float,
        out: Float[np.ndarray, " 6"],
    ) -> None:
        """Write the step (6,) of one period [s] into out: translation [m], then rotation vector [rad], in base axes.

        It follows (7), (8) and (9) of `probe`.

        Raises:
            InputError: arrays of other shapes.
        """
        self._speed = self.pushing.step(self._speed, self._off, period)
        x, y = self._place[0].tolist()
        for k, error in enumerate(turning_error(x, y)):
            self._turn[k] = self.turning[k].step(float(self._turn[k]), error, period)
        selected_step(rotation, self._speed, (float(self._turn[0]), float(self._turn[1])), period, out)


def force_error(force: float, wanted: float) -> float:
    """Return the force error f_z - f_d [N] of (7) of `probe`, positive if the probe presses too lightly.

    A positive error moves the probe along z, deeper into the tissue. f_z < 0 while pressed, and f_d is -`wanted`.

    Args:
        force: z of the force on the probe, in the sensor's frame [N].
        wanted: wanted contact force, positive [N].
    """
    return force + wanted


def turning_error(x: float, y: float) -> tuple[float, float]:
    """Return the errors that turn the probe about x and y, for a contact at (x, y) from its wanted place [m].

    (8) sets each turn equal to the offset along its own axis; geometry pairs them crosswise. On a convex probe that
    points along z the outward normal at (x, y) is n = (x/R_x, y/R_y, 1) to first order, R its radii there. The tissue
    touches where its own normal is -n. Turning the probe by the rotation vector z x n = (-y/R_y, x/R_x, 0) brings its z
    onto n, and so the contact back to the middle: about x with -y, about y with +x.

    Returns:
        (-y, x) [m].
    """
    return -y, x


@takes_arrays
def selected_step(
    rotation: Float[np.ndarray, "3 3"],
    speed: float,
    turning: tuple[float, float],
    dt: float,
    out: Float[np.ndarray, " 6"],
) -> None:
    """Write the wanted step of the sensor, (9) of `probe`: only along its z, only about its x and y; in base axes.

        e = dt [R (S_z . v), R (S_xy . w)],   S_z = (0, 0, 1),  S_xy = (1, 1, 0)

    The dt is missing in print, where e is called a difference of poses but is made of velocities.

    Args:
        rotation: R of the sensor in the base.
        speed: v_z [m/s].
        turning: w_x, w_y [rad/s].
        dt: [s].
        out: (6,) translation [m], then rotation vector [rad].

    Raises:
        InputError: `out` has another shape or is not writable.
    """
    require_out(out, (6,))
    along, about_x, about_y = dt * speed, dt * turning[0], dt * turning[1]
    for r in range(3):
        out[r] = rotation[r, 2] * along
        out[3 + r] = rotation[r, 0] * about_x + rotation[r, 1] * about_y
