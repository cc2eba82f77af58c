"""Logs of any length for the evidence: the demonstration's touches, one after the other, as MCAP, Parquet and CSV."""

from collections.abc import Iterator
from itertools import count
from pathlib import Path

import numpy as np
import polars as pl

from palpate.files.contacts.mcap import topics as declared
from palpate.files.mcap.writer import MESSAGE, McapWriter, WrittenTopic
from palpate.signals.recording import ORIENTATION, Recording
from palpate_lab.simulation.session import Session

RATE = 1000.0  # Hz, of wrenches and of poses
COLUMNS = ("time", "fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
BLOCK = 2_000  # samples a chunk
_HEADER = [("cdr", "u1", 4), ("sec", "<i4"), ("nanosec", "<u4"), ("named", "<u4"), ("frame", "S4")]


def pieces(session: Session, samples: int) -> Iterator[np.ndarray]:
    """Rows of `COLUMNS`, (n, 11), the session's touches over and over, at 1 kHz."""
    once = _rows(session.touches)
    for start in range(0, samples, len(once)):
        piece = once[: samples - start].copy()
        piece[:, 0] = (start + np.arange(len(piece))) / RATE
        yield piece


def write_log(path: Path, session: Session, samples: int) -> None:
    """As CSV, Parquet or MCAP (wrenches and poses), by the suffix."""
    if path.suffix == ".mcap":
        _write_mcap(path, session, samples)
    else:
        table = pl.DataFrame(np.concatenate(list(pieces(session, samples))), schema=COLUMNS)
        table.write_csv(path) if path.suffix == ".csv" else table.write_parquet(path, row_group_size=100_000)


def _rows(recording: Recording) -> np.ndarray:
    return np.column_stack([recording.time, recording.wrenches(), recording.channels[ORIENTATION]])


def _write_mcap(path: Path, session: Session, samples: int) -> None:
    definitions = {topic.kind: topic.definition for topic in declared()}
    wrench, pose = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PoseStamped"
    topics = (
        WrittenTopic("/ft_sensor/wrench", wrench, definitions[wrench]),
        WrittenTopic("/arm/sensor_pose", pose, definitions[pose]),
    )
    writer, sequence = McapWriter(topics, "evidence"), count()
    with path.open("wb") as file:
        file.write(writer.head)
        for piece in pieces(session, samples):
            for start in range(0, len(piece), BLOCK):
                rows = piece[start : start + BLOCK]
                wrenches = _messages(1, rows[:, 0], rows[:, 1:7], next(sequence))
                places = np.tile([0.4, 0.0, 0.6], (len(rows), 1))
                poses = _messages(2, rows[:, 0], np.column_stack([places, rows[:, 7:]]), 0)
                raw, chunk = writer.chunk((wrenches, poses))
                file.write(raw)
                writer.chunks.append(chunk)
        file.write(writer.tail())


def _messages(channel: int, time: np.ndarray, values: np.ndarray, sequence: int) -> np.ndarray:
    """Records of stamped messages in CDR, whose frame is called "abc"; what follows stands at a multiple of 8."""
    kind = np.dtype([*MESSAGE.descr, *_HEADER, ("values", "<f8", (values.shape[1],))])
    rows = np.zeros(len(time), dtype=kind)
    stamps = np.rint(time * 1e9).astype(np.int64)
    rows["opcode"], rows["length"], rows["channel"], rows["sequence"] = 5, kind.itemsize - 9, channel, sequence
    rows["log"] = rows["publish"] = stamps
    rows["cdr"], rows["named"], rows["frame"] = [0, 1, 0, 0], 4, b"abc"
    rows["sec"], rows["nanosec"] = np.divmod(stamps, 10**9)
    rows["values"] = values
    return rows
