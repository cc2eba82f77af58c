"""Delay and lag are found from commands and positions of a plant that is integrated apart, or the log is refused."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from claims.evidence.servo_log import ServoLog
from palpate.calibration.servo import ServoFit, identify_servo
from palpate.calibration.servo_motion import CommandChanges, ServoMotion
from palpate.control.servo import Servo, ServoModel
from palpate.errors import InputError, NotIdentifiable, PalpateError

short = partial(ServoLog, seconds=11.0)
ROUGH = [short(rate=333.0, jitter=1e-3, hidden=1e-3, lost=0.05, noise=1e-4, seed=20 + k) for k in range(4)]
rows = cache(ServoLog.rows)


@cache
def identified(log: ServoLog) -> tuple[ServoFit, int]:
    time, commands, positions, lost = rows(log)
    return identify_servo(time, commands, time, positions), lost


@pytest.mark.parametrize(
    "log",
    [
        short(rate=1000.0, seed=1),
        short(order=1, rate=250.0, lost=0.05, seed=2),
        short(ramp=False, period=0.008, lag=0.015, lost=0.05, seed=3),
        ROUGH[0],
    ],
)
def test_delay_lag_and_kind_are_found_to_a_millisecond(log: ServoLog) -> None:
    found, lost = identified(log)
    assert (found.servo.order, found.servo.ramp > 0.0) == (log.order, log.ramp)
    assert found.servo.delay == pytest.approx(log.delay, abs=2e-4)
    assert found.servo.lag == pytest.approx(log.lag, abs=1e-4)
    assert found.servo.period == pytest.approx(log.period, abs=2e-5)
    assert abs(found.lost - lost) <= 0.1 * lost
    assert found.validation.parts == 4


def test_a_late_command_changes_positions_as_stated() -> None:
    """Against the model with one command that comes 1 ms later, and whose ramp ends before the next one."""
    time, commands, positions, _ = rows(ServoLog(rate=200.0))
    sent, none = time[::4], np.zeros(len(time[::4]))
    motion, at = ServoMotion(time, positions, sent, commands[::4], 0.02, 0.0, none, 0.015), np.array([0.021, 0.033])
    late = np.where(np.arange(len(sent)) == 700, 1e-3, 0.0)
    change = replace(motion, late=late).model(*at.tolist()) - motion.model(*at.tolist())
    stated = CommandChanges(motion, at, motion.begins + 1e-3, 1.0).change(late / 1e-3)
    assert np.abs(stated - change).max() < 1e-3 * np.abs(change).max()


def test_deviations_hold() -> None:
    """Of four logs whose commands come with jitter, errors are of the stated size: chi-square of 8, to 1e-4."""
    found = [(identified(log)[0], log) for log in ROUGH]
    errors = np.array([[f.servo.delay - log.delay, f.servo.lag - log.lag] for f, log in found])
    stated = np.array([f.deviation for f, _ in found])
    assert 0.5 < float(np.sum((errors / stated) ** 2)) < 32.0


def test_positions_as_seldom_as_commands_leave_interpolation_assumed() -> None:
    time, commands, positions, _ = rows(short(rate=200.0))
    found = identify_servo(time, commands, time[::4], positions[::4])
    assert found.servo.ramp == found.servo.period
    assert (found.servo.delay, found.servo.lag) == pytest.approx((0.021, 0.033), abs=1e-3)
    assert any("is assumed" in note for note in found.notes)


def test_rows_that_do_not_show_when_commands_were_sent_widen_the_delay() -> None:
    """Commands every other row, always at the same phase: it may be anywhere in a row of 10 ms."""
    found, _ = identified(short(rate=100.0, seed=5))
    assert found.deviation[0] == pytest.approx(0.010 / 12.0**0.5, rel=0.1)
    assert any("Rows are so far from each other" in note for note in found.notes)


@pytest.mark.parametrize(
    ("motion", "change", "words"),
    [
        ("still", 1.0, "no joint is commanded"),
        ("steady", 1.0, "too steady"),
        ("mixed", np.degrees(1.0), "positions are in degrees"),
        ("mixed", np.radians(1.0), "commands are in degrees"),
        ("mixed", 1e3, "positions are in mm"),
        ("mixed", -1.0, "another sign"),
        ("mixed", 1.2, "move 1.2 times as far"),
        ("mixed", 0.0, "overlap in time, or positions stand still"),
    ],
)
def test_logs_that_cannot_tell_are_refused(motion: str, change: float, words: str) -> None:
    time, commands, positions, _ = rows(short(), motion)
    with pytest.raises(PalpateError, match=words):
        identify_servo(time, commands, time, positions * change)


def test_another_joint_or_clock_is_refused() -> None:
    time, commands, positions, _ = rows(short())
    for late, words in ((-0.1, "before the commands"), (5.0, "follow.*Name"), (1e6, "overlap.*Stamp")):
        with pytest.raises(InputError, match=words):
            identify_servo(time, commands, time + late, positions)
    with pytest.raises(InputError, match=r"before the commands.*Stamp"):
        identify_servo(time, positions, time, commands)
    with pytest.raises(InputError, match=r"do not follow.*Name"):
        identify_servo(time, commands, time, positions[:, ::-1])
    with pytest.raises(InputError, match=r"do not increase.*Stamp"):
        identify_servo(time[::-1], commands, time, positions)
    with pytest.raises(NotIdentifiable, match="less than 10 s"):
        identify_servo(time[:2000], commands[:2000], time[:2000], positions[:2000])


def test_a_model_of_first_order_follows_it() -> None:
    """The controller's model, against the plant: 0.1 mrad at a speed of 1 rad/s and the plant's steps of 0.1 ms."""
    log = short(order=1, noise=0.0, rate=200.0)
    time, commands, positions, _ = log.rows()
    model = ServoModel(Servo(0.02, log.delay, 0.02, log.lag, 0.0, 1), 3)
    model.start(0.0, commands[0])
    off = list[float]()
    for k, now in enumerate(time[:1000].tolist()):
        model.advance(now)
        off.append(float(np.abs(model.joints - positions[k]).max()))
        if k % 4 == 0:
            model.send(now, commands[k])
    assert max(off) < 2e-4
