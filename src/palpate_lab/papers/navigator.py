"""The state machine of `marker ring` (figure 10, tables I and II), the baseline: to the goal, backward, along."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.control.drive import DifferentialDrive
from palpate.control.navigation import heading_error, require_goal
from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays
from palpate_lab.papers.steering import Speedometer, Steering

__all__ = ["Condition", "PaperNavigator", "PaperSettings", "PaperState"]

_RETREATS = "goal", "turned", "random"


class PaperState(StrEnum):
    """The state of the navigator."""

    GOAL = "move to goal"  # I
    BACK = "move backward"  # II
    ALONG = "move along"  # III
    STOPPED = "stopped"  # no touch or no pose is known; goes on when both are
    ARRIVED = "arrived"  # for good


class Condition(StrEnum):
    """A condition of table I, or free where nothing touches."""

    FREE = "free"  # nothing touches, the timer is reset
    NO = "NO"  # T < t_t: not yet decided
    PUSH = "TBO.1"  # it moves in spite of the touch: go on
    AVOID = "TBO.2"  # too strong, or it does not move: back


@dataclass(frozen=True)
class PaperSettings:
    """The parameters of table II, and what the paper leaves open.

    Args:
        f_max: F_max [N]: a touch this strong is avoided immediately, at any T. (Table I has both NO and TBO.2 hold
            then; the text says "immediately".)
        t_t: duration of touch [s] after which it is decided whether the obstacle can be moved.
        t_r: duration of moving backward [s].
        t_a: duration of moving along [s].
        delta: angle between V_B and V_A [rad].
        alpha: share of the drive's top speed towards the goal, `beta` backward, `gamma` along. (V_G, V_B and V_A are a
            direction, a force and a force in the paper, and weights of 1 give them no speed: only their directions are
            used.)
        beta: see `alpha`.
        gamma: see `alpha`.
        reach: distance from the goal [m] at which it is reached. (Not stated.)
        retreat: side to which V_A is turned from V_B. The paper says "by rotating V_B by 90 deg", but states neither
            the side nor that it is always the same. "goal": the side nearer to the goal; "turned": counter-clockwise;
            "random": either side, by a seeded draw.
        still: speed [m/s] below which |V_R| ~ 0. (Not stated; a tenth of the top speed.)
        window: duration [s] over which V_R is measured from the poses; not above `t_t`, so that only motion during the
            touch counts. (Not stated.) A robot that turns on the spot does not move, as the paper's condition reads.
        aligned: heading error [rad] at which the turn to V_A is done; `turn_limit` [s] after which it is given up.
        turn_limit: see `aligned`.

    What the paper leaves open is read so. The drive cannot move sideways: in II it moves straight along its own axis,
    forward if V_B points forward and else backward, and it turns in III only. In III t_a begins when the turn to V_A is
    done, as the robot "steers its axis to a perpendicular direction and moves forward a short distance", and a touch of
    F_max starts II again. In II, touches change nothing: the contact that the robot retreats from still presses. T
    begins with the first touch in I.

    Raises:
        InputError: a number that is not positive, a window above t_t, a share above 1, or a choice not listed here.
    """

    f_max: float = 3.0
    t_t: float = 0.5
    t_r: float = 1.0
    t_a: float = 1.0
    delta: float = math.pi / 2.0
    alpha: float = 1.0
    beta: float = 1.0
    gamma: float = 1.0
    reach: float = 0.10
    retreat: str = "goal"
    still: float = 0.005
    window: float = 0.5
    aligned: float = math.radians(10.0)
    turn_limit: float = 4.0

    def __post_init__(self) -> None:
        if self.retreat not in _RETREATS:
            raise InputError(f"retreat must be one of {', '.join(_RETREATS)}, not {self.retreat!r}.", where="settings")
        for name, value in vars(self).items():
            if name != "retreat" and not 0.0 < value < math.inf:  # NaN too
                raise InputError(f"{name} must be positive, not {value}.", where="settings")
        if max(self.alpha, self.beta, self.gamma) > 1.0:
            raise InputError(
                "alpha, beta and gamma are shares of the top speed and must be at most 1.", where="settings"
            )
        if self.window > self.t_t:
            raise InputError(
                f"the window of {self.window:g} s must not be longer than t_t = {self.t_t:g} s.",
                where="settings",
            )


@called_as("PaperNavigator(goal=(1.2, 0.0))")
@takes_arrays
class PaperNavigator:
    """The paper's navigator: no memory, one rule.

    In I the robot moves to the goal, by a PI controller of the heading. A touch starts the timer T, and table I
    decides: TBO.2 leads to II, backward by V_B = sum of the forces on the robot for t_r; then to III, along V_A = V_B
    turned by delta for t_a; then to I. Where the forces cancel V_B is straight backward.

    Attributes:
        state: a `PaperState`.
        why: reason for the state.
        condition: a `Condition`, as last found in I.
        arrived: True once the robot is within `reach` of the goal, for good.

    Args:
        goal: (2,) position of the goal [m].
        drive: drive of the robot.
        settings: table II, and the choices.
        seed: seed of `retreat` "random".

    Raises:
        InputError: a goal that is not two finite numbers.
    """

    def __init__(
        self,
        goal: ArrayLike,
        *,
        drive: DifferentialDrive | None = None,
        settings: PaperSettings | None = None,
        seed: int = 0,
    ) -> None:
        self.goal = require_goal(goal)
        self.drive = DifferentialDrive() if drive is None else drive
        self.settings, self.seed = PaperSettings() if settings is None else settings, seed
        self._speedometer = Speedometer(self.settings.window)
        self._steering = Steering(self.drive)
        self.reset()

    def reset(self) -> None:
        """Start again in state I, with nothing touched and the same random draws."""
        self.state: str = PaperState.GOAL
        self.why: str = "nothing touched yet"
        self.condition: str = Condition.FREE
        self.arrived: bool = False
        self._speedometer.reset()
        self._steering.reset()
        self._random = np.random.default_rng(self.seed)
        self._time = -math.inf
        self._since = math.nan  # when the present state began; of III: when the turn was done
        self._touched = math.nan  # when T began, NaN while nothing touches
        self._back = self._along = 0.0  # [rad] directions of V_B and V_A
        self._lined_up = False
        self._wheels = (0.0, 0.0)

    @property
    def vectors(self) -> tuple[float, float]:
        """Pair of directions [rad] of V_B (backward) and V_A (along) in the goal's frame, as last decided, else 0."""
        return self._back, self._along

    def update(
        self, time: float, touches: Float[np.ndarray, "k 2"] | None, pose: Float[np.ndarray, "3"]
    ) -> tuple[float, float]:
        """Return the speeds of the left and right track [m/s], a pair; both 0 without touches (None) or a finite pose.

        They are 0 too once the robot has arrived; a time that is not later than the last one gives the last speeds
        again.

        Raises:
            InputError: arrays of other shapes.
        """
        x, y, heading = pose.tolist()
        if self.arrived or not time > self._time:
            return self._wheels
        self._time = time
        known = math.isfinite(x + y + heading)
        if touches is None or not known:
            what = "the skin says nothing" if known else "the pose is not known"
            self._touched = math.nan
            self._to(PaperState.STOPPED, what, time)
            self._speedometer.reset()
            self._wheels = (0.0, 0.0)
            return self._wheels
        if self.state == PaperState.STOPPED:
            self._to(PaperState.GOAL, "skin and pose are there again", time)
        speed = math.hypot(*self._speedometer.velocity(time, x, y))
        away = self.goal[0] - x, self.goal[1] - y
        if math.hypot(*away) <= self.settings.reach:
            self.arrived, self._wheels = True, (0.0, 0.0)
            self._to(PaperState.ARRIVED, "the goal is reached", time)
            return self._wheels
        bearing = math.atan2(away[1], away[0])
        self._decide(time, touches.tolist(), speed, heading, bearing)
        self._wheels = self._move(time, heading, bearing)
        return self._wheels

    def _decide(
        self, time: float, touches: Sequence[Sequence[float]], speed: float, heading: float, bearing: float
    ) -> None:
        """Update the timer, apply table I, and end II and III."""
        set_, strongest = self.settings, max((force for _, force in touches), default=0.0)
        if not touches:
            self._touched = math.nan
        elif math.isnan(self._touched):
            self._touched = time
        if self.state == PaperState.BACK and time - self._since >= set_.t_r:
            self._begin_along(time, bearing)
        elif self.state == PaperState.ALONG:
            if strongest >= set_.f_max:
                self._begin_back(time, touches, heading, f"{strongest:.2g} N while it moved along")
            elif self._along_is_over(time, heading):
                self._to(PaperState.GOAL, "moved along: the goal again", time)
                self._touched = math.nan
        if self.state == PaperState.GOAL:
            self._judge(time, touches, strongest, speed, heading)

    def _judge(
        self, time: float, touches: Sequence[Sequence[float]], strongest: float, speed: float, heading: float
    ) -> None:
        """Apply table I."""
        if touches and math.isnan(self._touched):
            self._touched = time
        found, why = table_1(self.settings, time - self._touched, strongest, speed)
        if found == Condition.AVOID:
            self._begin_back(time, touches, heading, why)
        elif found != self.condition:
            self.why = why
        self.condition = found

    def _begin_back(self, time: float, touches: Sequence[Sequence[float]], heading: float, why: str) -> None:
        """Begin II with V_B = sum of F_i, where a touch at angle a presses the robot towards a + pi."""
        x = -sum(force * math.cos(angle) for angle, force in touches)
        y = -sum(force * math.sin(angle) for angle, force in touches)
        cancel = math.hypot(x, y) <= 1e-9 * sum(force for _, force in touches)
        self._back = heading + (math.pi if cancel else math.atan2(y, x))
        self._to(PaperState.BACK, why, time)
        self.condition = Condition.AVOID

    def _begin_along(self, time: float, bearing: float) -> None:
        """Begin III with V_A, which is V_B turned by delta to the side that `retreat` selects."""
        delta, retreat = self.settings.delta, self.settings.retreat
        sides = [self._back + delta, self._back - delta]
        if retreat == "goal":
            sides.sort(key=lambda side: abs(heading_error(bearing, side)))
        elif retreat == "random" and self._random.random() < 0.5:
            sides.reverse()
        self._along, self._lined_up = sides[0], False
        self._to(PaperState.ALONG, "moved backward: along what it touched", time)

    def _along_is_over(self, time: float, heading: float) -> bool:
        set_ = self.settings
        if self._lined_up:
            return time - self._since >= set_.t_a
        error = abs(heading_error(self._along, heading))
        if error <= set_.aligned or time - self._since >= set_.turn_limit:
            self._lined_up, self._since = True, time
        return False

    def _move(self, time: float, heading: float, bearing: float) -> tuple[float, float]:
        """Return the track speeds for V_D of (3)."""
        set_, top = self.settings, self.drive.top
        if self.state == PaperState.GOAL:
            return self._steering.wheels(time, heading_error(bearing, heading), set_.alpha * top)
        if self.state == PaperState.ALONG:
            error = heading_error(self._along, heading)
            return self._steering.wheels(time, error, set_.gamma * top if self._lined_up else 0.0)
        ahead = math.cos(heading_error(self._back, heading)) > 0.0
        return self.drive.wheels(set_.beta * top if ahead else -set_.beta * top, 0.0)

    def _to(self, state: PaperState, why: str, time: float) -> None:
        if state != self.state or state == PaperState.BACK:
            self._since = time
            self._steering.reset()
            self.condition = Condition.FREE
        self.state, self.why = state, why


def table_1(settings: PaperSettings, touched: float, strongest: float, speed: float) -> tuple[Condition, str]:
    """Return the `Condition` of table I, and its reason in a sentence.

    Args:
        settings: F_max, t_t and the speed below which |V_R| ~ 0.
        touched: T [s]; NaN while nothing touches.
        strongest: largest of |F_i| [N].
        speed: |V_R| [m/s]; NaN where it is not known, which counts as moving.
    """
    if math.isnan(touched):
        return Condition.FREE, "nothing touches"
    if strongest >= settings.f_max:
        return Condition.AVOID, f"{strongest:.2g} N are not below {settings.f_max:g} N"
    if touched < settings.t_t - 1e-9:
        return Condition.NO, f"touched: waits for {settings.t_t:g} s to see whether it moves"
    if speed < settings.still:
        return Condition.AVOID, f"touched for {touched:.2g} s, and it does not move"
    return Condition.PUSH, "touched, and it moves: pushes on"
