"""Supervise the state of a contact loop: it holds or retreats if the contact is not known."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from palpate.contact import Status
from palpate.errors import InputError
from palpate.spatial._arrays import frozen
from palpate.spatial.arguments import frozen_value

BRIEF = 0.5  # s: after a shorter loss the loop goes on holding, for what it knows of the surface is not yet old


class State(StrEnum):
    """State of a contact loop."""

    APPROACH = "approach"  # moves along the probe's axis until something is touched
    CONTACT = "contact"  # presses until the wanted force is there, and learns how stiff it is
    HOLD = "hold"  # holds force and angle
    LOST = "lost"  # holds still: the contact, or the sensor, is gone
    STOPPED = "stopped"  # for good: retreats first, if it was for force


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

    Attributes:
        state: present `State`.
        why: reason for it, as a sentence.
        settled: time [s] when it began.
        retreating: True while the loop moves back from the surface before it stops.

    Raises:
        InputError: the limit on force is not above the wanted force.
    """

    def __init__(self, limits: Limits, force: float) -> None:
        if not limits.force > force:
            raise InputError(
                f"the limit on force ({limits.force:g} N) must be above the wanted force ({force:g} N).",
                where="limits",
                hint="Leave room for the force that a moving surface adds: twice the wanted force is usual.",
            )
        self.limits, self.force, self._before = limits, force, State.APPROACH
        self.start(0.0)

    def start(self, time: float) -> None:
        """Set the state to APPROACH at a time [s], without retreat."""
        self._to(State.APPROACH, "nothing touched yet", time)
        self._seen = self._touched = time
        self.retreating = False

    def stop(self, time: float, why: str, *, retreat: bool = False) -> None:
        """Set the state to STOPPED at a time [s] with a reason, which only `start` ends; retreat if requested."""
        if self.state != State.STOPPED:
            self._to(State.STOPPED, why, time)
            self.retreating = retreat

    def fresh(self, time: float, status: int, force: float) -> None:
        """Update the state by a new reading at a time [s]: its `Status`, and the length of the contact force [N].

        A SATURATED, INVALID or NO_POSE reading counts as none; a saturated one after the approach stops the loop.
        """
        if status in (Status.SATURATED, Status.INVALID, Status.NO_POSE):
            why = Status(status).label
            if status == Status.SATURATED and self.state != State.APPROACH:
                self.stop(time, "the sensor is saturated", retreat=True)
            else:
                self._silent(time, f"the sensor reads {why} values")
            return
        self._seen = time
        if force > self.limits.force:
            self.stop(time, f"{force:.3g} N is more than the limit of {self.limits.force:g} N", retreat=True)
            return
        if status <= Status.AMBIGUOUS:
            self._touched = time
            if self.state == State.APPROACH and force > self.limits.touch:
                self._to(State.CONTACT, "touched", time)
            elif self.state == State.LOST:
                brief = self._before == State.HOLD and time - self.settled < BRIEF
                self._to(State.HOLD if brief else State.CONTACT, "touched again", time)
        elif self.state == State.LOST and self._before == State.APPROACH:
            self._to(State.APPROACH, "the sensor reads again", time)
        elif self.state in (State.CONTACT, State.HOLD) and time - self._touched > self.limits.lost:
            self._to(State.LOST, f"no contact for {time - self._touched:.2g} s", time)
        self._give_up(time)

    def silent(self, time: float) -> None:
        """Update the state at a time [s] without a new reading: LOST after `stale`, STOPPED after `patience`."""
        self._silent(time, "no new reading of the sensor")

    def pressed(self, time: float) -> None:
        """Change from CONTACT to HOLD; call it once the wanted force is there and the law is ready."""
        if self.state == State.CONTACT:
            self._to(State.HOLD, "force and angle are held", time)

    def _silent(self, time: float, why: str) -> None:
        silence = time - self._seen
        if silence > self.limits.stale and self.state in (State.APPROACH, State.CONTACT, State.HOLD):
            self._to(State.LOST, f"{why} for {silence:.2g} s", time)
        self._give_up(time)

    def _give_up(self, time: float) -> None:
        if self.state == State.LOST and time - self.settled > self.limits.patience:
            self.stop(time, f"{self.why}, and none since", retreat=True)

    def _to(self, state: State, why: str, time: float) -> None:
        if state == State.LOST:
            self._before = self.state
        self.state, self.why, self.settled = state, why, time
