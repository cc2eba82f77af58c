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

ROWS = 32  # frames of a block, or fewer if they are large
BYTES = 1 << 26  # of a block
_NAMED = 3  # frames that a note names
_PNG = b"\x89PNG\r\n\x1a\n"

Frame = tuple[float, np.ndarray | None, str]  # time [s], image (None: it could not be decoded), what a note calls it


def refuse_others(layout: LogLayout, path: Path, called: str) -> None:
    """Check that a layout requests images alone; `called` says what the log is, such as "a video".

    Raises:
        InputError: it requests a wrench or arrays, or no images.
    """
    if layout.images is None or layout.wrench is not None or layout.arrays:
        wanted = [*(["a wrench"] if layout.wrench is not None else []), *(array.name for array in layout.arrays)]
        what = f"is {called}, which holds only images; requested is {' and '.join(wanted) or 'something else'}."
        raise InputError(what, where=str(path))


def to_bgr(image: np.ndarray) -> UInt8[np.ndarray, "height width 3"] | None:
    """Return an image of uint8 or uint16 (upper bits) as uint8 (height, width, 3), grey repeated; None for others."""
    if image.dtype.kind != "u" or image.dtype.itemsize > 2 or image.ndim not in (2, 3) or image.shape[2:] == (2,):
        return None
    if image.dtype.itemsize == 2:
        image = (image >> 8).astype(np.uint8)
    image = image[:, :, None] if image.ndim == 2 else image
    return np.ascontiguousarray(np.broadcast_to(image[:, :, :3], (*image.shape[:2], 3)))


def decoded(cv2: Any, raw: bytes, *, as_stored: bool = False) -> np.ndarray | None:
    """Return the image in a JPEG, PNG, BMP, TIFF or WebP file, uint8 (height, width, 3); None if it cannot be decoded.

    `as_stored` keeps the type and the number of channels. `cv2` is OpenCV.
    """
    if not raw or (raw.startswith(_PNG) and not _complete(raw)):
        return None
    try:
        flag = cv2.IMREAD_UNCHANGED if as_stored else cv2.IMREAD_COLOR
        return cv2.imdecode(np.frombuffer(raw, dtype=np.uint8), flag)
    except cv2.error:  # such as a head that says billions of pixels
        return None


def _complete(png: bytes) -> bool:
    """Return whether all chunks of a PNG are in it; OpenCV reserves the 4 GB that a damaged one may state."""
    at, kind = len(_PNG), b""
    while at < len(png) and kind != b"IEND":
        kind = png[at + 4 : at + 8]
        at += 12 + int.from_bytes(png[at : at + 4])
    return at <= len(png) and kind == b"IEND"


class ImageLog(Log):
    """Base class of the logs that consist of images.

    An image that could not be decoded, or whose size differs from that of the first decoded one, becomes zeros.
    """

    def __init__(self, path: Path, size: int, layout: LogLayout) -> None:
        super().__init__(path, size)
        self._layout = layout
        self._restart()

    @property
    def lost(self) -> int:
        """Number of images read so far that could not be decoded, or differ in size from the others."""
        return len(self._lost) + len(self._other)

    def notes(self) -> tuple[str, ...]:
        """Return notes on the images read so far, one sentence each: lost ones, those of other sizes, odd times."""
        height, width = self._size or (0, 0)
        said = (
            (self._lost, "could not be decoded and are replaced by black ones"),
            (self._other, f"are not {width} x {height} like the others and are replaced by black ones"),
        )
        own = [f"{len(names)} of {self._count} frames {what}: {_listed(names)}" for names, what in said if names]
        return (*self._said, *own, *self._samples.notes())

    def _restart(self) -> None:
        self._samples = SampleReader(self._layout, self.path)
        self._size: tuple[int, int] | None = None
        self._said, self._lost, self._other = list[str](), list[str](), list[str]()
        self._count, self.position, self.torn = 0, 0, ""

    def _begin(self, called: str) -> Any:
        """Check the layout, reset what was counted, and return the module of OpenCV."""
        refuse_others(self._layout, self.path, called)
        self._restart()
        return opencv()

    def _recordings(self, frames: Iterable[Frame]) -> Iterator[Recording]:
        """Yield all images, in order; raise an InputError if there are none, or none could be decoded."""
        held: list[tuple[float, np.ndarray | None]] = []
        for time, image, name in frames:
            self._count += 1
            held.append((time, self._fitting(image, name)))
            if self._size is not None and len(held) >= self._rows:
                yield from self._cut(held)
                held = []
        if self._size is None:
            what = f"none of its {self._count} frames can be decoded" if self._count else "it holds no frames"
            raise InputError(f"{what}.", where=str(self.path))
        yield from self._cut(held)

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
    def _rows(self) -> int:
        height, width = self._size or (1, 1)
        return max(1, min(ROWS, BYTES // (3 * height * width)))

    def _cut(self, held: Sequence[tuple[float, np.ndarray | None]]) -> Iterator[Recording]:
        for start in range(0, len(held), self._rows):
            part = held[start : start + self._rows]
            images = np.zeros((len(part), *(self._size or (0, 0)), 3), dtype=np.uint8)
            for row, (_, image) in zip(images, part, strict=True):
                if image is not None:
                    row[:] = image
            yield from self._samples.blocks(np.array([time for time, _ in part]), {IMAGE: images})


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
