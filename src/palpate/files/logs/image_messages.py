"""Read ROS messages with an image one by one: raw pixels, or the bytes of a JPEG or PNG."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.files.logs.cursor import Cursor
from palpate.files.logs.images import decoded, to_bgr
from palpate.files.messages import MessageBlock, Topic

_RAW, _COMPRESSED, _FOXGLOVE = "sensor_msgs/Image", "sensor_msgs/CompressedImage", "foxglove_msgs/CompressedImage"
IMAGES = (_RAW, _COMPRESSED, _FOXGLOVE)  # the last as ROS 2 writes it

_PIXELS: Mapping[str, tuple[str, int, str]] = {  # encoding -> each number, numbers a pixel, OpenCV's name of the way
    **{name: ("u1", 1, "") for name in ("mono8", "8UC1")},
    **{name: ("u2", 1, "") for name in ("mono16", "16UC1")},
    **{name: ("u1", 3, "") for name in ("bgr8", "8UC3")},
    **{name: ("u1", 4, "") for name in ("bgra8", "8UC4")},
    **{name: ("u1", 2, "YUV2BGR_UYVY") for name in ("yuv422", "uyvy")},
    **{name: ("u1", 2, "YUV2BGR_YUY2") for name in ("yuv422_yuy2", "yuyv")},
    **{f"rgb{bits}": (code, 3, "RGB2BGR") for bits, code in ((8, "u1"), (16, "u2"))},
    **{f"rgba{bits}": (code, 4, "RGBA2BGR") for bits, code in ((8, "u1"), (16, "u2"))},
    **{f"bgr{channels}16": ("u2", 3 + len(channels), "") for channels in ("", "a")},
    **{
        f"bayer_{order}{bits}": (code, 1, f"Bayer{order.upper()}2BGR")
        for order in ("rggb", "bggr", "gbrg", "grbg")
        for bits, code in ((8, "u1"), (16, "u2"))
    },
}


@dataclass(frozen=True)
class _Raw:
    """The pixels of a sensor_msgs/Image message, as stored."""

    data: bytes
    rows: int
    columns: int
    encoding: str
    big: bool
    step: int

    def image(self, cv2: Any) -> np.ndarray | None:
        """Return the image as uint8, blue, green, red; None if it is too short or its encoding is unknown."""
        code, channels, way = _PIXELS.get(self.encoding, ("", 0, ""))
        width = self.columns * channels * int(code[1:] or 0)
        if not self.rows * width or self.step < width or len(self.data) < self.rows * self.step:
            return None
        lines = np.frombuffer(self.data, np.uint8, self.rows * self.step).reshape(self.rows, self.step)[:, :width]
        pixels = np.ascontiguousarray(lines).view(f"{'>' if self.big else '<'}{code}")
        pixels = pixels.reshape(self.rows, self.columns, channels)
        if not way:
            return to_bgr(pixels)
        pixels = (pixels >> 8).astype(np.uint8) if code == "u2" else pixels
        try:
            return cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{way}"))
        except cv2.error:  # such as half a pair of pixels
            return None

    @property
    def channels(self) -> int:
        """Number of channels of the image that was sent; 3 for the YUV and Bayer encodings."""
        _, channels, way = _PIXELS.get(self.encoding, ("", 0, ""))
        return 3 if way.startswith(("YUV", "Bayer")) else channels


@dataclass(frozen=True)
class ImageMessage:
    """A message with an image.

    Attributes:
        stamp: of its header [ns]; None where that cannot be read.
        content: pixels, the bytes of an image file, or None if the message is cut.
    """

    stamp: int | None
    content: _Raw | bytes | None

    def image(self, cv2: Any) -> np.ndarray | None:
        """Return the image, (height, width, 3) uint8, blue, green, red; None if it cannot be read. `cv2` is OpenCV."""
        content = self.content
        return content.image(cv2) if isinstance(content, _Raw) else decoded(cv2, content or b"")

    def size(self, cv2: Any) -> tuple[int, int, int] | None:
        """Return height, width and channels of the image as sent; None if it cannot be read. `cv2` is OpenCV."""
        image = self.image(cv2)
        if image is None or self.content is None:
            return None
        if isinstance(self.content, _Raw):
            return *image.shape[:2], self.content.channels
        stored = decoded(cv2, self.content, as_stored=True)
        return *image.shape[:2], 1 if stored is None or stored.ndim == 2 else stored.shape[2]


def image_messages(messages: MessageBlock, topic: Topic) -> Iterator[ImageMessage]:
    """Yield the messages of a topic of one of the types `IMAGES`, one by one."""
    cursor = Cursor(messages, topic.encoding)
    stamps, stamped = cursor.stamp(), cursor.sound.copy()
    head: list[np.ndarray] = []
    if topic.kind == _RAW:
        rows, columns = cursor.number(), cursor.number()
        head = [rows, columns, *cursor.text(), cursor.numbers("u1", 1)[:, 0] != 0, cursor.number()]
    elif topic.kind == _COMPRESSED:
        cursor.text()
    length = cursor.length()
    for k, sound in enumerate(cursor.sound):
        content: _Raw | bytes | None = None
        if sound:
            content = messages.data[int(cursor.at[k]) : int(cursor.at[k] + length[k])]
            if head:
                high, wide, at, letters, big, step = (int(each[k]) for each in head)
                encoding = messages.data[at : at + letters].rstrip(b"\0").decode(errors="replace")
                content = _Raw(content, high, wide, encoding, bool(big), step)
        yield ImageMessage(int(stamps[k]) if stamped[k] else None, content)
