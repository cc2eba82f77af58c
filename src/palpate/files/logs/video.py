"""Read a video through OpenCV's FFmpeg: one sample per frame."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.inputs import open_input
from palpate.files.logs.images import Frame, ImageLog
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.log import Images, LogContents
from palpate.opencv import opencv
from palpate.signals.recording import Recording

BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")  # that an MP4 or QuickTime file may begin with
VIDEOS = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm")
RATE = 30.0  # Hz where nothing says it
_ROUNDED = 1e-3  # s: to which Matroska rounds its stamps


class VideoLog(ImageLog):
    """A log in a video file, one sample per frame, even for one that cannot be decoded.

    Times are k / rate by the layout's rate; else by the file's, if its stamps agree with that; else the stamps.

    Raises:
        OSError: the file does not exist.
        InputError: the layout is invalid.
    """

    def __init__(self, path: Path, layout: LogLayout) -> None:
        super().__init__(path, path.stat().st_size, layout)

    def contents(self) -> LogContents:
        """Return size, frame count, rate and codec, as the file's header announces them.

        Raises:
            InputError: the video cannot be opened, or OpenCV is not installed.
        """
        cv2 = opencv()
        with _opened(cv2, self.path, packed=True) as video:
            size = int(video.get(cv2.CAP_PROP_FRAME_HEIGHT)), int(video.get(cv2.CAP_PROP_FRAME_WIDTH))
            count, rate = max(0, int(video.get(cv2.CAP_PROP_FRAME_COUNT))), _rate(cv2, video)
            return LogContents(self.path, {}, images=Images((*size, 3), count, rate, _codec(cv2, video)))

    def blocks(self) -> Iterator[Recording]:
        """Yield the frames as recordings.

        Raises:
            InputError: the video cannot be opened, no frame can be decoded, the layout requests anything but images, or
                OpenCV is not installed.
        """
        cv2 = self._begin("a video")
        stamps, announced = self._stamps(cv2)
        yield from self._recordings(self._decoded(cv2, stamps))
        if announced:
            self.torn = f"the video is cut short: it announces {announced:,} frames and holds {len(stamps):,}"

    def _stamps(self, cv2: Any) -> tuple[Float[np.ndarray, " n"], int]:
        """Return the stamps [s] of all frames in display order, and the number announced if more, else 0."""
        with _opened(cv2, self.path, packed=True) as video:
            announced, rate = int(video.get(cv2.CAP_PROP_FRAME_COUNT)), _rate(cv2, video)
            found: list[float] = []
            while video.grab():
                found.append(video.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
        stamps = np.sort(np.array(found))
        stamps = stamps[stamps >= 0] if (stamps >= 0).any() else stamps  # others are decoded, but not shown
        if rate is None and self._layout.rate is None:
            self._said.append(f"the video states no rate: {RATE:g} Hz is assumed")
        span = float(stamps[-1] - stamps[0]) if len(stamps) else 0.0
        torn = announced > max(len(stamps), span * (rate or RATE) + 2.5)  # Matroska says only how long it lasts
        return stamps, announced if torn else 0

    def _times(self, stamps: Float[np.ndarray, " n"], rate: float | None) -> Float[np.ndarray, " n"]:
        even = np.arange(len(stamps)) / (self._layout.rate or rate or RATE)
        if self._layout.rate is not None or not len(stamps) or not _told_apart(stamps):
            return even
        even = stamps[0] + even
        return even if np.abs(even - stamps).max() < _ROUNDED else stamps

    def _decoded(self, cv2: Any, stamps: Float[np.ndarray, " n"]) -> Iterator[Frame]:
        """Yield each frame; the decoder skips bad ones, which stamps identify."""
        with _opened(cv2, self.path) as video:
            times, count = self._times(stamps, _rate(cv2, video)), len(stamps)
            named, listed = _told_apart(stamps), stamps.tolist()
            half = float(np.diff(stamps).min()) / 2 if named and count > 1 else 0.0
            k = failed = 0
            while k < count and failed <= count:
                image, at = None, k
                if video.grab():
                    stamp = video.get(cv2.CAP_PROP_POS_MSEC) / 1e3
                    at = max(k, min(bisect_left(listed, stamp - half), count - 1)) if named else k
                    sound, image = video.retrieve()
                    image = image if sound else None
                else:
                    failed += 1
                    if named:
                        continue
                for lost in range(k, at):
                    yield times[lost], None, f"frame {lost + 1}"
                self.position = self.size * (at + 1) // count
                yield times[at], image, f"frame {at + 1}"
                k = at + 1
            for lost in range(k, count):
                yield times[lost], None, f"frame {lost + 1}"


def _told_apart(stamps: Float[np.ndarray, " n"]) -> bool:
    return bool((np.diff(stamps) > 0).all())


def _rate(cv2: Any, video: Any) -> float | None:
    rate = float(video.get(cv2.CAP_PROP_FPS))
    return rate if 0 < rate < 1e5 else None


def _codec(cv2: Any, video: Any) -> str:
    code = int(video.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
    return "".join(chr(byte) if 32 <= byte < 127 else "?" for byte in code.to_bytes(4, "little"))


@contextmanager
def _opened(cv2: Any, path: Path, *, packed: bool = False) -> Generator[Any]:
    """Yield the opened video; `packed`: its frames are skipped, not decoded."""
    open_input(path).close()
    logging = cv2.utils.logging
    before = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        # absolute: FFmpeg takes a name such as pipe:x for a protocol
        video = cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1] if packed else [])
    finally:
        logging.setLogLevel(before)
    try:
        if not video.isOpened():
            raise _closed(cv2, path, packed=packed)
        yield video
    finally:
        video.release()


def _closed(cv2: Any, path: Path, *, packed: bool) -> InputError:
    if not packed:  # it could be opened to pass over its frames
        with _opened(cv2, path, packed=True) as video:
            codec = _codec(cv2, video)
        what = f"is a video whose frames cannot be decoded: OpenCV has no decoder for {codec!r} here."
        return InputError(what, where=str(path), hint="Convert it, as with ffmpeg -i IN -c:v mjpeg -q:v 2 OUT.avi.")
    if _lacks_index(path):
        what = "is a video without its index (moov): its recording was not finished, or the file is cut."
        hint = "Copy it again, or repair it with a tool like untrunc; .mkv and .avi can be read up to a cut."
        return InputError(what, where=str(path), hint=hint)
    return InputError("is a video that cannot be opened: it is damaged, or its format is not known.", where=str(path))


def _lacks_index(path: Path) -> bool:
    """Check whether an MP4 or QuickTime file lacks a complete index (moov)."""
    size, at = path.stat().st_size, 0
    with open_input(path) as file:
        if file.read(12)[4:8] not in BOXES:
            return False
        while at + 8 <= size:
            file.seek(at)
            head = file.read(16)
            length, name = int.from_bytes(head[:4]), head[4:8]
            length = int.from_bytes(head[8:]) if length == 1 else length or size - at
            if name == b"moov" and at + length <= size:
                return False
            at += max(length, 8)
    return True
