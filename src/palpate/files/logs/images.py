"""Frames of a camera, whatever they come in, become blocks of images of one size: uint8, blue, green, red."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from palpate.errors import InputError
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.log import Log
from palpate.files.logs.samples import SampleReader
from palpate.opencv import opencv
from palpate.signals.recording import IMAGE, Recording

__all__ = ["Frame", "FrameBlocks", "ImageLog", "decoded", "refuse_others"]

ROWS = 32  # frames of a block, or fewer if they are large
BYTES = 1 << 26  # of a block
_NAMED = 3  # frames that a note names

Frame = tuple[float, np.ndarray | None, str]  # time [s], image (None: it could not be decoded), what a note calls it


def refuse_others(layout: LogLayout, path: Path, called: str) -> None:
    """Raise an InputError where something else than images is asked for."""
    if layout.images is None or layout.wrench is not None or layout.arrays:
        wanted = [*(["a wrench"] if layout.wrench is not None else []), *(array.name for array in layout.arrays)]
        raise InputError(
            f"is {called}, which holds images alone; asked for is {' and '.join(wanted) or 'something else'}.",
            where=str(path),
        )


def to_bgr(image: np.ndarray) -> UInt8[np.ndarray, "height width 3"] | None:
    """Grey in three equal channels, without alpha, of 16 bits the upper 8; None of other numbers."""
    if image.dtype.kind != "u" or image.dtype.itemsize > 2:
        return None
    if image.dtype.itemsize == 2:
        image = (image >> 8).astype(np.uint8)
    image = image[:, :, None] if image.ndim == 2 else image
    return np.ascontiguousarray(np.broadcast_to(image[:, :, :3], (*image.shape[:2], 3)))


def decoded(cv2: Any, raw: bytes, *, as_stored: bool = False) -> np.ndarray | None:
    """The image in the bytes of a JPEG, PNG, BMP, TIFF or WebP file, or None.

    Args:
        cv2: OpenCV.
        raw: the bytes.
        as_stored: with as many channels as there are, and not (height, width, 3) of uint8.
    """
    if not raw:
        return None
    try:
        flag = cv2.IMREAD_UNCHANGED if as_stored else cv2.IMREAD_COLOR
        return cv2.imdecode(np.frombuffer(raw, dtype=np.uint8), flag)
    except cv2.error:  # such as a head that says billions of pixels
        return None


class FrameBlocks:
    """Makes the blocks of one log of images, and keeps account of what is odd in them.

    A frame that could not be decoded, or is of another size than the first that could, is a row of zeros.
    """

    def __init__(self, layout: LogLayout, path: Path) -> None:
        self._samples, self._path = SampleReader(layout, path), path
        self._size: tuple[int, int] | None = None
        self._lost, self._other = list[str](), list[str]()
        self.count = 0

    def blocks(self, frames: Iterable[Frame]) -> Iterator[Recording]:
        """All frames, in their order.

        Raises:
            InputError: there are none, or none could be decoded.
        """
        held: list[tuple[float, np.ndarray | None]] = []
        for time, image, name in frames:
            self.count += 1
            held.append((time, self._fitting(image, name)))
            if self._size is not None and len(held) >= self._rows:
                yield from self._cut(held)
                held = []
        if self._size is None:
            what = f"none of its {self.count} frames can be decoded" if self.count else "it holds no frames"
            raise InputError(f"{what}.", where=str(self._path))
        yield from self._cut(held)

    def notes(self) -> tuple[str, ...]:
        """What a reader should know of the frames so far, one sentence each."""
        height, width = self._size or (0, 0)
        said = (
            (self._lost, "could not be decoded and are black here"),
            (self._other, f"are not {width} x {height} as the others, and are black here"),
        )
        own = [f"{len(names)} of {self.count} frames {what}: {_listed(names)}" for names, what in said if names]
        return (*own, *self._samples.notes())

    def _fitting(self, image: np.ndarray | None, name: str) -> np.ndarray | None:
        image = None if image is None else to_bgr(image)
        if image is None:
            self._lost.append(name)
            return None
        self._size = self._size or image.shape[:2]
        if image.shape[:2] != self._size:
            self._other.append(name)
            return None
        return image

    @property
    def lost(self) -> int:
        """Rows of zeros so far, for what is said in `notes`."""
        return len(self._lost) + len(self._other)

    @property
    def _rows(self) -> int:
        height, width = self._size or (1, 1)
        return max(1, min(ROWS, BYTES // (3 * height * width)))

    def _cut(self, held: Sequence[tuple[float, np.ndarray | None]]) -> Iterator[Recording]:
        """More than a block where the log began with frames that could not be decoded."""
        for start in range(0, len(held), self._rows):
            part = held[start : start + self._rows]
            images = np.zeros((len(part), *(self._size or (0, 0)), 3), dtype=np.uint8)
            for row, (_, image) in zip(images, part, strict=True):
                if image is not None:
                    row[:] = image
            yield self._samples.block(np.array([time for time, _ in part]), {IMAGE: images})


class ImageLog(Log):
    """What every reader of images gives."""

    def __init__(self, path: Path, size: int, layout: LogLayout) -> None:
        super().__init__(path, size)
        self._layout, self._frames, self._said = layout, FrameBlocks(layout, path), list[str]()

    @property
    def lost(self) -> int:
        """Frames so far that could not be decoded, or are of another size than the others."""
        return self._frames.lost

    def notes(self) -> tuple[str, ...]:
        """See `palpate.files.logs.log.Log`."""
        return (*self._said, *self._frames.notes())

    def _begin(self, called: str) -> Any:
        """Nothing was read yet; OpenCV."""
        refuse_others(self._layout, self.path, called)
        self._frames, self._said, self.position, self.torn = FrameBlocks(self._layout, self.path), [], 0, ""
        return opencv()


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
