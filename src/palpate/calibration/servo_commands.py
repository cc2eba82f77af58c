"""Find when commands were sent, and which of them never reached the robot."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from palpate.calibration.servo_motion import CommandChanges, Pair, ServoMotion, spread_of
from palpate.spatial.arguments import takes_arrays

LEAST = 10  # commands
STEADY = 0.05  # of the usual distance of two rows, below which it is always the same
STRONG = 50.0  # chi-square of a command that was lost


Values = Float[np.ndarray, " k"]


@takes_arrays
def sent_commands(
    time: Float[np.ndarray, " m"], commands: Float[np.ndarray, "m n"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k n"], float, float]:
    """Return when commands that differ from those before were sent, these, their period, and its phase's deviation [s].

    A row of a steady table only shows that a command was sent since the row before.

    Args:
        time: (m,) [s] of the rows, or of messages, each of which is a command.
        commands: (m, n) in them.

    Raises:
        InputError: arrays of other shapes.
    """
    changed = np.append(True, np.any(np.diff(commands, axis=0) != 0, axis=1))
    sent, steps = time[changed], np.diff(time)
    step, gaps = float(np.median(steps)), np.diff(sent)
    if len(gaps) < LEAST or step > 0.75 * np.median(gaps) or np.std(steps) > STEADY * step:
        return sent, commands[changed], float(np.median(gaps)) if len(gaps) else step, 0.0
    usual = gaps / np.mean(gaps[gaps < 1.6 * np.median(gaps)])
    count = np.append(0.0, np.cumsum(np.maximum(1.0, np.floor(usual + 0.49))))
    line = np.polyfit(count, sent, 1)
    within, unsure = _within(sent - np.polyval(line, count), step)
    return sent - within, commands[changed], float(line[0]), unsure


def _within(phase: Values, step: float) -> tuple[Values, float]:
    """Return how long before its row each command was sent [s], and the deviation of what all have in common.

    Phase and jitter of the period are those of largest likelihood, with the latest of phases that are equally likely; a
    command is sent at its mean time within its row.
    """
    from scipy.special import ndtr  # here: it takes 0.5 s to import
    from scipy.stats import truncnorm

    at = np.linspace(float(phase.min()) - step, float(phase.max()), 201)
    sizes: Values = np.geomspace(1e-3 * step, step + 3.0 * float(np.std(phase)), 16)
    likely = np.empty((len(sizes), len(at)))
    for row, size in zip(likely, sizes.tolist(), strict=True):
        above = (phase - at[:, None]) / size
        inside = np.asarray(ndtr(above) - ndtr(above - step / size), dtype=np.float64)
        row[:] = np.log(np.maximum(inside, 1e-30)).sum(axis=1)
    alike = np.flatnonzero(likely.max(axis=0) > likely.max() - 1.0)
    best, size = float(at[alike[-1]]), float(sizes[np.argmax(likely[:, alike[-1]])])
    high: Values = (phase - best) / size
    mean: Any = best + size * truncnorm.mean(np.clip(high - step / size, -30.0, 29.0), np.clip(high, -29.0, 30.0))
    return phase - np.clip(mean, phase - step, phase), float(np.ptp(at[alike])) / 12.0**0.5


@takes_arrays
def lost_commands(motion: ServoMotion, values: Pair) -> Bool[np.ndarray, " m"]:
    """Return which commands never came: until the next one, the robot's line waits where it was.

    The shares of each wait are fitted together: 0 of a command that came, 1 or more of a lost one.

    Args:
        motion: commands and positions.
        values: delay and lag [s].

    Raises:
        InputError: arrays of other shapes.
    """
    residual, _ = motion.compared(*values.tolist())
    scale, last = spread_of(residual), motion.begins[-1] + motion.period
    waits = CommandChanges(motion, values, np.append(motion.begins[1:], last), (5.0 * scale) ** 2)
    return (waits.shares(residual) > 0.5) & (waits.sizes > STRONG * scale**2)
