"""`palpate calibrate servo`: delay and lag from logs of a plant that is integrated apart, with jitter and losses.

Servos have a delay of 5 to 40 ms and a lag of 15 to 50 ms; commands are sent and taken with a jitter of 1 ms each, and
every twentieth is lost.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from claims.evidence.servo_log import ServoLog
from claims.row import Row
from palpate.calibration.servo import ServoFit, identify_servo
from palpate.console.parallel import each_done

SEED, LOST = 300, 0.05
RATES = (100.0, 125.0, 200.0, 333.0, 500.0, 1000.0)  # Hz


def rows(small: bool) -> Iterator[Row]:
    """Errors of delay and lag by the order of the lag, what is stated of them, and lost commands."""
    for order in (2, 1):
        yield from _calibrated(order, *((1, 12.0) if small else (20, 30.0)))


def _identify(log: ServoLog) -> tuple[ServoLog, ServoFit, int]:
    time, commands, positions, lost = log.rows()
    return log, identify_servo(time, commands, time, positions), lost


def _calibrated(order: int, count: int, seconds: float) -> Iterator[Row]:
    logs = list[ServoLog]()
    for seed in range(count):
        rng = np.random.default_rng([SEED, seed])
        delay, lag = rng.uniform(0.005, 0.040), rng.uniform(0.015, 0.050)
        made = ServoLog(delay, lag, order=order, rate=RATES[seed % len(RATES)], lost=LOST, seed=seed, seconds=seconds)
        logs.append(replace(made, jitter=1e-3, hidden=1e-3, noise=1e-4))
    ran = list(each_done(_identify, logs, 1 if count == 1 else 2, "processes", "logs"))
    off = np.array([[fit.servo.delay - log.delay, fit.servo.lag - log.lag] for log, fit, _ in ran])
    stated = np.array([fit.deviation for _, fit, _ in ran])
    right, worst = sum(fit.servo.order == order for _, fit, _ in ran), 1e3 * np.abs(off).max(axis=0)
    total = 1e3 * np.abs(off.sum(axis=1)).max()
    what = (
        f"`calibrate servo`, {count} logs of {seconds:.0f} s at 100-1000 Hz, order {order}, jitter of 1 ms in sending "
    )
    what += f"and taking, {LOST:.0%} of commands lost: worst error of delay, lag, and their sum [ms]; order found"
    got = f"{worst[0]:.2f}, {worst[1]:.2f}, {total:.2f}; {right} of {count}"
    yield Row(what, "<= 1; all", got, max(*worst, total) <= 1.0 and right == count)
    inside = float(np.mean(np.abs(off) < 1.96 * stated))
    yield Row(f"the same {count} logs: delay and lag within their 95 % intervals", ">= 90 %", f"{inside:.0%}",
              inside >= 0.9)  # fmt: skip
    found, gone = sum(fit.lost for _, fit, _ in ran), sum(lost for *_, lost in ran)
    yield Row(f"the same {count} logs: commands found as lost", "90 to 105 %", f"{found} of {gone}",
              0.9 * gone <= found <= 1.05 * gone)  # fmt: skip
