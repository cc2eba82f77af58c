"""Find pokes in a log: periods in which taxels answer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking.activations import Activations, AnswerReader, Block, later
from palpate.sensors.taxels.poking.plausibility import believed
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.signals.correlation import correlation_time
from palpate.signals.recording import ORIENTATION, POSITION, Recording
from palpate.spatial.arguments import frozen_value
from palpate.spatial.pose import Pose, rotation_from_quaternion

HELD = 0.7  # of a poke's own 90th percentile of strength: leaves the ramps out, as in `calibration.presses`
PAUSE = 0.05  # s: taxels that answer again sooner answer to the same poke
SHORTEST = 0.05  # s of a poke's steady part
SETTLE = 0.1  # s around a poke that are neither poke nor free motion: a tool may press before a taxel answers
FREE = 0.5  # s of free motion beside a poke that say what the sensor reads without it
LEAST = 5  # samples of a mean
TURNED, SHIFTED = np.radians(0.5), 2e-3  # rad, m: an arm that moves less stays
NEAREST = 3  # pokes before and behind that a rest may be taken over from
AROUND = 4  # means of free motion before and behind that one is compared with
OUTLYING = 6.0  # deviations of a mean of free motion from the others': something touched
FEW = 4  # pokes in each stretch in which the arm stays, on average, or poses are what counts
NULLS = 12  # pairs of free means from which their scatter is taken
ROWS = 1 << 12  # that are summed up at once: they stay in the processor's cache


@frozen_value(eq=True)
class PokeSearch:
    """Settings of the search for pokes.

    Args:
        threshold: above the baseline; None: found from the noise of the taxels.
        pose: constant T_sensor_link; None: the log states the poses.
        top: largest reading of a taxel.
        falling: readings fall under load.
        limits: (6,) range of the sensor [N, N m], from which on readings are ignored; None: unlimited.
        start: expected places of the taxels, which separate two pokers; None: not known.
    """

    threshold: float | None = None
    pose: Pose | None = None
    top: float = np.inf
    falling: bool = False
    limits: Float[np.ndarray, "6"] | None = None
    start: TaxelPlaces | None = None


@dataclass(frozen=True, eq=False)
class _Samples:
    """Wrenches, quaternions and positions of one log, as running sums of the known rows.

    Attributes:
        time: (n,) rising; sums: (n + 1, 16) of wrench, quaternion, position and its squares; known: (n + 1,) rows.
        wrench: (n, 6) of all rows; shift: (3,) [m] subtracted from positions.
    """

    time: Float[np.ndarray, " n"]
    sums: Float[np.ndarray, "n1 16"]
    known: Int[np.ndarray, " n1"]
    wrench: Float[np.ndarray, "n 6"]
    shift: Float[np.ndarray, "3"]

    def windows(self, spans: Float[np.ndarray, "w 2"]) -> tuple[Float[np.ndarray, "w 16"], Int[np.ndarray, " w"]]:
        """Return means over each [start, end], (w, 16), and the number of rows in each."""
        first = np.searchsorted(self.time, spans[:, 0])
        last = np.maximum(np.searchsorted(self.time, np.nextafter(spans[:, 1], np.inf)), first)
        count = self.known[last] - self.known[first]
        return (self.sums[last] - self.sums[first]) / np.maximum(count, 1)[:, None], count


def find_pokes(parts: Iterable[Recording | Block], search: PokeSearch | None = None) -> Pokes:
    """Return the `Pokes` of one log, whose wrenches and taxels have separate times on one clock.

    A poke is a period in which some taxel exceeds its baseline. Its wrench is the mean over its steady part, minus that
    of the free motion around it in the same arm configuration; the noise is that of such a difference.

    Args:
        parts: blocks with wrenches and poses of the link, both in the sensor's frame, and blocks of times [s] and
            readings of the taxels, each kind in its own order.
        search: settings; None: the defaults.

    Raises:
        InputError: nothing answers, most taxels always answer, too few frames of taxels are complete, no wrench has a
            time, a block lacks force or torque, there is no free motion before the first poke, no rest between pokes,
            no pose, no usable poke, or no time in common; or blocks or `search.start` have another number of taxels.
    """
    search = search or PokeSearch()
    samples, answers, said = _read(parts, search)
    spans, active = _stretches(answers)
    _require_sense(samples, answers, active)
    free = _free(samples, active)
    rows, kept, dropped = _measured(samples, spans, free)
    if not len(rows):
        why = ", ".join(f"{count} {what}" for what, count in dropped.items())
        raise InputError(f"none of {len(spans)} pokes can be used: {why}.", where="pokes")
    poke, frames = _of_poke(answers, kept)
    left_out = [f"{count} of {len(spans)} pokes are left out: {why}" for why, count in dropped.items()]
    pokes = Pokes(
        rows[:, :6],
        rotation_from_quaternion(rows[:, 6:10] / np.linalg.norm(rows[:, 6:10], axis=1, keepdims=True)),
        rows[:, 10:13],
        _configurations(samples, rows, kept),
        *_responses(answers, poke, frames),
        len(answers.stuck),
        _noise(samples, free, kept),
        np.ones(len(rows)),
        kept.mean(axis=1),
        answers.threshold,
        (*said, *answers.notes, *left_out),
    )
    highest = np.bincount(poke[(poke >= 0) & answers.highest], minlength=len(kept)) > 0
    return believed(pokes, start=search.start, saturated=highest)


def _read(parts: Iterable[Recording | Block], search: PokeSearch) -> tuple[_Samples, Activations, list[str]]:
    """Read all wrenches, but only the answers of frames, which do not fit in memory."""
    reader = AnswerReader(search.threshold, top=search.top, falling=search.falling)
    wrenches = list[tuple[np.ndarray, ...]]()
    for part in parts:
        if isinstance(part, Recording):
            wrenches.append((part.time, part.wrenches(), *_poses(part, search.pose)))
        else:
            reader.take(*part)
    samples, said = _samples(wrenches, search.limits)
    return samples, reader.finish(), said


def _samples(
    parts: Sequence[tuple[np.ndarray, ...]], limits: Float[np.ndarray, "6"] | None
) -> tuple[_Samples, list[str]]:
    """Join blocks of times, wrenches, quaternions and positions, without rows that run back in time."""
    columns = [np.concatenate(each) for each in zip(*parts, strict=True)] or 4 * [np.zeros(0)]
    good, said = later(columns[0]), list[str]()
    if not good.all():
        back = np.count_nonzero(~good)
        said.append(
            f"{back} wrenches are not later than those before them, and are left out: check whether the clock jumped"
        )
        columns = [each[good] for each in columns]
    time, wrench, quaternion, position = columns
    if not len(time):
        raise InputError("the log must have at least one wrench with a time.", where="wrenches")
    if limits is not None:
        wrench = np.where((np.abs(wrench) >= limits).any(axis=1, keepdims=True), np.nan, wrench)
    quaternion = _aligned(quaternion)
    shift = np.nanmean(position, axis=0) if np.isfinite(position).any() else np.zeros(3)
    sums, known = np.zeros((len(time) + 1, 16)), np.zeros(len(time) + 1, dtype=np.int64)
    for start in range(0, len(time), ROWS):
        rows, after = slice(start, start + ROWS), slice(start + 1, start + 1 + ROWS)
        away = position[rows] - shift
        table = np.concatenate([wrench[rows], quaternion[rows], away, away**2], axis=1)
        sound = np.isfinite(table).all(axis=1)
        table[~sound] = 0.0
        table[0] += sums[start]
        np.cumsum(table, axis=0, out=sums[after])
        known[after] = known[start] + np.cumsum(sound)
    return _Samples(time, sums, known, wrench, shift), said


def _poses(block: Recording, pose: Pose | None) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3"]]:
    if pose is not None:
        count = len(block)
        return np.tile(pose.quaternion(), (count, 1)), np.tile(pose.translation, (count, 1))
    if ORIENTATION not in block.channels or POSITION not in block.channels:
        raise InputError(
            "does not state the pose of the link in the sensor's frame.",
            where=block.source,
            hint="Write in the rig's [pokes] either sensor and link (frames of /tf, or links of a urdf), or columns "
            "and position, or a topic, or a constant pose.",
        )
    return block.channels[ORIENTATION], block.channels[POSITION]


def _aligned(quaternion: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Return quaternions with signs by which each is near to the one before."""
    known = np.flatnonzero(np.isfinite(quaternion).all(axis=1))
    turned = (quaternion[known[1:]] * quaternion[known[:-1]]).sum(axis=1) < 0
    sign = np.ones(len(quaternion))
    sign[known[1:]] = np.cumprod(np.where(turned, -1.0, 1.0))
    return quaternion * sign[:, None]


def _stretches(answers: Activations) -> tuple[Float[np.ndarray, "p 2"], Float[np.ndarray, "q 2"]]:
    """Return start and end [s] of the steady part of each poke, and of each period in which a taxel answers."""
    time = answers.time
    strength = np.bincount(answers.frame, answers.above, minlength=len(time))
    on = np.flatnonzero(strength > 0)
    if not len(on):
        raise InputError(
            f"no taxel ever answers: all readings are within {answers.threshold:.3g} of their rest.",
            where="frames",
            hint="Write a lower threshold in the rig's [pokes], if the taxels were touched.",
        )
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    apart = np.diff(time[on]) > max(PAUSE, 1.5 * step)
    first, last = on[np.r_[True, apart]], on[np.r_[apart, True]]
    active = np.column_stack([time[first], time[last]])
    rows, owner, ends = _runs(first, last)
    held = strength[rows] >= HELD * _most(strength[rows], owner, ends)[owner]
    begin = np.minimum.reduceat(np.where(held, rows, len(time)), ends[:-1])
    end = np.maximum.reduceat(np.where(held, rows, -1), ends[:-1])
    long = (time[end] - time[begin] >= SHORTEST) & (end > begin)
    return np.column_stack([time[begin], time[end]])[long], active


def _runs(
    first: Int[np.ndarray, " p"], last: Int[np.ndarray, " p"]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"], Int[np.ndarray, " p1"]]:
    """Return all integers from first to last of each run, the run of each, and the bounds of the runs."""
    ends: Int[np.ndarray, " p1"] = np.concatenate([[0], np.cumsum(last - first + 1)])
    owner: Int[np.ndarray, " n"] = np.repeat(np.arange(len(first)), np.diff(ends))
    rows: Int[np.ndarray, " n"] = np.arange(int(ends[-1])) + (first - ends[:-1])[owner]
    return rows, owner, ends


def _most(
    values: Float[np.ndarray, " n"], owner: Int[np.ndarray, " n"], ends: Int[np.ndarray, " p1"]
) -> Float[np.ndarray, " p"]:
    """Return the 90th percentile of each run, as NumPy defines it."""
    ordered = values[np.lexsort((values, owner))]
    most = np.diff(ends) - 1
    low = (0.9 * most).astype(np.int64)
    under, over = ordered[ends[:-1] + low], ordered[ends[:-1] + np.minimum(low + 1, most)]
    return under + (0.9 * most - low) * (over - under)


def _require_sense(samples: _Samples, answers: Activations, active: Float[np.ndarray, "q 2"]) -> None:
    """Raise an InputError unless wrenches and taxels share a time, poses are known, and nothing is touched at first."""
    begin, end = samples.time[0], samples.time[-1]
    if answers.time[-1] < begin or end < answers.time[0]:
        raise InputError(
            f"wrenches ({begin:.3f} to {end:.3f} s) and taxels ({answers.time[0]:.3f} to {answers.time[-1]:.3f} s) "
            "have no time in common.",
            where="time",
        )
    if not np.count_nonzero(np.diff(samples.known)):
        raise InputError(
            "no wrench has a pose of the link in the sensor's frame at its time.",
            where="pokes",
            hint="Check that all joints of the urdf between sensor and link are in the log, or both frames in /tf.",
        )
    first = active[0, 0] - max(answers.time[0], begin)
    if first < SETTLE + PAUSE:
        raise InputError(
            f"there is no free motion before the first poke: a taxel answers {max(first, 0.0):.2g} s after the log "
            "begins, so the untouched reading of the sensor is not known.",
            where="pokes",
            hint=f"Record at least {SETTLE + FREE:g} s in which nothing touches.",
        )


@dataclass(frozen=True, eq=False)
class _Free:
    """Means over free motion: (w,) time [s] of each, its rows, samples, gap between pokes, and start and end [s]."""

    time: Float[np.ndarray, " w"]
    mean: Float[np.ndarray, "w 16"]
    count: Int[np.ndarray, " w"]
    gap: Int[np.ndarray, " w"]
    ends: Float[np.ndarray, "w 2"]


def _free(samples: _Samples, active: Float[np.ndarray, "q 2"]) -> _Free:
    """Return means at both ends of every gap between answers."""
    starts = np.concatenate([[samples.time[0] - SETTLE], active[:, 1]]) + SETTLE
    ends = np.concatenate([active[:, 0], [samples.time[-1] + SETTLE]]) - SETTLE
    long = ends - starts > 2 * FREE
    first = np.column_stack([starts, np.where(long, starts + FREE, ends)])
    second = np.column_stack([ends - FREE, ends])
    gap = np.concatenate([np.arange(len(starts)), np.flatnonzero(long)])
    order = np.argsort(gap, kind="stable")
    gap, spans = gap[order], np.concatenate([first, second[long]])[order]
    mean, count = samples.windows(spans)
    good = (count >= LEAST) & (spans[:, 1] > spans[:, 0]) & (_spread(mean) <= 1.0)
    if not good.any():
        raise InputError(
            "the arm never stays still and untouched between pokes.",
            where="pokes",
            hint=f"Record pauses of {FREE:g} s between pokes, in which nothing touches and the arm rests.",
        )
    return _untouched(_Free(spans[good].mean(axis=1), mean[good], count[good], gap[good], spans[good]))


def _untouched(free: _Free) -> _Free:
    """Remove outlying means, in which something touched although no taxel answered."""
    about, there = _around(np.arange(len(free.time)), range(-AROUND, AROUND + 1), len(free.time))
    same = there & (_apart(free.mean[about], free.mean[:, None]) <= 1.0)
    ordered = np.sort(np.where(same[..., None], free.mean[about, :3], np.inf), axis=1)
    count, row = same.sum(axis=1), np.arange(len(about))
    median = (ordered[row, (count - 1) // 2] + ordered[row, count // 2]) / 2.0
    off = np.linalg.norm(free.mean[:, :3] - median, axis=1)
    usual = 1.4826 * float(np.median(off[off > 0])) if (off > 0).any() else 0.0
    kept = off <= max(OUTLYING * usual, 1e-9)
    return _Free(*(each[kept] for each in vars(free).values()))


def _around(
    at: Int[np.ndarray, " n"], steps: range, count: int
) -> tuple[Int[np.ndarray, "n s"], Bool[np.ndarray, "n s"]]:
    """Return entries at some steps from others, of `count` in all, and whether these exist."""
    about = at[:, None] + np.array(steps)
    return np.clip(about, 0, count - 1), (about >= 0) & (about < count)


def _spread(mean: Float[np.ndarray, "n 16"]) -> Float[np.ndarray, " n"]:
    """Return the link's motion within each mean, rms, relative to the limit of a constant pose."""
    turned = np.sqrt(8.0 * np.maximum(1.0 - np.linalg.norm(mean[:, 6:10], axis=1), 0.0))
    shifted = np.sqrt(np.maximum((mean[:, 13:16] - mean[:, 10:13] ** 2).sum(axis=1), 0.0))
    return np.maximum(turned / TURNED, shifted / SHIFTED)


def _apart(one: Float[np.ndarray, "*n 16"], other: Float[np.ndarray, "*m 16"]) -> Float[np.ndarray, "*k"]:
    """Return the distance between poses, relative to the limit of a constant pose."""
    both = np.abs((one[..., 6:10] * other[..., 6:10]).sum(axis=-1))
    cosine = both / np.linalg.norm(one[..., 6:10], axis=-1) / np.linalg.norm(other[..., 6:10], axis=-1)
    turned = 2.0 * np.arccos(np.clip(cosine, 0.0, 1.0))
    shifted = np.linalg.norm(one[..., 10:13] - other[..., 10:13], axis=-1)
    return np.maximum(turned / TURNED, shifted / SHIFTED)


def _measured(
    samples: _Samples, spans: Float[np.ndarray, "p 2"], free: _Free
) -> tuple[Float[np.ndarray, "n 16"], Float[np.ndarray, "n 2"], dict[str, int]]:
    """Return usable pokes' means minus the free reading, start and end [s] of each, and counts of others by reason."""
    step = float(np.median(np.diff(samples.time))) if len(samples.time) > 1 else 0.0
    means, counts = samples.windows(spans)
    lacking = counts < np.maximum(LEAST, 0.5 * np.diff(spans, axis=1)[:, 0] / max(step, 1e-9))
    moving = ~lacking & (_spread(means) > 1.0)
    rows, kept = (each[~(lacking | moving)] for each in (means, spans))
    rest = _rests(free, rows, kept.mean(axis=1))
    known = np.isfinite(rest).all(axis=1)
    why = {"the arm moves": moving, "no wrench or pose": lacking, "no free motion in this configuration": ~known}
    rows[:, :6] -= rest
    rows[:, 10:13] += samples.shift
    return rows[known], kept[known], {what: int(which.sum()) for what, which in why.items() if which.any()}


def _rests(free: _Free, means: Float[np.ndarray, "n 16"], time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 6"]:
    """Return the free reading (n, 6), linear between before and after in the same pose, or NaN."""
    reach = 2 * NEAREST
    about, there = _around(np.searchsorted(free.time, time), range(-reach, reach), len(free.time))
    same = there & (_apart(free.mean[about], means[:, None]) <= 1.0)
    before, after = same[:, :reach].any(axis=1), same[:, reach:].any(axis=1)
    row = np.arange(len(means))
    one = about[row, reach - 1 - np.argmax(same[:, reach - 1 :: -1], axis=1)]
    other = about[row, reach + np.argmax(same[:, reach:], axis=1)]
    one, other = np.where(before, one, other), np.where(after, other, one)
    share = (time - free.time[one]) / np.maximum(free.time[other] - free.time[one], 1e-9)
    share = np.where(before & after, share, 0.0)[:, None]
    rest = (1.0 - share) * free.mean[one, :6] + share * free.mean[other, :6]
    found = np.asarray(before | after, dtype=bool)
    return np.where(found[:, None], rest, np.nan)


def _noise(samples: _Samples, free: _Free, spans: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "6 6"]:
    """Return the covariance of a poke's wrench, from means over as many samples of free motion.

    var = S tau (1/n + 1/(2 n_f)), S of one sample and tau its correlation time, n samples of a poke and n_f of each
    free mean; more where free means of one gap differ by more.
    """
    ends = np.searchsorted(samples.time, free.ends)
    longest = np.argsort(np.diff(ends, axis=1)[:, 0])[-64:]
    pieces = [samples.wrench[slice(*ends[k])] for k in longest.tolist()]
    pieces = [piece[np.isfinite(piece).all(axis=1)] for piece in pieces]
    pieces = [piece - piece.mean(axis=0) for piece in pieces if len(piece) >= LEAST]
    pieces = sorted(pieces, key=lambda piece: float(piece.var(axis=0)[:3].sum()))[: len(pieces) // 2 + 1]  # no motion
    freedom = max(sum(len(piece) - 1 for piece in pieces), 1)
    single = sum((piece.T @ piece for piece in pieces), np.zeros((6, 6))) / freedom
    tau = float(np.median([correlation_time(piece).mean() for piece in pieces])) if pieces else 1.0
    counts = np.diff(np.searchsorted(samples.time, spans), axis=1)
    usual, beside = float(np.median(np.maximum(counts, 1))), float(np.median(free.count))
    scale = 1.0
    pairs = np.flatnonzero(np.diff(free.gap) == 0)
    if len(pairs) >= NULLS:
        seen = np.median((free.mean[pairs + 1, :6] - free.mean[pairs, :6]) ** 2, axis=0) / 0.455  # of a chi-square of 1
        told = 2.0 * np.diag(single) * tau / beside
        scale = max(1.0, float(np.mean(seen / np.maximum(told, 1e-300))))
    floor = 1e-12 * np.diag([1.0, 1.0, 1.0, 1e-2, 1e-2, 1e-2])
    return single * tau * scale * (1.0 / usual + 0.5 / beside) + floor


def _responses(
    answers: Activations, poke: Int[np.ndarray, " m"], frames: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n1"], Int[np.ndarray, " j"], Float[np.ndarray, " j"]]:
    """Return starts, taxels and mean responses of taxels that answer in at least half of the frames."""
    taxels = len(answers.stuck)
    inside = poke >= 0
    key = poke[inside] * taxels + answers.taxel[inside]
    pairs, where = np.unique(key, return_inverse=True)
    count = np.bincount(where, minlength=len(pairs))
    mean = np.bincount(where, answers.above[inside], minlength=len(pairs)) / np.maximum(count, 1)
    kept = 2 * count >= frames[pairs // taxels]
    which, taxel = np.divmod(pairs[kept], taxels)
    return np.searchsorted(which, np.arange(len(frames) + 1)), taxel, mean[kept]


def _configurations(
    samples: _Samples, rows: Float[np.ndarray, "n 16"], spans: Float[np.ndarray, "n 2"]
) -> Int[np.ndarray, " n"]:
    """Return the configuration of each poke: a new one whenever the arm moved, or, if it always does, by poses."""
    moved = np.zeros(len(rows), dtype=bool)
    between, count = samples.windows(np.column_stack([spans[:-1, 1], spans[1:, 0]]))
    moved[1:] = (_apart(rows[1:], rows[:-1]) > 1.0) | ((count > 0) & (_spread(between) > 1.0))
    if np.count_nonzero(moved) + 1 <= max(len(rows) / FEW, 1):
        return np.cumsum(moved)
    configuration = np.full(len(rows), -1)
    while len(left := np.flatnonzero(configuration < 0)):
        same = _apart(rows[left], rows[left[0]]) <= 1.0
        configuration[left[same]] = configuration.max() + 1
    return configuration


def _of_poke(
    answers: Activations, spans: Float[np.ndarray, "n 2"]
) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " n"]]:
    """Return the poke in whose steady part each answer is, -1: none, and the number of frames of each."""
    ends = np.searchsorted(answers.time, spans)
    ends[:, 1] = np.searchsorted(answers.time, spans[:, 1], side="right")
    number = np.full(len(answers.time), -1)
    for k, (first, last) in enumerate(ends.tolist()):
        number[first:last] = k
    return number[answers.frame], np.diff(ends, axis=1)[:, 0]
