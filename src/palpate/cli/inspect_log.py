"""Inspect a log or a file of contacts of any length: counts and ranges of all of it, medians of a share of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.cli.inspect_images import image_layouts, image_topics, inspect_images
from palpate.console.console import Quantity, counting, lines, note, part, progress, shares, span, table, title
from palpate.contact.estimate import Status
from palpate.errors import InputError
from palpate.files.contacts import contact_blocks, unfinished
from palpate.files.logs import LogContents, contents, join, open_log
from palpate.files.logs.decoding import role
from palpate.files.logs.image_messages import IMAGES
from palpate.files.logs.opening import messages_of
from palpate.files.messages import Topic
from palpate.files.models import read_provenance
from palpate.setup import Rig
from palpate.setup.guess import topics_of
from palpate.setup.kinds import KINDS
from palpate.setup.makers import named_pose
from palpate.setup.new import guess_sensor
from palpate.setup.setup import Setup
from palpate.signals.noise import estimate_noise
from palpate.signals.recording import FORCE, ORIENTATION, POSITION, TORQUE, Recording
from palpate.viewer.report import percent
from palpate.viewer.samples import median

_UNITS = {FORCE: "N", TORQUE: "N m", "voltage": "V"}
_MOST = 40  # rows of a table of channels: where there are more, as in a frame, one row stands for all


def inspect_log(
    file: Path, rig: Rig | None, sensor: str | None = None, topic: str | None = None
) -> tuple[Recording | None, bool]:
    """Print figures of a log; where it has several wrenches and none is named, of each.

    Args:
        file: the log.
        rig: rig with its layout; None: guessed from its names.
        sensor: name of the sensor in the rig.
        topic: topic of the sensor's readings.

    Returns:
        (kept, torn): an excerpt of the first sensor's readings, None for images or no recognised sensor; whether the
        log is cut off.

    Raises:
        InputError: the log cannot be read, or the rig, `topic` or `sensor` does not fit it.
    """
    title(f"{file}: a log")
    there = contents(file)
    if there.images is not None and topic is not None:
        raise InputError("has no topics.", where=str(file), hint="Leave --topic out.")
    say_contents(there)
    of_wrenches = sensor is None or (sensor in KINDS and KINDS[sensor].channels == (FORCE, TORQUE))
    wrenches = topics_of(there, "wrench") if rig is None and topic is None and of_wrenches else []
    images = image_topics(there) if wrenches else []
    note([f"there are images on {', '.join(images)}: inspect them with --topic NAME"] if images else [])
    if len(wrenches) < 2:
        return inspect_readings(file, there, rig, sensor, topic)
    found: list[tuple[Recording | None, bool]] = []
    for each in wrenches:
        part(each)
        found.append(inspect_readings(file, there, rig, sensor, each))
    return found[0]


def inspect_readings(
    file: Path, there: LogContents, rig: Rig | None, sensor: str | None, topic: str | None
) -> tuple[Recording | None, bool]:
    """Print figures of one sensor's readings; arguments and results are those of `inspect_log`.

    Raises:
        InputError: the log cannot be read, or the rig, `topic` or `sensor` does not fit it.
    """
    remarks: tuple[str, ...] = ()
    setup: Setup | None = None
    if rig is not None:
        from palpate.setup.pipeline import open_log as open_rig_log  # here: a log alone needs nothing of it

        log = open_rig_log(file, rig, sensor, topic)
        kind, blocks, setup = log.kind, iter(log), log.setup
        if (layout := log.setup.layout()).images is not None:
            return None, inspect_images(file, there, [layout])
    else:
        unread = {each.name for each in there.topics if each.kind in IMAGES and not role(each.kind)}
        found = None if topic in unread else guess_sensor(file, sensor=sensor, topic=topic)
        if found is None and (layouts := image_layouts(there, topic)):
            return None, inspect_images(file, there, layouts)
        if found is None:
            note(["it has no recognisable wrenches, voltages of load cells, frames of taxels or images"])
            return None, False
        kind, guess = found
        remarks = guess.remarks
        log = open_log(file, guess.layout)
        blocks = log.blocks()
        lines([("taken for", f"{kind.called}: {guess.why}"), *([("frame", guess.frame)] if guess.frame else [])])
        if guess.layout.images is not None:
            return None, inspect_images(file, there, [guess.layout])
        note(([f"{guess.lacking}: `palpate rig new LOG --rate HZ`"] if guess.lacking else []), kind="check")
    excerpt, ranges = Excerpt(), _Ranges(kind.channels)
    try:
        with counting():
            for block in blocks:
                excerpt.add(block)
                ranges.add(block)
                progress(ranges.count, log.position / max(log.size, 1))
    except InputError as problem:
        if there.names or there.images is not None or excerpt.count:
            raise
        note([str(problem)])  # which topic or frame is meant is for a rig to say
        return None, bool(log.torn)
    kept = excerpt.recording()
    _say_samples(kept, ranges, there)
    _say_ranges(kept, ranges)
    note(() if setup is None else kind.warnings(setup, kept), kind="warning")
    if rig is not None and rig.surface is not None and (bounds := _proposed_bounds(file, rig, sensor)):
        lines([("bounds", bounds)])
    if excerpt.stride > 1:
        note([f"step, medians and noise are from one sample in {excerpt.stride}, all other figures from every sample"])
    note([f"torn: {log.torn}"] if log.torn else [], kind="warning")
    note(remarks, kind="check")
    note(log.notes())
    return kept, bool(log.torn)


def _proposed_bounds(file: Path, rig: Rig, sensor: str | None) -> str:
    """Return bounds of friction and torsion that the start of a log suggests, or ""."""
    from palpate.setup.pipeline import HEAD, Pipeline
    from palpate.setup.pipeline import open_log as open_rig_log

    with open_rig_log(file, rig, sensor) as log:
        pipeline, done = Pipeline.of(log), 0
        for block, _, _ in pipeline.stream():
            done += len(block)
            if done >= HEAD:
                break
        return pipeline.proposed_bounds()


class _Ranges:
    """Count, first and last time, and of each number the extremes and how often it is missing."""

    def __init__(self, channels: tuple[str, ...]) -> None:
        self.channels = channels
        self.count, self.ends = 0, np.empty(0)
        self.missing, self.least, self.most = np.array(0), np.array(np.inf), np.array(-np.inf)

    def add(self, block: Recording) -> None:
        """Add the next samples."""
        values = _flat(block, self.channels)
        self.count += len(values)
        self.missing = self.missing + np.count_nonzero(np.isnan(values), axis=0)
        self.least = np.fmin(self.least, np.fmin.reduce(values, axis=0, initial=np.inf))
        self.most = np.fmax(self.most, np.fmax.reduce(values, axis=0, initial=-np.inf))
        self.ends = _reached(self.ends, block.time)


def _flat(block: Recording, channels: tuple[str, ...]) -> np.ndarray:
    if channels == (FORCE, TORQUE):
        return block.wrenches()
    return np.concatenate([block.channels[name].reshape(len(block), -1) for name in channels], axis=1)


def _labels(block: Recording, channels: tuple[str, ...]) -> list[str]:
    named: list[str] = []
    for channel in channels:
        numbered = [f"{channel} {k + 1}" for k in range(block.channels[channel][:1].size)]
        names = [f"{channel[0]}{axis}" for axis in "xyz"] if channel in (FORCE, TORQUE) else numbered
        named += [f"{name} [{_UNITS[channel]}]" if channel in _UNITS else name for name in names]
    return named


def say_contents(there: LogContents) -> None:
    """Print which topics or columns there are."""
    if there.topics:
        rate = _rates(there)
        table(
            ("topic", "type", "messages", "rate [Hz]"),
            [(t.name, t.kind, f"{t.count:,}", rate(t)) for t in there.topics],
        )
    elif there.images is None:
        names = list(there.names)
        shown = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
        lines([("columns", f"{len(names)}: {shown}")])
        lines([("written", there.written)] if there.written else [])


def _rates(there: LogContents) -> Callable[[Topic], str]:
    """Return a function of a topic that gives its rate as text.

    It is the mean, or that of the median step where the log states no duration.
    """
    if there.duration > 0:
        return lambda topic: f"{(topic.count - 1) / there.duration:.4g}" if topic.count > 1 else "-"
    if (source := messages_of(there.path)) is None:
        return lambda _: "-"
    times = {topic.name: [np.empty(0, dtype=np.int64)] for topic in there.topics}
    for block in source.messages():
        for topic in there.topics:
            times[topic.name].append(block.of(topic).time)
    steps = {name: np.diff(np.concatenate(parts)) for name, parts in times.items()}
    usual = {name: float(np.median(step[step > 0])) for name, step in steps.items() if (step > 0).any()}
    return lambda topic: f"{1e9 / usual[topic.name]:.4g}" if topic.name in usual else "-"


def _say_samples(kept: Recording, ranges: _Ranges, there: LogContents) -> None:
    rate, ends = kept.rate(), span(ranges.ends)
    speed = "" if rate is None else f", a step of {1 / rate:.4g} (rate {rate:.4g})"
    lines(
        [
            ("samples" if there.topics else "rows", f"{ranges.count:,}"),
            ("time", Quantity(f"{ends}{speed}", {"from_to": ends.value, "rate": rate})),
            ("orientation", _orientation(kept, there)),
        ]
    )


def _orientation(kept: Recording, there: LogContents) -> str:
    if ORIENTATION in kept.channels:
        lost = ~np.isfinite(kept.channels[ORIENTATION]).all(axis=1)
        where = "" if POSITION in kept.channels else ", without a position"
        return f"present{where}" + (f", missing in {percent(lost.mean())}" if lost.any() else "")
    guess = named_pose(list(there.names))
    return "none" if guess is None else f"perhaps {', '.join(guess.orientation)} ({guess.form})"


def _say_ranges(kept: Recording, ranges: _Ranges) -> None:
    values = _flat(kept, ranges.channels)
    seen = estimate_noise(values)
    noise = None if seen is None else seen.deviation
    medians = [median(column) for column in values.T]
    header = ("", "least", "median", "most", "noise", "missing")
    if len(medians) <= _MOST:
        figures = np.stack([ranges.least, medians, ranges.most], axis=1)
        figures[ranges.least > ranges.most] = np.nan
        steps = [""] * len(medians) if noise is None else [f"{step:.3g}" for step in noise]
        rows = zip(_labels(kept, ranges.channels), figures, steps, ranges.missing, strict=True)
        table(header, [[name, *(f"{x:.4g}" for x in three), step, f"{missing}"] for name, three, step, missing in rows])
        return
    channel, step = ranges.channels[0], "" if noise is None else f"{np.median(noise):.3g}"
    name = f"{' x '.join(map(str, kept.channels[channel].shape[1:]))} {channel}"
    three = (ranges.least.min(), np.median(medians), ranges.most.max())
    table(header, [[name, *(f"{x:.4g}" for x in three), step, f"{ranges.missing.sum()}"]])
    never = int(np.count_nonzero(ranges.least == ranges.most))
    note([f"{never} of {len(medians)} {channel} never change"] if never else [])


def _reached(ends: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the first and the last of all times."""
    known = np.concatenate([ends, time[np.isfinite(time)]])
    return known[[known.argmin(), known.argmax()]] if len(known) else known


def inspect_contacts(file: Path) -> Recording:
    """Print figures of a file of contacts, finished or not.

    Returns:
        An excerpt with the strongest contact of each sample, see `force_and_place`; without rows, FORCE alone.

    Raises:
        InputError: the file cannot be read, holds no contacts, or a row is invalid.
    """
    from palpate.cli.spectrum import force_and_place  # here: a log needs nothing of it

    excerpt, counts = Excerpt(), np.zeros(len(Status), dtype=np.int64)
    ends, notes, features = np.empty(0), dict[str, None](), dict[str, None]()
    identities, samples, before = set[int](), 0, -1
    for block in contact_blocks(file):
        counts += np.bincount(block.status, minlength=len(Status))
        ends = _reached(ends, block.time)
        notes |= dict.fromkeys(block.notes)
        features |= dict.fromkeys(block.features)
        identities |= set(np.unique(block.identity[block.answered]).tolist())
        strongest = block[block.strongest()]
        samples += int(np.count_nonzero(np.diff(strongest.sample, prepend=before)))
        before = int(strongest.sample[-1]) if len(strongest) else before
        excerpt.add(force_and_place(strongest))
    title(f"{file}: contacts")
    total = int(counts.sum())
    of = f", of {samples:,} samples; {len(identities):,} contacts" if total > samples or len(identities) > 1 else ""
    lines([("rows", Quantity(f"{total:,}{of}", total)), ("time", span(ends))])
    lines([("features", ", ".join(features))] if features else [])
    lines(shares(counts))
    record = read_provenance(file)
    lines([("frame", record["frame"])] if "frame" in record else [])
    if (ended := record.get("ended", "whole")) != "whole":
        why = "the log was torn" if ended == "torn" else "estimating was interrupted"
        note([f"not all contacts are in it: {why}"], kind="warning")
    note([] if unfinished(file) is None else ["writing was interrupted: these are only the complete blocks"])
    note(notes)
    return excerpt.recording() if excerpt.count else Recording(np.empty(0), {FORCE: np.empty((0, 3))})


class Excerpt:
    """An excerpt of a log: pieces of consecutive samples, as steps and spectra need neighbours.

    Args:
        most: number of samples above which `stride` is doubled.
        piece: samples of a piece.

    Attributes:
        count: number of samples added.
        stride: one piece in so many is kept.
    """

    def __init__(self, most: int = 1 << 18, piece: int = 1 << 13) -> None:
        self.count, self.stride, self._most, self._piece = 0, 1, most, piece
        self._kept: list[tuple[int, Recording]] = []  # with the number of the piece that it is of

    def add(self, block: Recording) -> None:
        """Add the next samples, in blocks of any size."""
        start = 0
        while start < len(block):
            number, inside = divmod(self.count, self._piece)
            end = min(len(block), start + self._piece - inside)
            if number % self.stride == 0:
                self._keep(number, block.picked(slice(start, end)))
            self.count += end - start
            start = end

    def recording(self) -> Recording:
        """Return the kept samples as a `Recording`, with gaps between the pieces.

        Raises:
            IndexError: no sample was added.
        """
        return join([part for _, part in self._kept])

    def _keep(self, number: int, part: Recording) -> None:
        self._kept.append((number, part))
        while sum(len(one) for _, one in self._kept) > self._most and self.stride < 2 * self.count:
            self.stride *= 2
            self._kept = [one for one in self._kept if one[0] % self.stride == 0]
