"""Navigate by touch: remember touched places, plan a way around them, and push what moves.

This extends the state machine of [marker ring, V], which forgets a touch as soon as it has backed away:

* an obstacle that does not move is remembered (`TouchMap`), and a way is found around all of them;
* motion into a contact is slowed in proportion to the remaining allowed force;
* an object ahead is pushed, and counts as fixed if it has not moved after a while (`PushTest`);
* the robot gives way to anything that pushes back;
* an obstacle that is not felt is remembered, and a track that does not follow is noticed (`TrackWatch`);
* a search that only repeats its way is reported (`ProgressWatch`), and finally stopped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import atan2, cos, degrees, hypot, inf, isfinite, pi, radians, sin

import numpy as np
from jaxtyping import Float

from palpate.calls import called_as
from palpate.control.drive import DifferentialDrive
from palpate.control.navigation import heading_error, require_goal
from palpate.control.progress_watch import ProgressWatch
from palpate.control.push_test import Push, PushTest
from palpate.control.touch_map import TouchMap, TouchMapSettings
from palpate.control.track_watch import TrackWatch
from palpate.spatial.arguments import takes_arrays

DOUBT = "no nearer for long, and hardly anywhere new: is the goal in reach?"
Pose = tuple[float, float, float]
UNDER = 0.014  # m inside the skin, deeper than it is ever pressed in: what was touched there is gone
Felt = list[tuple[float, float]]  # angle [rad], force [N]


@dataclass(frozen=True)
class TouchNavigatorSettings:
    """Settings of a `TouchNavigator`: motion, forces and memory.

    Attributes:
        radius: [m] of the robot's round skin.
        reach: [m] distance from the goal at which the robot has arrived.
        force: [N] largest force that a contact should have.
        stiffness: [N/m] of the skin.
        soften: [s] least time to use up the remaining allowed force.
        flank, relief, off: from a contact on a flank with more than `flank` [N] the heading turns away by `relief`
            [rad/N], up to `off` [rad].
        squeeze: share of `force` on both flanks above which the robot does not go on between them.
        felt: [N] a smaller force is no touch.
        firm: [N] a smaller force is not remembered.
        facing: [rad] angle from the heading within which a contact is in the way.
        glancing: [rad] angle from the heading beyond which a contact is passed rather than pushed.
        settle, test, moved: arguments of `PushTest`.
        known: [m] a contact nearer to a remembered place is not pushed again.
        clearance, wall: [m] to both sides of a touch over which its surface is assumed to continue: of a single touch,
            and of one in line with others.
        passed, pushed: belief in a touch that was only passed, and in one that did not move when pushed; 1 for others.
        back: [s] for which the robot backs away from a fixed obstacle.
        slow: share of the top speed at which it backs away.
        turn: [rad/s] largest turn rate.
        still: ([m], [s]) a robot that has moved less than this distance in this time is stuck.
        doubt, ground: [s] after which the goal is reported as possibly out of reach, if the robot has come neither
            nearer nor to `ground` new places.
        patience: [s] after which the robot stops if it has come no nearer to its goal.
        push: False: nothing is pushed on purpose.
        remember: False: no memory.
        map: settings of the memory of places.
    """

    radius: float = 0.055
    reach: float = 0.10
    force: float = 2.6
    stiffness: float = 500.0
    soften: float = 0.2
    flank: float = 1.0
    relief: float = radians(12.0)
    off: float = radians(20.0)
    squeeze: float = 0.75
    felt: float = 0.25
    firm: float = 0.5
    facing: float = radians(70.0)
    glancing: float = radians(40.0)
    settle: float = 0.6
    test: float = 1.2
    moved: float = 0.004
    known: float = 0.045
    clearance: float = 0.025
    wall: float = 0.06
    passed: float = 0.6
    pushed: float = 2.0
    back: float = 0.65
    slow: float = 0.6
    turn: float = 1.0
    still: tuple[float, float] = (0.06, 15.0)
    doubt: float = 300.0
    ground: int = 50
    patience: float = 600.0
    push: bool = True
    remember: bool = True
    map: TouchMapSettings = field(default_factory=TouchMapSettings)


@called_as("palpate.TouchNavigator(goal=(1.2, 0.0))")
@takes_arrays
class TouchNavigator:
    """A `Navigator` with a memory of touches, meant for 30 updates a second.

    States: "move to goal", "push", "back off", "give way", "escape", "blind", "no pose", "stopped", "arrived".

    Args:
        goal: (2,) [m] in the frame of the poses.
        drive: the robot's drive; None: `DifferentialDrive()`.
        settings: of motion, forces and memory; None: `TouchNavigatorSettings()`.
        seed: of its random draws, which separate robots that block each other.

    Attributes:
        state: present state.
        why: reason for it, as a sentence.
        arrived: True once the goal was reached, until `reset`.

    Raises:
        InputError: the goal is not two finite numbers, or `ground` is less than 1.
    """

    def __init__(
        self,
        goal: Sequence[float] | Float[np.ndarray, "2"],
        *,
        drive: DifferentialDrive | None = None,
        settings: TouchNavigatorSettings | None = None,
        seed: int = 0,
    ) -> None:
        self.goal = require_goal(goal)
        self.drive, self.settings, self.seed = drive or DifferentialDrive(), settings or TouchNavigatorSettings(), seed
        self.map, self._watch = TouchMap(self.settings.radius, self.settings.map), TrackWatch(self.drive)
        self._progress = ProgressWatch(self.settings.doubt, self.settings.ground)
        self.reset()

    def reset(self) -> None:
        """Forget all touches, and set `arrived` to False."""
        self.state, self.arrived = "move to goal", False
        self.why = self._why = "nothing is in the way"
        self.map.reset()
        self._watch.reset()
        self._progress.reset()
        self._test = PushTest(self.settings.settle, self.settings.test, self.settings.moved)
        self._rng = np.random.default_rng([self.seed, 18])
        self._way: list[tuple[float, float]] = []
        self._planned, self._changed, self._blocked = -inf, True, False
        self._until, self._leave = -inf, (0.0, 0.0)
        self._stood = inf, inf, 0.0
        self._sent = 0.0, 0.0

    def update(
        self, time: float, touches: Float[np.ndarray, "k 2"] | None, pose: Float[np.ndarray, "3"]
    ) -> tuple[float, float]:
        """Return (left, right), the track speeds [m/s] from now on; set `state`, `why` and `arrived`.

        Args:
            time: [s] on one monotonic clock.
            touches: (k, 2) angle [rad] in the robot's frame, 0 ahead, counter-clockwise, and force [N] of each; None:
                no valid reading.
            pose: x [m], y [m] and heading [rad] of the robot in the goal's frame.

        Raises:
            InputError: arrays of other shapes.
            ValueError: an angle of a touch is infinite.
        """
        x, y, heading = (float(value) for value in pose)
        far = hypot(self.goal[0] - x, self.goal[1] - y)
        if self.arrived or far < self.settings.reach:
            self.arrived = True
            return self._say("arrived", "within reach of the goal")
        if self.state == "stopped":
            return self._say(self.state, self._why)
        if not isfinite(x + y + heading):
            return self._say("no pose", "the pose is not finite")
        if touches is None:
            return self._say("blind", "the skin says nothing")
        here = x, y, heading
        felt = [(heading_error(a, 0.0), force) for a, force in touches.tolist() if force >= self.settings.felt]
        fault = self._fault(time, here, far, touched=bool(felt))
        if fault is not None:
            return self._say("stopped", fault)
        self._remember(time, here, felt)
        forward, turn = self._decided(time, here, felt)
        return self._say(self.state, self._why, self._soft(forward, felt), self._aside(turn, felt))

    def _say(self, state: str, why: str, forward: float = 0.0, turn: float = 0.0) -> tuple[float, float]:
        self.state, self._why = state, why
        self.why = f"{why}; {DOUBT}" if self._progress.doubtful and state not in ("arrived", "stopped") else why
        self._sent = self.drive.wheels(forward, turn)
        return self._sent

    def _fault(self, time: float, here: Pose, far: float, *, touched: bool) -> str | None:
        """Return why the robot cannot go on; None if it can."""
        if side := self._watch.update(time, here, self._sent, touched=touched):
            return f"the {side} track does not follow"
        if self._progress.update(time, here[0], here[1], far) > self.settings.patience:
            return f"no nearer to the goal for {self.settings.patience:g} s"
        return None

    def _decided(self, time: float, here: Pose, felt: Felt) -> tuple[float, float]:
        """Return forward speed and turn rate; set the state and its reason."""
        behind = any(cos(angle) < -0.5 for angle, _ in felt)
        if time < self._until and not behind:
            return self._leave
        self._until = -inf
        self.state, self._why = "move to goal", "drives past what it touches" if felt else "nothing is in the way"
        if self._blocked:
            self._why = "no way is free: it tries what it touched longest ago"
        flanks = self._squeezed(felt)
        if flanks and not behind:
            self._stands(time, here, flanks, self.settings.pushed)
            return self._retreat(time, "back off", "it is too narrow here", 2.0 * self.settings.back)
        ahead = [(angle, force) for angle, force in felt if abs(angle) <= self.settings.facing]
        if ahead:
            stands = self._pressed(time, here, ahead)
            if stands is not None and not behind:  # between two it turns on the spot
                return self._retreat(time, "back off", stands, self.settings.back)
        else:
            self._test.none(time)
        if self._test.push is Push.BACK:
            self._test.end()
            return self._retreat(time, "give way", Push.BACK.value, float(self._rng.uniform(1.0, 3.0)))
        if self._watch.held:
            self._mark(time, here, here[2], self.settings.force, self.settings.clearance)
            why = "something holds it that the skin does not feel"
            return self._retreat(time, "back off", why, self.settings.back)
        if self._stuck(time, here):
            side = 0.4 if self._rng.random() < 0.5 else -0.4
            why = f"it has hardly moved for {self.settings.still[1]:g} s"
            return self._retreat(time, "escape", why, float(self._rng.uniform(1.0, 3.0)), side)
        if self._test.push is not None:
            self.state, self._why = "push", self._test.push.value
        return self._followed(time, here)

    # what is touched

    def _remember(self, time: float, here: Pose, felt: Felt) -> None:
        """Remember touches outside the way as passed; remove the places on which the robot stands."""
        set_ = self.settings
        if not set_.remember:
            self.map.reset()
            return
        before = len(self.map)
        self.map.clear(here[0], here[1], set_.radius - UNDER)
        for angle, force in felt:
            if abs(angle) > set_.facing and force > set_.firm:
                self._mark(time, here, here[2] + angle, force, 0.0, set_.passed)
        self._changed = self._changed or len(self.map) != before

    def _mark(self, time: float, here: Pose, way: float, force: float, beside: float, belief: float = 1.0) -> None:
        """Remember a touch of a surface that continues to both sides of it [m]."""
        out = self.settings.radius - force / self.settings.stiffness
        for aside in np.linspace(-beside, beside, 5 if beside > 0.03 else 3).tolist() if beside else (0.0,):
            x = here[0] + out * cos(way) - aside * sin(way)
            y = here[1] + out * sin(way) + aside * cos(way)
            self.map.touch(time, x, y, belief)
        self._changed = True

    def _squeezed(self, felt: Felt) -> Felt:
        """Return the contacts on both flanks, if the weaker side presses hard."""
        flanks = [(angle, force) for angle, force in felt if abs(cos(angle)) < cos(self.settings.glancing)]
        hard = [max((force for angle, force in flanks if angle * side > 0.0), default=0.0) for side in (1.0, -1.0)]
        return flanks if min(hard) > self.settings.squeeze * self.settings.force else []

    def _pressed(self, time: float, here: Pose, ahead: Felt) -> str | None:
        """Return why the contact ahead counts as fixed, and remember it; None if it does not."""
        set_ = self.settings
        strongest = max(force for _, force in ahead)
        firm = strongest > set_.firm
        if firm and min(abs(angle) for angle, _ in ahead) > set_.glancing:
            self._stands(time, here, ahead, set_.passed)
            return None  # it is passed as it is touched
        known = min(self.map.nearest(*_at(here, angle, set_.radius)) for angle, _ in ahead)
        way = here[2] + atan2(sum(f * sin(a) for a, f in ahead), sum(f * cos(a) for a, f in ahead))
        belief = 1.0
        if not set_.push:
            why = "pushing is switched off" if firm else None
        elif firm and known < set_.known and self._test.push is not Push.MOVES:
            why = "this place is already known as fixed"
        else:
            stands = self._test.touch(time, here[:2], (cos(way), sin(way))) is Push.STANDS
            why, belief = (Push.STANDS.value if stands else None), set_.pushed
        if why is not None:
            self._stands(time, here, ahead, belief)
        return why

    def _stands(self, time: float, here: Pose, ahead: Felt, belief: float = 1.0) -> None:
        """Remember the contacts ahead as fixed, as parts of a wall if in line with known places."""
        self._test.end()
        if not self.settings.remember:
            return
        for angle, force in ahead:
            way = here[2] + angle
            in_line = self.map.in_line(*_at(here, angle, self.settings.radius), way)
            self._mark(time, here, way, force, self.settings.wall if in_line else self.settings.clearance, belief)

    # motion

    def _retreat(self, time: float, state: str, why: str, seconds: float, turn: float = 0.0) -> tuple[float, float]:
        self.state, self._why, self._until = state, why, time + seconds
        self._leave = -self.settings.slow * self.drive.top, turn
        self._test.end()
        return self._leave

    def _stuck(self, time: float, here: Pose) -> bool:
        within, seconds = self.settings.still
        if hypot(here[0] - self._stood[0], here[1] - self._stood[1]) > within or time - self._stood[2] > seconds + 5.0:
            self._stood = here[0], here[1], time
        return time - self._stood[2] > seconds

    def _followed(self, time: float, here: Pose) -> tuple[float, float]:
        """Return forward speed and turn rate along the cheapest way."""
        if time - self._planned > (0.3 if self._changed else 2.0):
            way, cost = self.map.way(time, here[:2], self.goal)
            corners = [(here[0], here[1]), *((float(x), float(y)) for x, y in way)]
            length = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(corners))
            self._way, self._planned, self._changed = corners[1:], time, False
            self._blocked = cost > 1.2 * length + 0.05 * self.settings.map.weight
        while len(self._way) > 1 and hypot(self._way[0][0] - here[0], self._way[0][1] - here[1]) < 0.02:
            self._way.pop(0)
        to = self._way[0] if self._way else self.goal
        off = heading_error(atan2(to[1] - here[1], to[0] - here[0]), here[2])
        turn = max(-self.settings.turn, min(self.settings.turn, 3.0 * off))
        if abs(off) > radians(40.0):
            return 0.0, turn
        return self.drive.top * cos(off) * (1.0 - abs(degrees(off)) / 60.0), turn

    def _soft(self, forward: float, felt: Felt) -> float:
        """Return the forward speed [m/s] at which no contact is pressed harder than allowed.

        A contact at angle a is pressed in by v cos(a), so that its force F grows by k v cos(a): v is bounded such that
        the remaining F_max - F lasts for `soften`. Beyond F_max the bound changes its sign.
        """
        set_, high, low = self.settings, inf, -inf
        for angle, force in felt:
            share = cos(angle)
            if abs(share) < 0.15:  # beside it: neither way helps
                continue
            bound = (set_.force - force) / (set_.stiffness * set_.soften * share)
            high, low = (min(high, bound), low) if share > 0.0 else (high, max(low, bound))
        return 0.5 * (low + high) if low > high else max(low, min(high, forward))

    def _aside(self, turn: float, felt: Felt) -> float:
        """Return the turn rate [rad/s] that turns the heading away from contacts on a flank, more for more force."""
        set_, high, low = self.settings, inf, -inf
        for angle, force in felt:
            off = pi / 2 + min(set_.off, set_.relief * (force - set_.flank)) - abs(angle)
            if force < set_.flank or off < 0.0 or abs(angle) < set_.glancing:
                continue
            high, low = (min(high, -3.0 * off), low) if angle > 0.0 else (high, max(low, 3.0 * off))
        return 0.5 * (low + high) if low > high else max(low, min(high, turn))


def _at(here: Pose, angle: float, radius: float) -> tuple[float, float]:
    """Return the point (x, y) [m] of a touch at an angle [rad] on the robot's skin."""
    return here[0] + radius * cos(here[2] + angle), here[1] + radius * sin(here[2] + angle)
