"""Find touches in contacts, which may come block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.events import Events
from palpate.contact.origins import EXPECTED, Origin, Origins
from palpate.signals.recording import LARGEST

GAP, SHORTEST = 0.05, 0.02  # s
SPEED = 0.5  # m/s
WINDOW = 0.1  # s over which points are averaged before it is asked how far they moved
NEAR = 5.0  # standard deviations that a point moves by noise at most
LATEST = 1e20  # s: beyond any clock, in nanoseconds too
LEAST = 1e-24  # m^2: below any spread of a point
STRONG = 0.8  # of the largest force: what has less does not place a touch
FAINT = 0.1  # of the heaviest window's weight: what weighs less has no say in that
BLOCK = 65_536  # contacts at a time, for the memory that they take


def find_touches(contacts: Contacts, *, gap: float = GAP, shortest: float = SHORTEST, speed: float = SPEED) -> Events:
    """Return the touches among contacts as `Events`.

    Args:
        contacts: of any sensor.
        gap: [s] between answered samples of one identity that ends a touch, if at least one sample is missing between.
        shortest: [s]; a touch that lasts less is left out.
        speed: [m/s]; a point that moves faster, and by more than 5 standard deviations, is of another touch.
    """
    finder = TouchFinder(gap=gap, shortest=shortest, speed=speed)
    for start in range(0, len(contacts), BLOCK):
        finder.add(contacts[start : start + BLOCK])
    return finder.touches()


class _Span:
    """Columns of a sample, window or touch, before its features."""

    start = 0
    end = 1
    identity = 2
    row = 3  # of the first, among all rows
    first = slice(4, 8)  # point of the first sample and the trace of its covariance; inf: may be anywhere
    last = slice(8, 12)
    peak = 12  # the largest force, and its time
    at = 13
    time = 14  # of the sample that stands for the place of all, with its columns
    point = slice(15, 18)
    normal = slice(18, 21)
    covariance = slice(21, 30)
    length = 30


_OF_LAST, _OF_PEAK = np.r_[_Span.end, _Span.last], np.r_[_Span.peak, _Span.at]
_OF_PLACE, _OF_PATH = slice(_Span.time, _Span.length), slice(_Span.time, _Span.point.stop)


class _Sum:
    """Columns of sums."""

    count = 0
    ambiguous = 1
    force = 2
    weight = 3
    weighted = slice(4, 7)  # point
    plain = slice(7, 10)  # point


class TouchFinder:
    """Finder of touches in contacts that come block by block; ten rows of sums per second and identity are kept.

    A touch ends where no sample of its identity is answered for `gap`, or where its point jumps. A point that jumps and
    is back within `gap` has not left its touch.

    Args:
        gap: [s] between answered samples of one identity that ends a touch, if at least one sample is missing between.
        shortest: [s]; a touch that lasts less is left out.
        speed: [m/s]; a point that moves faster, and by more than 5 standard deviations, is of another touch. A sample
            that is ambiguous or has no covariance may lie anywhere.
    """

    def __init__(self, *, gap: float = GAP, shortest: float = SHORTEST, speed: float = SPEED) -> None:
        self._gap, self._shortest, self._speed = gap, shortest, speed
        self._last = np.empty(0)
        self._steps: list[float] = []
        self._rows, self._features = 0, dict[str, None]()
        self._open = np.empty((0, _Span.length)), np.empty((0, _Sum.plain.stop))  # samples of the last window
        self._windows: list[tuple[np.ndarray, np.ndarray]] = []
        self._of: dict[Origin, TouchFinder] = {}  # a finder for each sensor of a robot

    def add(self, contacts: Contacts) -> None:
        """Add the next contacts; numbers whose sums would overflow, and expected contacts, are left out."""
        if contacts.origins is not None:
            self._add_of_robot(contacts, contacts.origins)
            return
        time, estimate = contacts.time, contacts.estimate
        known = np.abs(time) <= LATEST  # not NaN
        steps = np.diff(np.concatenate([self._last, time[known]]))
        if (steps > 0).any():
            self._steps.append(float(np.median(steps[steps > 0])))
        self._last = time[known][-1:]
        self._features |= dict.fromkeys(contacts.features)
        numbers = np.concatenate([estimate.point, estimate.normal, estimate.force], axis=1)
        rows = np.flatnonzero(known & estimate.answered & ~(np.abs(numbers) > LARGEST).any(axis=1))
        if len(rows):
            spans, sums = _samples(contacts[rows], tuple(self._features))
            spans[:, _Span.row] = self._rows + rows
            spans, sums = _joined([self._open[0], spans]), np.concatenate([self._open[1], sums])
            done = np.floor(spans[:, _Span.start] / WINDOW) != np.floor(self._last[0] / WINDOW)
            self._windows.append(self._windows_of(spans[done], sums[done]))
            self._open = spans[~done], sums[~done]
        self._rows += len(time)

    def _add_of_robot(self, contacts: Contacts, origins: Origins) -> None:
        expected = contacts.features.get(EXPECTED, np.zeros(0)) == 1
        for k, origin in enumerate(origins.among):
            rows: np.ndarray = np.flatnonzero(origins.index == k)
            if len(rows) and not (expected.any() and expected[rows].all()):
                settings = {"gap": self._gap, "shortest": self._shortest, "speed": self._speed}
                self._of.setdefault(origin, TouchFinder(**settings)).add(replace(contacts[rows], origins=None))

    def _windows_of(
        self, spans: Float[np.ndarray, "n s"], sums: Float[np.ndarray, "n w"]
    ) -> tuple[Float[np.ndarray, "k s"], Float[np.ndarray, "k w"]]:
        """Return the columns and sums of the windows of samples, each placed at the sample nearest to its mean."""
        order = np.argsort(spans[:, _Span.identity], kind="stable")
        spans, sums = spans[order], sums[order]
        firsts = _firsts(_changes(spans) | _parted(spans[:-1], spans[1:], self._gap, self._speed), len(spans))
        added = _added(sums, firsts)
        group = _groups(firsts, len(spans))
        away = np.sum((spans[:, _Span.point] - _place(added)[group]) ** 2, axis=1)
        return _merged(spans, firsts, np.lexsort((away, group))[firsts]), added

    def touches(self) -> Events:
        """Return the touches of all samples so far as `Events`."""
        if self._of:
            return Events.joined([each.touches().with_origin(origin) for origin, each in self._of.items()])
        parts = [*self._windows, self._windows_of(*self._open)]
        wide = np.empty((0, _Span.length + len(self._features)))  # no sample may have been answered
        spans, sums = _joined([wide, *(spans for spans, _ in parts)]), np.concatenate([sums for _, sums in parts])
        order = np.argsort(spans[:, _Span.identity], kind="stable")
        spans, sums = spans[order], sums[order]
        gap = max(self._gap, 1.5 * float(np.median(self._steps)) if self._steps else 0.0)
        ends = _parted(spans[:-1], spans[1:], gap, self._speed)
        windows = _firsts(ends | _changes(spans), len(spans))  # blocks cut some in two
        pieces = np.searchsorted(windows, _firsts(ends, len(spans)))
        spans, sums = _merged(spans, windows), _added(sums, windows)
        touch = np.repeat(_returned(_merged(spans, pieces), gap, self._speed), np.diff(pieces, append=len(spans)))
        order = np.argsort(touch, kind="stable")
        spans, sums = spans[order], sums[order]
        firsts = _firsts(np.diff(touch[order]) != 0, len(spans))
        slid, way = _reach(sums, firsts), spans[:, _OF_PATH]
        paths: list[np.ndarray] = [way[first:end] for first, end in pairwise([*firsts.tolist(), len(way)])]
        spans, sums = _merged(spans, firsts, _middles(spans, sums, firsts)), _added(sums, firsts)
        order = np.argsort(spans[:, _Span.row])
        long = order[(spans[:, _Span.end] - spans[:, _Span.start] >= self._shortest)[order]]
        return _events(spans[long], sums[long], slid[long], [paths[int(k)] for k in long], tuple(self._features))


def _firsts(ends: Bool[np.ndarray, " m"], count: int) -> Int[np.ndarray, " k"]:
    """Return the first row of each group of `count` rows; `ends` masks the rows after which a group ends."""
    return np.flatnonzero(np.concatenate([[True], ends])[:count])


def _groups(firsts: Int[np.ndarray, " k"], count: int) -> Int[np.ndarray, " n"]:
    """Return the number of each row's group."""
    return np.repeat(np.arange(len(firsts)), np.diff(firsts, append=count))


def _joined(parts: Sequence[Float[np.ndarray, "_ _"]]) -> Float[np.ndarray, "n s"]:
    """Return rows one after the other; the features that earlier ones lack are NaN."""
    joined = np.full((sum(map(len, parts)), max(part.shape[1] for part in parts)), np.nan)
    row = 0
    for part in parts:
        joined[row : row + len(part), : part.shape[1]] = part
        row += len(part)
    return joined


def _changes(spans: Float[np.ndarray, "n s"]) -> Bool[np.ndarray, " m"]:
    """Return a mask of the rows after which another window of time begins."""
    return np.diff(np.floor(spans[:, _Span.start] / WINDOW)) != 0


def _parted(
    before: Float[np.ndarray, "m s"], after: Float[np.ndarray, "m s"], gap: float, speed: float
) -> Bool[np.ndarray, " m"]:
    """Return whether each span of `after` is of another touch than that of `before`: identity, time or place."""
    took = np.abs(after[:, _Span.start] - before[:, _Span.end])
    first, last = after[:, _Span.first], before[:, _Span.last]
    moved = np.linalg.norm(first[:, :3] - last[:, :3], axis=1)
    jumped = moved > speed * took + NEAR * np.sqrt(first[:, 3] + last[:, 3])
    return (took >= gap) | jumped | (after[:, _Span.identity] != before[:, _Span.identity])


def _returned(pieces: Float[np.ndarray, "p s"], gap: float, speed: float) -> Int[np.ndarray, " p"]:
    """Return the number of each piece's touch: that of the last but one if its point is back there."""
    touch = np.arange(len(pieces))
    for k in np.flatnonzero(~_parted(pieces[:-2], pieces[2:], gap, speed)):
        touch[k + 2] = touch[k]
    return touch


def _samples(
    contacts: Contacts, features: tuple[str, ...]
) -> tuple[Float[np.ndarray, "n s"], Float[np.ndarray, "n w"]]:
    """Return the columns of each answered contact, and its terms in the sums."""
    estimate, count = contacts.estimate, len(contacts)
    strength = np.linalg.norm(estimate.force, axis=1)
    ambiguous, point = estimate.status == Status.AMBIGUOUS, estimate.point
    covariance = estimate.covariance.reshape(-1, 9)
    trace = covariance[:, ::4].sum(axis=1, where=np.abs(covariance[:, ::4]) <= LARGEST)
    known = (np.abs(covariance) <= LARGEST).all(axis=1) & (trace > LEAST)
    weight = np.where(known, 1 / np.where(known, trace, 1.0), 0.0)
    end = np.column_stack([point, np.where(known & ~ambiguous, trace, np.inf)])
    spread = np.where(known[:, None], covariance, np.nan)
    times, unknown = [contacts.time] * 2, np.full(count, np.nan)
    added = [contacts.features.get(name, unknown) for name in features]
    peak, place = [strength, contacts.time], [contacts.time, point, estimate.normal, spread]
    spans = np.column_stack([*times, contacts.identity, np.zeros(count), end, end, *peak, *place, *added])  # as `_Span`
    return spans, np.column_stack([np.ones(count), ambiguous, strength, weight, weight[:, None] * point, point])


def _merged(
    spans: Float[np.ndarray, "n s"], firsts: Int[np.ndarray, " k"], places: Int[np.ndarray, " k"] | None = None
) -> Float[np.ndarray, "k s"]:
    """Return the columns of groups of rows, which are samples or windows; `places`: where each is, or the strongest."""
    if not len(firsts):
        return spans
    order = np.lexsort((-spans[:, _Span.peak], _groups(firsts, len(spans))))
    strongest, lasts = order[firsts], np.append(firsts[1:], len(spans)) - 1
    merged = spans[firsts]
    merged[:, _OF_LAST] = spans[lasts][:, _OF_LAST]
    merged[:, _OF_PEAK] = spans[strongest][:, _OF_PEAK]
    merged[:, _Span.length :] = spans[strongest, _Span.length :]
    merged[:, _OF_PLACE] = spans[strongest if places is None else places, _OF_PLACE]
    return merged


def _added(sums: Float[np.ndarray, "n w"], firsts: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k w"]:
    return np.add.reduceat(sums, firsts, axis=0) if len(firsts) else np.empty((0, sums.shape[1]))


def _place(sums: Float[np.ndarray, "n w"]) -> Float[np.ndarray, "n 3"]:
    """Return mean points (n, 3) [m], weighted if there are weights."""
    weight, count = sums[:, _Sum.weight, None], sums[:, _Sum.count, None]
    weighed = sums[:, _Sum.weighted] / np.where(weight > 0, weight, 1.0)
    return np.where(weight > 0, weighed, sums[:, _Sum.plain] / count)


def _middles(
    spans: Float[np.ndarray, "n s"], sums: Float[np.ndarray, "n w"], firsts: Int[np.ndarray, " k"]
) -> Int[np.ndarray, " k"]:
    """Return the window of each touch whose place is nearest to the mean point of its strong windows."""
    middles = np.zeros(len(firsts), dtype=np.int64)
    for k, (first, end) in enumerate(pairwise([*firsts.tolist(), len(spans)])):
        peaks = spans[first:end, _Span.peak]
        strong = first + np.flatnonzero(peaks >= STRONG * peaks.max())
        away = spans[strong][:, _Span.point] - _place(sums[strong].sum(axis=0, keepdims=True))
        middles[k] = strong[np.argmin(np.sum(away**2, axis=1))]
    return middles


def _reach(sums: Float[np.ndarray, "n w"], firsts: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return the largest distance [m] of the mean points of windows from the first; light windows do not count."""
    place = _place(sums)
    weight = np.where(sums[:, _Sum.weight] > 0, sums[:, _Sum.weight], sums[:, _Sum.count])
    reach = np.zeros(len(firsts))
    for k, (first, end) in enumerate(pairwise([*firsts, len(sums)])):
        heavy = weight[first:end] >= FAINT * weight[first:end].max()
        clear = place[first:end][heavy]
        reach[k] = np.linalg.norm(clear - clear[0], axis=1).max()
    return reach


def _events(
    spans: Float[np.ndarray, "k s"],
    sums: Float[np.ndarray, "k w"],
    slid: Float[np.ndarray, " k"],
    paths: Sequence[Float[np.ndarray, "_ 4"]],
    names: tuple[str, ...],
) -> Events:
    count = sums[:, _Sum.count]
    return Events(
        start=spans[:, _Span.start],
        end=spans[:, _Span.end],
        point=spans[:, _Span.point],
        covariance=spans[:, _Span.covariance].reshape(-1, 3, 3),
        normal=spans[:, _Span.normal],
        peak_force=spans[:, _Span.peak],
        peak_time=spans[:, _Span.at],
        mean_force=sums[:, _Sum.force] / count,
        slid=slid,
        samples=count.astype(np.int64),
        ambiguous=sums[:, _Sum.ambiguous] / count,
        identity=spans[:, _Span.identity].astype(np.int64),
        paths=tuple(paths),
        features=dict(zip(names, spans[:, _Span.length :].T, strict=True)),
    )
