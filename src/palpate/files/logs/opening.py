"""Open a log by what the file is, and read it in blocks or at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.inputs import open_input, read_some
from palpate.files.logs.arrays import ArrayLog, HeldLog
from palpate.files.logs.bag import BagFile, open_folder
from palpate.files.logs.columns import ColumnLog, plan
from palpate.files.logs.cursor import Cursor
from palpate.files.logs.decoding import role, shape_of
from palpate.files.logs.frame_folder import FrameFolder, holds_frames
from palpate.files.logs.image_messages import IMAGES
from palpate.files.logs.image_topics import ImageTopicLog, first_size
from palpate.files.logs.images import refuse_others
from palpate.files.logs.joints import JOINTS
from palpate.files.logs.layout import LogLayout, pose_path
from palpate.files.logs.log import Log, LogContents
from palpate.files.logs.message_fields import FieldPath, field_of, paths_of
from palpate.files.logs.parquet import ParquetLog
from palpate.files.logs.pose_table import pose_layout
from palpate.files.logs.survey import Survey, frame_named, survey_of
from palpate.files.logs.text import CsvLog, TextFrames, holds_text_frames
from palpate.files.logs.topic_log import TopicLog
from palpate.files.logs.topics import choose, choose_images
from palpate.files.logs.transforms import TREES
from palpate.files.logs.video import BOXES, VIDEOS, VideoLog
from palpate.files.mcap.reader import MAGIC, McapFile
from palpate.files.messages import MessageBlock, MessageFile, Topic
from palpate.signals.recording import ORIENTATION, POSITION, Recording, sealed

__all__ = [
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

_KINDS: dict[str, tuple[str, tuple[bytes, ...]]] = {  # usual suffix -> what it is, and its first bytes
    ".parquet": ("a Parquet file", (b"PAR1",)),
    ".mcap": ("an MCAP file", (MAGIC,)),
    ".bag": ("a ROS 1 bag", (b"#ROSBAG V",)),
    ".db3": ("a ROS 2 bag", (b"SQLite format 3\0",)),
    ".npy": ("a NumPy array", (b"\x93NUMPY",)),
    ".npz": ("an archive of NumPy arrays", (b"PK\x03\x04", b"PK\x05\x06")),  # the second: without an array
    "video": ("a video", ()),  # see `_is_video`
}
_ARRAYS = (".npy", ".npz")
_VIDEO, _FRAMES = "video", "frames"
_FOREIGN: dict[bytes, tuple[str, str]] = {  # first bytes of a file -> what it is, and what to do; Excel's first
    b"PK\x03\x04": ("is a workbook", "Save its sheet as CSV."),
    b"\xd0\xcf\x11\xe0": ("is a workbook", "Save its sheet as CSV."),
    b"\x1f\x8b": ("is compressed", "Unpack it first."),
    b"MATLAB 5.0 MAT": ("is a MAT file of MATLAB", "Write a table of it as CSV (writetable, writematrix)."),
    b"\x89HDF": ("is an HDF5 file", "Write a table of it as CSV or Parquet."),
    b"\x89PNG": ("is one image", "Name the folder of the frames, or a video."),
    b"\xff\xd8\xff": ("is one image", "Name the folder of the frames, or a video."),
}
_WORKBOOKS = (b"[Content_Types]", b"_rels/", b"xl/", b"docProps/", b"mimetype")  # what their archive begins with


def contents(path: str | Path | Mapping[str, np.ndarray]) -> LogContents:
    """Return `LogContents`: names, units, topics and images of a log, before its samples are read.

    Args:
        path: file, or folder of a bag or of images, or arrays by name.

    Raises:
        InputError: the file cannot be read, is not what its suffix indicates, has an unsupported format or needs a
            library that is not installed; a folder holds neither images nor one bag; an array is a single number.
    """
    return open_log(path).contents()


def topic_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return topic -> shape of an array, or (rows, columns) of a one-channel image; {} without topics.

    Raises:
        InputError: the file does not exist or cannot be read, is not a log, or needs a library that is not installed.
    """
    source = messages_of(path)
    if source is None:
        return {}
    arrays = [topic for topic in source.topics() if topic.count and role(topic.kind) == "array"]
    return {topic.name: shape for topic in arrays if (shape := _shape(source, topic)) is not None}


def frames_named(path: Path, topics: Sequence[Topic]) -> dict[str, str]:
    """Return topic -> the frame that the header of its first message names, of those that have a header.

    Raises:
        InputError: the file does not exist or cannot be read, is not a log, or needs a library that is not installed.
    """
    source = messages_of(path)
    named = {} if source is None else {topic.name: frame_named(source, topic) for topic in topics}
    return {name: frame for name, frame in named.items() if frame}


def topic_fields(path: Path) -> dict[tuple[str, str], int]:
    """Return (topic, field path) -> count of numbers, of messages whose type the log defines and Palpate does not know.

    Raises:
        InputError: the file does not exist or cannot be read, is not a log, or needs a library that is not installed.
    """
    source, found = _messages(path, _kind(path)), dict[tuple[str, str], int]()
    for topic in [] if source is None else source.topics():
        known = role(topic.kind) or topic.kind in (*IMAGES, JOINTS, *TREES)
        for field in paths_of(topic) if topic.count and topic.encoding in ("cdr", "ros1") and not known else ():
            reader = field_of(topic, field)
            first = None if source is None or reader is None else source.first(topic, partial(_first, topic, reader))
            found |= {(topic.name, field): first} if first else {}
    return found


def _first(topic: Topic, field: FieldPath, messages: MessageBlock) -> int | None:
    """Return the count of numbers in the first readable message that has some; None if there is none."""
    cursor = Cursor(messages, topic.encoding)
    counts = field.count(cursor)[cursor.sound]
    return int(counts[counts > 0][0]) if (counts > 0).any() else None


def image_size(path: str | Path, topic: str | None = None) -> tuple[int, int, int] | None:
    """Return height, width and channels of the first image of a log; None if it has no readable image.

    It is of `topic`; if that is None, of the first topic that has an image, compressed ones last.

    Raises:
        InputError: the file is not a log, or needs a library that is not installed.
    """
    path = Path(path)
    kind = _kind(path)
    if kind in (_VIDEO, _FRAMES):
        said = open_log(path).contents().images
        return said.size if said is not None and all(said.size) else None
    source = _messages(path, kind)
    if source is None:
        return None
    fitting = [each for each in source.topics() if each.kind in IMAGES and each.count and topic in (None, each.name)]
    fitting.sort(key=lambda each: IMAGES.index(each.kind))
    return next((size for each in fitting if (size := first_size(source, each)) is not None), None)


def survey(path: Path) -> Survey | None:
    """Return the frames, poses and joints that a log's messages mention; None for a log without topics.

    Raises:
        InputError: the file is not a log, or needs a library that is not installed.
    """
    source = messages_of(path)
    return None if source is None else survey_of(source)


def _shape(source: MessageFile, topic: Topic) -> tuple[int, ...] | None:
    return source.first(topic, lambda messages: shape_of(messages, topic))


def missing(there: LogContents, layout: LogLayout) -> list[str]:
    """Return the reason why a log cannot be read with a layout, in a list; [] if it can."""
    try:
        if there.images is not None:
            refuse_others(layout, there.path, "a folder of frames" if there.path.is_dir() else "a video")
        elif there.names:
            plan(layout, there.names, there.path)
        elif layout.images is not None:
            choose_images(there, layout.images)
        else:
            choose(there, layout)
    except InputError as problem:
        return [problem.what]
    return []


def open_log(path: str | Path | Mapping[str, np.ndarray], layout: LogLayout | None = None) -> Log:
    """Open a log: text such as CSV, Parquet, NumPy, MCAP, a ROS 1 or 2 bag, a video, a folder of images, or arrays.

    Args:
        path: file, or folder of a bag or of images, or arrays by name.
        layout: what is read by `Log.blocks`; None: the defaults.

    Raises:
        InputError: the file cannot be read, is not what its suffix indicates, or has a format that is not supported; a
            folder holds neither images nor the bag of one recording; or the layout is invalid (for images).
    """
    layout = layout or LogLayout()
    log = _opened(path, layout)
    poses = pose_path(layout.pose_file, log.path)
    if poses is not None and not (isinstance(log, TopicLog) and log.posed):
        return _posed(log, open_log(poses, pose_layout(layout)))
    if layout.offset and isinstance(log, ColumnLog) and log.path.is_fifo():
        what = "is a pipe, whose rows cannot be read twice, as a clock's offset needs."
        raise InputError(what, where=str(log.path), hint="Save its contents to a file first, or remove the offset.")
    if layout.offset and isinstance(log, ColumnLog) and ORIENTATION in plan(layout, log.contents().names, log.path):
        itself = replace(layout, pose_file=log.path.name, pose_time_unit=layout.time_unit)
        return _posed(_opened(path, itself), open_log(path, replace(pose_layout(itself), rate=layout.rate)))
    return log


def _posed(log: Log, poses: Log) -> Log:
    """Return the log, to whose samples the poses of a table are joined."""
    if not isinstance(log, ColumnLog | TopicLog):
        what = f"holds images, to which the poses of {poses.path.name} cannot be joined."
        raise InputError(what, where=str(log.path), hint="Remove file from the rig's [orientation].")
    log.pose_log = poses
    return log


def _opened(path: str | Path | Mapping[str, np.ndarray], layout: LogLayout) -> Log:
    if isinstance(path, Mapping):
        return HeldLog(path, layout)
    path = Path(path)
    kind = _kind(path)
    if kind in (_VIDEO, _FRAMES):
        return (VideoLog if kind == _VIDEO else FrameFolder)(path, layout)
    if kind == ".parquet":
        return ParquetLog(path, layout)
    if kind in _ARRAYS:
        return ArrayLog(path, layout)
    source = _messages(path, kind)
    if source is None:
        return (CsvLog if path.is_fifo() or not holds_text_frames(path) else TextFrames)(path, layout)
    return (TopicLog if layout.images is None else ImageTopicLog)(path, layout, source)


def read_recording(path: str | Path, layout: LogLayout | None = None) -> Recording:
    """Read a complete log in SI, one row per sample, in order; what cannot be read is NaN and noted.

    Args:
        path: file, or folder of a bag or of images.
        layout: what is read, and its units; None: the defaults.

    Raises:
        InputError: the file is not a log, lacks something that the layout requests, or needs a library that is not
            installed.
    """
    log = open_log(path, layout)
    recording = join(list(log.blocks()))
    return replace(recording, notes=(*([log.torn] if log.torn else []), *log.notes()))


def read_poses(
    path: str | Path, layout: LogLayout | None = None
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k 4"], Float[np.ndarray, "k 3"]]:
    """Return the poses in a log: stamps (k,) [s], quaternions x, y, z, w (k, 4) and positions (k, 3) [m].

    Stamps are without the layout's offset; unknown positions are NaN. In a log of columns each row is a pose.

    Raises:
        InputError: the file is not a log, has no poses, or needs a library that is not installed.
    """
    log = open_log(path, layout)
    log = log.pose_log or log
    if isinstance(log, TopicLog):
        time, values = log.poses()
        return time, values[:, 3:], values[:, :3]
    recording = join(list(log.blocks()))
    if ORIENTATION not in recording.channels:
        what = "the log has no orientation."
        hint = "Add columns qx, qy, qz, qw (sensor in base), or name them in the rig's [orientation]."
        raise InputError(what, where=str(path), hint=hint)
    unknown = np.full((len(recording), 3), np.nan)
    return recording.time, recording.channels[ORIENTATION], recording.channels.get(POSITION, unknown)


def join(blocks: Sequence[Recording]) -> Recording:
    """Join the blocks of one log, in their order, to one recording.

    Raises:
        IndexError: there are no blocks.
    """
    if len(blocks) == 1:
        return blocks[0]
    channels = {name: _joined([block.channels[name] for block in blocks]) for name in blocks[0].channels}
    return replace(blocks[0], time=_joined([block.time for block in blocks]), channels=channels)


def _joined(arrays: Sequence[np.ndarray]) -> np.ndarray:
    return sealed(np.concatenate(arrays), own=True, dtype=arrays[0].dtype)


def messages_of(path: Path) -> MessageFile | None:
    """Return the messages of a log; None if it has no topics.

    Raises:
        InputError: the file does not exist or cannot be read, is not a log, or needs a library that is not installed.
    """
    return _messages(path, _kind(path))


def _messages(path: Path, kind: str) -> MessageFile | None:
    if kind == ".mcap":
        return McapFile(path)
    if kind in (".bag", ".db3"):
        return BagFile(path)
    return open_folder(path) if kind == "folder" else None


def _require_ours(first: bytes, path: Path) -> None:
    for magic, (what, hint) in _FOREIGN.items():
        archive = magic.startswith(b"PK")
        if first.startswith(magic) and (not archive or first[30:].startswith(_WORKBOOKS)):
            raise InputError(f"{what}.", where=str(path), hint=hint)


def _kind(path: Path) -> str:
    """Return the format by the first bytes: its usual suffix, "" for text, "video", "frames" or "folder"."""
    if path.is_dir():
        return _FRAMES if holds_frames(path) else "folder"
    if path.is_fifo():  # it gives its first bytes once
        return ""
    with open_input(path) as file:
        first = read_some(file, path, 64)
    _require_ours(first, path)
    kind = next((suffix for suffix, (_, magic) in _KINDS.items() if first.startswith(magic)), "")
    kind = _VIDEO if _is_video(first) else kind
    suffix = path.suffix.lower()
    suffix = _VIDEO if suffix in VIDEOS else suffix
    if suffix in _KINDS and kind != suffix and not (kind in _ARRAYS and suffix in _ARRAYS):
        what = f"does not begin as {_KINDS[suffix][0]} does" if first else "is empty"
        raise InputError(f"{what}.", where=str(path), hint=f"It is {_KINDS[kind][0]}: rename it." if kind else "")
    return kind


def _is_video(first: bytes) -> bool:
    """Return True if the first bytes of a file, twelve or more, are those of a video."""
    riff = first[:4] == b"RIFF" and first[8:11] == b"AVI"
    return riff or first[:4] == b"\x1aE\xdf\xa3" or first[4:8] in BOXES
