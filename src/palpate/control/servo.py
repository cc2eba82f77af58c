"""What a position-controlled robot makes of the commands that it is given: where its joints are now, and how fast."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError

__all__ = ["Servo", "ServoModel"]


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
        self.servo, self.correction = servo, correction
        self._y, self._speed, self._pull = np.zeros(count), np.zeros(count), np.zeros(count)
        self._from, self._to = np.zeros(count), np.zeros(count)
        self._begun = -np.inf  # when the ramp began
        self._waiting: deque[tuple[float, np.ndarray]] = deque()
        self.offset = np.zeros(count)
        self._past: deque[tuple[float, np.ndarray]] = deque(maxlen=64)
        self._time = 0.0
        self._fed = -np.inf

    def start(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """At rest at these joints, with nothing commanded."""
        for array in (self._y, self._from, self._to):
            array[:] = joints
        self._speed[:] = self._pull[:] = self.offset[:] = 0.0
        self._begun, self._time, self._fed = -np.inf, time, time
        self._waiting.clear()
        self._past.clear()

    def send(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """A command, given now."""
        self._waiting.append((time + self.servo.delay, joints.copy()))

    def advance(self, time: float) -> None:
        """To a later time [s]; earlier ones are left alone."""
        while self._waiting and self._waiting[0][0] <= time:
            begins, target = self._waiting.popleft()
            self._follow(begins)
            self._from[:], self._to[:] = self._reference(begins), target
            self._begun = begins
        self._follow(time)
        self._past.append((time, self._y.copy()))

    def correct(self, time: float, joints: Float[np.ndarray, " n"]) -> None:
        """By feedback of the joints as they were at this time, at most some cycles ago."""
        if not self._past or not np.isfinite(joints).all():
            return
        modelled = min(self._past, key=lambda each: abs(each[0] - time))[1]
        share = 1.0 - float(np.exp(-max(0.0, time - self._fed) / self.correction))
        self.offset += share * (joints - modelled - self.offset)
        self._fed = max(time, self._fed)

    @property
    def joints(self) -> Float[np.ndarray, " n"]:
        """(n,) where they are now."""
        return self._y + self.offset

    @property
    def speeds(self) -> Float[np.ndarray, " n"]:
        """(n,) their derivatives."""
        return self._speed

    @property
    def accelerations(self) -> Float[np.ndarray, " n"]:
        """(n,) theirs."""
        return self._pull

    def _reference(self, time: float) -> Float[np.ndarray, " n"]:
        ramp = self.servo.ramp
        share = 1.0 if ramp == 0.0 else min(1.0, (time - self._begun) / ramp)
        return self._from + share * (self._to - self._from)

    def _follow(self, time: float) -> None:
        """Over the ramp until it ends, then over what stands still."""
        ends = self._begun + self.servo.ramp
        if self._time < ends < time:
            self._along(ends)
        if self._time < time:
            self._along(time)

    def _along(self, time: float) -> None:
        """In closed form while the reference r is one line: q = r - 2 r'/w + (a + b t) exp(-w t)."""
        step, ramping = time - self._time, self._time < self._begun + self.servo.ramp
        slope = (self._to - self._from) / self.servo.ramp if ramping else np.zeros_like(self._y)
        before, after = self._reference(self._time), self._reference(time)
        self._time = time
        if self.servo.lag == 0.0:
            self._y[:], self._speed[:], self._pull[:] = after, slope, 0.0
            return
        w = 2.0 / self.servo.lag
        a = self._y - before + 2.0 / w * slope
        b = self._speed - slope + w * a
        decay = float(np.exp(-w * step))
        free = (a + b * step) * decay
        moving = b * decay - w * free
        self._y[:] = after - 2.0 / w * slope + free
        self._speed[:] = slope + moving
        self._pull[:] = -w * b * decay - w * moving
