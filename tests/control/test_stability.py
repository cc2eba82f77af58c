"""Spectral radii against the loops themselves, written out in finer steps; the bounds that papers state."""

import copy
import pickle

import numpy as np
import pytest

from palpate.control.stability import (
    Admittance,
    DelayedRobot,
    Tracker,
    admittance_radius,
    least_damping,
    observer_radius,
    require_stable,
    stiffest,
)
from palpate.errors import InputError

DT, FINE = 0.02, 50
PAPER = Admittance(10.0, 290.0)
ROBOT = DelayedRobot(DT, delay=1, ramp=True, lag=0.03, order=2)  # about 70 ms in all
ROBOTS = [
    DelayedRobot(DT),
    DelayedRobot(DT, delay=2),
    DelayedRobot(DT, delay=1, lag=0.03),
    DelayedRobot(DT, delay=1, lag=0.03, order=2),
    ROBOT,
    DelayedRobot(DT, delay=1, ramp=True, lag=0.03, order=2, smoothing=0.016),
]


def test_a_constant_error_ends_in_its_share_of_the_damping() -> None:
    """The recursion's closed form, v = (1 - (1 - a)^k) error/D with a = dt D/M, to rounding."""
    law, speed, dt = Admittance(10.0, 290.0), 0.0, 0.02
    for k in range(1, 200):
        speed = law.step(speed, 2.0, dt)
        assert speed == pytest.approx((1.0 - (1.0 - dt * 29.0) ** k) * 2.0 / 290.0, rel=1e-9)
    assert law.step(speed, np.nan, dt) == 0.0
    assert law.step(np.inf, 1.0, dt) == 0.0


@pytest.mark.parametrize("wrong", [(0.0, 1.0), (1.0, -1.0), (np.nan, 1.0), (1.0, np.inf)])
def test_mass_and_damping_are_positive(wrong: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="must be positive"):
        Admittance(*wrong)


class Servo:
    """The robot in fine steps of time: Heun's rule: (2 dt / 50 lag)^2 / 6 of an error, 1e-4, against edges of 5 %."""

    def __init__(self, robot: DelayedRobot) -> None:
        self.robot, self.state = robot, np.zeros(2)
        self.sent = [0.0] * (robot.delay + 2)

    def flow(self, state: np.ndarray, target: float) -> np.ndarray:
        """How position and speed change."""
        if self.robot.order == 1:
            return np.array([(target - state[0]) / self.robot.lag, 0.0])
        w = 2.0 / self.robot.lag
        return np.array([state[1], w * w * (target - state[0]) - 2.0 * w * state[1]])

    def cycle(self, command: float) -> None:
        """Until the next reading."""
        self.sent = [command, *self.sent[:-1]]
        start, end = self.sent[self.robot.delay + 1], self.sent[self.robot.delay]
        if self.robot.lag == 0:
            self.state = np.array([end, 0.0])
            return
        h = DT / FINE
        for k in range(FINE):
            goals = [start + (end - start) * (k + s) / FINE if self.robot.ramp else end for s in (0, 1)]
            first = self.flow(self.state, goals[0])
            second = self.flow(self.state + h * first, goals[1])
            self.state = self.state + 0.5 * h * (first + second)


def growth(robot: DelayedRobot, admittance: Admittance, stiffness: float, cycles: int = 300) -> float:
    """Amplitude of the last third of a press that was disturbed, over that of the middle third."""
    servo, speed, command, smoothed, seen = Servo(robot), 0.01, 0.0, 0.0, list[float]()
    share = 1.0 if robot.smoothing == 0 else 1.0 - np.exp(-DT / robot.smoothing)
    for _ in range(cycles):
        smoothed += share * (servo.state[0] - smoothed)
        speed += DT / admittance.mass * (-stiffness * smoothed - admittance.damping * speed)
        command += DT * speed
        servo.cycle(command)
        seen.append(abs(servo.state[0]))
    third = cycles // 3
    return max(seen[-third:]) / max(seen[third:-third])


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_edge_is_where_the_loop_begins_to_grow(robot: DelayedRobot) -> None:
    """5 % inside the edge it decays, 5 % outside it grows."""
    edge = stiffest(robot, PAPER)
    assert admittance_radius(robot, PAPER, 0.999 * edge) < 1.0 < admittance_radius(robot, PAPER, 1.001 * edge)
    assert growth(robot, PAPER, 0.95 * edge) < 0.9
    assert growth(robot, PAPER, 1.05 * edge) > 1.1
    if robot.delay:  # without, a greater damping is nearer to the edge
        assert least_damping(robot, PAPER.mass, edge) == pytest.approx(PAPER.damping, rel=1e-6)


@pytest.mark.parametrize("mass", [1.0, 10.0])
@pytest.mark.parametrize("share", [0.1, 1.4])
def test_the_bounds_of_the_remarks_come_out(mass: float, share: float) -> None:
    """Without delay dt D/M + K dt^2/(2 M) < 2, with one cycle of it K dt < D whatever M; to rounding."""
    admittance = Admittance(mass, share * mass / DT)
    assert stiffest(DelayedRobot(DT), admittance) == pytest.approx(2.0 * mass / DT**2 * (2.0 - share), rel=1e-9)
    assert stiffest(DelayedRobot(DT, delay=1), admittance) == pytest.approx(admittance.damping / DT, rel=1e-9)
    assert admittance_radius(DelayedRobot(DT), Admittance(mass, 2.01 * mass / DT), 1e-6) > 1.0
    assert stiffest(DelayedRobot(DT), Admittance(mass, 2.01 * mass / DT)) == 0.0


def test_gains_that_oscillate_are_refused_with_the_bound() -> None:
    require_stable(ROBOT, PAPER, 2240.0)
    with pytest.raises(InputError) as caught:
        require_stable(ROBOT, Admittance(10.0, 60.0), 2240.0)
    said = str(caught.value)
    assert "a damping of 60 N s/m" in said
    assert "unstable against 2240 N/m with 1 cycle of delay and 30 ms of lag" in said
    bound = float(said.split("at least ")[1].split()[0])
    assert admittance_radius(ROBOT, Admittance(10.0, bound), 2240.0) < 1.0
    assert admittance_radius(ROBOT, Admittance(10.0, 0.98 * bound), 2240.0) > 1.0
    with pytest.raises(InputError, match=r"the orientation loop is unstable against 0.06 m/rad.*m s/rad"):
        require_stable(ROBOT, Admittance(1e-4, 1e-3), 0.06, "orientation")
    with pytest.raises(InputError, match="must be positive"):
        require_stable(ROBOT, PAPER, np.nan)


def test_where_no_damping_is_enough_the_mass_is_named() -> None:
    with pytest.raises(InputError, match=r"Use a mass above 2\.9 kg"):
        require_stable(ROBOT, Admittance(1.0, 290.0), 2240.0)
    with pytest.raises(InputError, match=r"Use a damping of at least \S+ N s/m with a mass of") as caught:
        require_stable(ROBOT, Admittance(0.1, 5.0), 2240.0)
    words = str(caught.value).split("at least ")[1].split()
    assert admittance_radius(ROBOT, Admittance(float(words[7]), float(words[0])), 2240.0) < 1.0


def watched(robot: DelayedRobot, tracker: Tracker, ratio: float, cycles: int = 400) -> float:
    """As `growth`, of a loop that observes a surface at rest from an angle off it."""
    servo, share = Servo(robot), 1.0 if robot.smoothing == 0 else 1.0 - np.exp(-DT / robot.smoothing)
    value, rate, p, smoothed, seen = 0.0, 1.0, np.exp(-tracker.bandwidth * DT), 0.0, list[float]()
    for _ in range(cycles):
        smoothed += share * (servo.state[0] - smoothed)
        value += DT * rate
        new = servo.state[0] - ratio * smoothed - value
        value, rate = value + (1.0 - p**2) * new, rate + (1.0 - p) ** 2 / DT * new
        servo.cycle(value + tracker.prediction * rate)
        seen.append(abs(servo.state[0]))
    third = cycles // 3
    return max(seen[-third:]) / max(seen[third:-third])


@pytest.mark.parametrize(("ratio", "smoothing"), [(2.6, 0.0), (1.0, 0.068)])
def test_an_observer_is_stable_below_a_bandwidth(ratio: float, smoothing: float) -> None:
    """Its edge lies where the loop, written out, begins to grow: 10 % inside it decays, 10 % outside it grows."""
    robot = DelayedRobot(DT, delay=1, ramp=True, lag=0.03, order=2, smoothing=smoothing)

    def radius(bandwidth: float) -> float:
        return observer_radius(robot, Tracker(bandwidth, 0.07), ratio)

    low, high = 0.5, 60.0
    assert radius(low) < 1.0 < radius(high)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if radius(middle) < 1.0 else (low, middle)
    assert watched(robot, Tracker(0.9 * low, 0.07), ratio) < 0.95
    assert watched(robot, Tracker(1.1 * low, 0.07), ratio) > 1.05


def test_a_gain_that_is_known_leaves_the_filters_poles() -> None:
    """With g = 1 nothing of the robot's own motion comes back: p is the pole, of order 2 threefold, to 1e-4 of it."""
    for order in (0, 1, 2):
        pole = np.exp(-5.0 * DT)
        assert observer_radius(ROBOT, Tracker(5.0, 0.07, order), 1.0) == pytest.approx(pole, rel=1e-4)
    assert observer_radius(ROBOT, Tracker(60.0, 0.07), 1.5) < 1.0  # a gain half as wrong bears a far faster filter


def test_what_cannot_be_is_refused_and_values_travel() -> None:
    for make in (
        lambda: DelayedRobot(0.0),
        lambda: DelayedRobot(DT, delay=-1),
        lambda: DelayedRobot(DT, lag=np.nan),
        lambda: DelayedRobot(DT, order=3),
        lambda: Tracker(0.0),
    ):
        with pytest.raises(InputError):
            make()
    robots = pickle.loads(pickle.dumps(ROBOT)), ROBOT
    assert len({admittance_radius(robot, PAPER, 2240.0) for robot in robots}) == 1
    assert copy.copy(ROBOT) is ROBOT
