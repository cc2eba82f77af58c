"""What a position-controlled robot makes of the commands that it is given: where its joints are now, and how fast."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError

__all__ = ["Servo", "ServoModel"]

REMEMBERED = 64  # moments, to find what feedback is to be compared with
BEGUN = 4  # commands, to find one that never came
FAINT = 2e-5  # rad or m that feedback is off the model at least: encoders
ODD = 4.0  # times what it usually is off
USUAL = 0.05  # share of the newest feedback in that


@dataclass(frozen=True)
class Servo:
    """How a robot follows joint commands; what its maker states, or a step shows.

    A command waits for `delay`, is reached along a straight line within `ramp`, and the joints follow that line as a
    critically damped system of second order, w = 2/lag:

        q'' + 2 w q' + w^2 q = w^2 r

    Args:
        period: [s] between two commands.
        delay: [s] until the robot begins with one.
        ramp: [s] that it takes to interpolate from one to the next; usually the period. 0: none.
        lag: [s] by which its joints lag behind a ramp. 0: none.

    Raises:
        InputError: a period that is not positive, or another time that is negative.
    """

    period: float = 0.02
    delay: float = 0.02
    ramp: float = 0.02
    lag: float = 0.03

    def __post_init__(self) -> None:
        times = {name: getattr(self, name) for name in ("delay", "ramp", "lag")}
        wrong = [name for name, value in times.items() if not 0 <= value < np.inf]  # NaN too
        if not 0 < self.period < np.inf:
            wrong.append("period")
        if wrong:
            raise InputError(f"{wrong[0]} of a servo must be a time [s], not {getattr(self, wrong[0])}.")

    @property
    def late(self) -> float:
        """[s] from a command to where joints are that follow a ramp of commands: it is reached this much later."""
        return self.delay + self.ramp + self.lag


@dataclass(frozen=True, eq=False)
class _Begun:
    """A command, when it began, and what the model was before."""

    time: float
    target: Float[np.ndarray, " n"]
    state: Float[np.ndarray, "3 n"]
    line: Float[np.ndarray, "2 n"]
    begun: float


class ServoModel:
    """Joints, their speeds and accelerations between and ahead of the robot's own feedback.

    Exact for ramps: the solution of the differential equation in closed form from one change of the ramp to the next.
    What the joints are off it in their feedback (sag, deflection, friction) is followed slowly and added. A command
    that was lost on its way shows in the feedback after it should have begun, and is taken out.

    Args:
        servo: how the robot follows.
        count: n, of joints.
        correction: [s] time constant by which feedback corrects the model.

    Attributes:
        offset: (n,) what the joints are off the model, by their feedback.
        missed: how many commands never came.
    """

    def __init__(self, servo: Servo, count: int, correction: float = 0.1) -> None:
        from palpate.control import _servo as kernel  # compiled: loaded when first needed

        self.servo, self.correction = servo, correction
        self._following, self._apart = kernel.follow, kernel.apart
        self._state, self._line = np.zeros((3, count)), np.zeros((2, count))
        self.offset, self._joints = np.zeros(count), np.zeros(count)
        self._waiting: deque[tuple[float, np.ndarray]] = deque()
        self._begins = deque[_Begun](maxlen=BEGUN)
        self._off = np.zeros(count)
        self._past, self._times, self._kept = np.zeros((REMEMBERED, count)), np.zeros(REMEMBERED), 0
        self.start(0.0, np.zeros(count))
        self.advance(1e-3)  # compiles
        self.correct(1e-3, np.zeros(count))
        self.start(0.0, np.zeros(count))

    def start(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """At rest at these joints, with nothing commanded."""
        self._state[:], self._line[:], self.offset[:] = 0.0, joints, 0.0
        self._state[0] = self._joints[:] = joints
        self._begun, self._time, self._fed = -np.inf, time, time
        self._waiting.clear()
        self._begins.clear()
        self._usual, self.missed = 5.0 * FAINT, 0  # what feedback is off usually
        self._times[:] = -np.inf
        self._kept = 0

    def send(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """A command, given now."""
        self._waiting.append((time + self.servo.delay, joints.copy()))

    def advance(self, time: float) -> None:
        """To a later time [s]; earlier ones are left alone."""
        while self._waiting and self._waiting[0][0] <= time:
            self._take(*self._waiting.popleft())
        self._follow(time)
        self._past[self._kept], self._times[self._kept] = self._state[0], time
        self._kept = (self._kept + 1) % REMEMBERED

    def correct(self, time: float, joints: Float[np.ndarray, " n"]) -> bool:
        """By feedback of the joints as they were at this time, at most some cycles ago.

        Returns:
            Whether it shows that the newest command that should have begun never came. The model is then that of a
            robot which never had it, from when on it should have begun.
        """
        off = self._apart(self._past, self._times, time, joints, self.offset, self._off)
        if not off < np.inf:
            return False
        newest = next((each for each in reversed(self._begins) if each.time < time - 0.5 * self.servo.period), None)
        without = off
        if newest is not None and off > ODD * self._usual:
            without = self._without(newest, time, joints)
        lost = without < 0.5 * off
        size = min(off, without, 2.0 * self._usual)  # one that is odd counts little
        self._usual = max(FAINT, math.sqrt(self._usual**2 + USUAL * (size**2 - self._usual**2)))
        if newest is not None and lost:
            self._take_out(newest)
        else:
            self.offset += (1.0 - math.exp(-max(0.0, time - self._fed) / self.correction)) * self._off
        self._fed = max(time, self._fed)
        return lost

    @property
    def joints(self) -> Float[np.ndarray, " n"]:
        """(n,) where they are now; written anew by `advance`, as the next two are."""
        return self._joints

    @property
    def speeds(self) -> Float[np.ndarray, " n"]:
        """(n,) their derivatives."""
        return self._state[1]

    @property
    def accelerations(self) -> Float[np.ndarray, " n"]:
        """(n,) theirs."""
        return self._state[2]

    def _take(self, begins: float, target: Float[np.ndarray, " n"]) -> None:
        """The reference goes to a new command from here on."""
        self._follow(begins)
        self._begins.append(_Begun(begins, target, self._state.copy(), self._line.copy(), self._begun))
        share = 1.0 if self.servo.ramp == 0.0 else min(1.0, (begins - self._begun) / self.servo.ramp)
        self._line[0] += share * (self._line[1] - self._line[0])
        self._line[1], self._begun = target, begins

    def _without(self, command: _Begun, time: float, joints: Float[np.ndarray, " n"]) -> float:
        """Root mean square of what the feedback is off joints that never had this command."""
        given = command.begun, self.servo.ramp, self.servo.lag
        modelled = np.empty_like(self.offset)
        self._following(command.state.copy(), command.line, self.offset, *given, command.time, time, modelled)
        return math.dist(joints, modelled) / math.sqrt(len(joints))

    def _take_out(self, command: _Begun) -> None:
        """As if this command had never come; those after it begin as they did."""
        now, later = self._time, [each for each in self._begins if each.time > command.time]
        while self._begins and self._begins[-1].time >= command.time:
            self._begins.pop()
        self._state[:], self._line[:] = command.state, command.line
        self._begun, self._time = command.begun, command.time
        for each in later:
            self._take(each.time, each.target)
        self._follow(now)
        self._times[self._times > command.time] = -np.inf  # what was modelled since was wrong
        self.missed += 1

    def _follow(self, time: float) -> None:
        """To a later time, as the reference goes now."""
        given = self._begun, self.servo.ramp, self.servo.lag
        self._following(self._state, self._line, self.offset, *given, self._time, time, self._joints)
        self._time = max(self._time, time)
