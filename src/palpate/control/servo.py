"""What a position-controlled robot makes of the commands that it is given: where its joints are now, and how fast."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError

__all__ = ["Servo", "ServoModel"]

REMEMBERED = 64  # moments, to find what feedback is to be compared with


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


class ServoModel:
    """Joints, their speeds and accelerations between and ahead of the robot's own feedback.

    Exact for ramps: the solution of the differential equation in closed form from one change of the ramp to the next.
    What the joints are off it in their feedback (sag, deflection, friction) is followed slowly and added.

    Args:
        servo: how the robot follows.
        count: n, of joints.
        correction: [s] time constant by which feedback corrects the model.
    """

    def __init__(self, servo: Servo, count: int, correction: float = 0.1) -> None:
        from palpate.control import _servo as kernel  # compiled: loaded when first needed

        self.servo, self.correction, self._along = servo, correction, kernel.along
        self._state, self._line = np.zeros((3, count)), np.zeros((2, count))
        self.offset, self._joints = np.zeros(count), np.zeros(count)
        self._waiting: deque[tuple[float, np.ndarray]] = deque()
        self._past, self._times, self._kept = np.zeros((REMEMBERED, count)), np.zeros(REMEMBERED), 0
        self.start(0.0, np.zeros(count))
        self.advance(1e-3)  # compiles
        self.start(0.0, np.zeros(count))

    def start(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """At rest at these joints, with nothing commanded."""
        self._state[:], self._line[:], self.offset[:] = 0.0, joints, 0.0
        self._state[0] = self._joints[:] = joints
        self._begun, self._time, self._fed = -np.inf, time, time
        self._waiting.clear()
        self._times[:] = -np.inf
        self._kept = 0

    def send(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """A command, given now."""
        self._waiting.append((time + self.servo.delay, joints.copy()))

    def advance(self, time: float) -> None:
        """To a later time [s]; earlier ones are left alone."""
        while self._waiting and self._waiting[0][0] <= time:
            begins, target = self._waiting.popleft()
            self._follow(begins)
            share = 1.0 if self.servo.ramp == 0.0 else min(1.0, (begins - self._begun) / self.servo.ramp)
            self._line[0] += share * (self._line[1] - self._line[0])
            self._line[1], self._begun = target, begins
        self._follow(time)
        np.add(self._state[0], self.offset, out=self._joints)
        self._past[self._kept], self._times[self._kept] = self._state[0], time
        self._kept = (self._kept + 1) % REMEMBERED

    def correct(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """By feedback of the joints as they were at this time, at most some cycles ago."""
        if not np.isfinite(joints).all():
            return
        modelled = self._past[int(np.argmin(np.abs(self._times - time)))]
        share = 1.0 - float(np.exp(-max(0.0, time - self._fed) / self.correction))
        self.offset += share * (joints - modelled - self.offset)
        self._fed = max(time, self._fed)

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

    def _follow(self, time: float) -> None:
        """Over the ramp until it ends, then over what stands still."""
        ends = self._begun + self.servo.ramp
        for until in (ends, time) if self._time < ends < time else (time,):
            if self._time < until:
                given = self._begun, self.servo.ramp, self.servo.lag
                self._along(self._state, self._line, *given, self._time, until)
                self._time = until
