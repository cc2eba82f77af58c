"""Model a position-controlled robot: positions, speeds and accelerations of its joints from its commands."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays

REMEMBERED = 64  # past moments, with the nearest of which feedback is compared
BEGUN = 4  # commands that are remembered
SHOWN = 2  # of them that may be lost: an older lost one would have shown in earlier feedback
FAINT = 2e-5  # rad or m: least difference of feedback from the model (encoders)
ODD = 4.0  # times the usual difference
CORRECTION = 0.1  # s: time constant by which feedback corrects the model
USUAL = 0.05  # share of the newest feedback in the usual difference


@dataclass(frozen=True)
class Servo:
    """Times with which a robot follows joint commands, from its data sheet or a step response.

    After `delay`, a command is reached along a straight line within `ramp`; the joints follow that line as a critically
    damped system of second order, w = 2/lag:

        q'' + 2 w q' + w^2 q = w^2 r

    Args:
        period: [s] between two commands.
        delay: [s] from a command until the robot begins to follow it.
        ramp: [s] in which it interpolates between commands, usually the period; 0: none.
        lag: [s] by which its joints lag behind a ramp; 0: none.

    Raises:
        InputError: a period that is not positive, or another time that is negative or not finite.
    """

    period: float = 0.02
    delay: float = 0.02
    ramp: float = 0.02
    lag: float = 0.03

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
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


class _Course:
    """Motion of joints: exact from one change of the line that they follow to the next."""

    def __init__(self, servo: Servo, time: float, joints: Float[np.ndarray, " n"]) -> None:
        from palpate.control import _servo as kernel  # compiled: loaded when first needed

        self.servo, self.time, self.begun, self._follow = servo, time, -np.inf, kernel.follow.unchecked
        self.state, self.line = np.zeros((3, len(joints))), np.zeros((2, len(joints)))
        self.state[0] = self.line[:] = joints

    def copy(self) -> _Course:
        """Return a copy that continues from the present state."""
        made = object.__new__(_Course)  # for every command
        made.servo, made.time, made.begun, made._follow = self.servo, self.time, self.begun, self._follow
        made.state, made.line = self.state.copy(), self.line.copy()
        return made

    def follow(self, time: float) -> None:
        """Advance to a later time [s]; earlier times are ignored."""
        self._follow(self.state, self.line, self.begun, self.servo.ramp, self.servo.lag, self.time, time)
        self.time = max(self.time, time)

    def take(self, begins: float, target: Float[np.ndarray, " n"]) -> None:
        """Let the line lead to a new command from this time on."""
        self.follow(begins)
        share = 1.0 if self.servo.ramp == 0.0 else min(1.0, (begins - self.begun) / self.servo.ramp)
        self.line[0] += share * (self.line[1] - self.line[0])
        self.line[1], self.begun = target, begins


@dataclass(frozen=True, eq=False)
class _Begun:
    """A command, when it began, and the course before it."""

    time: float
    target: Float[np.ndarray, " n"]
    before: _Course


@takes_arrays
class ServoModel:
    """A model of joints, their speeds and accelerations, between and before the robot's feedback.

    The model is exact for ramps of commands. The difference of the feedback from it (sag, deflection, friction) is
    followed with a time constant of 0.1 s and added. A command that the feedback shows as lost is removed.

    Args:
        servo: times with which the robot follows commands.
        count: n, the number of joints.

    Attributes:
        joints: present joint positions (n,) [rad, m]; `advance` overwrites them, and the speeds and accelerations.
        offset: (n,) difference of the joints from the model, by their feedback.
        missed: number of commands that never came, if feedback comes about once per command and lags behind it.
    """

    def __init__(self, servo: Servo, count: int) -> None:
        from palpate.control import _servo as kernel  # compiled: loaded when first needed

        self.servo, self._apart = servo, kernel.separate.unchecked
        self.offset, self.joints, self._off = np.zeros(count), np.zeros(count), np.zeros(count)
        self._waiting: deque[tuple[float, np.ndarray]] = deque()
        self._begins = deque[_Begun](maxlen=BEGUN)
        self._past, self._times, self._kept = np.zeros((REMEMBERED, count)), np.zeros(REMEMBERED), 0
        self.start(0.0, np.zeros(count))
        self.advance(1e-3)  # compiles
        self.correct(1e-3, np.zeros(count))
        self.start(0.0, np.zeros(count))

    def start(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """Begin at rest at joints (n,) [rad, m] at a time [s], without commands, offset and `missed`.

        Raises:
            InputError: joints has another shape.
        """
        self._course, self._fed = _Course(self.servo, time, joints), time
        self.offset[:], self.joints[:] = 0.0, joints
        self._waiting.clear()
        self._begins.clear()
        self._usual, self.missed = 5.0 * FAINT, 0  # what feedback is off usually
        self._times[:] = -np.inf
        self._kept = 0

    def send(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """Add a command (n,) [rad, m] sent at a time [s].

        Raises:
            InputError: joints has another shape.
        """
        self._waiting.append((time + self.servo.delay, joints.copy()))

    def advance(self, time: float) -> None:
        """Advance the model to a later time [s]; earlier times are ignored."""
        while self._waiting and self._waiting[0][0] <= time:
            self._take(*self._waiting.popleft())
        self._course.follow(time)
        np.add(self._course.state[0], self.offset, out=self.joints)
        self._past[self._kept], self._times[self._kept] = self._course.state[0], time
        self._kept = (self._kept + 1) % REMEMBERED

    def correct(self, time: float, joints: Float[np.ndarray, " n"]) -> Feedback:
        """Correct the model by the joints (n,) [rad, m] at a time [s], at most some cycles ago; return a `Feedback`.

        Raises:
            InputError: feedback of another number of joints.
        """
        if joints.shape != self.offset.shape:
            raise InputError(f"feedback must have {len(self.offset)} joints, not shape {joints.shape}.", where="joints")
        off = self._apart(self._past, self._times, time, joints, self.offset, self._off)
        if not off < np.inf:
            return Feedback.ODD
        odd, without, lost = off > ODD * self._usual, off, None
        begun = [each for each in self._begins if each.time <= time][-SHOWN:]
        for each in begun if odd else ():
            if (gap := self._without(each, time, joints)) < without:
                without, lost = gap, each
        size = min(off, without, 2.0 * self._usual)  # one that is odd counts little
        self._usual = max(FAINT, math.sqrt(self._usual**2 + USUAL * (size**2 - self._usual**2)))
        passed, self._fed = max(0.0, time - self._fed), max(time, self._fed)
        if lost is not None and without < 0.5 * off:
            self._take_out(lost)
            return Feedback.LOST
        self.offset += (1.0 - math.exp(-passed / CORRECTION)) * self._off
        return Feedback.ODD if odd else Feedback.AGREES

    @property
    def speeds(self) -> Float[np.ndarray, " n"]:
        """Present joint speeds (n,) [rad/s, m/s]."""
        return self._course.state[1]

    @property
    def accelerations(self) -> Float[np.ndarray, " n"]:
        """Present joint accelerations (n,) [rad/s^2, m/s^2]."""
        return self._course.state[2]

    def _take(self, begins: float, target: Float[np.ndarray, " n"]) -> None:
        """Begin a command."""
        self._course.follow(begins)
        self._begins.append(_Begun(begins, target, self._course.copy()))
        self._course.take(begins, target)

    def _after(self, command: _Begun) -> list[_Begun]:
        return [each for each in self._begins if each.time > command.time]

    def _without(self, command: _Begun, time: float, joints: Float[np.ndarray, " n"]) -> float:
        """Return the root mean square difference of the feedback from joints without this command."""
        course = command.before.copy()
        for each in self._after(command):
            if each.time <= time:
                course.take(each.time, each.target)
        course.follow(time)
        return math.dist(joints, course.state[0] + self.offset) / math.sqrt(len(joints))

    def _take_out(self, command: _Begun) -> None:
        """Remove a command that never came, and model the time since again."""
        later = deque(self._after(command))
        while self._begins and self._begins[-1].time >= command.time:
            self._begins.pop()
        self._course = command.before
        for k in np.argsort(self._times, kind="stable").tolist():
            moment = float(self._times[k])
            if moment >= command.time:
                while later and later[0].time <= moment:
                    self._take(later[0].time, later.popleft().target)
                self._course.follow(moment)
                self._past[k] = self._course.state[0]
        np.add(self._course.state[0], self.offset, out=self.joints)
        self.missed += 1
