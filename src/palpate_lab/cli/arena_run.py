"""The closed loop of touch navigation: arena, skins and navigators, one moment per image, and the result of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import cos, inf, isnan, nan, pi, sin
from typing import Literal

import numpy as np
from jaxtyping import Float

from palpate.control.drive import DifferentialDrive
from palpate.control.navigation import Navigator
from palpate.control.push_test import Push
from palpate.control.touch_navigator import TouchNavigator, TouchNavigatorSettings
from palpate.errors import InputError
from palpate_lab.cli.arena_ring import RingSense, RingWear
from palpate_lab.papers.navigator import PaperNavigator, PaperSettings
from palpate_lab.simulation.arena.layout import ArenaLayout
from palpate_lab.simulation.arena.moment import ArenaMoment, ArenaResult
from palpate_lab.simulation.arena.planner import require_solvable
from palpate_lab.simulation.arena.settings import FRAME, RobotSettings
from palpate_lab.simulation.arena.world import ArenaWorld

RATE = 1.0 / FRAME  # frames a second
METHODS = ("ours", "paper", "paper-turned", "paper-random", "no-push", "no-memory")
FAULTS = ("blind", "torn", "stuck-wheel", "wrong-goal")
FELT = 0.2  # N: less is not counted as contact in a result
TRACKED = np.array([5e-4, 5e-4, np.radians(0.2)])  # m, m, rad: standard deviations of a tracker
STILL = 0.05, 30.0  # m, s: a robot that moves less for this long is in a deadlock


@dataclass(frozen=True)
class RobotFault:
    """A fault of one robot: `kind` is one of `FAULTS`; blind and stuck-wheel begin at `since` [s]."""

    kind: str
    robot: int = 0
    since: float = 10.0


@dataclass(frozen=True)
class ArenaSettings:
    """The settings of a run.

    Attributes:
        layout: arena of the run.
        seed: seed of all noise and of the navigators' draws.
        method: one of `METHODS`.
        sensing: "images": images of each skin's camera go through the detector; "skin": the markers' positions with the
            detector's noise, without an image.
        touch: contacts that navigators get: "all", the strongest "one", or "binary": their angles without forces.
        pose: "tracker" (0.5 mm, 0.2 deg) or "odometry" (tracks and a gyroscope, from the start on).
        seconds: longest duration of the run [s].
        faults: faults of single robots.
    """

    layout: ArenaLayout
    seed: int = 0
    method: str = "ours"
    sensing: Literal["images", "skin"] = "skin"
    touch: Literal["all", "one", "binary"] = "all"
    pose: Literal["tracker", "odometry"] = "tracker"
    seconds: float = 600.0
    faults: tuple[RobotFault, ...] = ()


class ArenaRun:
    """A run of robots in an arena; iterate over its moments, then call `result`.

    Args:
        settings: settings of the run.
        wear: skin of every robot, and its calibration.
        robot: physical settings of the robots; None for the usual ones.

    Raises:
        InputError: an unknown method or fault, an arena that cannot be solved, or MuJoCo is not installed.
    """

    def __init__(self, settings: ArenaSettings, wear: RingWear, robot: RobotSettings | None = None) -> None:
        self.settings, self.robot = settings, robot or RobotSettings()
        layout, count = settings.layout, len(settings.layout.starts)
        for fault in settings.faults:
            if fault.kind not in FAULTS or not 0 <= fault.robot < count:
                raise InputError(
                    f"the fault {fault.kind!r} of robot {fault.robot + 1} is not possible: use one of "
                    f"{', '.join(FAULTS)}, and a robot from 1 to {count}."
                )
        if settings.method not in METHODS:
            raise InputError(f"the method {settings.method!r} is unknown: use one of {', '.join(METHODS)}.")
        require_solvable(layout, self.robot.radius)
        self.world = ArenaWorld(layout, self.robot, settings.seed)
        self.drive = DifferentialDrive(self.robot.track)
        self.navigators = [self._navigator(k) for k in range(count)]
        images, torn = settings.sensing == "images", [self._fault(k, "torn") is not None for k in range(count)]
        self.senses = [RingSense(wear, [settings.seed, 2, k], images=images, torn=torn[k]) for k in range(count)]
        self.places = [_Place(settings.pose, layout.starts[k], self.drive, [settings.seed, 3, k]) for k in range(count)]
        self._sums = _Sums(count)

    def _fault(self, robot: int, kind: str) -> RobotFault | None:
        return next((each for each in self.settings.faults if each.robot == robot and each.kind == kind), None)

    def _navigator(self, robot: int) -> Navigator:
        settings, drive = self.settings, self.drive
        goal = settings.layout.goals[robot]
        if self._fault(robot, "wrong-goal"):
            goal = np.array([settings.layout.size[0] + 0.3, goal[1]])
        seed = 1000 * settings.seed + robot
        method = settings.method
        if method.startswith("paper"):
            retreat = {"paper": "goal", "paper-turned": "turned", "paper-random": "random"}[method]
            return PaperNavigator(goal, drive=drive, settings=PaperSettings(retreat=retreat), seed=seed)
        ours = TouchNavigatorSettings(push=method != "no-push", remember=method != "no-memory")
        return TouchNavigator(goal, drive=drive, settings=ours, seed=seed)

    def __iter__(self) -> Iterator[ArenaMoment]:
        world, settings = self.world, self.settings
        arrived = np.zeros(len(self.navigators), dtype=bool)
        while world.time < settings.seconds and not arrived.all():
            moment = self._moment()
            arrived = moment.arrived
            yield moment
            world.step(self._driven(moment))

    def _moment(self) -> ArenaMoment:
        world, time = self.world, self.world.time
        truths = [world.touches(k) for k in range(len(self.navigators))]
        touches, poses = self._felt(time, truths), world.poses
        wheels, tracked = np.zeros((len(poses), 2)), np.zeros((len(poses), 3))
        for k, (navigator, place) in enumerate(zip(self.navigators, self.places, strict=True)):
            tracked[k] = place.told(poses[k])
            wheels[k] = navigator.update(time, touches[k], tracked[k])
            place.driven(wheels[k], FRAME)
        states = tuple(each.state for each in self.navigators)
        whys = tuple(each.why for each in self.navigators)
        frames = [each.frame for each in self.senses] if self.settings.sensing == "images" else None
        arrived = np.array([each.arrived for each in self.navigators])
        moment = ArenaMoment(time, poses, tracked, world.blocks, touches, truths, wheels, states, whys, frames, arrived)
        self._sums.add(moment, self.settings.layout.goals)
        return moment

    def _felt(self, time: float, truths: list[Float[np.ndarray, "k 5"]]) -> list[Float[np.ndarray, "k 2"] | None]:
        """Return the contacts that the navigators get.

        Each step is done for one robot after the other, so that its code stays in the processor's cache.
        """
        for k, (sense, truth) in enumerate(zip(self.senses, truths, strict=True)):
            blind = self._fault(k, "blind") if self.settings.faults else None
            sense.look(truth, dark=blind is not None and time >= blind.since)
        return [_told(sense.feel(time), self.settings.touch) for sense in self.senses]

    def _driven(self, moment: ArenaMoment) -> Float[np.ndarray, "n 2"]:
        """Return the real speeds of the tracks, with faults."""
        wheels = moment.wheels.copy()
        for fault in self.settings.faults:
            if fault.kind == "stuck-wheel" and moment.time >= fault.since:
                wheels[fault.robot, 0] = 0.0
        return wheels

    def result(self) -> ArenaResult:
        """Return the `ArenaResult` of the moments so far."""
        return self._sums.result(self.settings.seed, self.navigators, self.world.time)

    def play(self, watch: Callable[[ArenaMoment], None] | None = None) -> ArenaResult:
        """Run all moments, call `watch` with each, and return the `ArenaResult`.

        Raises:
            RuntimeError: the engine warned, and its results cannot be trusted.
        """
        for moment in self:
            if watch is not None:
                watch(moment)
        return self.result()


def _told(felt: Float[np.ndarray, "k 2"] | None, touch: str) -> Float[np.ndarray, "k 2"] | None:
    if felt is None or not len(felt) or touch == "all":
        return felt
    if touch == "one":
        return felt[[int(felt[:, 1].argmax())]]
    return np.stack([felt[:, 0], np.ones(len(felt))], axis=1)


class _Place:
    """The pose that a robot gets: a tracker's, or odometry of its tracks and a gyroscope since the start."""

    def __init__(self, kind: str, start: Float[np.ndarray, "3"], drive: DifferentialDrive, seed: list[int]) -> None:
        self._rng = np.random.default_rng(seed)
        self._kind, self._drive, self._counted = kind, drive, np.array(start, dtype=np.float64)
        self._scale, self._bias = 1.0 + 0.005 * self._rng.standard_normal(), 1e-4 * self._rng.standard_normal()
        self._heading, self._noise = float(start[2]), self._noises()

    def _noises(self) -> Iterator[Float[np.ndarray, "3"]]:
        """Yield a tracker's noise, drawn for many moments at a time: the same numbers in the same order."""
        while True:
            yield from self._rng.standard_normal((300, 3)) * TRACKED

    def told(self, pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Return the pose that the robot gets, from the true one."""
        if self._kind == "tracker":
            return pose + next(self._noise)
        turned = (pose[2] - self._heading + pi) % (2.0 * pi) - pi  # a gyroscope counts it
        self._heading = float(pose[2])
        self._counted[2] += turned + self._bias * FRAME
        return self._counted.copy()

    def driven(self, wheels: Float[np.ndarray, "2"], seconds: float) -> None:
        """Advance the odometry by commanded track speeds [m/s] over a duration [s]."""
        forward, _ = self._drive.twist(float(wheels[0]), float(wheels[1]))
        way = self._scale * forward * seconds
        self._counted[0] += way * cos(self._counted[2])
        self._counted[1] += way * sin(self._counted[2])


class _Sums:
    """Running sums from which a result is computed."""

    def __init__(self, count: int) -> None:
        self.arrived, self.path, self.greatest = [nan] * count, [0.0] * count, [0.0] * count
        self.pushes, self.deadlocks = [0] * count, [0] * count
        self._forces = list[float]()
        self._last: np.ndarray | None = None
        self._rest = np.full((count, 3), inf)  # where and since when it stands
        self._pushed = [False] * count

    def add(self, moment: ArenaMoment, goals: Float[np.ndarray, "n 2"]) -> None:
        here, time = moment.poses[:, :2], moment.time
        if self._last is None:
            self._last, self._rest = here, np.column_stack([here, np.full(len(here), time)])
        off = here - np.stack([self._last, goals, self._rest[:, :2]])
        self._last = here
        ways = zip(*np.hypot(off[..., 0], off[..., 1]).tolist(), moment.arrived.tolist(), strict=True)
        for k, (went, left, moved, arrived) in enumerate(ways):  # plain numbers: robots are few
            self.path[k] += went
            if arrived and left < 0.15 and isnan(self.arrived[k]):  # believed, and true
                self.arrived[k] = time
            if len(moment.truths[k]):
                pressed = [force for force in moment.truths[k][:, 1].tolist() if force > FELT]
                self._forces += pressed
                self.greatest[k] = max(self.greatest[k], *pressed, 0.0)
            pushing = moment.whys[k] == Push.MOVES.value
            self.pushes[k] += pushing and not self._pushed[k]
            self._pushed[k] = pushing
            stood = moved <= STILL[0] and not arrived and time - float(self._rest[k, 2]) >= STILL[1]
            self.deadlocks[k] += stood
            if moved > STILL[0] or stood or arrived:
                self._rest[k, :2], self._rest[k, 2] = here[k], time

    def result(self, seed: int, navigators: list[Navigator], seconds: float) -> ArenaResult:
        return ArenaResult(
            seed,
            tuple(self.arrived),
            tuple(self.path),
            tuple(self.greatest),
            float(np.percentile(self._forces, 99)) if self._forces else 0.0,
            tuple(self.pushes),
            tuple(self.deadlocks),
            tuple(f"{each.state}: {each.why}" for each in navigators),
            seconds,
        )
