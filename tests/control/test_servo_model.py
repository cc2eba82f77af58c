"""The model of a robot's servo: its differential equation solved by SciPy, the lag of a ramp, feedback."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from claims.evidence.servo_contacts import LABS
from palpate.control.align import AlignController
from palpate.control.servo import Feedback, Servo, ServoModel
from palpate.errors import InputError
from palpate_lab.cli.phantom_run import FORCE, controller_for
from palpate_lab.simulation.phantom.lab import LabSettings
from palpate_lab.simulation.phantom.motion import motion


def reference(servo: Servo, sent: list[tuple[float, float]], time: float) -> float:
    """The line that the joints follow, from the commands: each is reached over the ramp that begins after the delay."""
    value = 0.0
    for given, target in sent:
        share = np.clip((time - given - servo.delay) / servo.ramp, 0.0, 1.0)
        value += share * (target - value)
    return float(value)


def test_joints_solve_the_servos_equation() -> None:
    """Against an integrator of order 8 at 1e-10, from one bend of the line to the next; commands at their period."""
    servo, times = Servo(period=0.02, delay=0.015, ramp=0.02, lag=0.03), np.arange(61) * 0.005
    sent = [(0.02 * k, float(np.sin(3.0 * k))) for k in range(12)]
    model, found = ServoModel(servo, 1), []
    model.start(0.0, np.zeros(1))
    for time in times:
        model.advance(float(time))
        if round(time * 1000) % 20 == 0 and round(time * 50) < len(sent):
            model.send(float(time), np.array([sent[round(time * 50)][1]]))
        found.append([model.joints[0], model.speeds[0], model.accelerations[0]])
    w = 2.0 / servo.lag

    def change(time: float, state: np.ndarray) -> list[float]:
        return [state[1], w * w * (reference(servo, sent, time) - state[0]) - 2.0 * w * state[1]]

    bends = np.unique(np.concatenate([[0.0], *[[g + 0.015, g + 0.035] for g, _ in sent], [times[-1]]]))
    state, true = np.zeros(2), {0.0: np.zeros(2)}
    for start, end in pairwise(bends.tolist()):
        inside = np.append(times[(times > start) & (times < end)], end)
        solved = solve_ivp(change, (start, end), state, "DOP853", inside, rtol=1e-10, atol=1e-12)
        true |= dict(zip(inside.tolist(), solved.y.T, strict=True))
        state = solved.y[:, -1]
    for time, (place, speed, pull) in zip(times.tolist(), found, strict=True):
        near = min(true, key=lambda each: abs(each - time))
        q, v = true[near]
        assert place == pytest.approx(q, abs=1e-8)
        assert speed == pytest.approx(v, abs=1e-6)
        assert pull == pytest.approx(w * w * (reference(servo, sent, time) - q) - 2.0 * w * v, abs=1e-4)


def test_a_ramp_is_met_late_by_what_the_servo_says() -> None:
    """Commands k T of a ramp are where the joints are `late` afterwards: delay, ramp and lag, to exp(-w t)."""
    servo, model = Servo(), ServoModel(Servo(), 1)
    model.start(0.0, np.zeros(1))
    for k in range(400):
        model.advance(0.005 * k)
        if k % 4 == 0:
            model.send(0.005 * k, np.array([0.005 * k]))
    assert model.joints[0] == pytest.approx(0.005 * 399 - servo.total_delay, abs=1e-9)
    assert model.speeds[0] == pytest.approx(1.0, abs=1e-9)


def test_a_ramp_may_end_between_two_looks() -> None:
    """(R(t) - R(t - T)) / T with the answer R to a ramp of 1/s, t - 2/w + (t + 2/w) exp(-w t), and its derivatives."""
    servo, model = Servo(), ServoModel(Servo(), 1)
    model.start(0.0, np.zeros(1))
    model.send(0.0, np.ones(1))
    model.advance(0.07)
    w = 2.0 / servo.lag
    t = 0.07 - servo.delay - np.array([0.0, servo.ramp])  # since it began, and since it ended
    decay = np.exp(-w * t)
    ramp = np.array([t - 2.0 / w + (t + 2.0 / w) * decay, 1.0 - (1.0 + w * t) * decay, w * w * t * decay])
    found = [model.joints[0], model.speeds[0], model.accelerations[0]]
    assert found == pytest.approx((ramp[:, 0] - ramp[:, 1]) / servo.ramp, rel=1e-9)


def test_without_lag_and_ramp_a_command_is_there_at_once() -> None:
    model = ServoModel(Servo(period=0.002, delay=0.0, ramp=0.0, lag=0.0), 2)
    model.start(0.0, np.zeros(2))
    model.send(0.002, np.array([1.0, -2.0]))
    model.advance(0.004)
    assert model.joints.tolist() == [1.0, -2.0]


def test_feedback_is_followed_slowly_and_nan_is_left_out() -> None:
    """A sag of 1 mrad is known to exp(-t/correction)."""
    model = ServoModel(Servo(), 1)
    model.start(0.0, np.zeros(1))
    for k in range(1, 51):
        model.advance(0.02 * k)
        model.correct(0.02 * k, np.array([np.nan if k == 7 else 1e-3]))
    assert model.joints[0] + 0.0 == pytest.approx(1e-3, rel=1e-3)


def test_feedback_of_no_joint_spoils_nothing() -> None:
    model, rng = ServoModel(Servo(), 6), np.random.default_rng(2)
    model.start(0.0, np.zeros(6))
    for k in range(1, 60):
        model.send(0.02 * k, np.zeros(6))
        model.correct(0.02 * k, rng.normal(size=6) * 10.0 ** rng.choice([-2, 2, 16, 80], 6))
    assert np.isfinite(model.joints).all()


def test_feedback_is_held_against_the_moment_that_it_is_of() -> None:
    """What comes 20 ms late is no offset: on a ramp of 1 rad/s that would be 20 mrad."""
    model = ServoModel(Servo(), 1)
    model.start(0.0, np.zeros(1))
    joints = {}
    for k in range(200):
        model.advance(0.005 * k)
        joints[k] = float(model.joints[0])
        if k % 4 == 0:
            model.send(0.005 * k, np.array([0.005 * k]))
            if k >= 4:
                model.correct(0.005 * (k - 4), np.array([joints[k - 4]]))
    assert model.offset[0] == pytest.approx(0.0, abs=1e-12)


def driven(lag: float, lost: set[int], phase: int = 0, late: int = 0) -> tuple[ServoModel, np.ndarray]:
    """A model of 30 ms and how far it is off a robot of this lag, which never gets some of 200 commands; every 5 ms.

    Feedback comes once a command, `phase` times 5 ms after it is given, and is `late` times 5 ms old.
    """
    model, robot, rng = ServoModel(Servo(), 2), ServoModel(Servo(lag=lag), 2), np.random.default_rng(6)
    off, was = list[float](), list[np.ndarray]()
    for each in (model, robot):
        each.start(0.0, np.zeros(2))
    kept = np.zeros(2)
    for k in range(800):
        now = 0.005 * k
        model.advance(now)
        robot.advance(now)
        was.append(robot.joints.copy())
        if k % 4 == phase and k >= late:
            model.correct(0.005 * (k - late), was[k - late] + 1e-5 * rng.standard_normal(2))
        if k % 4 == 0:
            wanted = 0.3 * np.sin([2.0 * now, 3.0 * now])
            model.send(now, wanted)
            kept = kept if k // 4 in lost else wanted
            robot.send(now, kept)
        off.append(float(np.abs(model.joints - robot.joints).max()))
    return model, np.array(off)


LOST = {40, 80, 81, 120, 121, 122, 160}  # one, two and three in a row


@pytest.mark.parametrize("phase", [0, 1, 2, 3])
@pytest.mark.parametrize("late", [0, 4])
def test_a_command_that_never_came_is_taken_out(phase: int, late: int) -> None:
    """Found by the second feedback at the latest after it should have begun, and the model is the robot's again."""
    model, off = driven(0.030, LOST, phase, late)
    assert model.missed == len(LOST)
    wrong = {4 * each + k for each in LOST for k in range(4, 8 + phase + late)}
    right = [k for k in range(len(off)) if k not in wrong]
    assert off[right].max() < 3e-4  # 0.3 ms of delay and lag, which are learnt, at 0.9 rad/s
    assert phase > 1 or off[sorted(wrong)].max() > 1e-3  # it does make a difference, if it is found late


def test_a_command_that_never_came_is_found_behind_a_larger_one_that_did() -> None:
    """A lost step of 4 mrad shows only in the feedback in which the next, of 0.8 rad, shows three times as much."""
    exact = Servo(known=0.0)
    model, robot, said = ServoModel(exact, 1), ServoModel(exact, 1), list[Feedback]()
    for each in (model, robot):
        each.start(0.0, np.zeros(1))
    model.send(0.0, np.array([4e-3]))
    for time in (0.02, 0.025, 0.045):
        for each in (model, robot):
            each.advance(time)
            if time == 0.02:
                each.send(time, np.array([0.8]))
        if time > 0.02:
            said.append(model.correct(time, robot.joints.copy()))
    assert said == [Feedback.AGREES, Feedback.LOST]
    assert model.missed == 1
    assert model.joints[0] == pytest.approx(robot.joints[0], abs=2e-5)  # the first feedback was off by 16 urad


def test_joints_that_yield_to_a_contact_are_not_taken_for_a_robot_of_another_delay() -> None:
    """At 20 mrad/s a force that grows to 7 N in 80 ms bends one by 0.5 mrad; without that force 10 ms were learnt."""
    model, robot = ServoModel(Servo(), 2), ServoModel(Servo(known=0.0), 2)
    for each in (model, robot):
        each.start(0.0, np.zeros(2))
    for k in range(60):
        for each in (model, robot):
            each.advance(0.02 * k)
        bent = robot.joints + np.interp(k, (40, 44), (0.0, 5e-4)) * np.array([1.0, 0.0])
        model.correct(0.02 * k, bent, 7.0 / 4.0 * (40 < k <= 44))
        assert model.joints == pytest.approx(bent, abs=2e-5)
        for each in (model, robot):
            each.send(0.02 * k, np.array([4e-4, 1e-4]) * k)
    assert model.missed == 0
    assert model.total_delay == pytest.approx(Servo().total_delay, abs=1e-4)


@pytest.mark.parametrize("wrong", [0.010, -0.010])
def test_a_robot_whose_servo_is_stated_wrongly_is_not_taken_for_one_that_loses_commands(wrong: float) -> None:
    """Their sum is found instead, in spite of encoders' noise, and of slow motion each of them less sharply."""
    model, off = driven(0.030 + wrong, set())
    assert model.missed == 0
    assert model.total_delay == pytest.approx(0.070 + wrong, abs=2e-4)
    assert (model.found.delay, model.found.lag) == pytest.approx((0.020, 0.030 + wrong), abs=2e-3)
    assert off[400:].max() < 1e-4


@pytest.mark.parametrize(
    ("contact", "seed", "delay"), [("elastic", 312, 0.028), ("elastic", 312, 0.012), ("the engine's", 314, 0.028)]
)
def test_delay_and_lag_are_found_while_a_robot_lands(contact: str, seed: int, delay: float) -> None:
    """Of MuJoCo's robot; the approach shows their sum alone, and the first quick commands misled a filter."""
    lab = LABS[contact](LabSettings(motion=motion("still"), seed=seed))
    made = controller_for(lab)
    servo = Servo(delay=delay)
    controller, reading = AlignController(made.arm, made.estimator, FORCE, face=made.face, servo=servo), lab.reading
    while reading.time < 3.0:
        lab.command(controller.update(reading.time, reading.wrench, reading.joints))
        reading = lab.step()
    assert controller.model.missed == 0
    assert (controller.model.found.delay, controller.model.found.lag) == pytest.approx((0.020, 0.030), abs=1e-3)


def test_feedback_that_jumps_once_is_ignored_and_twice_is_followed() -> None:
    """The joints were stopped on their way, by a brake or by torque: from there the model goes on."""
    model = ServoModel(Servo(), 1)
    model.start(0.0, np.zeros(1))
    said = list[Feedback]()
    for k in range(1, 60):
        model.advance(0.02 * k)
        said.append(model.correct(0.02 * k, np.array([0.5 if k in (30, 50, 51) else 0.0])))
    assert [k + 1 for k, each in enumerate(said) if each == Feedback.ODD][:3] == [30, 50, 51]
    assert said[30] == Feedback.AGREES
    assert abs(model.joints[0]) < 0.05


def test_feedback_that_is_none_says_nothing() -> None:
    model = ServoModel(Servo(), 2)
    assert model.correct(0.0, np.array([np.nan, 0.0])) == Feedback.ODD
    assert model.correct(0.0, np.zeros(2)) == Feedback.AGREES
    with pytest.raises(InputError, match=r"joints: .*2 joints"):
        model.correct(0.0, np.zeros(3))


@pytest.mark.parametrize("wrong", [{"period": 0.0}, {"lag": -1.0}, {"delay": np.nan}, {"ramp": np.inf}])
def test_times_that_are_none_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        Servo(**wrong)
