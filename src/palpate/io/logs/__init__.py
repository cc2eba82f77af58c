"""Logs: from what a file is to recordings in SI, block by block. `open_log` opens any of them."""

from palpate.io.logs.layout import ArrayChannel, Layout
from palpate.io.logs.log import Log, LogContents
from palpate.io.logs.opening import contents, join, missing, open_log, read_poses, read_recording, topic_shapes

__all__ = [
    "ArrayChannel",
    "Layout",
    "Log",
    "LogContents",
    "contents",
    "join",
    "missing",
    "open_log",
    "read_poses",
    "read_recording",
    "topic_shapes",
]
