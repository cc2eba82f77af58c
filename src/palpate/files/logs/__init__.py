"""Read logs of any format as recordings in SI, block by block; `open_log` opens any of them."""

from palpate.files.logs.layout import ArrayChannel, ImageChannel, LogLayout
from palpate.files.logs.log import Log, LogContents, Stored
from palpate.files.logs.opening import (
    contents,
    image_size,
    join,
    missing,
    open_log,
    read_poses,
    read_recording,
    topic_fields,
    topic_shapes,
)

__all__ = [
    "ArrayChannel",
    "ImageChannel",
    "Log",
    "LogContents",
    "LogLayout",
    "Stored",
    "contents",
    "image_size",
    "join",
    "missing",
    "open_log",
    "read_poses",
    "read_recording",
    "topic_fields",
    "topic_shapes",
]
