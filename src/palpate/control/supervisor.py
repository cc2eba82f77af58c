"""Supervise the state of a contact loop: it holds or retreats if the contact is not known."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from palpate.contact import Status
from palpate.errors import InputError
from palpate.spatial._arrays import frozen
from palpate.spatial.arguments import frozen_value

ENOUGH = 2  # readings in a row that are evidence of a touch, of too much force, or of saturation
OUTSIDE = (
    0.10  # s outside the band after which force counts as off: less than 0.2 with noise and the lag of its low-pass
)
SMOOTH = 0.02  # s: time constant of that low-pass
BACK = 4  # readings in a row within the band that lead back to HOLD
INSIDE = 0.97  # of the band, in which force counts as inside in spite of noise
BRIEF = 0.5  # s: after a shorter loss the loop goes on holding, for what it knows of the surface is not yet old


class State(StrEnum):
    """State of a contact loop."""

    APPROACH = "approach"  # moves along the probe's axis until something is touched
    CONTACT = "contact"  # presses until the wanted force is there, and learns how stiff it is
    HOLD = "hold"  # holds force and angle
    FOLLOW = "follow"  # the same law, while the force is off the wanted one
    LOST = "lost"  # holds still: the contact, or the sensor, is gone
    STOPPED = "stopped"  # for good: retreats first, if it was for force


PRESSING = (State.CONTACT, State.HOLD, State.FOLLOW)


@frozen_value(eq=True)
class Limits:
    """Limits of a contact loop, and the times for which it waits.

    Args:
        force: [N] largest contact force; beyond it the loop retreats and stops.
        speed: [m/s] largest speed of the tip.
        turn: [rad/s] largest turn rate of the probe.
        approach: [m/s] speed of the approach and of the retreat.
        travel: [m] largest distance of the approach, and of the tip from its first contact.
        tilt: [rad] largest lean of the probe from its axis at first contact.
        touch: [N] force that ends the approach; more than the error of the inertial forces of the motion.
        lost: [s] without contact after which it counts as lost.
        stale: [s] without a new reading of the sensor after which the loop holds still.
        patience: [s] after which a lost contact is given up.
        drift: (2,) bounds of the sensor's drift since its tare [N/s, N m/s].
        drift_angle: [rad] largest angle by which that drift may turn the probe; beyond it the loop stops and requests a
            tare.

    Raises:
        InputError: a limit is not positive and finite, or drift is not two finite numbers of 0 or more.
    """

    force: float = 20.0
    speed: float = 0.1
    turn: float = 3.0
    approach: float = 0.01
    travel: float = 0.06
    tilt: float = float(np.radians(35.0))
    touch: float = 0.5
    lost: float = 0.15
    stale: float = 0.1
    patience: float = 2.0
    drift: ArrayLike = (0.0, 0.0)
    drift_angle: float = float(np.radians(3.0))

    def __post_init__(self) -> None:
        drift = frozen(self.drift, tail=(2,), name="drift")
        object.__setattr__(self, "drift", drift)
        for name, value in vars(self).items():
            if name != "drift" and not 0 < value < np.inf:  # NaN too
                raise InputError(f"{name} must be positive, not {value}.", where="limits")
        if not ((drift >= 0) & np.isfinite(drift)).all():
            raise InputError("drift must be two numbers of 0 or more: N/s and N m/s.", where="limits")


class Supervisor:
    """State machine of a contact loop.

    Args:
        limits: of force and waiting times.
        force: [N] wanted contact force.
        within: [N] difference from it within which the force counts as held.

    Attributes:
        state: present `State`.
        why: reason for it, as a sentence.
        settled: time [s] when it began.
        retreating: True while the loop moves back from the surface before it stops.

    Raises:
        InputError: the limit on force is not above the wanted force, or `within` is not positive.
    """

    def __init__(self, limits: Limits, force: float, within: float = 1.0) -> None:
        if not within > 0:  # NaN too
            raise InputError(f"within must be a force above 0 N, not {within}.", where="within")
        if not limits.force > force:
            raise InputError(
                f"the limit on force ({limits.force:g} N) must be above the wanted force ({force:g} N).",
                where="limits",
                hint="Leave room for the force that a moving surface adds: twice the wanted force is usual.",
            )
        self.limits, self.force, self.within = limits, force, within
        self.start(0.0)

    def start(self, time: float) -> None:
        """Set the state to APPROACH at a time [s], without retreat."""
        self._to(State.APPROACH, "nothing touched yet", time)
        self._seen = self._touched = self._inside = time
        self._before, self._smooth = State.APPROACH, 0.0
        self._strong = self._touches = self._back = 0
        self.retreating = False

    def stop(self, time: float, why: str, *, retreat: bool = False) -> None:
        """Set the state to STOPPED at a time [s] with a reason, which only `start` ends; retreat if requested."""
        if self.state != State.STOPPED:
            self._to(State.STOPPED, why, time)
            self.retreating = retreat

    def fresh(self, time: float, status: int, force: float, pressing: float | None = None) -> None:
        """Update the state by a new reading at a time [s].

        A SATURATED, INVALID or NO_POSE reading counts as none. One reading alone is no evidence: two in a row make a
        touch, and two in a row that are saturated after the approach, or above the limit, stop the loop.

        Args:
            time: [s].
            status: `Status` of the reading.
            force: [N] length of the contact force.
            pressing: [N] its part along the normal; None: all of it.
        """
        saturated = status == Status.SATURATED and self.state != State.APPROACH
        self._strong = self._strong + 1 if saturated or force > self.limits.force else 0
        if self._strong >= ENOUGH:
            why = f"{force:.3g} N is more than the limit of {self.limits.force:g} N"
            self.stop(time, "the sensor is saturated" if saturated else why, retreat=True)
            return
        if status in (Status.SATURATED, Status.INVALID, Status.NO_POSE):
            self._silent(time, f"the sensor reads {Status(status).label} values")
            return
        touched = status <= Status.AMBIGUOUS
        self._touches = self._touches + 1 if touched and force > self.limits.touch else 0
        self._judge(time, (force if pressing is None else pressing) if touched else 0.0)
        if touched:
            self._touch(time)
        elif self.state == State.LOST and self._before == State.APPROACH:
            self._to(State.APPROACH, "the sensor reads again", time)
        elif self.state in PRESSING and time - self._touched > self.limits.lost:
            self._to(State.LOST, f"no contact for {time - self._touched:.2g} s", time)
        self._give_up(time)

    def silent(self, time: float) -> None:
        """Update the state at a time [s] without a new reading: LOST after `stale`, STOPPED after `patience`."""
        self._silent(time, "no new reading of the sensor")

    def pressed(self, time: float) -> None:
        """Change from CONTACT or FOLLOW to HOLD if the force is within the band; call it once the law is ready."""
        if self.state == State.CONTACT or (self.state == State.FOLLOW and self._back >= BACK):
            self._to(State.HOLD, "force and angle are held", time)
            self._require_force(time)

    def _touch(self, time: float) -> None:
        """Update the state by a reading of a contact."""
        self._touched = time
        if self.state == State.APPROACH and self._touches >= ENOUGH:
            self._to(State.CONTACT, "touched", time)
        elif self.state == State.LOST:
            brief = self._before in (State.HOLD, State.FOLLOW) and time - self.settled < BRIEF
            self._to(State.FOLLOW if brief else State.CONTACT, "touched again", time)

    def _judge(self, time: float, pressing: float) -> None:
        """Update the low-passed force by a reading [N], and the time at which it was last within the band."""
        self._smooth += min(1.0, (time - self._seen) / SMOOTH) * (pressing - self._smooth)
        self._seen = time
        # both: a force that swings passes the band where no reading lies, and a single reading may be noise
        if max(abs(self._smooth - self.force), abs(pressing - self.force)) < INSIDE * self.within:
            self._inside, self._back = time, self._back + 1
        else:
            self._back = 0
        self._require_force(time)

    def _require_force(self, time: float) -> None:
        if self.state == State.HOLD and time - self._inside > OUTSIDE:
            self._to(State.FOLLOW, f"the force is {self._smooth:.2g} N, not {self.force:g} +- {self.within:g} N", time)

    def _silent(self, time: float, why: str) -> None:
        self._require_force(time)
        silence = time - self._seen
        if silence > self.limits.stale and self.state in (State.APPROACH, *PRESSING):
            self._to(State.LOST, f"{why} for {silence:.2g} s", time)
        self._give_up(time)

    def _give_up(self, time: float) -> None:
        if self.state == State.LOST and time - self.settled > self.limits.patience:
            self.stop(time, f"{self.why}, and none since", retreat=True)

    def _to(self, state: State, why: str, time: float) -> None:
        if state == State.LOST:
            self._before = self.state
        self.state, self.why, self.settled = state, why, time
