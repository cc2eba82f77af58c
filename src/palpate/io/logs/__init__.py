"""Logs: from what a file is to recordings in SI, block by block. `open_log` opens any of them."""

from palpate.io.logs.layout import Layout
from palpate.io.logs.log import Log
from palpate.io.logs.opening import join, open_log, read_poses, read_recording, topics

__all__ = ["Layout", "Log", "join", "open_log", "read_poses", "read_recording", "topics"]
