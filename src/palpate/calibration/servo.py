"""Identify with which delay and lag a robot follows commands, from a log of its motion in free space."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from palpate.calibration.servo_commands import lost_commands, sent_commands
from palpate.calibration.servo_motion import CAUCHY, LEAST_JITTER, SEARCH, Pair, ServoMotion, spread_of
from palpate.calibration.validation import Validation, cross_validate
from palpate.control.servo import Servo
from palpate.errors import InputError, NotIdentifiable
from palpate.spatial.arguments import takes_arrays

COARSE = 0.01  # s, of the search for a delay
MOST = 8_000  # positions that are used
BEGUN = 0.5  # s after the first command, before which the robot may still follow older ones
LEAST = 10  # s in which it moves
MOVES = 1e-3  # rad or m
SAME = 0.05  # of 1: gains of positions by commands
FOLLOWS = 0.1  # share of the motion that may remain unexplained
UNSURE = 3e-3  # s: delay or lag that is not known better is no answer
FLOOR = 1e-3  # s: by which a robot's delay differs from one start to the next
SURE = 3.0  # standard deviations
OFTEN = 0.75  # of the period: positions that come less often do not show what happens between two commands
LATE = (
    "Rows are so far from each other that commands may have been sent up to {:.0f} ms before them: log each command "
    "when it is sent, or more rows."
)
SELDOM = "Positions come no more often than commands: that the robot interpolates between commands is assumed."
ALIKE = "Lags of first and of second order explain the log alike: only delay + lag is certain."
UNITS = {"degrees": 180.0 / np.pi, "mm": 1e3}


@dataclass(frozen=True)
class ServoFit:
    """A servo, and how well it is known.

    Attributes:
        servo: `Servo`; its `known` is the larger deviation, at least 1 ms.
        deviation: (delay, lag) [s], standard deviations.
        residual: robust standard deviation of a position [rad, m].
        commands: number of commands used.
        lost: number of those that never came.
        validation: agreement of parts of the log with the rest.
        notes: messages for the user, one sentence each.
    """

    servo: Servo
    deviation: tuple[float, float]
    residual: float
    commands: int
    lost: int
    validation: Validation = field(default_factory=Validation)
    notes: tuple[str, ...] = ()


@takes_arrays
def identify_servo(
    command_time: Float[np.ndarray, " m"],
    commands: Float[np.ndarray, "m n"],
    position_time: Float[np.ndarray, " k"],
    positions: Float[np.ndarray, "k n"],
) -> ServoFit:
    """Find the delay and lag with which joints follow commands, and return a `ServoFit`.

    The model is that of `Servo`. Cauchy's likelihood of the positions is maximised over delay and lag, with an offset
    and a gain for each joint; kinds of servo (order 2 or 1, with or without interpolation) compete. Commands whose
    omission explains the positions are taken for lost. Each command may be taken a little late, by its own time; the
    likelihood has these times integrated out. The standard deviations are the sandwich over stretches of 1 s.

    Args:
        command_time: (m,) [s] when each command was sent; repeated commands do not count. Where rows come steadily and
            more often than commands, commands are taken as sent periodically, before the first row that has them.
        commands: (m, n) [rad, m] of n joints.
        position_time: (k,) [s] on the same clock.
        positions: (k, n) [rad, m] measured; repeated ones do not count.

    Raises:
        InputError: times do not increase, positions do not follow the commands, or in another unit or sign, or before
            them; or arrays of other shapes.
        NotIdentifiable: nothing moves, for less than 10 s, or too steadily to distinguish delay from lag.
    """
    first = _motion(command_time, commands, position_time, positions)
    start = np.array([max(_coarse(first), 0.0), 0.03])
    often = float(np.median(np.diff(first.time))) < OFTEN * first.period
    kinds = [(order, ramp) for ramp in ((first.period, 0.0) if often else (first.period,)) for order in (2, 1)]
    fits = [_without_lost(replace(first, order=order, ramp=ramp), start) for order, ramp in kinds]
    best, alike = _best(fits)
    motion, values = fits[best]
    _require_same(motion, motion.compared(*values), SAME)
    covariance, residual = motion.spread(values)
    validation = _left_out(motion, values)
    deviation = np.sqrt(np.diag(covariance) * validation.widening)
    _require_known(values, deviation)
    deviation[0] = np.hypot(deviation[0], motion.unsure)
    notes, found = [*validation.notes, *([] if often else [SELDOM])], values.tolist()
    if motion.unsure > FLOOR / 2.0:
        notes.append(LATE.format(1e3 * 12.0**0.5 * motion.unsure))
    for other in alike:
        notes.append(ALIKE)
        deviation = np.hypot(deviation, fits[other][1] - values)
    known = max(FLOOR, float(deviation.max()))
    servo = Servo(motion.period, max(0.0, found[0]), motion.ramp, found[1], known, motion.order)
    lost, (one, two) = len(first.sent) - len(motion.sent), deviation.tolist()
    return ServoFit(servo, (one, two), residual, len(first.sent), lost, validation, tuple(notes))


def _left_out(motion: ServoMotion, values: Pair) -> Validation:
    """Compare delay and lag of parts of the log with those of the rest."""

    def predict(left: Bool[np.ndarray, " k"]) -> tuple[Pair, Float[np.ndarray, "2 2"]]:
        part, rest = motion.part(left), motion.part(~left)
        (part, one), (rest, other) = part.refined(values), rest.refined(values)
        return one - other, part.spread(one)[0] + rest.spread(other)[0]

    return cross_validate(len(motion.time), predict)


def _motion(
    command_time: Float[np.ndarray, " m"],
    commands: Float[np.ndarray, "m n"],
    position_time: Float[np.ndarray, " k"],
    positions: Float[np.ndarray, "k n"],
) -> ServoMotion:
    """Return the joints that move, in rows that differ from those before."""
    for name, time in (("commands", command_time), ("positions", position_time)):
        if len(time) < LEAST or not (np.diff(time) > 0).all():
            raise InputError(
                f"the times of the {name} do not increase, or are fewer than {LEAST}.",
                hint="Stamp each row by one monotonic clock.",
            )
    moving = np.ptp(commands, axis=0) > MOVES
    if not moving.any():
        raise _unexcited("no joint is commanded to move by 1e-3 rad or m.")
    commands, positions = commands[:, moving], positions[:, moving]
    sent, targets, period, unsure = sent_commands(command_time, commands)
    begun = position_time > command_time[0] + BEGUN
    fresh = np.flatnonzero(begun & np.append(True, np.any(np.diff(positions, axis=0) != 0, axis=1)))
    fresh = fresh[:: -(-len(fresh) // MOST) or 1]
    if len(sent) < LEAST or len(np.unique(np.floor(sent))) < LEAST:
        raise _unexcited(f"the robot is commanded to move in less than {LEAST} s.")
    if len(fresh) < LEAST or position_time[fresh[-1]] < sent[-1] - 1.0 or position_time[fresh[0]] > sent[-1]:
        raise InputError(
            "commands and positions do not overlap in time, or positions stand still.",
            hint="Stamp both by one clock, and name the columns or topics of measured positions.",
        )
    late = np.zeros(len(sent))
    return ServoMotion(position_time[fresh], positions[fresh], sent, targets, round(period, 5), unsure, late)


def _coarse(motion: ServoMotion) -> float:
    """Return the delay [s] of the search that explains the positions best, and check what they follow."""
    lagging = replace(motion, ramp=motion.period)
    delays = np.arange(*SEARCH, COARSE)
    compared = [lagging.compared(float(delay), 0.03) for delay in delays]
    best = int(np.argmin([np.sum(residual**2) for residual, _ in compared]))
    _require_same(motion, compared[best], 3.0 * SAME)
    if best in (0, len(delays) - 1):
        raise InputError(
            f"positions follow commands best at a delay of {delays[best]:.2g} s, at the edge of the search.",
            hint="Stamp commands and positions by one clock.",
        )
    return float(delays[best])


def _require_same(
    motion: ServoMotion, compared: tuple[Float[np.ndarray, "k n"], Float[np.ndarray, " n"]], same: float
) -> None:
    """Raise an InputError where a joint does not follow its commands with a gain of 1."""
    residual, gains = compared
    share = np.mean(residual**2, axis=0) / np.maximum(np.var(motion.seen, axis=0), 1e-18)
    for joint in np.flatnonzero((share > FOLLOWS) | (np.abs(gains - 1.0) > same)).tolist():
        hint = "Name columns or topics of the same joints, unit and sign."
        raise InputError(_mistake(float(gains[joint]), float(share[joint]), joint), hint=hint)


def _mistake(gain: float, share: float, joint: int) -> str:
    which = f"of the joints that move, number {joint + 1}"
    if share > FOLLOWS:
        return f"positions do not follow the commands ({which}: {share:.0%} of its motion is another)."
    if gain < 0:
        return f"positions have another sign than commands ({which})."
    for unit, size in UNITS.items():
        for ones, others, ratio in (("positions", "commands", size), ("commands", "positions", 1.0 / size)):
            if abs(gain / ratio - 1.0) < SAME:
                return f"{ones} are in {unit}, {others} are not ({which})."
    return f"positions move {gain:.3g} times as far as commands ({which})."


def _without_lost(motion: ServoMotion, start: Pair) -> tuple[ServoMotion, Pair]:
    """Return the motion without the commands that the positions show as lost, and its delay and lag.

    Lateness is found at the end: while delay and lag are far off, it would explain a lost command.
    """
    kept, rest, values = np.full(len(motion.sent), True), motion, motion.fitted(start)
    for refine in (False, False, False, True, True):
        late = np.zeros(len(kept))
        late[kept] = rest.late
        kept = ~lost_commands(replace(motion, late=late), values)
        rest = replace(motion, sent=motion.sent[kept], targets=motion.targets[kept], late=late[kept])
        rest, values = rest.refined(values) if refine else (rest, rest.fitted(values))
    return rest, values


def _best(fits: list[tuple[ServoMotion, Pair]]) -> tuple[int, list[int]]:
    """Return the number of the kind of servo that fits best, and of the other order, where it is as good.

    Another than the first must be better beyond chance.
    """
    scale = min(spread_of(motion.compared(*values)[0]) for motion, values in fits)
    jitter = max(LEAST_JITTER, min(float(np.sqrt(np.mean(motion.late**2))) for motion, _ in fits))
    costs = [motion.costs(values, scale, jitter) for motion, values in fits]
    usable = [k for k, (_, values) in enumerate(fits) if values[0] > -SURE * FLOOR] or [*range(len(fits))]

    def better(k: int, other: int) -> bool:
        gain = costs[other] - costs[k]
        most = CAUCHY * float(np.median(np.abs(gain)))  # a loss that shows in one fit only is no more evidence
        gain = np.clip(gain, -most, most)
        return bool(gain.sum() > SURE * np.sqrt(np.sum(gain**2)))

    best = usable[0]
    for k in usable:
        best = k if better(k, best) else best
    return best, [k for k in usable if k == best ^ 1 and not better(best, k)]


def _require_known(values: Pair, deviation: Pair) -> None:
    """Raise an error where delay and lag are not known each, or positions come before their commands."""
    delay, total = 1e3 * float(values[0]), 1e3 * float(values.sum())
    known = bool((deviation < UNSURE).all())  # False for NaN too
    ahead = -delay if known else -total
    if ahead > 1e3 * SURE * (max(float(deviation[0]), FLOOR) if known else FLOOR):
        raise InputError(
            f"positions come {ahead:.0f} ms before the commands that they follow.",
            hint="Stamp commands and positions by one clock, and exchange neither columns nor topics.",
        )
    if not known:
        raise _unexcited(
            f"the motion is too steady to distinguish delay from lag: only their sum, {total:.1f} ms, shows."
        )


def _unexcited(what: str) -> NotIdentifiable:
    hint = "Move joints to and fro for 20 s or more, quickly and slowly in turn."
    return NotIdentifiable(f"{what} {hint}", rank=0, missing=("delay", "lag"))
