"""Convert camera images from any source to blocks of images of one size: uint8, blue, green, red."""

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
    """Raise an InputError if the layout requests a wrench or arrays, or no images."""
    if layout.images is None or layout.wrench is not None or layout.arrays:
        wanted = [*(["a wrench"] if layout.wrench is not None else []), *(array.name for array in layout.arrays)]
        raise InputError(
            f"is {called}, which holds only images; requested is {' and '.join(wanted) or 'something else'}.",
            where=str(path),
        )


def to_bgr(image: np.ndarray) -> UInt8[np.ndarray, "height width 3"] | None:
    """Return uint8 (height, width, 3): grey repeated, alpha dropped, the upper 8 of 16 bits; None for other types."""
    if image.dtype.kind != "u" or image.dtype.itemsize > 2:
        return None
    if image.dtype.itemsize == 2:
        image = (image >> 8).astype(np.uint8)
    image = image[:, :, None] if image.ndim == 2 else image
    return np.ascontiguousarray(np.broadcast_to(image[:, :, :3], (*image.shape[:2], 3)))


def decoded(cv2: Any, raw: bytes, *, as_stored: bool = False) -> np.ndarray | None:
    """Decode the bytes of a JPEG, PNG, BMP, TIFF or WebP file; return None if that fails.

    Args:
        cv2: OpenCV.
        raw: the bytes.
        as_stored: keep the number of channels and the type, rather than return (height, width, 3) of uint8.
    """
    if not raw:
        return None
    try:
        flag = cv2.IMREAD_UNCHANGED if as_stored else cv2.IMREAD_COLOR
        return cv2.imdecode(np.frombuffer(raw, dtype=np.uint8), flag)
    except cv2.error:  # such as a head that says billions of pixels
        return None


class FrameBlocks:
    """Builder of the recordings of one log of images, which also counts irregular ones.

    An image that could not be decoded, or whose size differs from that of the first decoded one, becomes zeros.
    """

    def __init__(self, layout: LogLayout, path: Path) -> None:
        self._samples, self._path = SampleReader(layout, path), path
        self._size: tuple[int, int] | None = None
        self._lost, self._other = list[str](), list[str]()
        self.count = 0

    def blocks(self, frames: Iterable[Frame]) -> Iterator[Recording]:
        """Yield all images, in their order, as recordings with `IMAGE` (n, height, width, 3).

        Raises:
            InputError: there are no images, or none could be decoded.
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
        """Return notes on the images so far, one sentence each: lost ones, those of other sizes, odd times."""
        height, width = self._size or (0, 0)
        said = (
            (self._lost, "could not be decoded and are replaced by black ones"),
            (self._other, f"are not {width} x {height} like the others and are replaced by black ones"),
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
        """Number of images so far that are zeros, because they were lost or have another size."""
        return len(self._lost) + len(self._other)

    @property
    def _rows(self) -> int:
        height, width = self._size or (1, 1)
        return max(1, min(ROWS, BYTES // (3 * height * width)))

    def _cut(self, held: Sequence[tuple[float, np.ndarray | None]]) -> Iterator[Recording]:
        """Yield images in blocks; there are several blocks if the log begins with images that cannot be decoded."""
        for start in range(0, len(held), self._rows):
            part = held[start : start + self._rows]
            images = np.zeros((len(part), *(self._size or (0, 0)), 3), dtype=np.uint8)
            for row, (_, image) in zip(images, part, strict=True):
                if image is not None:
                    row[:] = image
            yield self._samples.block(np.array([time for time, _ in part]), {IMAGE: images})


class ImageLog(Log):
    """Base class of the logs that consist of images."""

    def __init__(self, path: Path, size: int, layout: LogLayout) -> None:
        super().__init__(path, size)
        self._layout, self._frames, self._said = layout, FrameBlocks(layout, path), list[str]()

    @property
    def lost(self) -> int:
        """Number of images so far that could not be decoded, or differ in size from the others."""
        return self._frames.lost

    def notes(self) -> tuple[str, ...]:
        """Return the notes on the images read so far, one sentence each."""
        return (*self._said, *self._frames.notes())

    def _begin(self, called: str) -> Any:
        """Check the layout, reset what was counted, and return the module of OpenCV."""
        refuse_others(self._layout, self.path, called)
        self._frames, self._said, self.position, self.torn = FrameBlocks(self._layout, self.path), [], 0, ""
        return opencv()


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
