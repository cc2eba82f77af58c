"""Inspect a log of images: count, size, times, brightness, and frames without information."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.console.console import Quantity, counting, lines, note, part, progress, span
from palpate.errors import InputError
from palpate.files.logs import ImageChannel, LogContents, LogLayout, open_log
from palpate.files.logs.image_messages import IMAGES
from palpate.files.logs.images import ImageLog
from palpate.signals.recording import IMAGE, Recording
from palpate.viewer.report import percent

_DARK = 5.0  # of 255: a mean below it is a black frame, whatever the noise


def image_topics(there: LogContents) -> list[str]:
    """Return the names of the topics that have images."""
    return [topic.name for topic in there.topics if topic.count and topic.kind in IMAGES]


def image_layouts(there: LogContents, topic: str | None) -> list[LogLayout]:
    """Return a `LogLayout` for each series of images in a log; where it has topics, for each, or for `topic` alone."""
    alone = LogLayout(wrench=None, images=ImageChannel())
    if there.images is not None:
        return [alone]
    names = [name for name in image_topics(there) if topic in (None, name)]
    return [LogLayout(wrench=None, images=ImageChannel(name)) for name in names]


def inspect_images(file: Path, there: LogContents, layouts: list[LogLayout]) -> bool:
    """Print figures of each series of images in a log; return whether the log is torn.

    Raises:
        InputError: the only series cannot be read.
    """
    torn = False
    for layout in layouts:
        if len(layouts) > 1 and layout.images is not None:
            part(layout.images.topic or "")
        try:
            torn |= _inspect_one(file, there, layout)
        except InputError as problem:
            if len(layouts) < 2:
                raise
            note([problem.what], kind="warning")
    return torn


def _inspect_one(file: Path, there: LogContents, layout: LogLayout) -> bool:
    log, frames = open_log(file, layout), _Frames()
    with counting():
        for block in log.blocks():
            frames.add(block)
            progress(frames.count, log.position / max(log.size, 1))
    rate, ends, lost = frames.rate(), span(frames.ends), log.lost if isinstance(log, ImageLog) else 0
    speed = "" if rate is None else f", {rate:.4g} Hz"
    height, width = frames.size
    lines(
        [
            ("frames", Quantity(f"{frames.count:,}", frames.count)),
            ("size", Quantity(f"{width} x {height}", [width, height])),
            ("time", Quantity(f"{ends}{speed}", {"from_to": ends.value, "rate": rate})),
            *([] if there.images is None else [("codec", there.images.codec)]),
            ("brightness", frames.brightness()),
            ("black", _share(frames.black - lost, frames.count)),
            ("repeated", _share(frames.repeated, frames.count)),
            ("not decoded", _share(lost, frames.count)),
        ]
    )
    note(frames.warnings(lost), kind="warning")
    note([f"torn: {log.torn}"] if log.torn else [], kind="warning")
    note(log.notes())
    return bool(log.torn)


class _Frames:
    """Figures of all frames."""

    def __init__(self) -> None:
        self.count = self.black = self.repeated = self._run = self._longest = 0
        self.size = (0, 0)
        self._since = self._longest_since = np.nan
        self._times, self._means = list[np.ndarray](), list[np.ndarray]()
        self._last: np.ndarray | None = None

    def add(self, block: Recording) -> None:
        """Add the next frames."""
        images = block.channels[IMAGE]
        self.size = (images.shape[1], images.shape[2])
        self._times.append(np.array(block.time))
        self._means.append(images.mean(axis=(1, 2, 3)))
        self.black += int(np.count_nonzero(self._means[-1] < _DARK))
        for time, mean, image in zip(block.time.tolist(), self._means[-1].tolist(), images, strict=True):
            same = self._last is not None and mean >= _DARK and np.array_equal(image, self._last)
            self.repeated += same
            self._run, self._since = (self._run + 1, self._since) if same else (0, time)
            if self._run > self._longest:
                self._longest, self._longest_since = self._run, self._since
            self._last = image
        self.count += len(block)

    @property
    def ends(self) -> np.ndarray:
        """All finite times [s]."""
        time = np.concatenate(self._times)
        return time[np.isfinite(time)]

    def rate(self) -> float | None:
        """Return the rate of the frames [Hz]; None where it is not known."""
        return Recording(np.concatenate(self._times), {}).rate()

    def brightness(self) -> Quantity:
        """Return the mean of all frames, of the darkest and of the brightest one that is not black."""
        means = np.concatenate(self._means)
        means = means[means >= _DARK]
        if not len(means):
            return Quantity("none", None)
        mean, least, most = float(means.mean()), float(means.min()), float(means.max())
        value = {"mean": mean, "least": least, "most": most}
        return Quantity(f"{mean:.1f} of 255, from {least:.1f} to {most:.1f}", value)

    def warnings(self, lost: int) -> list[str]:
        """Return sentences on black and repeated frames."""
        found: list[str] = []
        if self.count - lost and self.black == self.count:
            found.append("every frame is black: check the lens and the light")
        if self._longest:
            what = f"the longest series has {self._longest + 1} frames, from {self._longest_since:.3f} s on"
            found.append(f"{self.repeated:,} frames are the same as the one before ({what}): check the camera")
        return found


def _share(count: int, total: int) -> Quantity:
    return Quantity(f"{count:,}" + (f" ({percent(count / total)})" if count else ""), count)
