"""Model a position-controlled robot: positions, speeds and accelerations of its joints from its commands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays

BEGUN = 4  # commands that are kept when what they did has decayed
SHOWN = 2  # of the begun that may be lost: an older lost one would have shown in earlier feedback
SETTLED = 6.0  # lags after which a motion has decayed, to (1 + 12) exp(-12)
FAINT = 2e-5  # rad or m: least difference of feedback from the model (encoders)
SAG = 1e-3  # rad or m, of joints from their commands at the start
ODD = 16.0  # chi-square per joint above which the model does not explain feedback
LESS = 0.1  # of it that remains without a lost command; until the servo is LEARNT, of what another servo leaves
CORRECTION = 0.1  # s: time constant by which feedback corrects the offset
YIELD = 1e-4  # rad or m per N: by which joints yield to a force on the robot's tip
WANDER = 2e-4  # s per square root of a second, of delay and lag
NONSENSE = 1e16  # chi-square per joint from which feedback is no joint's, and would spoil the model by rounding
SOUND = 2.0  # chi-square per joint up to which another servo explains feedback that is odd
LEARNT = 5e-4  # s: standard deviation of delay and lag
WIDENED = 2e-3  # s, by which delay and lag may be other than was learnt, where feedback is odd
BOUND = 3.0  # standard deviations of delay and lag as stated, beyond which neither is looked for
STEP = 5e-4  # s, of the lag, of a finite difference
ROUNDS = 3  # of an iterated Kalman filter: positions are not linear in delay and lag where commands change
USUAL = 0.05  # share of the newest feedback in the usual difference
_Course = list[Float[np.ndarray, "..."]]  # state (3, n), line (2, n), begin of the line and present time (2,)


@dataclass(frozen=True)
class Servo:
    """Times with which a robot follows joint commands, from `palpate calibrate servo`, a data sheet or a step response.

    After `delay`, a command is reached along a straight line within `ramp`; the joints follow that line as a critically
    damped system of second order, w = 2/lag, or as one of first order, w = 1/lag:

        q'' + 2 w q' + w^2 q = w^2 r  or  q' + w q = w r

    Args:
        period: [s] between two commands.
        delay: [s] from a command until the robot begins to follow it.
        ramp: [s] in which it interpolates between commands, usually the period; 0: none.
        lag: [s] by which its joints lag behind a ramp; 0: none.
        known: [s] standard deviation of delay and lag as they are stated; 0: exact, nothing is learnt from feedback.
        order: of the system, 2 or 1.
        provenance: of a calibration.

    Raises:
        InputError: a period that is not positive, another time that is negative or not finite, or another order.
    """

    period: float = 0.02
    delay: float = 0.02
    ramp: float = 0.02
    lag: float = 0.03
    known: float = 0.01
    order: int = 2
    provenance: Mapping[str, str] = field(default_factory=dict[str, str], compare=False)

    def __post_init__(self) -> None:
        if self.order not in (1, 2):
            raise InputError(f"order must be 1 or 2, not {self.order}.")
        for name in ("period", "delay", "ramp", "lag", "known"):
            value = getattr(self, name)
            if not 0 <= value < np.inf or (name == "period" and value == 0):  # NaN too
                raise InputError(f"{name} must be a time of 0 s or more (period: above 0 s), not {value}.")

    @property
    def total_delay(self) -> float:
        """Delay [s] of joints that follow a ramp of commands: delay + ramp + lag."""
        return self.delay + self.ramp + self.lag


class Feedback(Enum):
    """Result of comparing feedback with the model."""

    AGREES = "agrees"
    ODD = "odd"
    """The feedback is not finite, or far from the model, and no lost command explains this."""
    LOST = "lost"
    """The newest command that should show in the feedback never came."""


@takes_arrays
class ServoModel:
    """A model of joints, their speeds and accelerations, between and before the robot's feedback, from which it learns.

    The model is exact for ramps of commands. Delay, lag and each joint's offset from the model (sag, deflection,
    friction) are states of an iterated Kalman filter that feedback corrects: delay and lag from what was stated, with
    `Servo.known` as standard deviation; the offset follows with a time constant of 0.1 s, and sooner where joints yield
    to a force. A command that the feedback shows as lost is removed. Feedback that nothing explains is ignored; where
    the next one agrees with it, the model begins from there.

    Args:
        servo: times with which the robot follows commands, as stated.
        count: n, the number of joints.

    Attributes:
        joints: present joint positions (n,) [rad, m]; `advance` overwrites them, and the speeds and accelerations.
        offset: (n,) difference of the joints from the model, by their feedback.
        missed: number of commands that never came, if feedback comes about once per command and lags behind it.
    """

    def __init__(self, servo: Servo, count: int) -> None:
        from palpate.control import _servo as kernel  # compiled: loaded when first needed

        self.servo, self._run, self._learn = servo, kernel.run.unchecked, kernel.learn.unchecked
        slowest = servo.total_delay + SETTLED * servo.lag + 2.0 * (1.0 + SETTLED) * servo.known
        kept = math.ceil(slowest / servo.period) + BEGUN
        self._sent, self._targets = np.zeros(kept), np.zeros((kept, count))
        self._now, self._base, self._trial = ([np.zeros((m, count)) for m in (3, 2)] + [np.zeros(2)] for _ in range(3))
        self._span, self._slopes, self._gain = np.zeros(3, dtype=np.int64), np.zeros((2, count)), np.zeros(2 + count)
        self.joints, self._times = np.zeros(count), np.zeros(4)
        self._least = np.maximum(0.0, np.array([servo.delay, servo.lag]) - BOUND * servo.known)
        self._most = np.array([servo.delay, servo.lag]) + BOUND * servo.known
        self.start(0.0, np.zeros(count))
        self.advance(1e-3)  # compiles
        self.correct(1e-3, np.zeros(count))
        self.start(0.0, np.zeros(count))

    def start(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """Begin at rest at joints (n,) [rad, m] at a time [s], with the stated servo, without commands and `missed`.

        Raises:
            InputError: joints has another shape.
        """
        state, line, clock = self._base
        state[:], line[:], clock[:] = 0.0, joints, (-np.inf, time)
        state[0], self._count, self.missed = joints, 0, 0
        self._values = np.concatenate([[self.servo.delay, self.servo.lag], np.zeros(len(joints))])
        self._covariance = np.diag([self.servo.known**2] * 2 + [SAG**2] * len(joints))
        self._usual, self._fed, self._off = 5.0 * FAINT, time, np.full(len(joints), np.inf)
        self._take(self._values, self._covariance)
        self._again(time)

    def send(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """Add a command (n,) [rad, m] sent at a time [s].

        Raises:
            InputError: joints has another shape.
        """
        if self._count == len(self._sent):
            self._advance(self._base, 0, self._sent[0] + self._times[0], last=1)
            self._remove(0)
        self._sent[self._count], self._targets[self._count] = time, joints
        self._count += 1

    def advance(self, time: float) -> None:
        """Advance the model to a later time [s]; earlier times are ignored."""
        self._next = self._advance(self._now, self._next, time)
        np.add(self._now[0][0], self.offset, out=self.joints)

    def correct(self, time: float, joints: Float[np.ndarray, " n"], force_change: float = 0.0) -> Feedback:
        """Correct the model by the joints (n,) [rad, m] at a time [s], at most some cycles ago; return a `Feedback`.

        `force_change` [N] is that of the force on the robot's tip since the last feedback: its joints yield to it.

        Raises:
            InputError: feedback of another number of joints.
        """
        if joints.shape != self.offset.shape:
            raise InputError(f"feedback must have {len(self.offset)} joints, not shape {joints.shape}.", where="joints")
        size, *learnt = self._explained(time, joints)
        if not 0.0 <= size < NONSENSE:
            return Feedback.ODD
        found, lost, widened = Feedback.AGREES, -1, 0.0
        if size > ODD:
            first, widened = size, WIDENED
            size, *learnt = self._explained(time, joints, widened=widened)
            found = Feedback.ODD if size > SOUND else found
            lost, other = self._lost(time, joints)
            if other < min(ODD, LESS * (first if self.found.known < LEARNT else size)):
                found, size = Feedback.LOST, other
        self._usual = max(FAINT, self._usual * math.sqrt(1.0 + USUAL * (min(size, 4.0) - 1.0)))
        if found == Feedback.ODD:
            self._begin_again(time, joints)
        else:
            self._off = np.full(len(joints), np.inf)
        if found == Feedback.LOST:  # what it showed before, if little, was taken for another servo: learn nothing more
            self._remove(lost)
            self.missed += 1
        elif found == Feedback.AGREES:
            if force_change > 0.0 and self.servo.known > 0.0:  # joints that yield are no evidence of another delay
                _, *learnt = self._explained(time, joints, widened=widened, yielded=YIELD * force_change)
            self._take(*learnt)
        self._fed = max(time, self._fed)
        self._again(self._now[2][1])
        return found

    @property
    def found(self) -> Servo:
        """The servo with the delay and lag that were found so far, and the larger of their standard deviations."""
        delay, lag = self._values[:2].tolist()
        known = float(np.sqrt(np.diag(self._covariance)[:2].max()))
        return replace(self.servo, delay=delay, lag=lag, known=known)

    @property
    def total_delay(self) -> float:
        """Present delay [s] of joints that follow a ramp of commands."""
        return float(self._times[:3].sum())

    @property
    def speeds(self) -> Float[np.ndarray, " n"]:
        """Present joint speeds (n,) [rad/s, m/s]."""
        return self._now[0][1]

    @property
    def accelerations(self) -> Float[np.ndarray, " n"]:
        """Present joint accelerations (n,) [rad/s^2, m/s^2]."""
        return self._now[0][2]

    def _advance(self, course: _Course, first: int, time: float, *, last: int | None = None, omitted: int = -1) -> int:
        """Advance a course through the commands from the first on; return the first that has not begun by then."""
        self._span[:] = first, self._count if last is None else last, omitted
        return self._run(*course, self._sent, self._targets, self._span, self._times, time)

    def _replay(self, course: _Course, time: float, omitted: int = -1) -> int:
        """Let a course begin at the oldest commands again."""
        for to, of in zip(course, self._base, strict=True):
            to[:] = of
        return self._advance(course, 0, time, omitted=omitted)

    def _again(self, time: float) -> None:
        self._next = self._replay(self._now, time)
        np.add(self._now[0][0], self.offset, out=self.joints)

    def _lost(self, time: float, joints: Float[np.ndarray, " n"]) -> tuple[int, float]:
        """Return the command without which the feedback is explained best, and chi-square per joint without it."""
        begun = np.flatnonzero(self._sent[: self._count] + self._times[0] <= time)[-SHOWN:]
        sizes = [self._explained(time, joints, k)[0] for k in begun.tolist()]
        best = int(np.argmin(sizes)) if sizes else -1
        return (int(begun[best]), sizes[best]) if sizes else (-1, np.inf)

    def _begin_again(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """Begin from odd feedback that agrees with the one before: joints were stopped, by torque or a contact."""
        state, passed = self._trial[0], max(time - self._fed, self.servo.period)
        self._replay(self._trial, time)
        off = joints - state[0] - self.offset
        change, self._off = off - self._off, off
        if float(change @ change) < float(off @ off):
            state[0] += off
            state[1] += change / passed
            for to, of in zip(self._base, self._trial, strict=True):
                to[:] = of
            while self._count and self._sent[0] + self._times[0] <= time:
                self._remove(0)

    def _remove(self, k: int) -> None:
        """Remove a command from those that are kept."""
        for rows in (self._sent, self._targets):
            rows[k : self._count - 1] = rows[k + 1 : self._count]
        self._count -= 1
        self._next -= self._next > k

    def _take(self, values: Float[np.ndarray, " m"], covariance: Float[np.ndarray, "m m"]) -> None:
        values[:2] = np.clip(values[:2], self._least, self._most)
        self._values, self._covariance, self.offset = values, covariance, values[2:]
        self._times[:] = values[0], self.servo.ramp, values[1], self.servo.order

    def _explained(
        self,
        time: float,
        joints: Float[np.ndarray, " n"],
        omitted: int = -1,
        *,
        widened: float = 0.0,
        yielded: float = 0.0,
    ) -> tuple[float, Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
        """Return chi-square per joint of feedback, if a command is omitted, and what the filter learns from it.

        `widened` [s] is added to the standard deviations of delay and lag, `yielded` [rad, m] to those of the offset.
        """
        passed = max(0.0, time - self._fed)
        spread, state, values = self._covariance.copy(), self._trial[0], self._values
        added = np.full(len(values), (self._usual * passed / CORRECTION) ** 2 + yielded**2)
        added[:2] = WANDER**2 * passed + widened**2 if self.servo.known > 0.0 else 0.0
        spread.flat[:: len(values) + 1] += added
        size, covariance = np.nan, spread
        for _ in range(ROUNDS if self.servo.known > 0.0 else 1):
            at = np.clip(values[:2], self._least, self._most)
            self._times[[0, 2]] = at[0], at[1] + STEP
            self._replay(self._trial, time, omitted)
            self._slopes[1] = state[0]
            self._times[2] = at[1]
            self._replay(self._trial, time, omitted)
            self._slopes[0], self._slopes[1] = -state[1], (self._slopes[1] - state[0]) / STEP
            modelled = state[0] + (self._values[:2] - at) @ self._slopes
            values, covariance = self._values.copy(), spread.copy()
            given = self._slopes, self._usual**2, values, covariance, self._gain
            size = self._learn(joints, modelled, *given) / len(joints)
        self._times[[0, 2]] = self._values[:2]
        return size, values, covariance
