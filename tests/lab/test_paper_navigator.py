"""The paper's state machine on scripted touches and poses, by closed forms, and steering by the heading."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from palpate.control.drive import DifferentialDrive
from palpate.control.navigation import Navigator, heading_error
from palpate.errors import InputError
from palpate_lab.papers.navigator import Condition, PaperNavigator, PaperSettings, PaperState, table_1
from palpate_lab.papers.steering import Speedometer, Steering

FRAME = 1.0 / 30.0
GOAL = (2.0, 0.0)
NONE: list[tuple[float, float]] = []
SOFT, HARD = 1.0, 3.0  # N, below F_max and not below
Touched = Callable[[float], list[tuple[float, float]] | None]


@dataclass
class Course:
    """A robot without a world: its drive moves it, unless it is held; touches are scripted over time."""

    navigator: PaperNavigator
    pose: np.ndarray = field(default_factory=lambda: np.zeros(3))
    time: float = 0.0
    states: list[str] = field(default_factory=list[str])
    wheels: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    poses: list[np.ndarray] = field(default_factory=list[np.ndarray])

    def go(self, seconds: float, touched: Touched | list[tuple[float, float]], *, held: bool = False) -> Course:
        """`touched` by the time since the course began."""
        for _ in range(round(seconds / FRAME)):
            felt = touched(self.time) if callable(touched) else touched
            rows = None if felt is None else np.array(felt, dtype=float).reshape(-1, 2)
            wheels = self.navigator.update(self.time, rows, self.pose)
            self.states.append(self.navigator.state)
            self.wheels.append(wheels)
            self.poses.append(self.pose)
            forward, turn = self.navigator.drive.twist(*wheels)
            heading = self.pose[2] + 0.5 * turn * FRAME
            moved = np.array([forward * math.cos(heading), forward * math.sin(heading), turn]) * FRAME
            self.pose = self.pose + moved * (0.0 if held else 1.0)
            self.time += FRAME
        return self

    def lasted(self, state: PaperState) -> float:
        """[s] in a state, over all."""
        return self.states.count(state) * FRAME


def course(settings: PaperSettings | None = None, goal: tuple[float, float] = GOAL, **options: float) -> Course:
    return Course(PaperNavigator(goal, settings=settings, seed=int(options.get("seed", 0))))


# --- table I ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("touched", [math.nan, 0.0, 0.49, 0.5, 3.0])
@pytest.mark.parametrize("strongest", [0.0, 2.99, 3.0, 8.0])
def test_table_1(touched: float, strongest: float) -> None:
    """Each condition as it is printed; where the table has two hold, the force is stronger."""
    set_ = PaperSettings()
    for speed in (0.0, 0.0049, 0.0051, 0.05, math.nan):
        moves, decided = not speed < set_.still, touched >= set_.t_t
        holds = {
            Condition.FREE: math.isnan(touched),
            Condition.PUSH: strongest < set_.f_max and decided and moves,
            Condition.AVOID: touched >= 0.0 and (strongest >= set_.f_max or (decided and not moves)),
            Condition.NO: touched < set_.t_t and strongest < set_.f_max,
        }
        found, why = table_1(set_, touched, strongest, speed)
        assert [name for name, true in holds.items() if true] == [found]
        assert why


def test_without_touches_it_goes_to_the_goal_and_stays_there() -> None:
    way = course().go(45.0, NONE)
    assert way.navigator.arrived
    assert set(way.states) == {PaperState.GOAL, PaperState.ARRIVED}
    assert way.states.index(PaperState.ARRIVED) * FRAME == pytest.approx(1.9 / 0.05, abs=2 * FRAME)
    assert way.navigator.update(way.time, np.array([[0.0, 9.0]]), np.array([5.0, 5.0, 0.0])) == (0.0, 0.0)
    assert way.navigator.arrived


def test_a_touch_that_holds_it_is_avoided_after_its_time() -> None:
    way = course().go(1.0, NONE).go(1.2, [(0.0, SOFT)], held=True)
    assert way.states.index(PaperState.BACK) * FRAME == pytest.approx(1.0 + 0.5, abs=1.01 * FRAME)
    assert "does not move" in way.navigator.why


def test_what_moves_is_pushed() -> None:
    way = course().go(1.0, NONE).go(0.4, [(0.0, SOFT)])
    assert way.navigator.condition == Condition.NO
    way.go(5.0, [(0.0, SOFT)])
    assert set(way.states) == {PaperState.GOAL}
    assert way.navigator.condition == Condition.PUSH


def test_noise_of_the_tracker_does_not_move_a_robot_that_is_held() -> None:
    rng, frames = np.random.default_rng(0), round(0.5 / FRAME)
    for _ in range(20):
        navigator, states = PaperNavigator(GOAL), list[str]()
        for k in range(frames + 1):
            pose = np.array([0.5, 0.5, 0.0]) + 0.5e-3 * rng.standard_normal(3)
            navigator.update(k * FRAME, np.array([[0.0, SOFT]]), pose)
            states.append(navigator.state)
        assert states == [PaperState.GOAL] * frames + [PaperState.BACK]


def test_the_timer_is_reset_when_nothing_touches() -> None:
    """0.4 s of touch and a frame without, again and again: never t_t."""
    way = course().go(1.0, NONE, held=True)
    for _ in range(8):
        way.go(0.4, [(0.0, SOFT)], held=True).go(FRAME, NONE, held=True)
    assert set(way.states) == {PaperState.GOAL}


def test_a_turn_that_does_not_end_is_given_up() -> None:
    set_ = PaperSettings(turn_limit=2.0)
    way = course(set_).go(1.0, NONE).go(FRAME, [(0.0, HARD)]).go(10.0, NONE, held=True)
    assert way.lasted(PaperState.ALONG) == pytest.approx(3.0, abs=2.01 * FRAME)


# --- V_B and V_A -----------------------------------------------------------------------------------------------------


def test_stronger_touches_count_for_more() -> None:
    """3 N ahead and 4 N from the left: pushed back and to the right, atan2(-4, -3)."""
    way = course().go(FRAME, [(0.0, 3.0), (math.pi / 2.0, 4.0)])
    assert way.navigator.vectors[0] == pytest.approx(math.atan2(-4.0, -3.0))


def test_forces_that_cancel_lead_straight_back() -> None:
    way = course().go(FRAME, [(math.pi / 2.0, 4.0), (-math.pi / 2.0, 4.0)])
    assert abs(heading_error(way.navigator.vectors[0], math.pi)) < 1e-12
    assert way.wheels[-1] == (-0.05, -0.05)


@pytest.mark.parametrize(("side", "turn"), [(1.0, 1), (-1.0, -1)])
def test_the_retreat_towards_the_goal(side: float, turn: int) -> None:
    """Touched ahead while it looks along x: along is the side on which the goal is."""
    way = course(goal=(1.0, side))
    way.go(FRAME, [(0.0, HARD)]).go(1.1, NONE)
    assert way.navigator.state == PaperState.ALONG
    assert heading_error(way.navigator.vectors[1], turn * math.pi / 2.0) == pytest.approx(0.0, abs=1e-12)


def test_the_retreat_by_chance_is_seeded_and_goes_both_ways() -> None:
    def sides(seed: int) -> list[float]:
        way, found = course(PaperSettings(retreat="random"), seed=seed), list[float]()
        for _ in range(12):
            way.go(FRAME, [(0.0, HARD)]).go(1.1, NONE, held=True)
            found.append(round(heading_error(way.navigator.vectors[1], way.navigator.vectors[0]), 9))
            way.go(6.0, NONE, held=True)
        return found

    assert sides(1) == sides(1)
    assert sides(1) != sides(2)
    assert set(sides(1)) == {round(math.pi / 2, 9), -round(math.pi / 2, 9)}


def test_strong_touches_while_it_moves_along() -> None:
    way = course().go(FRAME, [(0.0, HARD)]).go(1.1, NONE).go(FRAME, [(1.0, SOFT)])
    assert way.navigator.state == PaperState.ALONG
    way.go(FRAME, [(1.0, HARD)])
    assert way.navigator.state == PaperState.BACK


# --- what holds for every navigator ----------------------------------------------------------------------------------


@pytest.mark.parametrize("blind", [True, False])
def test_without_skin_or_pose_it_stops_and_says_so(blind: bool) -> None:
    way = course().go(1.0, NONE)
    pose = way.pose.copy()
    if blind:
        way.go(1.0, lambda _: None)
    else:
        way.pose = np.full(3, np.nan)
        way.go(1.0, NONE, held=True)
    assert way.navigator.state == PaperState.STOPPED
    assert set(way.wheels[31:]) == {(0.0, 0.0)}
    assert way.navigator.why == ("the skin says nothing" if blind else "the pose is not known")
    way.pose = pose
    assert way.go(1.0, NONE).navigator.state == PaperState.GOAL


def script(time: float) -> list[tuple[float, float]]:
    """Touches of every kind."""
    if 1.0 <= time < 2.0 or 8.0 <= time < 8.3:
        return [(0.3, SOFT), (-1.0, 0.4)]
    return [(2.5 - time, HARD)] if 4.0 <= time < 4.1 or 12.0 <= time < 12.2 else NONE


def run(goal: np.ndarray, pose: np.ndarray, begin: float = 0.0) -> Course:
    way = Course(PaperNavigator(goal, settings=PaperSettings(retreat="random", t_t=0.6), seed=3), pose, begin)
    return way.go(20.0, lambda time: script(time - begin))


def test_nothing_depends_on_where_the_frame_lies_or_when_the_clock_began() -> None:
    turn, shift = 1.1, np.array([0.7, -0.4])
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    goal, start = np.array([0.6, 0.5]), np.array([0.1, -0.2, 0.3])
    moved_start = np.append(rotation @ start[:2] + shift, start[2] + turn - 2.0 * math.tau)
    one, other = run(goal, start), run(rotation @ goal + shift, moved_start, 64.0)  # 64: the same steps in binary
    assert len(set(one.states)) == 3
    assert one.states == other.states
    np.testing.assert_allclose(one.wheels, other.wheels, atol=1e-9)
    back = (np.array(other.poses)[:, :2] - shift) @ rotation
    np.testing.assert_allclose(back, np.array(one.poses)[:, :2], atol=1e-9)


def test_reset_is_a_new_navigator() -> None:
    way = run(np.array([0.6, 0.5]), np.zeros(3))
    way.navigator.reset()
    assert (way.navigator.state, way.navigator.arrived) == (PaperState.GOAL, False)
    again = Course(way.navigator).go(20.0, script)
    assert (again.states, again.wheels) == (way.states, way.wheels)


def test_a_time_that_does_not_grow_changes_nothing() -> None:
    navigator = PaperNavigator(GOAL)
    first = navigator.update(1.0, np.zeros((0, 2)), np.zeros(3))
    assert navigator.update(1.0, np.array([[0.0, 9.0]]), np.zeros(3)) == first
    assert navigator.state == PaperState.GOAL


def test_it_is_a_navigator_within_its_drive() -> None:
    drive = DifferentialDrive(track=0.1, top=0.03)
    navigator = PaperNavigator(GOAL, drive=drive)
    assert isinstance(navigator, Navigator)
    way = Course(navigator, np.array([0.0, 0.0, 2.0])).go(15.0, script)
    assert max(abs(speed) for pair in way.wheels for speed in pair) <= drive.top * (1.0 + 1e-12)


def test_weights_are_shares_of_the_top_speed() -> None:
    way = course(PaperSettings(alpha=0.8, beta=0.6, gamma=0.4)).go(1.0, NONE)
    assert way.wheels[-1] == pytest.approx((0.04, 0.04))
    way.go(FRAME, [(0.0, HARD)])
    assert way.wheels[-1] == pytest.approx((-0.03, -0.03))
    way.go(4.0, NONE)
    along = [sum(pair) / 2 for pair, state in zip(way.wheels, way.states, strict=True) if state == PaperState.ALONG]
    assert max(along) == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"f_max": 0.0}, "f_max must be positive"),
        ({"t_t": math.nan}, "t_t must be positive"),
        ({"retreat": "left"}, "one of goal, turned, random"),
        ({"gamma": 1.5}, "at most 1"),
        ({"t_t": 0.3}, "the window of 0.5 s"),
    ],
)
def test_settings_that_cannot_be(wrong: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        PaperSettings(**wrong)  # pyright: ignore[reportArgumentType] - that is what is tried


RATE = 30.0
NOISE = 0.5e-3  # m, of the tracker


def driven(error: float, bias: float = 0.0, seconds: float = 30.0, speed: float = 0.05) -> np.ndarray:
    """(n, 3) pose of an ideal drive that is to go along x; `bias` [m/s] of the right track."""
    drive = DifferentialDrive()
    steering, pose, poses = Steering(drive), np.array([0.0, 0.0, -error]), list[np.ndarray]()
    for k in range(int(seconds * RATE)):
        left, right = steering.wheels(k / RATE, heading_error(0.0, float(pose[2])), speed)
        forward, turn = drive.twist(left, right + bias)
        pose = pose + np.array([forward * math.cos(pose[2]), forward * math.sin(pose[2]), turn]) / RATE
        poses.append(pose)
    return np.array(poses)


@pytest.mark.parametrize("error", [0.0, 0.3, -1.0, 2.0, 3.1])
def test_steering_finds_the_heading_and_goes_there(error: float) -> None:
    poses = driven(error)
    assert abs(poses[-1, 2]) < 1e-3
    assert abs(poses[:, 2]).max() <= abs(error) + 1e-12  # no overshoot beyond the start
    assert np.diff(poses[-30:, 0]).mean() * RATE == pytest.approx(0.05, rel=1e-3)


def test_it_turns_on_the_spot_where_it_looks_away() -> None:
    left, right = Steering(DifferentialDrive()).wheels(0.0, 2.0, 0.05)
    assert left == -right < 0.0


def test_the_integral_takes_out_a_track_that_is_wrong() -> None:
    """5 mm/s at one track turn by 0.06 rad/s, which k_p alone would answer with 0.06/3 rad."""
    assert abs(driven(0.0, bias=0.005, speed=0.03)[-1, 2]) < 2e-4


def test_reset_forgets_the_integral() -> None:
    steering = Steering(DifferentialDrive())
    first = [steering.wheels(k / RATE, 0.1, 0.02) for k in range(30)]
    assert first[-1] != first[0]
    steering.reset()
    assert [steering.wheels(k / RATE, 0.1, 0.02) for k in range(30)] == first


def test_the_speed_is_that_of_the_window() -> None:
    meter = Speedometer(0.5)
    found = [meter.velocity(k / RATE, 0.04 * min(k / RATE, 1.0), -0.03 * min(k / RATE, 1.0)) for k in range(60)]
    assert all(math.isnan(x) for x, _ in found[:7])  # under half of the window
    for x, y in found[8:31]:
        assert (x, y) == pytest.approx((0.04, -0.03))
    assert found[45] == pytest.approx((0.0, 0.0), abs=1e-12)  # 0.5 s after it stopped
    meter.reset()
    assert math.isnan(meter.velocity(2.0, 0.0, 0.0)[0])


def test_its_noise_is_as_stated() -> None:
    rng, meter = np.random.default_rng(3), Speedometer(0.5)
    poses = NOISE * rng.standard_normal((4000, 2))
    found = np.array([meter.velocity(k / RATE, *pose) for k, pose in enumerate(poses.tolist())])[20:]
    n = 16
    stated = NOISE * RATE * math.sqrt(12.0 / (n**3 - n))
    assert found.std() == pytest.approx(stated, rel=0.1)  # windows overlap: some 500 are independent
    assert stated == pytest.approx(0.81e-3, rel=0.01)


def test_repeated_times_and_lost_poses_add_nothing() -> None:
    meter, twice = Speedometer(0.5), Speedometer(0.5)
    for k in range(20):
        wanted = meter.velocity(k / RATE, 0.001 * k, 0.0)
        twice.velocity(k / RATE, 0.001 * k, 0.0)
        twice.velocity(k / RATE, math.nan, 0.0)
        assert twice.velocity(k / RATE, 7.0, 7.0) == pytest.approx(wanted, nan_ok=True)
