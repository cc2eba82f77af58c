"""Control a robot that presses a probe on a surface with a wanted force, at right angles, by force sensing alone."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.contact import Status, WrenchEstimator
from palpate.contact.estimate import ROW
from palpate.control.arm import Arm
from palpate.control.control_law import MotionLaw, Sensed
from palpate.control.probe_face import ProbeFace
from palpate.control.servo import Feedback, Servo, ServoModel
from palpate.control.supervisor import ENOUGH, PRESSING, Limits, State, Supervisor
from palpate.control.tracking_law import Follow
from palpate.errors import InputError
from palpate.signals.payload import Payload
from palpate.signals.recording import Recording
from palpate.signals.wrench_sensor import Tare
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import number, takes_arrays
from palpate.surfaces.mesh import Mesh

DAMPING = 0.01  # of (10): a twentieth of what an arm of half a metre moves, where it is not near a singular pose
DEAF = 10  # commands in a row that never came
JUMP = 5.0  # s between two calls that no clock makes
LEAST = 1e-4  # s: cycles are told apart to this


@called_as("palpate.AlignController(arm, palpate.WrenchEstimator(mesh, sensor), force=7.0)")
class AlignController:
    """Controller from wrench, joints and time to a joint command, at the sensor's rate.

    Once per period of the robot there is a new command. A cycle: pose of the robot (`ServoModel`), inertial part of the
    wrench, contact (`WrenchEstimator`), state (`Supervisor`), step of the tip (`MotionLaw`), joints within their limits
    ((10) of `probe`).

    Args:
        arm: the chain from the base to the sensor.
        estimator: of the contact, live; without a filter for `Follow`, which filters itself.
        force: [N] wanted contact force.
        face: of the probe, in the surface's frame; None: the face along z of the estimator's mesh.
        servo: how the robot follows commands, from which delay and lag are learnt; None: `Servo()`.
        limits: limits of force, motion and time; None: `Limits()`.
        law: law of motion; None: `Follow`.
        within: [N] difference from the wanted force within which it counts as held: `State.HOLD`, or else FOLLOW.
        inertia: (3, 3) [kg m^2] of the payload about its centre, in the sensor's frame; an error in it moves the
            contact whenever the robot turns the probe. None: that of the mesh's hull, filled evenly with the payload.

    Raises:
        InputError: the limit on force is not above the wanted force, or that is not positive; the surface is no mesh
            and no face is given; or the estimator filters and the law is `Follow`, which does not know that delay.
        GeometryError: no facet of the mesh looks along z.
    """

    @takes_arrays
    def __init__(
        self,
        arm: Arm,
        estimator: WrenchEstimator,
        force: float = 7.0,
        *,
        face: ProbeFace | None = None,
        servo: Servo | None = None,
        limits: Limits | None = None,
        law: MotionLaw | None = None,
        within: float = 1.0,
        inertia: ArrayLike | None = None,
    ) -> None:
        from palpate.control import _align, _arm  # compiled: loaded when first needed

        self._kernel, self._moves = _align, _arm
        surface = estimator.locator.surface
        if law is None and estimator.filter is not None:
            raise InputError(
                "the estimator has a filter, but the motion law has its own.", hint="Build the estimator without it."
            )
        if face is None:
            if not isinstance(surface, Mesh):
                what = "the probe's face must be stated: it is known only of a mesh."
                raise InputError(what, where="face", hint="Pass a ProbeFace.")
            face = ProbeFace.of(surface)
        self.arm, self.estimator, self.face, self.force = arm, estimator, face, float(force)
        self.servo = Servo() if servo is None else servo
        self.limits = Limits() if limits is None else limits
        self.law: MotionLaw = Follow(face, self.force) if law is None else law
        self.supervisor = Supervisor(self.limits, self.force, float(within))
        self.model = ServoModel(self.servo, len(arm.names))
        mount = estimator.mount
        self._axes = np.ascontiguousarray(mount.rotation @ face.axes)  # of the face, in the sensor's frame
        self._tip = np.ascontiguousarray(mount.apply(face.place))
        payload: Payload | None = getattr(estimator.sensor, "payload", None)
        self._centre = np.zeros(3) if payload is None else np.array(payload.center_of_mass)
        self._gravity = np.zeros(3) if payload is None else np.nan_to_num(payload.gravity)
        mass = 0.0 if payload is None else payload.mass
        self._load = mass * (self._centre - self._tip)
        self._inertia = _filled(surface, mount.rotation, mass) if inertia is None else np.array(inertia, dtype=float)
        self._allocate(len(arm.names))
        drift, lever = np.asarray(self.limits.drift), float(np.linalg.norm(self._tip))
        self._drifts = float(drift[1] + drift[0] * lever) / self.force  # m/s that a contact seems to move
        self._tared: float | None = None

    def _allocate(self, count: int) -> None:
        self._row, self.seen = self.estimator.empty(1)[0], Sensed()
        self._sensor, self._place = np.eye(3), np.zeros(3)  # pose of the sensor in the base, now
        self._stance, self._foremost = np.eye(3), np.zeros(3)  # axes of the face and its tip, as commanded last
        self._motion, self._e, self._last = np.zeros(12), np.zeros(6), np.zeros(count)
        self._command, self._feedback, self._unheard, self._jumps = np.zeros(count), np.zeros(count), 0, 0
        self._bounds = np.array([DAMPING, self.limits.speed, self.limits.turn])
        self._fed, self._read = list[float](), list[float]()
        self._pressed = self._pressed_before = [0.0] * 3  # N: the contact's force, now and at the last feedback
        self._wrench, self._felt = np.full(6, np.nan), np.zeros(6)
        self._time = self._due = -np.inf
        self._upright = np.zeros(3)  # the probe's axis where it first touched
        self._home, self._moved, self._spent = np.zeros(3), np.zeros(3), np.zeros(3)
        self._face_axes, self._middle = np.array(self.face.axes), np.array(self.face.place)

    @property
    def state(self) -> State:
        """Present `State` of the loop, such as APPROACH, CONTACT or HOLD."""
        return self.supervisor.state

    @property
    def why(self) -> str:
        """Reason for the present state, as a sentence."""
        return self.supervisor.why

    @property
    def within(self) -> float:
        """Difference [N] from the wanted force within which it counts as held."""
        return self.supervisor.within

    @property
    def contact(self) -> Float[np.ndarray, " 22"]:
        """Last contact estimate, (22,), laid out as `ROW` (`palpate.contact`); the next call overwrites it."""
        return self._row

    @property
    def drifted(self) -> float:
        """Largest angle [rad] by which drift within `Limits.drift` may have turned the probe since the tare.

        A torque of dM moves the contact by dM/force, which turns the probe by that over the smaller radius of its face.
        """
        return 0.0 if self._tared is None else (self._time - self._tared) * self._drifts / float(self.law.radii.min())

    def tare(self, recording: Recording, time: float) -> Tare:
        """Subtract the untouched sensor's mean reading from now on; return a `Tare`. Drift counts from this time [s].

        Raises:
            InputError: too few samples, the sensor was not at rest, or a channel is missing.
        """
        taken = self.estimator.tare(recording)
        self._tared = time
        return taken

    def start(self, time: float, joints: ArrayLike) -> None:
        """Begin anew at a time [s] at rest at joints (n,) [rad, m] with the approach; the first `update` does it.

        Everything but the tare is as in a new controller: servo and stiffness as stated, no state, no reading.

        Raises:
            InputError: joints of another number than the arm's, or not finite.
        """
        self._command[:] = shaped(joints, self._command.shape, "joints")
        if not np.isfinite(self._command).all():
            raise InputError("the joints to start from must be finite.", where="joints")
        self.model.start(time, self._command)
        self.supervisor.start(time)
        self.law.reset()
        self.law.delay = self.model.total_delay
        self.estimator.reset()
        self._last[:] = self._e[:] = 0.0
        self._unheard = self._jumps = 0
        self._wrench[:], self._row[:], self._read = np.nan, np.nan, []
        self._time = self._due = time
        self._fed = self._command.tolist()
        self._pressed = self._pressed_before = [0.0] * 3
        self._moves.pose.unchecked(self.arm.chain, self.model.joints, self._sensor, self._place)
        self._home[:] = self._place + self._sensor @ self._tip
        self._tared = time if self._tared is None else self._tared

    def update(
        self, time: float, wrench: ArrayLike | None, joints: ArrayLike, acceleration: ArrayLike | None = None
    ) -> Float[np.ndarray, " n"]:
        """Return the joint command to send now, (n,) [rad, m].

        Args:
            time: [s] of the reading, on one monotonic clock; one that does not grow is ignored.
            wrench: (6,) [N, N m] as the sensor reads it; None, NaN or the same numbers again: no new reading.
            joints: (n,) [rad, m] the robot's newest feedback, unchanged until the next one.
            acceleration: (3,) [m/s^2] of an accelerometer at the sensor's origin, in its frame; None: from the robot's
                model.

        Returns:
            (n,) within the arm's limits, to be sent once per period, changed or not; the next call overwrites it.

        Raises:
            InputError: joints of another number than the arm's, or not finite at the first call; a time that is no
                number.
            ValueError: an acceleration of another shape.
        """
        if type(time) is not float:
            time = number(time, "time")
        feedback, given = self._feedback, shaped(joints, (...,), "joints")
        if given.shape != feedback.shape:
            raise InputError(f"feedback must have {len(feedback)} joints, not shape {given.shape}.", where="joints")
        feedback[:] = given
        if self._time == -np.inf:
            self.start(time, feedback)
        elif not time > self._time or not time < self._time + JUMP:
            self._jumps = self._jumps + 1 if JUMP < abs(time - self._time) < np.inf else 0
            if self._jumps >= ENOUGH:
                self.supervisor.stop(self._time, f"the clock jumped by {time - self._time:.3g} s")
            return self._command
        self._time, self._jumps = time, 0
        self.model.advance(time)
        fed = feedback.tolist()  # of six numbers a list compares ten times as fast as an array
        if fed != self._fed:
            self._fed = fed
            change, self._pressed_before = math.dist(self._pressed, self._pressed_before), self._pressed
            self._heed(time, self.model.correct(time, feedback, change))
            self.law.delay = self.model.total_delay
        self._moves.pose.unchecked(self.arm.chain, self.model.joints, self._sensor, self._place)
        if self._new(wrench):
            self._sense(time, acceleration)
        else:
            self.supervisor.silent(time)
        if time >= self._due - LEAST:
            self._due = max(self._due + self.servo.period, time)
            self._move(time)
        return self._command

    def _heed(self, time: float, said: Feedback) -> None:
        """Keep or discard observations according to the robot's feedback; stop after too many lost commands."""
        if said == Feedback.AGREES:
            self._unheard = 0
            self.law.keep()
            return
        self.law.forget()
        if said == Feedback.LOST:
            self._unheard += 1
            if self._unheard >= DEAF:
                self.supervisor.stop(time, f"the robot has not followed the last {self._unheard} commands")

    def _new(self, wrench: ArrayLike | None) -> bool:
        """Store the wrench; return whether it is a new, finite reading."""
        if wrench is None:
            return False
        reading = np.asarray(wrench, dtype=np.float64)
        numbers = reading.tolist()
        if reading.shape != (6,) or numbers == self._read or not all(map(math.isfinite, numbers)):
            return False
        self._read = numbers
        self._wrench[:] = reading
        return True

    def _sense(self, time: float, acceleration: ArrayLike | None) -> None:
        """Estimate the contact, update the state, and pass the reading to the law."""
        moved = self._acceleration(acceleration)
        self.estimator.update_into(time, self._felt, self._row, self._sensor, moved)
        row = self._row
        status = Status(int(row[ROW.status]))
        before, force = self.supervisor.state, math.hypot(*row[ROW.force].tolist())
        pressing = -float(row[ROW.force] @ row[ROW.normal])
        known = math.isfinite(force) and math.isfinite(pressing)
        self._pressed = row[ROW.force].tolist() if known else [0.0] * 3
        self.supervisor.fresh(time, status, force if known else 0.0, pressing if known else 0.0)
        if status > Status.AMBIGUOUS or force > self.limits.force:
            return
        seen, state = self.seen, self.supervisor.state
        seen.time = time
        face = (self._face_axes, self._middle, self._axes, self._tip, self._spent)
        out = (seen.rotation, seen.tip, seen.place, seen.variance, seen.force)
        self._kernel.sensed.unchecked(row, self._sensor, self._place, *face, *out)
        if state == State.CONTACT and before != State.CONTACT:
            self.law.start(seen)
            self._home[:], self._upright[:] = seen.tip, seen.rotation[:, 2]
        if state in PRESSING:
            self.law.observe(seen)
        if state in (State.CONTACT, State.FOLLOW) and self.law.ready:
            self.supervisor.pressed(time)

    def _acceleration(self, said: ArrayLike | None) -> Float[np.ndarray, " 3"]:
        """Return the acceleration (3,) of the payload's centre, in the sensor's frame; compensate its rotation."""
        model, centre, moved = self.model, self._centre, self._moved
        moves = model.joints, model.speeds, model.accelerations
        self._moves.motion.unchecked(self.arm.chain, *moves, centre, self._motion)
        load, wrenches = (self._inertia, self._load), (self._wrench, self._felt)
        self._kernel.felt.unchecked(self._motion, self._sensor, *load, *wrenches, moved, self._spent)
        if said is None:
            return moved
        turning, speeding = (self._sensor.T @ self._motion[k : k + 3] for k in (3, 9))
        lever = np.cross(speeding, centre) + np.cross(turning, np.cross(turning, centre))
        return np.asarray(said, dtype=np.float64) + self._sensor.T @ self._gravity + lever

    def _move(self, time: float) -> None:
        """Compute the next command from the last one's pose and the wanted step."""
        self._e[:] = 0.0
        arm, offset, axes, tip = self.arm, self.model.offset, self._stance, self._foremost
        self._moves.stance.unchecked(arm.chain, self._command, offset, self._axes, self._tip, axes, tip)
        self._guard(time, axes, tip)
        state, period = self.supervisor.state, self.servo.period
        if state == State.APPROACH:
            self._e[:3] = self.limits.approach * period * axes[:, 2]
        elif state == State.CONTACT:
            self.law.press(self.seen, period, self._e)
        elif state in PRESSING:
            self.law.hold(time, axes, tip, period, self._e)
        elif self.supervisor.retreating:
            self._e[:3] = -self.limits.approach * period * axes[:, 2]
        given = offset, self._tip, self._e, self._bounds
        self._moves.stepped.unchecked(arm.chain, arm.limits, *given, period, self._command, self._last)
        self.model.send(time, self._command)

    def _guard(self, time: float, axes: Float[np.ndarray, "3 3"], tip: Float[np.ndarray, " 3"]) -> None:
        """Stop the loop if the tip, the lean or the drift exceeds its limit."""
        supervisor, limits = self.supervisor, self.limits
        moved = math.dist(tip.tolist(), self._home.tolist())
        if supervisor.state == State.APPROACH:
            if moved > limits.travel:
                supervisor.stop(time, f"nothing was touched within {1e3 * limits.travel:.0f} mm", retreat=True)
            return
        if supervisor.retreating:
            supervisor.retreating = moved < limits.travel and time - supervisor.settled < limits.patience
            return
        if supervisor.state == State.STOPPED:
            return
        why = ""
        if self.drifted > limits.drift_angle:
            why = f"drift since the tare may have turned the probe by {math.degrees(self.drifted):.1f} deg: tare again"
        elif moved > limits.travel:
            why = f"the tip is more than {1e3 * limits.travel:.0f} mm from where it first touched"
        elif float(axes[:, 2] @ self._upright) < math.cos(limits.tilt):
            why = f"the probe leans by more than {math.degrees(limits.tilt):.0f} deg from where it first touched"
        if why:
            supervisor.stop(time, why, retreat=True)


def _filled(surface: object, rotation: Float[np.ndarray, "3 3"], mass: float) -> Float[np.ndarray, "3 3"]:
    """Return the inertia (3, 3) [kg m^2] of a mesh's hull with this mass about its centre, in the sensor's frame."""
    if mass == 0.0 or not isinstance(surface, Mesh):
        return np.zeros((3, 3))
    from trimesh import Trimesh  # here: it takes 0.2 s to import

    hull = Trimesh(surface.vertices, surface.faces, process=False).convex_hull
    inside: Float[np.ndarray, "3 3"] = np.asarray(hull.moment_inertia) * (mass / float(hull.volume))
    return np.ascontiguousarray(rotation @ inside @ rotation.T)
