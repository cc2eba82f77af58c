"""Find baseline and noise of taxels, and which of them are dead, stuck or wrapped around."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.rest import CLOSE, falls, resting
from palpate.signals.recording import Recording
from palpate.signals.wrench_sensor import Tare
from palpate.spatial._arrays import frozen
from palpate.spatial.arguments import frozen_value

SCATTER = 4.0  # times the noise, in a tare
FEWEST = 8  # frames from which a cell can be judged
SILENT = 5  # frames in which a cell was silent between neighbours that were pressed
PRESSED = 0.25  # of the largest excursion in the log: then a cell is pressed
AFTER, LEFT = 0.5, 0.03  # s after a touch, and the share of a reading that may remain then
FALLS = (
    "readings fall under load, by the direction of their largest excursions: write falling = true in [skin], or "
    "falling = false if they rise"
)
OPPOSITE = -0.8  # cosine between the ways to two neighbours
MOVED, ALIKE = 4.0, 0.5  # deviations of noise, and share of the median in which cells differ, of a zero that moved
PART = 10  # of the log at its start and end, in which it is seen
WRAP = 0.85  # of the range: a step of a cell alone that is no touch
BETWEEN = 10  # frames over which differences show the noise of taxels with three axes, which a rest that drifts is not
SPREAD = 8192  # frames, evenly spread, that show the direction of a load
# of the largest load: good taxels fall by up to 0.08 where others are pressed; frames that show still readings
PULLED, BESIDE, STILL = 0.15, 0.1, 100


@frozen_value
class Health:
    """Baseline and noise of the cells, and which of them are bad.

    Attributes:
        baseline: (k,) reading without a touch [counts].
        noise: (k,) standard deviation of that reading.
        dead: (k,) true for cells that are silent between neighbours that are pressed; of taxels with three axes also
            where a reading never changes, or a calibrated taxel is reversed along z.
        stuck: (k,) true for cells at one value far from the others' baseline.
        frames: number of frames from which the baseline was taken.
        notes, warnings: one sentence each.
        hysteresis: median share of a reading's height that remains 0.5 s after a touch; NaN: not known.
        falling: readings fall under load.
        sideways: (2, 2, k) the same baseline and noise of the tangential loads of taxels with three axes [N]; None:
            taxels have one.
    """

    baseline: Float[np.ndarray, " k"]
    noise: Float[np.ndarray, " k"]
    dead: Bool[np.ndarray, " k"]
    stuck: Bool[np.ndarray, " k"]
    frames: int = 1_000
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    hysteresis: float = float("nan")
    falling: bool = False
    sideways: Float[np.ndarray, "2 2 k"] | None = None

    @property
    def good(self) -> Bool[np.ndarray, " k"]:
        """Return bools (k,), whether each cell is neither dead nor stuck."""
        return ~(self.dead | self.stuck)


def examine(
    recording: Recording, body: TaxelBody, *, seconds: float | None = None, falling: bool | None = None
) -> Health:
    """Return the `Health` of a body's cells from a log's start, which may contain touches.

    Args:
        recording: at least 8 frames.
        body: the body that was recorded.
        seconds: time at the start in which nothing was touched; None: not known.
        falling: readings fall under load; None: found by `falls_under_load`, with a note where they do.

    Raises:
        InputError: no readings of this body, too few frames, or every cell keeps one value and is stuck.
    """
    if falling is None:
        found = examine(recording, body, seconds=seconds, falling=falls_under_load(recording, body, seconds))
        noted = found.falling and not body.calibrated
        return replace(found, notes=(*found.notes, FALLS)) if noted else found
    raw, tangential = body.loads(recording)
    known = np.isfinite(raw).all(axis=1)
    cells, time = -raw[known] if falling else raw[known], recording.time[known]
    if len(cells) < FEWEST:
        raise InputError(
            f"only {len(cells)} of {len(raw)} frames have {body.named()}, and at least {FEWEST} are needed to know the "
            "cells at rest.",
            where=recording.source,
            hint="Check that the rig states rows and columns as the log has them."
            if len(raw) >= FEWEST
            else "The log is too short: record for longer.",
        )
    cells, wrapped = _unwrapped(cells, body)
    rest = cells
    if seconds is not None:
        rest = cells[time <= time[0] + seconds]
        if len(rest) < FEWEST:
            what = f"a tare needs at least {FEWEST} frames, and the first {seconds:g} s have {len(rest)}."
            raise InputError(what, where=recording.source, hint="Tare for longer.")
    baseline, noise = resting(rest, counts=body.bits is not None)
    still = np.ptp(cells, axis=0) == 0
    stuck = _stuck(baseline, still, body)
    if stuck.all() or (still.all() and np.ptp(baseline) > 0 and body.bits is not None):
        raise InputError(
            f"every cell keeps its value in the first {len(cells):,} frames: all cells are stuck.",
            where=recording.source,
            hint="Check that the taxels are connected, and that the columns are those of their readings.",
        )
    if body.response is None:
        dead, mute, pulled = _dead(cells - baseline, noise, still, stuck, body), *np.zeros((2, len(body)), dtype=bool)
    else:
        readings = body.raw(recording)[known]
        own = readings[..., 2] * body.response.gains[:, 2, 2]
        rest_of, noise_of = resting(own, counts=False)
        dead = _dead(own - rest_of, noise_of, np.ptp(own, axis=0) == 0, stuck, body)
        mute, pulled = _mute(readings) & ~stuck, _pulled(cells - baseline, body) & body.calibrated
    hysteresis = _hysteresis(time, np.where(stuck | dead, 0.0, cells - baseline), noise)
    notes = _named("wrapped around (readings jump from one end of the range to the other)", wrapped, body)
    if still.all():
        notes.append(f"no cell moves in the first {len(cells):,} frames")
    doubts = [
        *_named("dead: silent between cells that are pressed", dead & ~mute, body),
        *_named("dead: one of their three readings never changes", mute, body),
        *_named("reversed along z: they read a pull (they are left out; correct the sign in the log)", pulled, body),
        *_named("stuck at one value", stuck, body),
    ]
    if hysteresis > LEFT:
        share = f"{100 * hysteresis:.0f} % of a reading remains {AFTER:g} s after a touch"
        doubts.append(f"{share}: after it, forces are too large for a while (hysteresis, or slow recovery)")
    good = ~(stuck | dead)
    if seconds is None and good.any():
        doubts += _moved(cells[:, good], noise[good])
    at_rest = _sideways(tangential[known][: len(rest)], rest, baseline, noise)
    noise = noise if at_rest is None else _steady(rest, np.abs(rest - baseline) <= CLOSE * noise, noise)
    baseline = -baseline if falling else baseline
    counted = (len(rest), tuple(notes), tuple(doubts), hysteresis, falling)
    return Health(frozen(baseline), frozen(noise), dead | mute | pulled, stuck, *counted, at_rest)


def _moved(cells: Float[np.ndarray, "n k"], noise: Float[np.ndarray, " k"]) -> list[str]:
    """Return a list of a warning where nearly all cells read more, or less, at the end by about the same."""
    part = len(cells) // PART
    if part < FEWEST:
        return []
    shift = np.median(cells[-part:], axis=0) - np.median(cells[:part], axis=0)
    low, middle, high = np.quantile(shift * np.sign(np.median(shift)), (0.1, 0.5, 0.75))
    if low < MOVED * np.median(noise) or high - low > ALIKE * middle:
        return []
    return [
        f"nearly all cells read {middle:.2g} {'more' if np.median(shift) > 0 else 'less'} at the end of the first "
        f"{len(cells):,} frames than at their start: if not all are pressed alike, the zero jumped or drifts, which "
        "is followed only with tare = SECONDS of an untouched start in [skin]"
    ]


def _sideways(
    loads: Float[np.ndarray, "n _"], raw: Float[np.ndarray, "n k"], baseline: np.ndarray, noise: np.ndarray
) -> Float[np.ndarray, "2 2 k"] | None:
    """Return mean and noise of the tangential loads while the taxels are not pressed; None where there are none."""
    if not loads.shape[1]:
        return None
    free = np.abs(raw - baseline) <= CLOSE * noise
    free |= ~free.any(axis=0)  # a taxel that never rests: all its frames
    both = np.where(free[:, None], loads.reshape(len(loads), 2, -1), np.nan)
    middle = np.nanmedian(both, axis=0)
    deviation = np.maximum(1.4826 * np.nanmedian(np.abs(both - middle), axis=0), 1e-3 * noise)
    steady = [_steady(loads.reshape(both.shape)[:, a], free, deviation[a]) for a in range(2)]
    return frozen(np.stack([middle, np.array(steady)]))


def _steady(
    loads: Float[np.ndarray, "n k"], free: Bool[np.ndarray, "n k"], most: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Return the noise of loads at rest by their differences, between 0.2 times and one times the most it may be."""
    if len(loads) <= 2 * BETWEEN:
        return most
    both = free[BETWEEN:] & free[:-BETWEEN]
    both |= ~both.any(axis=0)
    apart = np.where(both, np.abs(loads[BETWEEN:] - loads[:-BETWEEN]), np.nan)
    return np.clip(1.4826 / np.sqrt(2.0) * np.nanmedian(apart, axis=0), 0.2 * most, most)


def falls_under_load(recording: Recording, body: TaxelBody, seconds: float | None = None) -> bool:
    """Return whether readings fall under load, by the direction of their largest excursions.

    Args:
        recording: with touches; without any, readings are taken to rise.
        body: the body that was recorded.
        seconds: time at the start in which nothing was touched; None: not known.

    Raises:
        InputError: no readings of this body.
    """
    raw, time = body.readings(recording), recording.time
    known = np.isfinite(raw).all(axis=1) & np.isfinite(time)
    cells, rest = raw[known], raw[known]
    if seconds is not None and known.any():
        rest = rest[time[known] <= time[known][0] + seconds]
    every = 1 + len(cells) // SPREAD
    return len(rest) >= FEWEST and falls(cells[::every][:, body.usable], rest[::every][:, body.usable])


def _at_rest(recording: Recording, body: TaxelBody, falling: bool) -> Health:
    """Return the `Health` of untouched cells; raise an InputError if they do not keep still."""
    health = examine(recording, body, seconds=np.inf, falling=falling)
    raw = body.readings(recording)
    off = raw[np.isfinite(raw).all(axis=1)] - health.baseline
    if body.bits is not None:
        off -= (body.top + 1.0) * np.rint(off / (body.top + 1.0))
    moved = np.maximum(off.std(axis=0), SCATTER * np.abs(off[: len(off) // 2].mean(axis=0)))
    restless = body.usable & ~health.stuck & (moved > SCATTER * health.noise)
    if restless.any():
        cell = int(np.argmax(np.where(restless, moved / health.noise, 0.0)))
        raise InputError(
            f"the cells were not at rest during the tare: cell {body.name(cell)} reads up to "
            f"{np.abs(off[:, cell]).max():.3g} from its rest, and its noise is only {health.noise[cell]:.2g}.",
            where=recording.source,
            hint="Let nothing touch them during the tare, or mask cells that never settle.",
        )
    return health


def tared(
    recording: Recording, body: TaxelBody, before: Health | None, *, pressed: float, falling: bool = False
) -> tuple[Health, Tare]:
    """Return the `Health` after a tare, and the `Tare`, which has a warning where cells look touched.

    Args:
        recording: steady and untouched.
        body: the body that was recorded.
        before: earlier health, whose bad cells stay bad; None: not known.
        pressed: height above the baseline at which a cell looks pressed, in standard deviations of its noise.
        falling: readings fall under load.

    Raises:
        InputError: no readings of this body, too few frames, every cell stuck, or cells that do not keep still.
    """
    rest = _at_rest(recording, body, falling)
    noise = float(np.median(rest.noise))
    said = f"tare over {rest.frames} frames: cells rest at {np.median(rest.baseline):.3g}, with noise of {noise:.2g}"
    usual = np.median(rest.baseline) if before is None else before.baseline
    above = (-1.0 if falling else 1.0) * (rest.baseline - usual)
    scatter = 0.0 if before is not None else 14.8 * float(np.median(np.abs(above - np.median(above))))
    high = np.flatnonzero(body.usable & (above > scatter + pressed * rest.noise))
    doubt = ""
    if len(high) and len(high) < 0.5 * len(body):
        where = ", ".join(body.name(cell) for cell in high[:5].tolist())
        doubt = f"cells {where} rest high, as under a steady touch: make sure that nothing touched them"
    if before is not None:
        rest = replace(rest, dead=before.dead, stuck=before.stuck, notes=before.notes, warnings=before.warnings)
    return rest, Tare(said, doubt)


def _hysteresis(
    time: Float[np.ndarray, " n"], above: Float[np.ndarray, "n k"], noise: Float[np.ndarray, " k"]
) -> float:
    """Return the median share that remains after releases; NaN where there is none."""
    limit = 0.25 * float(above.max(initial=0.0))
    if not limit > 20 * float(np.median(noise)):
        return float("nan")
    pressed = above > limit
    later = np.searchsorted(time, time + AFTER)  # of sorted times
    found: list[float] = []
    for start, cell in np.argwhere(pressed[:-1] & ~pressed[1:]).tolist():
        end = int(later[start])
        if end < len(above) and not pressed[start + 1 : end + 1].any() and abs(time[end] - time[start] - AFTER) < AFTER:
            found.append(float(above[end, cell] / above[max(start - 5, 0) : start + 1, cell].max()))
    return float(np.median(found)) if found else float("nan")


def _stuck(baseline: Float[np.ndarray, " k"], still: Bool[np.ndarray, " k"], body: TaxelBody) -> Bool[np.ndarray, " k"]:
    """Return which cells never move and are far from the baseline of the others."""
    usual = np.median(baseline)
    spread = 1.4826 * np.median(np.abs(baseline - usual))
    far = max(10 * float(spread), 0.05 * body.top if body.bits else 0.05 * float(np.ptp(baseline)), 1e-12)
    return still & (np.abs(baseline - usual) > far)


def _dead(
    above: Float[np.ndarray, "n k"],
    noise: Float[np.ndarray, " k"],
    still: Bool[np.ndarray, " k"],
    stuck: Bool[np.ndarray, " k"],
    body: TaxelBody,
) -> Bool[np.ndarray, " k"]:
    """Return which cells are silent while both of two opposite neighbours are pressed hard."""
    above = np.where(stuck, 0.0, np.abs(above))
    hard = above > max(PRESSED * float(above.max(initial=0.0)), 10 * float(np.median(noise)))
    between = np.zeros_like(hard)
    for one, other in _opposite(body):
        both = (one >= 0) & (other >= 0)
        between[:, both] |= hard[:, one[both]] & hard[:, other[both]]
    if body.calibrated and not (body.response is None or body.response.sums):  # all neighbours bear a force
        between |= (hard[:, body.neighbours] & (body.neighbours >= 0)).any(axis=2)
    silent = above <= CLOSE * np.maximum(noise, np.median(noise))
    said_nothing = (between & silent).sum(axis=0)
    answered = (between & ~silent).sum(axis=0)
    never = above.max(axis=0) <= 2 * CLOSE * np.maximum(noise, np.median(noise))
    return ((said_nothing >= SILENT) & (answered == 0) & (never | still)) & ~stuck


def _mute(readings: Float[np.ndarray, "n k 3"]) -> Bool[np.ndarray, " k"]:
    """Return which taxels with three axes have a reading that never changes, while most others have noise."""
    changes = np.mean(np.diff(readings, axis=0) != 0, axis=0)
    return (changes == 0).any(axis=1) & (len(readings) >= STILL and np.median(changes) > 0.5)


def _pulled(above: Float[np.ndarray, "n k"], body: TaxelBody) -> Bool[np.ndarray, " k"]:
    """Return which cells fall where a neighbour is pressed, far more than they ever rise."""
    beside = np.zeros_like(above)
    for neighbour in body.neighbours.T:  # at once they would take gigabytes
        np.maximum(beside, np.where(neighbour >= 0, above[:, neighbour], 0.0), out=beside)
    top = float(above.max(initial=0.0))
    falls = np.count_nonzero((above < -PULLED * top) & (beside > BESIDE * top), axis=0)
    return (falls >= SILENT) & (above.max(axis=0, initial=0.0) < PULLED * top)


def _opposite(body: TaxelBody) -> Iterator[tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]]:
    """Yield pairs of neighbours (k,) at opposite sides of each cell; -1 where there are none."""
    beside = np.where(body.between[..., 0] < 0, body.neighbours, -1)
    for a in range(beside.shape[1]):
        for b in range(a):
            one, other = body.steps[:, a], body.steps[:, b]
            size = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
            apart = (one * other).sum(axis=1) < OPPOSITE * size
            if (apart & (beside[:, a] >= 0) & (beside[:, b] >= 0)).any():
                yield np.where(apart, beside[:, a], -1), beside[:, b]


def _unwrapped(
    cells: Float[np.ndarray, "n k"], body: TaxelBody
) -> tuple[Float[np.ndarray, "n k"], Bool[np.ndarray, " k"]]:
    """Undo the wrap of readings that fell below 0 at rest; return which cells wrapped."""
    if body.bits is None or cells.min() < 0:  # floats, or turned: rest is at the top, and falls
        return cells, np.zeros(len(body), dtype=bool)
    turn = body.top + 1.0
    noise = np.median(np.abs(np.diff(cells, axis=0)), axis=0) if len(cells) > 1 else np.zeros(len(body))
    rest = np.quantile(cells, 0.25, axis=0)
    below = (cells > WRAP * turn) & (rest <= 1.0 + 3.0 * noise)  # noise takes no other rest below 0
    if below.any():
        high = cells > 0.25 * turn
        for beside in body.neighbours.T:  # a touch presses neighbours too
            below &= ~(high[:, beside] & (beside >= 0))
    return np.where(below, cells - turn, cells), np.asarray(below.any(axis=0))


def _named(what: str, which: Bool[np.ndarray, " k"], body: TaxelBody) -> list[str]:
    found = [body.name(cell) for cell in np.flatnonzero(which).tolist()]
    if not found:
        return []
    cells = f"cell{'s' if len(found) > 1 else ''} {', '.join(found[:6])}{', ...' if len(found) > 6 else ''}"
    return [f"{len(found)} of {which.size} cells {what}: {cells}"]
