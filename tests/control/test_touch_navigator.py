"""Our navigator among lines that press on it by a closed form: force = stiffness x depth, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from palpate.control.navigation import Navigator
from palpate.control.progress_watch import ProgressWatch
from palpate.control.push_test import Push, PushTest
from palpate.control.touch_navigator import TouchNavigator, TouchNavigatorSettings
from palpate.control.track_watch import TrackWatch
from palpate.errors import InputError

FRAME, RADIUS, STIFFNESS = 1.0 / 30.0, 0.055, 500.0


@dataclass
class Wall:
    """A line from a to b [m] that a disc of `RADIUS` presses against; it moves rather than bear above `yields` [N]."""

    a: tuple[float, float]
    b: tuple[float, float]
    yields: float = math.inf

    def touch(self, pose: np.ndarray) -> tuple[float, float] | None:
        """Angle in the robot's frame and force, if it touches; moves where it yields."""
        a, b = np.array(self.a), np.array(self.b)
        share = np.clip((pose[:2] - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        off = a + share * (b - a) - pose[:2]
        distance = float(np.hypot(*off))
        depth = RADIUS - distance
        if depth <= 0.0:
            return None
        spare = depth - self.yields / STIFFNESS
        if spare > 0.0:
            move = spare * off / distance
            self.a, self.b = tuple((a + move).tolist()), tuple((b + move).tolist())
        return math.atan2(off[1], off[0]) - float(pose[2]), STIFFNESS * min(depth, self.yields / STIFFNESS)


@dataclass
class Course:
    """A robot among walls; `driven` may change what the tracks do."""

    navigator: TouchNavigator
    walls: tuple[Wall, ...] = ()
    pose: np.ndarray = field(default_factory=lambda: np.zeros(3))
    driven: Callable[[tuple[float, float]], tuple[float, float]] = lambda wheels: wheels
    feels: bool = True
    time: float = 0.0
    greatest: float = 0.0
    seen: set[str] = field(default_factory=set[str])
    poses: list[np.ndarray] = field(default_factory=list[np.ndarray])

    def go(self, seconds: float) -> Course:
        """Until it has arrived, or so long."""
        for _ in range(round(seconds / FRAME)):
            felt = [touch for wall in self.walls if (touch := wall.touch(self.pose)) is not None]
            self.greatest = max(self.greatest, *(force for _, force in felt), 0.0)
            rows = np.array(felt if self.feels else [], dtype=float).reshape(-1, 2)
            wheels = self.driven(self.navigator.update(self.time, rows, self.pose))
            forward, turn = self.navigator.drive.twist(*wheels)
            heading = float(self.pose[2]) + 0.5 * turn * FRAME
            step = np.array([forward * math.cos(heading), forward * math.sin(heading), turn]) * FRAME
            self.pose, self.time = self.pose + step, self.time + FRAME
            self.seen.add(f"{self.navigator.state}: {self.navigator.why}")
            self.poses.append(self.pose)
            if self.navigator.arrived:
                break
        return self

    @property
    def path(self) -> float:
        """[m] driven."""
        return float(np.hypot(*np.diff(np.array(self.poses)[:, :2], axis=0).T).sum())


def course(*walls: Wall, goal: tuple[float, float] = (1.0, 0.0), **settings: Any) -> Course:
    return Course(TouchNavigator(goal, settings=TouchNavigatorSettings(**settings)), walls)


def test_a_free_way_is_driven_straight_and_ends_within_reach() -> None:
    made = course(goal=(0.8, 0.6)).go(60.0)
    assert isinstance(made.navigator, Navigator)
    assert made.navigator.arrived
    assert made.path == pytest.approx(0.9, abs=0.03)  # 1 m less the reach
    assert made.navigator.update(99.0, None, np.full(3, np.nan)) == (0.0, 0.0)  # for good


@pytest.fixture(scope="module")
def round_a_wall() -> Course:
    return course(Wall((0.4, -0.25), (0.4, 0.15))).go(120.0)


def test_a_wall_is_gone_round_softly(round_a_wall: Course) -> None:
    assert round_a_wall.navigator.arrived
    assert round_a_wall.greatest < 3.0  # 2.6 N, and a frame of 50 mm/s: 0.8 N
    assert any("does not move" in each for each in round_a_wall.seen)
    assert round_a_wall.path < 3.0


def test_without_memory_the_same_wall_is_never_passed() -> None:
    made = course(Wall((0.4, -0.25), (0.4, 0.25)), remember=False).go(60.0)
    assert not made.navigator.arrived


def test_what_yields_is_pushed_and_forgotten() -> None:
    made = course(Wall((0.4, -0.05), (0.4, 0.05), yields=1.5)).go(60.0)
    assert made.navigator.arrived
    assert "push: what is ahead moves" in made.seen
    assert made.walls[0].a[0] > 0.5
    shy = course(Wall((0.4, -0.05), (0.4, 0.05), yields=1.5), push=False).go(60.0)
    assert not any("moves" in each for each in shy.seen)
    assert shy.greatest < 1.5


def test_a_gap_that_narrows_is_left() -> None:
    made = course(Wall((0.3, 0.12), (0.8, 0.03)), Wall((0.3, -0.12), (0.8, -0.03))).go(90.0)
    assert made.greatest < 3.5
    assert any("narrow" in each or "before" in each or "past" in each for each in made.seen)
    assert made.navigator.arrived


def test_turned_and_shifted_it_does_the_same() -> None:
    turn, shift = 0.7, np.array([3.0, -2.0])
    matrix = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    here = TouchNavigator((1.0, 0.2))
    there = TouchNavigator(matrix @ [1.0, 0.2] + shift)
    rng = np.random.default_rng(4)
    pose = np.zeros(3)
    for k in range(60):
        felt = np.array([[rng.uniform(-3.0, 3.0), rng.uniform(0.3, 2.0)]]) if k % 3 else np.zeros((0, 2))
        moved = np.array([*(matrix @ pose[:2] + shift), pose[2] + turn + 2 * math.pi])
        one = here.update(k * FRAME, felt, pose)
        two = there.update(k * FRAME, felt + np.array([2 * math.pi, 0.0]), moved)
        if k < 6:  # later the cells of the map, which do not turn, make small differences
            assert one == pytest.approx(two, abs=1e-9)
        pose = pose + np.array([0.001, 0.0, 0.002])


def test_faults_are_told() -> None:
    assert course().navigator.update(0.0, None, np.zeros(3)) == (0.0, 0.0)
    lost = course().navigator
    assert lost.update(0.0, np.zeros((0, 2)), np.array([np.nan, 0.0, 0.0])) == (0.0, 0.0)
    assert lost.state == "no pose"
    stuck = course(goal=(3.0, 0.0))
    stuck.driven = lambda wheels: (0.0, wheels[1])
    assert stuck.go(30.0).navigator.why == "the left track does not follow"
    numb = course(Wall((0.3, -0.05), (0.3, 0.05)))
    numb.feels = False
    numb.driven = lambda wheels: (0.0, 0.0) if numb.pose[0] > 0.26 and sum(wheels) > 0.0 else wheels
    assert any("does not feel" in each for each in numb.go(20.0).seen)
    assert len(numb.navigator.map)
    walled = course(*(Wall((x, -0.4), (x, 0.4)) for x in (-0.2, 0.3)), doubt=10.0, patience=20.0)
    assert walled.go(18.0).navigator.state != "stopped"
    assert walled.navigator.why.count("is the goal in reach?") == 1
    assert walled.go(42.0).navigator.state == "stopped"
    with pytest.raises(InputError, match=r"goal: .*goal"):
        TouchNavigator((1.0, math.inf))
    with pytest.raises(InputError, match="ground"):
        TouchNavigator((1.0, 0.0), settings=TouchNavigatorSettings(ground=0))


def test_a_push_is_judged_along_the_push() -> None:
    test = PushTest(settle=0.5, test=1.0, moved=0.004)
    ahead = (1.0, 0.0)

    def press(speed: tuple[float, float], seconds: float) -> Push | None:
        test.end()
        for time in np.arange(0.0, seconds, FRAME).tolist():
            test.touch(7.0 + time, (speed[0] * time, speed[1] * time), ahead)  # whenever the clock began
        return test.push

    assert press((0.0, 0.0), 1.4) is Push.WAITING  # until both times are over
    assert press((0.0, 0.0), 1.6) is Push.STANDS
    assert test.touch(8.6, (0.0, 0.0), (math.cos(0.5), math.sin(0.5))) is Push.STANDS  # 29 degrees aside
    assert test.touch(8.6, (0.0, 0.0), (math.cos(0.55), math.sin(0.55))) is Push.WAITING
    assert press((0.0, 0.05), 1.6) is Push.STANDS  # it slides past
    assert press((0.01, 0.0), 1.6) is Push.MOVES
    assert press((-0.01, 0.0), 1.6) is Push.BACK
    test.none(8.7)
    assert test.push is Push.BACK
    test.none(9.0)
    assert test.push is None


@pytest.mark.parametrize(
    ("driven", "touched", "side", "held"),
    [
        ((1.0, 1.0), False, None, False),
        ((0.0, 1.0), False, "left", False),
        ((1.0, 0.0), False, "right", False),
        ((0.0, 0.0), False, None, True),
        ((0.0, 1.0), True, None, False),
    ],
)
def test_tracks_are_watched(driven: tuple[float, float], touched: bool, side: str | None, held: bool) -> None:
    made = course()
    watch, pose, ever = TrackWatch(made.navigator.drive), np.zeros(3), False
    said: str | None = None
    for k in range(300):
        said = watch.update(k * FRAME, tuple(pose.tolist()), (0.04, 0.04), touched=touched)
        ever = ever or watch.held
        forward, turn = made.navigator.drive.twist(0.04 * driven[0], 0.04 * driven[1])
        heading = float(pose[2]) + 0.5 * turn * FRAME
        pose = pose + np.array([forward * math.cos(heading), forward * math.sin(heading), turn]) * FRAME
    assert (said, ever) == (side, held)


@pytest.mark.parametrize("ground", [1, 2, 5])
@pytest.mark.parametrize("seed", range(4))
def test_a_robot_is_doubted_by_the_times_of_its_new_places(ground: int, seed: int) -> None:
    """Against all places so far, counted at each step: enough new ones of late, or nearer of late."""
    rng, watch, been, doubtful = np.random.default_rng(seed), ProgressWatch(8.0, ground), dict[object, float](), False
    nearest, since, x, y = np.inf, 0.0, 0.0, 0.0
    for step in range(400):
        time = 0.5 * step + 1e9 * (seed % 2)  # whenever the clock began
        x, y = x + rng.normal(0.0, 0.08), y + rng.normal(0.0, 0.08)
        far = float(np.hypot(x - 2.0, y))
        if far < nearest - 0.05:
            nearest, since, doubtful = far, time, False
        been.setdefault((round(x / 0.1), round(y / 0.1)), time)
        fresh = sum(time - first <= 8.0 for first in been.values())
        doubtful = doubtful or (time - since > 8.0 and fresh < ground)
        assert watch.update(time, x, y, far) == pytest.approx(time - since)
        assert watch.doubtful == doubtful
