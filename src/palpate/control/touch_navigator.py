"""A robot that finds its way by touch: it remembers what it touched, plans round it, and pushes what moves.

Beyond the state machine of the paper [marker ring, V], which forgets a touch as soon as it has backed away from it:

* what does not move is remembered (`TouchMap`), and a way is found round all of it again and again; a wall is followed
  because each touch of it makes the way along it the cheaper one;
* motion into a contact is slowed in proportion to what is left of the force allowed, so that a touch stays soft;
* what is ahead is pushed, and what has not moved after a while stands fast;
* what stops the robot and is not felt is remembered as well; a track that does not follow is noticed.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import atan2, ceil, cos, hypot, inf, isfinite, pi, radians, sin
from typing import Literal

import numpy as np
from jaxtyping import Float

from palpate.control.drive import DifferentialDrive
from palpate.control.touch_map import TouchMap, TouchMapSettings

__all__ = ["TouchNavigator", "TouchNavigatorSettings"]

Pose = tuple[float, float, float]


@dataclass(frozen=True)
class TouchNavigatorSettings:
    """How the robot moves and what it believes.

    Attributes:
        radius: [m] of its round skin.
        reach: [m] from the goal at which it has arrived.
        force: [N] that no contact should be pressed with.
        stiffness: [N/m] of the skin.
        soften: [s] in which the force left is used up, at most.
        felt: [N]: less is no touch.
        ahead: [rad] from the heading within which a contact is in the way.
        settle, test, moved: what is pushed at has `settle` [s] until the force is there, then `test` [s] to move by
            `moved` [m].
        known: [m]: what is nearer to a remembered place is not pushed again.
        beside: [m] to both sides of a touch where its surface is taken to go on.
        back: [m] by which it leaves what does not move.
        push: False: nothing is pushed on purpose.
        remember: False: no memory.
        map: how places are remembered.
    """

    radius: float = 0.055
    reach: float = 0.10
    force: float = 2.6
    stiffness: float = 500.0
    soften: float = 0.2
    felt: float = 0.25
    ahead: float = radians(70.0)
    glancing: float = radians(40.0)
    settle: float = 0.6
    test: float = 1.2
    moved: float = 0.004
    known: float = 0.045
    beside: float = 0.025
    far: float = 0.06
    back: float = 0.012
    push: bool = True
    remember: bool = True
    map: TouchMapSettings = field(default_factory=TouchMapSettings)


@dataclass
class _Press:
    """A contact ahead that is pushed at: since when, where the robot was, which way it presses (world)."""

    since: float
    seen: float
    way: tuple[float, float]
    mark: tuple[float, float] | None = None
    marked: float = 0.0
    moves: bool = False


class TouchNavigator:
    """From touches and pose to the speeds of both tracks, at the caller's rate (30 Hz in mind).

    States: "move to goal", "push", "back off", "escape", "blind", "stopped", "arrived"; `why` says more.

    Args:
        goal: (2,) [m].
        drive: of the robot.
        settings: how it moves.
        seed: of its own draws, which part robots that stand in each other's way.
    """

    def __init__(
        self,
        goal: Float[np.ndarray, "2"],
        *,
        drive: DifferentialDrive | None = None,
        settings: TouchNavigatorSettings | None = None,
        seed: int = 0,
    ) -> None:
        self.goal = float(goal[0]), float(goal[1])
        self.drive, self.settings, self.seed = drive or DifferentialDrive(), settings or TouchNavigatorSettings(), seed
        self.map = TouchMap(self.settings.radius, self.settings.map)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.state, self.why, self.arrived = "move to goal", "nothing is in the way", False
        self.map.reset()
        self._rng = np.random.default_rng([self.seed, 18])
        self._past: deque[tuple[float, float, float, float, float]] = deque(maxlen=64)
        self._way: list[tuple[float, float]] = []
        self._planned, self._changed, self._price = -inf, True, inf
        self._press: _Press | None = None
        self._until, self._turn, self._leave = -inf, 0.0, (0.0, 0.0)
        self._stood = inf, inf, 0.0
        self._blind_since: float | None = None
        self._sent = 0.0, 0.0

    def update(
        self, time: float, touches: Float[np.ndarray, "k 2"] | None, pose: Float[np.ndarray, "3"]
    ) -> tuple[float, float]:
        """Speeds of the left and the right track [m/s].

        Args:
            time: [s].
            touches: angle [rad] from the heading and force [N] of each contact; None: the skin says nothing.
            pose: x, y [m] and heading [rad].
        """
        x, y, heading = pose.tolist()
        here = x, y, heading
        if self.arrived or hypot(self.goal[0] - x, self.goal[1] - y) < self.settings.reach:
            self.arrived = True
            return self._say("arrived", "within reach of the goal", 0.0, 0.0)
        felt = [] if touches is None else [(a, f) for a, f in touches.tolist() if f >= self.settings.felt]
        self._past.append((time, x, y, heading, self._sent[0]))
        self._notice(time, here, felt)
        speeds = self._decide(time, here, felt)
        return speeds

    def _say(self, state: str, why: str, forward: float, turn: float) -> tuple[float, float]:
        self.state, self.why, self._sent = state, why, (forward, turn)
        return self.drive.wheels(forward, turn)

    def _notice(self, time: float, here: Pose, felt: list[tuple[float, float]]) -> None:
        """Places beside the robot are remembered, places under it forgotten."""
        set_ = self.settings
        if not set_.remember:
            self.map.reset()
            return
        x, y, heading = here
        before = len(self.map)
        self.map.clear(x, y, set_.radius - 0.014)
        for angle, force in felt:
            if abs(angle) > set_.ahead and force > 0.5:
                self._mark(time, here, heading + angle, force, 0.0)
        self._changed = self._changed or len(self.map) != before

    def _mark(self, time: float, here: Pose, way: float, force: float, beside: float) -> None:
        radius = self.settings.radius - force / self.settings.stiffness
        sides = (0.0, beside, -beside, 0.5 * beside, -0.5 * beside) if beside > 0.03 else (0.0, beside, -beside)
        for aside in sides if beside else (0.0,):
            x = here[0] + radius * cos(way) - aside * sin(way)
            y = here[1] + radius * sin(way) + aside * cos(way)
            self.map.touch(time, x, y)
        self._changed = True

    def _decide(self, time: float, here: Pose, felt: list[tuple[float, float]]) -> tuple[float, float]:
        if time < self._until:
            return self._leaving(time, here, felt)
        ahead = [(a, f) for a, f in felt if abs(a) <= self.settings.ahead]
        fast = self._pressing(time, here, ahead)
        if fast is not None:
            return self._retreat(time, here, fast, felt)
        if self._stalled(time, felt):
            self._mark(time, here, here[2], self.settings.force, self.settings.beside)
            return self._retreat(time, here, "something holds it that the skin does not feel", felt)
        if self._stuck(time, here):
            return self._escape(time, here, felt)
        forward, turn = self._follow(time, here)
        forward = self._soft(forward, felt)
        if self._press is not None:
            why = "what is ahead moves" if self._press.moves else "seeing whether what is ahead moves"
            return self._say("push", why, forward, turn)
        return self._say("move to goal", "a touch is passed" if felt else "nothing is in the way", forward, turn)

    # what is ahead

    def _pressing(self, time: float, here: Pose, ahead: list[tuple[float, float]]) -> str | None:
        """Follow a press on what is ahead; why it is given up, or None. What stands fast is remembered."""
        set_, press = self.settings, self._press
        if not ahead:
            if press is not None and time - press.seen > 0.2:
                self._press = None
            return None
        angle = atan2(sum(f * sin(a) for a, f in ahead), sum(f * cos(a) for a, f in ahead))
        way = here[2] + angle
        if press is None or cos(way) * press.way[0] + sin(way) * press.way[1] < cos(radians(30.0)):
            press = self._press = _Press(time, time, (cos(way), sin(way)))
        press.seen = time
        strongest = max(f for _, f in ahead)
        if not set_.push and strongest > 0.5:
            return self._fast(time, here, ahead, "it pushes nothing")
        if strongest > 0.5 and min(abs(a) for a, _ in ahead) > set_.glancing:
            self._fast(time, here, ahead, "")
            self._planned = min(self._planned, time - 0.3)
            return None
        known = min(
            self.map.nearest(here[0] + set_.radius * cos(here[2] + a), here[1] + set_.radius * sin(here[2] + a))
            for a, _ in ahead
        )
        if known < set_.known and strongest > 0.8 and not press.moves:
            return self._fast(time, here, ahead, "it was here before")
        if time - press.since < set_.settle:
            return None
        if press.mark is None:
            press.mark, press.marked = here[:2], time
        gone = (here[0] - press.mark[0]) * press.way[0] + (here[1] - press.mark[1]) * press.way[1]
        if gone >= set_.moved:
            press.mark, press.marked, press.moves = here[:2], time, True
        elif time - press.marked >= set_.test:
            return self._fast(time, here, ahead, "what is ahead does not move")
        return None

    def _fast(self, time: float, here: Pose, ahead: list[tuple[float, float]], why: str) -> str:
        self._press = None
        if self.settings.remember:
            for angle, force in ahead:
                way = here[2] + angle
                known = self.map.along(here[0] + self.settings.radius * cos(way), here[1] + self.settings.radius * sin(way), way)
                self._mark(time, here, way, force, self.settings.far if known else self.settings.beside)
        return why

    def _retreat(self, time: float, here: Pose, why: str, felt: list[tuple[float, float]]) -> tuple[float, float]:
        self._until = time + 1.2 * self.settings.back / self.drive.top + 0.35
        self._leave, self._turn = (-0.6 * self.drive.top, 0.0), 0.0
        self._press = None
        self._say("back off", why, 0.0, 0.0)
        return self._leaving(time, here, felt)

    def _leaving(self, time: float, here: Pose, felt: list[tuple[float, float]]) -> tuple[float, float]:
        forward, turn = self._leave
        if self.state == "back off" and not any(abs(a) <= self.settings.ahead for a, _ in felt):
            pass
        return self._say(self.state, self.why, self._soft(forward, felt), turn)

    # stuck

    def _stalled(self, time: float, felt: list[tuple[float, float]]) -> bool:
        """Driven forward for a while, not moved, and nothing felt."""
        past = self._past
        if felt or len(past) < 40:
            return False
        first = past[-40]
        driven = sum(each[4] for each in list(past)[-40:]) * (time - first[0]) / 40
        return driven > 0.02 and hypot(past[-1][1] - first[1], past[-1][2] - first[2]) < 0.25 * driven

    def _stuck(self, time: float, here: Pose) -> bool:
        """It has hardly moved for long."""
        if hypot(here[0] - self._stood[0], here[1] - self._stood[1]) > 0.06:
            self._stood = here[0], here[1], time
        return time - self._stood[2] > 15.0

    def _escape(self, time: float, here: Pose, felt: list[tuple[float, float]]) -> tuple[float, float]:
        self._stood = here[0], here[1], time
        side = 1.0 if self._rng.random() < 0.5 else -1.0
        self._until = time + float(self._rng.uniform(1.0, 3.0))
        self._leave = -0.6 * self.drive.top, side * 0.4
        self._say("escape", "it has hardly moved for 15 s", 0.0, 0.0)
        return self._leaving(time, here, felt)

    # motion

    def _follow(self, time: float, here: Pose) -> tuple[float, float]:
        """Forward speed and turn rate towards the way."""
        if self._changed and time - self._planned > 0.3 or time - self._planned > 2.0:
            way, self._price = self.map.way(time, here[:2], self.goal)
            self._way = [(float(x), float(y)) for x, y in way]
            self._planned, self._changed = time, False
        while len(self._way) > 1 and hypot(self._way[0][0] - here[0], self._way[0][1] - here[1]) < 0.02:
            self._way.pop(0)
        to = self._way[0] if self._way else self.goal
        off = wrapped(atan2(to[1] - here[1], to[0] - here[0]) - here[2])
        top = self.drive.top
        turn = max(-1.0, min(1.0, 3.0 * off))
        if abs(off) > radians(40.0):
            return 0.0, turn
        return top * cos(off) * (1.0 - abs(off) / radians(60.0)), turn

    def _soft(self, forward: float, felt: list[tuple[float, float]]) -> float:
        """The forward speed at which no contact is pressed harder than allowed."""
        set_ = self.settings
        high, low = inf, -inf
        for angle, force in felt:
            share = cos(angle)
            if abs(share) < 0.15:
                continue
            bound = (set_.force - force) / (set_.stiffness * set_.soften * share)
            high, low = (min(high, bound), low) if share > 0 else (high, max(low, bound))
        if low > high:
            return 0.5 * (low + high)
        return max(low, min(high, forward))


def wrapped(angle: float) -> float:
    """An angle [rad] within -pi ... pi."""
    return angle - 2.0 * pi * ceil((angle - pi) / (2.0 * pi))
