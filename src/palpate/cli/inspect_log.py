"""What is in a log or a file of contacts of any length: counts and ranges of all of it, medians of a share of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate.cli.screen import counting, lines, note, percent, progress, table, title
from palpate.cli.spectrum import PLACE
from palpate.contact.estimate import Status
from palpate.errors import InputError
from palpate.io.contacts import contact_blocks, unfinished
from palpate.io.logs import contents, join, open_log
from palpate.io.logs.guess import guess_orientation, guess_time, guess_wrench
from palpate.io.logs.layout import Layout
from palpate.io.models import read_provenance
from palpate.sensors.noise import estimate_noise
from palpate.sensors.recording import FORCE, ORIENTATION, POSITION, Recording

__all__ = ["inspect_contacts", "inspect_log"]

_CHANNELS = ("fx [N]", "fy [N]", "fz [N]", "tx [N m]", "ty [N m]", "tz [N m]")


class Excerpt:
    """Takes all samples of a log in order, and keeps some long pieces of it: steps and spectra need neighbours.

    Every `stride`-th piece is kept; `stride` doubles when they get too many.

    Args:
        most: samples to keep.
        piece: samples of a piece.
    """

    def __init__(self, most: int = 1 << 18, piece: int = 1 << 13) -> None:
        self.count, self.stride, self._most, self._piece = 0, 1, most, piece
        self._kept: list[tuple[int, Recording]] = []  # with the number of the piece that it is of

    def add(self, block: Recording) -> None:
        """The next samples, in blocks of any size."""
        start = 0
        while start < len(block):
            number, inside = divmod(self.count, self._piece)
            end = min(len(block), start + self._piece - inside)
            if number % self.stride == 0:
                self._keep(number, block.picked(slice(start, end)))
            self.count += end - start
            start = end

    def recording(self) -> Recording:
        """What was kept, with gaps in it."""
        return join([part for _, part in self._kept])

    def _keep(self, number: int, part: Recording) -> None:
        self._kept.append((number, part))
        while sum(len(one) for _, one in self._kept) > self._most and self.stride < 2 * self.count:
            self.stride *= 2
            self._kept = [one for one in self._kept if one[0] % self.stride == 0]


def inspect_log(file: Path, names: Sequence[str], layout: Layout | None) -> tuple[Recording | None, bool]:
    """Say what is in a log.

    Args:
        file: the log.
        names: its columns; none where it has topics.
        layout: where a rig says it; None: guessed from the names.

    Returns:
        What was kept of it (None where no wrench was found in it), and whether it is torn.
    """
    title(f"{file}: a log")
    _say_contents(file, names)
    layout = layout or _guessed(names)
    if layout is None:
        note(["no columns look like a time with three forces and three torques"])
        return None, False
    log = open_log(file, layout)
    excerpt, ranges = Excerpt(), _Ranges()
    try:
        with counting():
            for block in log.blocks():
                excerpt.add(block)
                ranges.add(block)
                progress(ranges.count, log.position / max(log.size, 1))
    except InputError as problem:
        if names or excerpt.count:
            raise
        note([str(problem)])  # several topics, and which one is meant is for a rig to say
        return None, bool(log.torn)
    kept = excerpt.recording()
    _say_samples(kept, ranges, names, layout)
    _say_ranges(kept, ranges)
    _say_share(excerpt)
    note(([f"torn: {log.torn}"] if log.torn else []), kind="warning")
    note(log.notes())
    return kept, bool(log.torn)


class _Ranges:
    """Of all samples: how many, from when to when, the least and the most of each channel, how many it lacks."""

    def __init__(self) -> None:
        self.count, self.first, self.last = 0, np.inf, -np.inf
        self.missing = np.zeros(6, dtype=np.int64)
        self.least, self.most = np.full(6, np.inf), np.full(6, -np.inf)

    def add(self, block: Recording) -> None:
        """The next samples."""
        wrenches, time = block.wrenches(), block.time[np.isfinite(block.time)]
        self.count += len(wrenches)
        self.missing += np.count_nonzero(np.isnan(wrenches), axis=0)
        self.least = np.fmin(self.least, np.fmin.reduce(wrenches, axis=0, initial=np.inf))
        self.most = np.fmax(self.most, np.fmax.reduce(wrenches, axis=0, initial=-np.inf))
        self.first, self.last = min(self.first, time.min(initial=np.inf)), max(self.last, time.max(initial=-np.inf))

    def span(self) -> str:
        """From when to when."""
        return f"{self.first:.3f} to {self.last:.3f}" if self.first <= self.last else "none"


def _guessed(names: Sequence[str]) -> Layout | None:
    if not names:
        return Layout()  # the only topic of its kind
    wrench, time = guess_wrench(names), guess_time(names)
    return None if wrench is None or time is None else Layout(time=time, wrench=wrench)


def _say_contents(file: Path, names: Sequence[str]) -> None:
    if names:
        shown = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
        lines([("columns", f"{len(names)}: {shown}")])
    else:
        table(
            ("topic", "type", "messages"),
            [(topic.name, topic.kind, f"{topic.count:,}") for topic in contents(file).topics],
        )


def _say_samples(kept: Recording, ranges: _Ranges, names: Sequence[str], layout: Layout) -> None:
    rate = kept.rate()
    speed = "" if rate is None else f", a step of {1 / rate:.4g} (rate {rate:.4g})"
    taken = [("taken as", f"{layout.time}; {', '.join(layout.wrench or ())}")] if names else []
    lines(
        [
            ("rows" if names else "samples", f"{ranges.count:,}"),
            *taken,
            ("time", f"{ranges.span()}{speed}"),
            ("orientation", _orientation(kept, names)),
        ]
    )


def _orientation(kept: Recording, names: Sequence[str]) -> str:
    if ORIENTATION in kept.channels:
        lost = ~np.isfinite(kept.channels[ORIENTATION]).all(axis=1)
        where = "" if POSITION in kept.channels else ", without a position"
        return f"there{where}" + (f", missing in {percent(lost.mean())}" if lost.any() else "")
    guess = guess_orientation(names)
    return "none" if guess is None else f"perhaps {', '.join(guess)}"


def _say_ranges(kept: Recording, ranges: _Ranges) -> None:
    wrenches = kept.wrenches()
    noise = estimate_noise(wrenches)
    rows: list[list[str]] = []
    for k, name in enumerate(_CHANNELS):
        known = wrenches[np.isfinite(wrenches[:, k]), k]
        middle = float(np.median(known)) if len(known) else np.nan
        all_of_them = (ranges.least[k], middle, ranges.most[k]) if ranges.least[k] <= ranges.most[k] else (np.nan,) * 3
        step = "" if noise is None else f"{noise[k]:.3g}"
        rows.append([name, *(f"{value:.4g}" for value in all_of_them), step, f"{ranges.missing[k]}"])
    table(("as N and N m", "least", "median", "most", "noise", "missing"), rows)


def _say_share(excerpt: Excerpt) -> None:
    if excerpt.stride > 1:
        note([f"step, medians and noise are those of one sample in {excerpt.stride} (in long pieces), the rest of all"])


def inspect_contacts(file: Path) -> Recording:
    """Say what is in a file of contacts, finished or not.

    Returns:
        What was kept of it: FORCE [N], and PLACE [m] of the contact, NaN where not answered.
    """
    excerpt, counts = Excerpt(), np.zeros(len(Status), dtype=np.int64)
    first, last, notes = np.inf, -np.inf, dict[str, None]()
    for block in contact_blocks(file):
        estimate, known = block.estimate, block.time[np.isfinite(block.time)]
        counts += np.bincount(estimate.status, minlength=len(Status))
        first, last = min(first, known.min(initial=np.inf)), max(last, known.max(initial=-np.inf))
        notes |= dict.fromkeys(block.notes)
        point = np.where(estimate.answered[:, None], estimate.point, np.nan)
        excerpt.add(Recording(block.time, {FORCE: estimate.force, PLACE: point}).picked(block.contact == 0))
    title(f"{file}: contacts")
    total = int(counts.sum())
    lines([("rows", f"{total:,}"), ("time", f"{first:.3f} to {last:.3f}" if first <= last else "none")])
    lines((kind.label, percent(counts[kind] / total)) for kind in Status if counts[kind])
    beside, cut = read_provenance(file), unfinished(file) is not None
    lines([("frame", beside["frame"])] if "frame" in beside else [])
    ended = beside.get("ended", "whole")
    if ended != "whole":
        note(
            [f"they are not all: {'the log was torn' if ended == 'torn' else 'estimating was interrupted'}"],
            kind="warning",
        )
    note([*(["writing it was cut short: these are the blocks that were whole"] if cut else []), *notes])
    return excerpt.recording() if excerpt.count else Recording(np.empty(0), {FORCE: np.empty((0, 3))})
