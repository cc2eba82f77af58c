"""Write pictures, one after the other, into a video with OpenCV."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from palpate.errors import InputError
from palpate.opencv import opencv


class Video:
    """A video that grows by a picture at a time.

    Args:
        path: file of the video (.mp4).
        size: (width, height) of every picture [px].
        rate: pictures per second.

    Raises:
        InputError: OpenCV is not installed, or no video can be written.
    """

    def __init__(self, path: Path, size: tuple[int, int], rate: int) -> None:
        cv2 = opencv()
        self._writer: Any = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate, size)
        if not self._writer.isOpened():
            what = "OpenCV cannot open this file to write a video (MPEG-4)."
            raise InputError(what, where=str(path), hint="Check the folder and the free space.")

    def add(self, picture: UInt8[np.ndarray, "h w 3"]) -> None:
        """Append a picture to the video, (h, w, 3) uint8 in blue, green, red."""
        self._writer.write(picture)

    def close(self) -> None:
        """Write the remaining pictures and close the file."""
        self._writer.release()
