"""Load OpenCV when it is first needed: it is an extra."""

from __future__ import annotations

import os
from types import ModuleType
from typing import cast

from palpate.errors import importing_extra


def opencv() -> ModuleType:
    """Load OpenCV and return its module, `cv2`; its FFmpeg prints nothing, and it refuses images beyond 67 megapixels.

    Raises:
        InputError: it is not installed or does not load.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # read when the first video is opened
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 26))  # read when OpenCV is loaded; else 3 GB an image
    with importing_extra("images need OpenCV", "camera"):
        import cv2
    return cast("ModuleType", cv2)
