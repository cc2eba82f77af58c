"""Read a folder of images, one file each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs.bag import natural
from palpate.files.logs.images import Frame, ImageLog, decoded
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.log import Images, LogContents
from palpate.files.logs.text import CsvLog
from palpate.files.logs.video import RATE
from palpate.opencv import opencv
from palpate.signals.recording import Recording

FRAMES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
TIMES = ("times.csv", "truth.csv")
_BAG = (".mcap", ".db3")


def holds_frames(path: Path) -> bool:
    """Return True if a folder contains images and no bag; False if it cannot be read."""
    try:
        names = [file.name.lower() for file in path.iterdir()]
    except OSError:
        return False
    bag = "metadata.yaml" in names or any(name.endswith(_BAG) for name in names)
    return not bag and any(name.endswith(FRAMES) for name in names)


class FrameFolder(ImageLog):
    """A log in a folder of image files, one sample each, in the natural order of their names.

    Times are a column of `times.csv` in it, or else of `truth.csv`, if it has as many rows; else k / rate.

    Attributes:
        files: the images' files, in order.

    Raises:
        OSError: the folder cannot be read.
        InputError: the layout is invalid.
    """

    def __init__(self, path: Path, layout: LogLayout) -> None:
        files = (file for file in path.iterdir() if file.suffix.lower() in FRAMES and not file.name.startswith("."))
        self.files = sorted(filter(Path.is_file, files), key=natural)
        super().__init__(path, sum(file.stat().st_size for file in self.files), layout)

    def contents(self) -> LogContents:
        """Return the number and the formats of the images, and the size of the first readable one.

        Raises:
            InputError: OpenCV is not installed.
        """
        cv2, size = opencv(), (0, 0, 0)
        for file in self.files:
            if (image := decoded(cv2, _bytes(file), as_stored=True)) is not None:
                size = (*image.shape[:2], image.shape[2] if image.ndim == 3 else 1)
                break
        suffixes = ", ".join(dict.fromkeys(file.suffix[1:].lower() for file in self.files))
        return LogContents(self.path, {}, images=Images(size, len(self.files), None, suffixes))

    def blocks(self) -> Iterator[Recording]:
        """Yield the images as recordings.

        Raises:
            InputError: no image is readable, the layout requests anything but images, or OpenCV is not installed.
        """
        cv2 = self._begin("a folder of frames")
        yield from self._recordings(self._read(cv2, self._times()))

    def _read(self, cv2: Any, times: Float[np.ndarray, " n"]) -> Iterator[Frame]:
        for time, file in zip(times.tolist(), self.files, strict=True):
            raw = _bytes(file)
            self.position += len(raw)
            yield time, decoded(cv2, raw), file.name

    def _times(self) -> Float[np.ndarray, " n"]:
        count = len(self.files)
        for name in TIMES:
            if not (self.path / name).is_file():
                continue
            time = _column(self.path / name, self._layout)
            if time is None:
                has = f"no readable column {self._layout.time!r}, so it is not used for the frames' times"
            elif len(time) != count:
                has = f"{len(time):,} rows for {count:,} frames, so it is not used for their times"
            else:
                return time
            self._said.append(f"{name} has {has}")
        if self._layout.rate is None:
            self._said.append(f"frames have no times: a rate of {RATE:g} Hz is assumed")
        return np.arange(count) / (self._layout.rate or RATE)


def _column(file: Path, layout: LogLayout) -> Float[np.ndarray, " n"] | None:
    alone = LogLayout(time=layout.time, time_unit=layout.time_unit, wrench=None)
    try:
        return np.concatenate([block.time for block in CsvLog(file, alone).blocks()])
    except InputError:
        return None


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError:
        return b""
