"""Read live images from a camera."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from palpate.errors import InputError
from palpate.live.source import Batch, drained
from palpate.opencv import opencv
from palpate.setup.setup import Setup
from palpate.setup.source import RigSource

AGAIN = 1.0  # s between attempts to open a camera that was lost


class CameraSource:
    """A camera that OpenCV opens, as a `Source` of images, stamped when they are read.

    The constructor opens the camera; its first image gives the size of all.

    Args:
        address: number ("0"), device ("/dev/video0"), or a video, played as fast as it is read.
        rate: [Hz] requested from the camera; None: its default.

    Raises:
        InputError: OpenCV is not installed, or the camera does not exist, is in use or may not be opened.
    """

    dtype: DTypeLike = np.uint8
    poses = False

    def __init__(self, address: str, rate: float | None = None) -> None:
        self._cv2: Any = opencv()
        self._address, self._rate = address, rate
        self._said: list[str] = []
        self._device: Any = None
        self._tried = 0.0
        first = self._opened() and self._device.read()[1]
        if first is None or first is False:
            what = "the camera cannot be opened: it does not exist, is in use, or is not permitted."
            hint = "Write its number (0) or device (/dev/video0); your user must be in the group `video`."
            raise InputError(what, where=f"{address}, [source] of the rig", hint=hint)
        self.shape = tuple(first.shape)
        self._first: np.ndarray | None = first

    @classmethod
    def of(cls, stated: RigSource, setup: Setup) -> CameraSource:
        """Return the `CameraSource` that a rig's [source] names, already open.

        Raises:
            InputError: OpenCV is not installed, or the camera does not exist, is in use or may not be opened.
        """
        own = setup.link.folder / stated.address
        return cls(str(own) if own.is_file() else stated.address, stated.rate)

    def open(self) -> None:
        """Do nothing: the constructor has opened the camera."""

    def receive(self, batch: Batch, timeout: float) -> int:
        """Fill a batch with one image and return 1; return 0 if none came.

        A lost camera is opened again, after a wait of up to `timeout` [s].
        """
        if self._first is not None:
            frame, self._first = self._first, None
        elif self._device is None:
            return self._reopened(timeout)
        else:
            fine, frame = self._device.read()
            if not fine:
                self._said.append(f"the camera {self._address} sends no more frames; it is being opened again")
                self.close()
                return 0
        if frame.shape != self.shape:
            self._said.append(
                f"the camera sent an image of another size, {frame.shape[1]} x {frame.shape[0]}, which is ignored"
            )
            return 0
        batch.stamp[0], batch.lost[0] = time.time_ns(), 0
        batch.values[0] = frame
        return 1

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each: camera lost or back, images of another size."""
        return drained(self._said)

    def close(self) -> None:
        """Release the camera; may be called again."""
        if self._device is not None:
            self._device.release()
        self._device = None

    def _opened(self) -> bool:
        number = int(self._address) if self._address.isdigit() else self._address
        device = self._cv2.VideoCapture(number)
        if not device.isOpened():
            device.release()
            return False
        if self._rate is not None:
            device.set(self._cv2.CAP_PROP_FPS, self._rate)
        self._device = device
        return True

    def _reopened(self, timeout: float) -> int:
        """Try to open a lost camera, once a second at most, and return 0."""
        if time.monotonic() - self._tried < AGAIN:
            time.sleep(timeout)
            return 0
        self._tried = time.monotonic()
        if self._opened():
            self._said.append(f"the camera {self._address} sends frames again")
        return 0
