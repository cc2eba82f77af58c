"""One short session, written in every format by libraries that are not ours: rosbags, mcap, polars and plain text."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
COLUMNS = ("time", "fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw", "x", "y", "z")
WRENCH, POSE = "/ft/wrench", "/arm/pose"
STAMPED = {WRENCH: "geometry_msgs/msg/WrenchStamped", POSE: "geometry_msgs/msg/PoseStamped"}


@dataclass(frozen=True)
class Session:
    """Stamps [ns] and the numbers behind them: (n,), (n, 6), (n, 4), (n, 3)."""

    stamp: np.ndarray
    wrench: np.ndarray
    quaternion: np.ndarray
    position: np.ndarray

    @property
    def table(self) -> np.ndarray:
        """(n, 14) as `COLUMNS`; the time is the double nearest to the decimal, which is what Python's float is."""
        time = [float(f"{stamp // 10**9}.{stamp % 10**9:09d}") for stamp in self.stamp.tolist()]
        return np.column_stack([time, self.wrench, self.quaternion, self.position])

    def messages(self, *, frame: str = "tool") -> Iterator[tuple[int, str, Any]]:
        for k, stamp in enumerate(self.stamp.tolist()):
            yield stamp, WRENCH, wrench_stamped(stamp, self.wrench[k], frame)
            yield stamp, POSE, pose_stamped(stamp, self.quaternion[k], self.position[k])


def session(count: int = 300, *, start: int = 0, step: int = 10**6, seed: int = 0) -> Session:
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=(count, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    stamp = start + step * np.arange(count, dtype=np.int64)
    return Session(stamp, rng.normal(size=(count, 6)), quaternion, rng.normal(size=(count, 3)))


def header(stamp: int, frame: str = "tool", types: Any = ROS2.types) -> Any:
    time = types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
    make = types["std_msgs/msg/Header"]
    return make(time, frame) if types is ROS2.types else make(0, time, frame)


def vector(values: np.ndarray, types: Any = ROS2.types) -> Any:
    return types["geometry_msgs/msg/Vector3"](*(float(value) for value in values))


def wrench_stamped(stamp: int, values: np.ndarray, frame: str = "tool", types: Any = ROS2.types) -> Any:
    """A wrench [N, N m] as ROS stamps it."""
    wrench = types["geometry_msgs/msg/Wrench"](vector(values[:3], types), vector(values[3:], types))
    return types["geometry_msgs/msg/WrenchStamped"](header(stamp, frame, types), wrench)


def pose(quaternion: np.ndarray, position: np.ndarray, types: Any = ROS2.types) -> Any:
    point = types["geometry_msgs/msg/Point"](*(float(value) for value in position))
    turn = types["geometry_msgs/msg/Quaternion"](*(float(value) for value in quaternion))
    return types["geometry_msgs/msg/Pose"](point, turn)


def pose_stamped(stamp: int, quaternion: np.ndarray, position: np.ndarray, types: Any = ROS2.types) -> Any:
    return types["geometry_msgs/msg/PoseStamped"](header(stamp, "base", types), pose(quaternion, position, types))


def write_csv(path: Path, log: Session) -> None:
    rows = (",".join(map(repr, row)) for row in log.table.tolist())
    path.write_text("\n".join([",".join(COLUMNS), *rows]) + "\n", encoding="utf-8")


def write_parquet(path: Path, log: Session) -> None:
    """By polars, in row groups that end within a second."""
    pl.DataFrame(dict(zip(COLUMNS, log.table.T, strict=True))).write_parquet(path, row_group_size=97)


def cdr(message: Any, *, little_endian: bool = True) -> bytes:
    return bytes(ROS2.serialize_cdr(message, message.__msgtype__, little_endian=little_endian))


def write_mcap(path: Path, messages: Any, kinds: dict[str, str] | None = None, **options: Any) -> None:
    """By the mcap library; `messages` are (stamp, topic, message or its bytes)."""
    kinds = STAMPED if kinds is None else kinds
    with path.open("wb") as file:
        writer = Writer(file, **{"compression": CompressionType.NONE, **options})
        writer.start(profile="ros2", library="test")
        channels = {
            topic: writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
            for topic, kind in kinds.items()
        }
        for stamp, topic, message in messages:
            raw = message if isinstance(message, bytes) else cdr(message)
            writer.add_message(channels[topic], stamp, raw, stamp)
        writer.finish()


def write_ros2(
    path: Path, messages: Any, storage: StoragePlugin = StoragePlugin.SQLITE3, kinds: dict[str, str] = STAMPED
) -> None:
    """By rosbags; `messages` as in `write_mcap`."""
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        topics = {topic: writer.add_connection(topic, kind, typestore=ROS2) for topic, kind in kinds.items()}
        for stamp, topic, message in messages:
            writer.write(topics[topic], stamp, message if isinstance(message, bytes) else cdr(message))


def write_ros1(path: Path, log: Session) -> None:
    types = ROS1.types
    with Writer1(path) as writer:
        topics = {topic: writer.add_connection(topic, kind, typestore=ROS1) for topic, kind in STAMPED.items()}
        for k, stamp in enumerate(log.stamp.tolist()):
            for topic, message in (
                (WRENCH, wrench_stamped(stamp, log.wrench[k], types=types)),
                (POSE, pose_stamped(stamp, log.quaternion[k], log.position[k], types)),
            ):
                writer.write(topics[topic], stamp + 1, bytes(ROS1.serialize_ros1(message, STAMPED[topic])))
