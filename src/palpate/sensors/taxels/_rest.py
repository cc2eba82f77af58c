"""Compiled: follow what cells read at rest, where it drifts, jumps, or does not return after a touch."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import uncounted

# numbers of a cell: constants, state after the last frame (baseline, reading, last finite one), and work space
NOISE, LIMIT, LAST, HELD, Z, SPREAD = 0, 1, 2, 3, 4, 5
ERROR, USED, OWN, VARIANCE, AT, PEAK, FADED = 6, 7, 8, 9, 10, 12, 13
# of taxels with three axes, along both tangents: baseline (behind the normal one, which all have), its noise, and the
# load (before the normal one); and the loads of before, along the tangents and into the body, that readings follow late
BASELINE, SIDEWAYS, ROUGH, LOAD, FORCE, SLOW, NUMBERS = 14, 15, 17, 19, 21, 22, 25
# and integers: the same; its present turns around the range, and the number of times it wrapped; the window in which
# it was last touched
GOOD, CURVE, TURNS, WRAPPED, LABEL, LIVE, CELLS, PARENT, TOUCHED, WHOLE = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
# numbers of the skin: time of the last frame, frames without use, frames of a new zero so far (0: none is taken), zeros
# that jumped and the time of the last, share of cells above rest less those below in the last frame, largest share of a
# touch that remained and its cell
LATEST, UNUSED, STILL, JUMPS, JUMPED, SIDE, REMAINS, WHERE = 0, 1, 2, 3, 4, 5, 6, 7
# frames far below rest without a touch, frames with a touch, cells whose touch has not faded yet; of taxels with
# three axes areas that are pressed hard, and the sum of the logarithms of their mean squares of misfits
FALLEN, TOUCHES, FADING, HARD, MISFITS, CLOCK = 8, 9, 10, 11, 12, 13
_SETTLES = 10  # frames without motion whose mean is a new zero
_BOTH, _MOST = 0.2, 0.75  # of the cells above rest and as many below, and off it in all: no touch does that
_ALL, _NONE = 0.9, 0.1  # of the cells that step together in one frame, and that were off their rest before it
_EQUAL = 0.2  # of their mean by which these steps differ
_DEEP = 3.0  # thresholds of a touch below rest at which readings may fall under load
_REMAINDER = 0.1  # of a touch's peak, which is no touch any more
_FADES = 0.2  # s for which it must remain
RECOVERS = 0.5  # s in which the baseline follows it
# of a baseline that a Kalman filter follows, as `contact.drift_tracker` does for wrenches
WINDOW = 0.1  # s whose mean is taken
DELAY = 10  # windows to wait for a touch that shows late
AFTER = 5  # windows after a touch that are not used
SLOTS = DELAY + 1
NEVER = -(1 << 60)
_HELD = 4.0  # standard deviations above the baseline beyond which a window has a touch below the thresholds


@uncounted
def enter_window(time, walk, sign, zeros, numbers, whole):
    """Start a new window: add the random walk to all variances, and use windows now known to be untouched."""
    sums, slots, clock = zeros
    now = np.floor(time / WINDOW)
    if now == clock[0] or np.isnan(time):
        return
    passed = time - clock[1] if clock[1] == clock[1] else 0.0
    if passed < 0.0:
        slots[:, 1] = 0.0  # time runs back: what waited is of no use
    variance = numbers[VARIANCE]
    for k in range(sums.shape[1]):
        variance[k] += walk * walk * max(passed, 0.0)
    clock[0], clock[1] = now, time
    waiting, frames = numbers[OWN], 0.0
    waiting[:] = 0.0
    for i in range(SLOTS):
        if slots[i, 1] > 0.0:
            waiting += sums[i]
            frames += slots[i, 1]
    waiting /= max(frames, 1.0)
    for step in range(1, SLOTS + 1):
        i = (int(now) + step) % SLOTS
        if slots[i, 1] > 0.0 and slots[i, 0] <= now - DELAY:
            _take_in(time, walk, sign, sums[i], slots[i], frames, numbers, whole)
    i = int(now) % SLOTS
    slots[i, 0], slots[i, 1], slots[i, 2] = now, 0.0, 0.0
    sums[i] = 0.0


@uncounted
def _take_in(time, walk, sign, total, slot, frames, numbers, whole):
    """Update the baseline of each cell untouched about a window by its mean: a Kalman filter of a random walk.

    Variances are those of now, the mean is that of a second ago: the walk lies between them. The mean of all `frames`
    that wait, in numbers[OWN], reveals a touch below the thresholds.
    """
    baseline, noise, variance, waiting = numbers[BASELINE], numbers[NOISE], numbers[VARIANCE], numbers[OWN]
    good, touched, count = whole[GOOD], whole[TOUCHED], slot[1]
    since = walk * walk * max(time - slot[2] / count, 0.0)
    for k in range(len(total)):
        if not good[k] or touched[k] > slot[0] - AFTER:
            continue
        before, reads = max(variance[k] - since, 0.0), noise[k] * noise[k] / count
        off = total[k] / count - baseline[k]
        if sign * (waiting[k] - baseline[k]) > _HELD * np.sqrt(variance[k] + noise[k] * noise[k] / frames):
            continue
        gain = before / (before + reads)
        baseline[k] += gain * off
        variance[k] = (1.0 - gain) * before + since
    slot[1] = 0.0


@uncounted
def keep_window(time, value, zeros, whole):
    """Add a frame to its window, and mark cells that were touched in it or were on the rim of a touch."""
    sums, slots, _ = zeros
    if np.isnan(time):
        return
    now = int(np.floor(time / WINDOW))
    label, live, touched = whole[LABEL], whole[LIVE], whole[TOUCHED]
    i = now % SLOTS
    for k in range(len(value)):
        sums[i, k] += value[k]
        if label[k] != 0 or not live[k]:
            touched[k] = now
    slots[i, 1] += 1.0
    slots[i, 2] += time


@uncounted
def moves(z, live, on, off, value, bulges, numbers, clock):
    """Return whether the zero of all cells has jumped, or moves on while a new one is taken.

    A touch takes no cell below its rest, unless the skin `bulges`, as taxels with three axes show. A zero jumps where
    many cells are above and many below (a magnetic skin that turned in the earth's field), or where nearly all are off
    by the same within one frame.
    """
    above, below, count = 0, 0, len(z)
    for k in range(count):
        above += z[k] > off
        below += z[k] < -off
    before, clock[SIDE] = clock[SIDE], (above - below) / count
    if clock[STILL] == 0.0 and below < 2 and above <= _ALL * count:
        return False
    far, deep = 0, 0
    for k in range(count):
        far += abs(z[k]) > on
        deep += z[k] < -_DEEP * on
    clock[FALLEN] += deep > 1 and above == 0 and not bulges
    if clock[STILL] > 0.0:
        return far > _NONE * count
    if not bulges and min(above, below) > _BOTH * count and above + below > _MOST * count:
        return True
    stepped = abs(before) < _NONE and abs(clock[SIDE]) > _ALL and far > _ALL * count
    return stepped and _equal(live, value, numbers)


@uncounted
def _equal(live, value, numbers):
    """Return whether all cells are off their rest by nearly the same."""
    count, mean, square, noise = 0, 0.0, 0.0, 0.0
    for k in range(len(value)):
        if live[k]:
            away = value[k] - numbers[BASELINE, k]
            count, mean, square = count + 1, mean + away, square + away * away
            noise += numbers[NOISE, k] * numbers[NOISE, k]
    mean /= max(count, 1)
    return square - count * mean * mean < 4.0 * noise + count * (_EQUAL * mean) ** 2


@uncounted
def least(on, off, peak):
    """Return the height at which a touch begins, which exceeds the remainder of one that is over, with its noise."""
    return on if peak >= 0.0 else max(on, off - _REMAINDER * peak)


@uncounted
def settle(time, moves, value, sideways, zeros, numbers, whole, clock):
    """Take the mean of the frames since the cells keep still as their new baseline."""
    if clock[STILL] == 0.0:
        clock[JUMPS] += 1.0
        clock[JUMPED] = time
    clock[STILL] = 1.0 if moves else clock[STILL] + 1.0
    baseline, noise = numbers[BASELINE], numbers[NOISE]
    for k in range(len(value)):
        baseline[k] += (value[k] - baseline[k]) / clock[STILL]
        for a in range(2 if len(sideways) > 0 else 0):
            numbers[SIDEWAYS + a, k] += (sideways[a * len(value) + k] - numbers[SIDEWAYS + a, k]) / clock[STILL]
        if numbers[VARIANCE, k] > 0.0:
            numbers[VARIANCE, k] = noise[k] * noise[k] / clock[STILL]
    numbers[FORCE], numbers[PEAK], whole[LABEL] = 0.0, 0.0, 0
    numbers[SLOW : SLOW + 3] = 0.0
    zeros[1][:, 1] = 0.0  # windows that wait are of the old zero
    if clock[STILL] == _SETTLES:
        clock[STILL], clock[SIDE] = 0.0, 0.0


@uncounted
def fade(cells, count, passed, off, z, numbers, label):
    """Note the peak of each cell of an area; return whether the area is only what remains of a touch, and unmark it.

    Little of the peak is there, and it has been so for a while, or the touch had ended before.
    """
    peak, faded = numbers[PEAK], numbers[FADED]
    strongest, before, over = 0.0, 0.0, False
    for i in range(count):
        k = cells[i]
        strongest, before = max(strongest, z[k]), max(before, abs(peak[k]))
        over = over or peak[k] < 0.0 or faded[k] > _FADES
    fades = strongest < off + _REMAINDER * before
    for i in range(count):
        k = cells[i]
        if fades and over:
            peak[k], label[k] = -before, 0
        else:
            peak[k], faded[k] = max(abs(peak[k]), z[k]), faded[k] + passed if fades else 0.0
    return fades and over


@uncounted
def recover(passed, off, recovers, value, sideways, numbers, whole, clock):
    """Let baselines quickly follow what remains of touches that ended, until it is mostly below `off`."""
    baseline, z, peak, faded = numbers[BASELINE], numbers[Z], numbers[PEAK], numbers[FADED]
    label, live, touched, ended = whole[LABEL], whole[LIVE], 0, 0
    for k in range(len(value)):
        touched += peak[k] != 0.0
        ended += (peak[k] != 0.0) & (label[k] == 0)
    clock[FADING] = touched
    if ended == 0:
        return
    for k in range(len(value)):
        if peak[k] == 0.0 or label[k] != 0 or not live[k]:
            continue
        peak[k] = -abs(peak[k])
        faded[k] += passed if z[k] > off else -passed
        if faded[k] < -_FADES:
            peak[k], faded[k] = 0.0, 0.0
        elif faded[k] > _FADES:
            faded[k] = min(faded[k], 2.0 * _FADES)
            baseline[k] += recovers * (value[k] - baseline[k])
            for a in range(2 if len(sideways) > 0 else 0):
                numbers[SIDEWAYS + a, k] += recovers * numbers[LOAD + a, k]
            share = -z[k] / peak[k]
            if clock[REMAINS] < share < _REMAINDER:
                clock[REMAINS], clock[WHERE] = share, k
